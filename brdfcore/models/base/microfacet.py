"""Microfacet distributions D and masking G of isotropic rough surfaces.

m is the roughness (rms slope for `beckmann`, alpha for `ggx`), dimensionless. theta_h is the angle between the normal
and the half vector, and t^2 = tan^2 theta_h is all a distribution needs. D is in 1/sr and has unit projected area,
int D cos theta_h dw = 1 over the hemisphere.

Masking enters as the visibility V = G/(4 cos_i cos_o), which is finite where a cosine is 0 and the quotient is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError, missing_extra
from brdfcore.base.quadrature import composite

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Distribution:
    """D(t^2) = scale root(t^2)^2, the exponential or power shared out over two equal factors.

    A model multiplies root (scale ... V F) root: where D alone underflows and is then divided by two small cosines,
    the product still has all its digits.

    scale (channels,); root maps t^2 (n, 1) to (n, channels).
    """

    scale: Float64Array
    root: Callable[[Float64Array], Float64Array]

    def density(self, tan2_h: npt.ArrayLike) -> Float64Array:
        """D in 1/sr of t^2 >= 0, any shape; shape + (channels,)."""
        with np.errstate(under="ignore"):
            root = self.root(np.asarray(tan2_h, dtype=np.float64)[..., None])
            density: Float64Array = self.scale * root * root
        return density


def beckmann(m: Float64Array) -> Distribution:
    """D = exp(-t^2/m^2)/(pi m^2 cos^4 theta_h), with cos^-4 = (1 + t^2)^2 inside the exponent.

    Source: P. Beckmann and A. Spizzichino, The Scattering of Electromagnetic Waves from Rough Surfaces, 1963;
    R. Cook and K. Torrance, ACM TOG 1(1), 1982, doi:10.1145/357290.357293 (which prints D without the pi).
    """
    two_m2 = 2 * m * m
    return Distribution(1 / (np.pi * m * m), lambda t2: np.exp(np.log1p(t2) - t2 / two_m2))


def ggx(m: Float64Array) -> Distribution:
    """D = [m (1 + t^2)/(t^2 + m^2)]^2/pi, which is m^2/(pi cos^4 theta_h (m^2 + t^2)^2).

    Source: T. Trowbridge and K. Reitz, JOSA 65, 1975, doi:10.1364/JOSA.65.000531; B. Walter et al., EGSR 2007,
    doi:10.2312/EGWR/EGSR07/195-206.
    """
    m2 = m * m
    return Distribution(np.full_like(m, 1 / np.pi), lambda t2: m * (1 + t2) / (t2 + m2))


def blinn(m: Float64Array) -> Distribution:
    """D = (N + 2)/(2 pi) cos^N theta_h with N = -ln 2/ln cos m, so that D falls to half at theta_h = m; m < pi/2.

    Source: J. Blinn, SIGGRAPH 1977, doi:10.1145/965141.563893.
    """
    if (m >= np.pi / 2).any():
        raise InputError(
            "bad_parameter",
            f"roughness: distribution 'blinn' needs m < pi/2 (cos^N halves at theta_h = m); got {float(m.max())!r}",
            where="roughness",
            got=float(m.max()),
            expected="m < pi/2",
        )
    # ln cos m without cos m, which is 1 to all digits for m < 1e-8
    exponent = -math.log(2) / np.log1p(-2 * np.sin(0.5 * m) ** 2)
    quarter = 0.25 * exponent
    return Distribution((exponent + 2) / (2 * np.pi), lambda t2: np.exp(-quarter * np.log1p(t2)))


def gaussian(m: Float64Array) -> Distribution:
    """D = exp(-(theta_h/m)^2)/A, A its projected area int exp(-(theta/m)^2) cos theta 2 pi sin theta dtheta.

    A is integrated numerically, every term positive: Dawson's function m pi F(m) alone, as often printed, extends
    the integral past the horizon and is 2.7e-6 off at m = .5.
    Source: K. Torrance and E. Sparrow, JOSA 57, 1967, doi:10.1364/JOSA.57.001105.
    """
    area = np.array([_gaussian_area(float(x)) for x in m])
    root_two_m = math.sqrt(2) * m

    def root(t2: Float64Array) -> Float64Array:
        u = np.arctan(np.sqrt(t2)) / root_two_m
        return np.exp(-u * u)

    return Distribution(1 / area, root)


def _gaussian_area(m: float) -> float:
    # in units of m; past 7 m the integrand is below e^-49 = 5e-22, nothing beside the whole
    end = min(0.5 * np.pi / m, 7.0)
    u, w = composite(np.linspace(0.0, end, 9), 16)
    return float(np.pi * m * (w @ (np.exp(-u * u) * np.sin(2 * m * u))))


DISTRIBUTIONS: dict[str, Callable[[Float64Array], Distribution]] = {
    "beckmann": beckmann,
    "blinn": blinn,
    "gaussian": gaussian,
    "ggx": ggx,
}

# ---- masking ---------------------------------------------------------------------------------------

Visibility = Callable[[Any], Float64Array]


def vgroove(cos_i: Float64Array, cos_o: Float64Array, tan2_h: Float64Array) -> Float64Array:
    """V = G/(4 cos_i cos_o) of V-grooves, G = min(1, 2 (n.h)(n.o)/(o.h), 2 (n.h)(n.i)/(o.h)).

    n.h/o.h = 2/(S (1 + t^2)) with S = cos_i + cos_o, so V = min(1/(4 cos_i cos_o), 1/(S (1 + t^2) max(cos_i, cos_o))).
    Its min() is a kink. Source: Torrance and Sparrow 1967; Cook and Torrance 1982.
    """
    return np.minimum(0.25 / (cos_i * cos_o), 1 / ((cos_i + cos_o) * (1 + tan2_h) * np.maximum(cos_i, cos_o)))


def unmasked(cos_i: Float64Array, cos_o: Float64Array) -> Float64Array:
    """V = 1/(4 cos_i cos_o), no masking: unbounded at grazing incidence, does not conserve energy."""
    return 0.25 / (cos_i * cos_o)


def smith(
    distribution: str,
    m: Float64Array,
    cos_i: Float64Array,
    cos_o: Float64Array,
    sin_i: Float64Array,
    sin_o: Float64Array,
) -> Float64Array:
    """V of height-correlated Smith masking, G = 1/(1 + L_i + L_o), with the exact L of "beckmann" or "ggx".

    V = 1/(4 (cos_o Q_i + cos_i Q_o)), Q = cos (1/2 + L): for ggx Q = sqrt(cos^2 + m^2 sin^2)/2; for beckmann, with
    a = cos/(m sin), Q = (cos erf(a) + m sin exp(-a^2)/sqrt(pi))/2. Every term is positive and Q is finite at grazing
    incidence, where L is not. "beckmann" needs scipy (`MissingExtraError` without it).
    Source: E. Heitz, JCGT 3(2), 2014, https://jcgt.org/published/0003/02/03.
    """
    q = _q_ggx if distribution == "ggx" else _q_beckmann
    return 0.25 / (cos_o * q(m, cos_i, sin_i) + cos_i * q(m, cos_o, sin_o))


def smith_separable(
    m: Float64Array, cos_i: Float64Array, cos_o: Float64Array, sin_i: Float64Array, sin_o: Float64Array
) -> Float64Array:
    """V of separable Smith masking of ggx, G = G1(i) G1(o) with G1 = 1/(1 + L) = 2 cos/(cos + sqrt(cos^2 + m^2 sin^2)).

    V = 1/((cos_i + q_i)(cos_o + q_o)), q = sqrt(cos^2 + m^2 sin^2): finite at grazing incidence. It takes masking and
    shadowing as independent and is darker than the height-correlated `smith`.
    Source: B. Walter et al., EGSR 2007, doi:10.2312/EGWR/EGSR07/195-206, equations 23 and 34.
    """
    v: Float64Array = 1 / ((cos_i + 2 * _q_ggx(m, cos_i, sin_i)) * (cos_o + 2 * _q_ggx(m, cos_o, sin_o)))
    return v


def require_smith(owner: str, distribution: str) -> None:
    """`InputError` for a distribution without a known Smith function, `MissingExtraError` where scipy is absent."""
    if distribution not in ("beckmann", "ggx"):
        raise InputError(
            "bad_parameter",
            f"{owner}: masking = 'smith' is known for the distributions 'beckmann' and 'ggx', not for "
            f"{distribution!r}; use masking='vgroove'",
            where="masking",
            got="smith",
            expected="'vgroove' or 'none'",
        )
    if distribution == "beckmann":
        _erf()


def _q_ggx(m: Float64Array, cos: Float64Array, sin: Float64Array) -> Float64Array:
    return 0.5 * np.hypot(cos, m * sin)


def _q_beckmann(m: Float64Array, cos: Float64Array, sin: Float64Array) -> Float64Array:
    slope = m * sin
    # erf(a) = 1 and exp(-a^2) = 0 in float64 from a = 27 on: 1000 stands for all above, sin = 0 included
    a = cos / np.maximum(slope, 1e-3 * cos)
    with np.errstate(under="ignore"):
        q: Float64Array = 0.5 * (cos * _erf()(a) + slope * np.exp(-a * a) / math.sqrt(math.pi))
    return q


def _erf() -> Callable[[Float64Array], Float64Array]:
    try:
        from scipy.special import erf  # numpy has none; the base install is numpy only
    except ImportError as error:
        raise missing_extra("scipy", "core", "Smith masking of the Beckmann distribution") from error
    return erf
