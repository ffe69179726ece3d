"""Fresnel reflectance in float32 for the fast kernels: the forms of `models.base.fresnel` in real numbers.

What cancels (n - 1, eta^2 - 1) is formed in float64 once a model, by `fresnel_numbers`. Elementwise functions, see
`elementary`; each takes cos theta_d, sin^2 theta_d and one row of those numbers.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.kernels.machine.elementary import HALF, ONE, ZERO, elementwise, select

#: Order of the forms, as the kernels count them; "dielectric" is "conductor" with k = 0.
FRESNEL = {"none": 0, "conductor": 1, "dielectric": 1, "schlick": 2, "conductor_approximate": 3}
#: Numbers a channel that `fresnel_numbers` makes.
FRESNEL_NUMBERS = 7


def fresnel_numbers(
    kind: str, ior: npt.NDArray[np.complex128] | None, exterior_ior: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Constants of the form `kind` for indices `ior`, both (channels,) or (1,); float32 (channels, 7)."""
    if ior is None:
        return np.zeros((1, FRESNEL_NUMBERS), np.float32)
    index, outside = np.broadcast_arrays(ior, exterior_ior)
    n, k = index.real / outside, index.imag / outside
    above = (index.real - outside) / outside  # n - 1
    zero = np.zeros_like(n)
    if kind == "schlick":
        below = (n + 1) ** 2 + k * k
        numbers = [(above * above + k * k) / below, 4 * n / below, zero, zero, zero, zero, zero]
    elif kind == "conductor_approximate":
        numbers = [n, k, above, zero, zero, zero, zero]
    else:
        e = above * (n + 1) - k * k  # Re(eta^2 - 1)
        size = np.hypot(e, 2 * n * k)
        # g^2 = cos^2 + e, or eta^2 - sin^2 where eta is near 0, which e has lost
        near = (size < 0.5).astype(np.float64)
        eta2 = (n - k) * (n + k)
        numbers = [size, eta2, 2 * n * k, np.where(near > 0, e, eta2), near, 1 - near, zero]
    return np.stack(numbers, axis=1).astype(np.float32)


@elementwise
def conductor(cos, sin2, size_e, eta2, eta2_imaginary, g2, with_cos, with_sin):
    """Exact reflectance of unpolarised light, k >= 0; 1 to rounding in total internal reflection.

    With g^2 = eta^2 - sin^2, g = a + ib: |r_s| = |e|/|cos + g|^2, |r_p| = |e||eta^2 cos^2 - sin^2|/|eta^2 cos + g|^2.
    """
    cos2 = cos * cos
    real = (with_cos * cos2 - with_sin * sin2) + g2
    size = np.sqrt(real * real + eta2_imaginary * eta2_imaginary)
    larger = np.sqrt(HALF * (size + abs(real)))
    smaller = HALF * eta2_imaginary / select(larger > ZERO, larger, ONE)
    a = select(real >= ZERO, larger, smaller)
    b = select(real >= ZERO, smaller, larger)
    s_real = cos + a
    p_real = eta2 * cos + a
    p_imaginary = eta2_imaginary * cos + b
    r_s = size_e / (s_real * s_real + b * b)
    r_p = size_e / (p_real * p_real + p_imaginary * p_imaginary)
    w_real = eta2 * cos2 - sin2
    w_imaginary = eta2_imaginary * cos2
    reflected = HALF * (r_s * r_s + (r_p * r_p) * (w_real * w_real + w_imaginary * w_imaginary))
    return select(reflected < ONE, reflected, ONE)


@elementwise
def schlick(cos, sin2, f0, rest):
    """F0 + (1 - F0)(1 - cos)^5, with 1 - cos = sin^2/(1 + cos)."""
    x = sin2 / (ONE + cos)
    x2 = x * x
    reflected = f0 + rest * ((x2 * x2) * x)
    return select(reflected < ONE, reflected, ONE)


@elementwise
def conductor_approximate(cos, sin2, n, k, above):
    """The approximation for n^2 + k^2 >> 1; its numerators as sums of squares."""
    less = sin2 / (ONE + cos)
    k_cos = k * cos
    p, p_below = above * cos - less, n * cos + ONE
    s, s_below = above + less, n + cos
    r_p = (p * p + k_cos * k_cos) / (p_below * p_below + k_cos * k_cos)
    r_s = (s * s + k * k) / (s_below * s_below + k * k)
    reflected = HALF * (r_p + r_s)
    return select(reflected < ONE, reflected, ONE)
