"""The irradiance kernel: how much of each degree of an environment a Lambertian surface sees.

E(n) = int L(w) max(n.w, 0) dw multiplies the coefficients of L by A_l = 2 pi int_0^1 x P_l(x) dx:
pi, 2 pi/3, pi/4, 0, -pi/24, 0, pi/64 ... (R. Ramamoorthi and P. Hanrahan 2001, DOI 10.1145/383259.383317).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.quadrature import composite
from brdfcore.harmonics.legendre import legendre

Float64Array = npt.NDArray[np.float64]


def irradiance_factors(lmax: int) -> Float64Array:
    """A_l, l = 0 ... lmax, to 1e-14 of pi."""
    x, w = composite(np.cos(np.linspace(np.pi / 2, 0, lmax // 16 + 2)), 64)
    l = np.arange(lmax + 1)  # noqa: E741
    polynomials = legendre(lmax, x, first_order=0, last_order=0) * np.sqrt(4 * np.pi / (2 * l + 1))[:, None]
    return np.asarray(2 * np.pi * (polynomials @ (w * x)))


def kernel_energy(lmax: int) -> dict[str, float]:
    """What degrees 0 ... lmax hold of the kernel max(cos theta, 0): its energy, and the relative L2 error without the
    rest, sqrt(1 - energy). At lmax = 2, nine coefficients: 99.219 % and 8.839 %; the second is an error, the first a
    square of amplitudes."""
    a = irradiance_factors(lmax)
    l = np.arange(lmax + 1)  # noqa: E741
    energy = float(((2 * l + 1) / (4 * np.pi) * a**2).sum() / (2 * np.pi / 3))
    return {"energy": energy, "l2": float(np.sqrt(max(1 - energy, 0.0)))}
