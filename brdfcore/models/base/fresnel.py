"""Fresnel reflectance of unpolarised light, in forms that keep their digits where the textbook ones cancel.

Every function takes cos theta of the incident light (0 ... 1) and the index n + ik of the medium behind the surface;
arrays broadcast. `exterior_ior` is the real index of the medium in front, so eta = (n + ik)/exterior_ior.

With e = eta^2 - 1 and g = sqrt(cos^2 + e) = sqrt(eta^2 - sin^2) = eta cos theta_t, the textbook amplitudes
(cos - g)/(cos + g) and (eta^2 cos - g)/(eta^2 cos + g) are -e/(cos + g)^2 and
e (eta^2 cos^2 - sin^2)/(eta^2 cos + g)^2.
The first pair subtracts nearly equal numbers for eta near 1; the second takes the difference in e, where it is exact.
`sin2_theta` may be given by a caller who knows sin^2 theta better than (1 - cos)(1 + cos) tells it: near normal
incidence a rounded cosine has lost it.

Source: M. Born and E. Wolf, Principles of Optics, 7th ed., sections 1.5 and 14.2, doi:10.1017/CBO9781139644181.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError

Float64Array = npt.NDArray[np.float64]
Complex128Array = npt.NDArray[np.complex128]

KINDS = ("auto", "conductor", "conductor_approximate", "dielectric", "schlick", "none")

#: Largest error of `conductor_approximate` against the exact form that passes without a warning.
APPROXIMATION_WARNS_ABOVE = 0.01


def _sin2(c: Float64Array, sin2_theta: npt.ArrayLike | None) -> Float64Array:
    return np.asarray((1 - c) * (1 + c) if sin2_theta is None else sin2_theta, dtype=np.float64)


def _one_minus_cos(c: Float64Array, sin2_theta: npt.ArrayLike | None) -> Float64Array:
    return np.asarray(1 - c if sin2_theta is None else np.asarray(sin2_theta, dtype=np.float64) / (1 + c))


def _size2(real: Float64Array, imaginary: Float64Array) -> Float64Array:
    """|z|^2. Products of complex arrays are written out throughout: numpy's own take another path for one element
    than for many and differ in the last bit."""
    return real * real + imaginary * imaginary


def _root(z: Complex128Array) -> tuple[Float64Array, Float64Array]:
    """Real and imaginary part of the square root, neither from a difference: the larger is sqrt((|z| + |Re z|)/2)."""
    larger = np.sqrt(0.5 * (np.hypot(z.real, z.imag) + np.abs(z.real)))
    smaller = np.divide(0.5 * np.abs(z.imag), larger, out=np.zeros_like(larger), where=larger > 0)
    real, imaginary = np.where(z.real >= 0, larger, smaller), np.where(z.real >= 0, smaller, larger)
    return real, np.copysign(imaginary, z.imag)


def _squares(
    c: Float64Array, sin2: Float64Array, ior: npt.ArrayLike, exterior_ior: npt.ArrayLike
) -> tuple[Complex128Array, Complex128Array, Complex128Array]:
    """(eta^2, e = eta^2 - 1, g^2), each difference taken before the division, where it is exact."""
    index = np.asarray(ior, dtype=np.complex128)
    n, k, outside = index.real, index.imag, np.asarray(exterior_ior, dtype=np.float64)
    square = outside * outside
    twice_nk = 2j * (n / outside) * (k / outside)
    eta2 = (n - k) * (n + k) / square + twice_nk
    e = ((n - outside) * (n + outside) - k * k) / square + twice_nk
    # near eta = 1 the small term is e; near eta = 0 it is eta^2, which e has lost
    g2 = np.where(np.abs(e) < 0.5, c * c + e, eta2 - sin2)
    return eta2, e, g2


def dielectric(
    cos_theta: npt.ArrayLike,
    n: npt.ArrayLike,
    exterior_ior: npt.ArrayLike = 1.0,
    *,
    sin2_theta: npt.ArrayLike | None = None,
) -> Float64Array:
    """Reflectance of an interface to a medium that does not absorb; exactly 1 in total internal reflection.

    F = (r_s^2 + r_p^2)/2 with the amplitudes of the module's head. Shape broadcast(cos_theta, n, exterior_ior).
    Just outside the critical angle F falls from 1 as a square root: the last bit of cos_theta is 1e-8 of F there.
    """
    c = np.asarray(cos_theta, dtype=np.float64)
    sin2 = _sin2(c, sin2_theta)
    eta2, e, g2 = (x.real for x in _squares(c, sin2, np.asarray(n, dtype=np.float64), exterior_ior))
    total = (g2 <= 0) & (e != 0)
    g = np.sqrt(np.maximum(g2, 0.0))
    # e = 0 is no interface: F = 0 also at grazing incidence, where the quotients are 0/0
    known = total | (e == 0)
    r_s = e / np.where(known, 1.0, c + g) ** 2
    r_p = e * (eta2 * c * c - sin2) / np.where(known, 1.0, eta2 * c + g) ** 2
    return np.where(total, 1.0, np.minimum(0.5 * (r_s * r_s + r_p * r_p), 1.0))  # rounding may pass 1 by an ulp


def conductor(
    cos_theta: npt.ArrayLike,
    ior: npt.ArrayLike,
    exterior_ior: npt.ArrayLike = 1.0,
    *,
    sin2_theta: npt.ArrayLike | None = None,
) -> Float64Array:
    """Reflectance of an interface to an absorbing medium of complex index n + ik; k = 0 gives `dielectric`.

    F = (|r_s|^2 + |r_p|^2)/2. Shape broadcast(cos_theta, ior, exterior_ior).
    """
    c = np.asarray(cos_theta, dtype=np.float64)
    sin2 = _sin2(c, sin2_theta)
    eta2, e, g2 = _squares(c, sin2, ior, exterior_ior)
    a, b = _root(g2)
    matched = e == 0  # as in `dielectric`
    # only magnitudes are wanted: |r_s| = |e|/|c + g|^2, |r_p| = |e| |eta^2 c^2 - sin^2| / |eta^2 c + g|^2
    size = _size2(e.real, e.imag)
    below_s = np.where(matched, 1.0, _size2(c + a, b))
    below_p = np.where(matched, 1.0, _size2(eta2.real * c + a, eta2.imag * c + b))
    across = _size2(eta2.real * c * c - sin2, eta2.imag * c * c)
    r_s2 = size / below_s / below_s
    r_p2 = size / below_p * (across / below_p)
    return np.minimum(0.5 * (r_s2 + r_p2), 1.0)  # rounding may pass 1 by an ulp


def absorptance(
    cos_theta: npt.ArrayLike,
    ior: npt.ArrayLike,
    exterior_ior: npt.ArrayLike = 1.0,
    *,
    sin2_theta: npt.ArrayLike | None = None,
) -> Float64Array:
    """1 - F, what enters the medium (the transmitted fraction of a dielectric), without the cancellation at F near 1.

    With g = a + ib: A_s = 4 a c/|c + g|^2, A_p = 4 a c (|g|^2 + sin^2)/|eta^2 c + g|^2, A = (A_s + A_p)/2, every
    term positive. Exactly 0 in total internal reflection. Shape broadcast(cos_theta, ior, exterior_ior).
    """
    c = np.asarray(cos_theta, dtype=np.float64)
    sin2 = _sin2(c, sin2_theta)
    eta2, e, g_squared = _squares(c, sin2, ior, exterior_ior)
    a, b = _root(g_squared)
    size = _size2(a, b)
    through, weight = a * c, size + sin2
    below_s = size + 2 * through + c * c
    below_p = (eta2.real**2 + eta2.imag**2) * c * c + 2 * through * weight + size
    matched = e == 0  # no interface, all passes, also at grazing incidence, where the quotients are 0/0
    a_s = 4 * through / np.where(matched, 1.0, below_s)
    a_p = 4 * through * weight / np.where(matched, 1.0, below_p)
    return np.where(matched, 1.0, np.minimum(0.5 * (a_s + a_p), 1.0))


def transmitted(
    cos_theta: npt.ArrayLike,
    ior: npt.ArrayLike,
    exterior_ior: npt.ArrayLike = 1.0,
    *,
    sin2_theta: npt.ArrayLike | None = None,
) -> Float64Array:
    """The transmitted fraction 1 - F of the light that meets the surface, in [0, 1].

    What a diffuse base under a smooth coat receives, or what enters a metal and is absorbed there: `absorptance` under
    the name that dielectrics use. 4 n/(n + 1)^2 at normal incidence; .96 for glass of n = 1.5.
    cos_theta in [0, 1]; ior n or n + ik, dimensionless. Shape broadcast(cos_theta, ior, exterior_ior).
    """
    return absorptance(cos_theta, ior, exterior_ior, sin2_theta=sin2_theta)


def schlick(
    cos_theta: npt.ArrayLike,
    ior: npt.ArrayLike,
    exterior_ior: npt.ArrayLike = 1.0,
    *,
    sin2_theta: npt.ArrayLike | None = None,
) -> Float64Array:
    """Schlick's approximation F0 + (1 - F0)(1 - cos)^5 with F0 = ((n-1)^2 + k^2)/((n+1)^2 + k^2).

    Source: C. Schlick, Computer Graphics Forum 13(3), 1994, doi:10.1111/1467-8659.1330233.
    """
    c = np.asarray(cos_theta, dtype=np.float64)
    index, outside = np.asarray(ior, dtype=np.complex128), np.asarray(exterior_ior, dtype=np.float64)
    n, k2 = index.real, index.imag**2
    f0 = ((n - outside) ** 2 + k2) / ((n + outside) ** 2 + k2)
    rest = 4 * n * outside / ((n + outside) ** 2 + k2)  # 1 - F0
    with np.errstate(under="ignore"):
        rise = _one_minus_cos(c, sin2_theta) ** 5
        return np.asarray(np.minimum(f0 + rest * rise, 1.0))  # rounding may pass 1 by an ulp


def conductor_approximate(
    cos_theta: npt.ArrayLike,
    ior: npt.ArrayLike,
    exterior_ior: npt.ArrayLike = 1.0,
    *,
    sin2_theta: npt.ArrayLike | None = None,
) -> Float64Array:
    """The approximation of course notes for n^2 + k^2 >> 1, unfit for glass (`largest_approximation_error`).

    r_p^2 = ((n^2+k^2) c^2 - 2nc + 1)/((n^2+k^2) c^2 + 2nc + 1),
    r_s^2 = ((n^2+k^2) - 2nc + c^2)/((n^2+k^2) + 2nc + c^2);
    the numerators are formed as sums of squares, (nc - 1)^2 + (kc)^2 and (n - c)^2 + k^2.
    Source: M. Pharr and G. Humphreys, Physically Based Rendering, 2nd ed., 2010, section 8.2.1.
    """
    c = np.asarray(cos_theta, dtype=np.float64)
    index, outside = np.asarray(ior, dtype=np.complex128), np.asarray(exterior_ior, dtype=np.float64)
    n, k = index.real / outside, index.imag / outside
    above, vers = (index.real - outside) / outside, _one_minus_cos(c, sin2_theta)  # n - 1 and 1 - c
    r_p = ((above * c - vers) ** 2 + (k * c) ** 2) / ((n * c + 1) ** 2 + (k * c) ** 2)
    r_s = ((above + vers) ** 2 + k * k) / ((n + c) ** 2 + k * k)
    return np.asarray(np.minimum(0.5 * (r_p + r_s), 1.0))


def largest_approximation_error(ior: npt.ArrayLike, exterior_ior: npt.ArrayLike = 1.0) -> float:
    """max over cos theta and channels of |conductor_approximate - conductor|, on 4,097 cosines denser at grazing."""
    c = (np.linspace(0.0, 1.0, 4097) ** 2)[:, None]
    index, outside = np.atleast_1d(ior), np.atleast_1d(exterior_ior)
    difference = conductor_approximate(c, index, outside) - conductor(c, index, outside)
    return float(np.abs(difference).max())


@dataclass(frozen=True, slots=True)
class Fresnel:
    """The Fresnel term of a model: reflectance of n angles and all channels. Made by `make`."""

    kind: str
    ior: Complex128Array | None
    exterior_ior: Float64Array

    def __call__(self, cos_theta: Float64Array, sin2_theta: Float64Array | None = None) -> Float64Array:
        """F in [0, 1] of shape (n, channels) or (n, 1); `sin2_theta` as at the module's head."""
        c = cos_theta[:, None]
        if self.ior is None:
            return np.ones_like(c)
        sin2 = None if sin2_theta is None else sin2_theta[:, None]
        if self.kind == "dielectric":
            return dielectric(c, self.ior.real, self.exterior_ior, sin2_theta=sin2)
        form = {"conductor": conductor, "schlick": schlick, "conductor_approximate": conductor_approximate}[self.kind]
        return form(c, self.ior, self.exterior_ior, sin2_theta=sin2)


def make(owner: str, kind: str, ior: Complex128Array | None, exterior_ior: Any = 1.0) -> Fresnel:
    """The Fresnel term `kind` of KINDS for indices `ior` (channels,), None meaning F = 1.

    "auto" is "none" without an ior, "dielectric" if no channel absorbs, else "conductor".
    Raises `InputError` for an exact or approximate form without ior, and for "dielectric" with k > 0.
    Warns (UserWarning) if "conductor_approximate" is further than .01 from the exact form.
    """
    outside = np.atleast_1d(np.asarray(exterior_ior, dtype=np.float64))
    if kind == "auto":
        kind = "none" if ior is None else "dielectric" if not ior.imag.any() else "conductor"
    if kind == "none":
        return Fresnel("none", None, outside)
    if ior is None:
        raise InputError(
            "bad_parameter",
            f"{owner}: fresnel = {kind!r} needs an ior; give one, or fresnel='none' for a reflectance of 1",
            where="ior",
            got="None",
            expected="an index of refraction",
        )
    if kind == "dielectric" and ior.imag.any():
        raise InputError(
            "bad_parameter",
            f"{owner}: fresnel = 'dielectric' takes a real ior, this one absorbs (k > 0); use 'conductor' or 'auto'",
            where="fresnel",
            got=kind,
            expected="'conductor' or 'auto'",
        )
    if kind == "conductor_approximate":
        error = largest_approximation_error(ior, outside)
        if error > APPROXIMATION_WARNS_ABOVE:
            warnings.warn(
                f"{owner}: fresnel = 'conductor_approximate' is up to {error:.2g} off the exact reflectance for this "
                "ior; use 'conductor' or 'dielectric'",
                stacklevel=3,
            )
    return Fresnel(kind, ior, outside)
