"""Oren and Nayar's rough diffuse surface, the full form of 1994."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.geometry import PairGeometry
from brdfcore.base.parameters import Parameter
from brdfcore.models.base import lobe
from brdfcore.models.base.model import FastArguments, Model, channels_for

Float64Array = npt.NDArray[np.float64]

#: Reflectance up to which the albedo stays below 1 for every sigma; above, the published form reaches 1.06.
CONSERVES_UP_TO = 0.95


class OrenNayar(Model):
    """V-grooves of Lambertian facets, f = (rho/pi)(L1 + rho L2) in 1/sr, clamped at 0.

    With alpha = max(theta_i, theta_o), beta = min(theta_i, theta_o), phi = delta_phi, s = sigma^2:
    L1 = C1 + C2 cos phi tan beta + C3 (1 - |cos phi|) tan((alpha + beta)/2),
    L2 = .17 s/(s + .13) (1 - cos phi (2 beta/pi)^2), the interreflections,
    C1 = 1 - .5 s/(s + .33), C3 = .125 s/(s + .09) (4 alpha beta/pi^2)^2,
    C2 = .45 s/(s + .09) sin alpha for cos phi >= 0, else .45 s/(s + .09) (sin alpha - (2 beta/pi)^3).

    Parameters (a number, or a list of one per channel)
    ----------
    reflectance : rho in [0, 1], of a facet.
    sigma : standard deviation of the facets' slope angle, radians, [0, pi/2]; 0 is Lambert's surface.

    f is reciprocal, and without bound where both directions graze. The printed fit goes down to -.085 rho there, on
    the side away from the light: that is clamped to 0. `energy_conserving` is True for rho <= .95 or sigma = 0; above,
    the albedo reaches 1.06 at grazing incidence. Error 1e-12 of max(f, 1e-3 rho/pi).
    Source: M. Oren and S. Nayar, Generalization of Lambert's Reflectance Model, SIGGRAPH 1994,
    doi:10.1145/192161.192213, equations 30 and 31.
    """

    name: ClassVar[str] = "oren_nayar"
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter("reflectance", "rho", "reflectance of a facet", 0.5, bounds=(0.0, 1.0)),
        Parameter(
            "sigma",
            "sigma",
            "standard deviation of the facets' slope angle",
            0.3,
            bounds=(0.0, np.pi / 2),
            unit="rad",
        ),
    )
    SUMMARY: ClassVar[str] = "Rough diffuse surface, plaster or the moon: bright towards the light."
    FORMULA: ClassVar[str] = (
        "f = (rho/pi) max(0, C1 + C2 cos phi tan beta + C3 (1 - |cos phi|) tan((alpha + beta)/2) + rho L2), "
        "alpha, beta = max, min(theta_i, theta_o), phi = delta_phi"
    )
    REFERENCE: ClassVar[str] = "M. Oren and S. Nayar, SIGGRAPH 1994, doi:10.1145/192161.192213"
    FAST: ClassVar[str] = "brdfcore.kernels.models.oren_nayar:oren_nayar"

    _analytic: bool = True

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        rho, sigma = (lobe.per_channel(self.parameters[key]) for key in ("reflectance", "sigma"))
        self.channels = channels_for(self.name, rho, sigma)
        self.energy_conserving = bool(((rho <= CONSERVES_UP_TO) | (sigma == 0)).all())
        s = sigma * sigma
        with np.errstate(under="ignore"):
            self._c1 = 1 - 0.5 * s / (s + 0.33)
            self._c2 = 0.45 * s / (s + 0.09)
            self._c3 = 0.125 * s / (s + 0.09)
            self._inter = 0.17 * rho * s / (s + 0.13)
        self._scale = rho / np.pi

    def _fast_arguments(self) -> FastArguments:
        from brdfcore.kernels.models.lobe_blocks import per_channel

        numbers = per_channel([self._c1, self._c2, self._c3, self._inter], len(self.channels))
        return FastArguments(self._scale, 0 * self._scale, numbers, (0,))

    def _value(self, pair: PairGeometry) -> Float64Array:
        cos_phi = pair.cos_delta_phi
        cos_beta, sin_beta = np.maximum(pair.cos_i, pair.cos_o), np.minimum(pair.sin_i, pair.sin_o)
        with np.errstate(under="ignore"):
            theta_i, theta_o = np.arctan2(pair.sin_i, pair.cos_i), np.arctan2(pair.sin_o, pair.cos_o)
            alpha, beta = np.maximum(theta_i, theta_o), np.minimum(theta_i, theta_o)
            toward = cos_phi * (sin_beta / cos_beta) * _c2_angles(pair, beta, np.arctan2(cos_beta, sin_beta))
            # tan((alpha + beta)/2) is this quotient of positive sums
            aside = (4 * alpha * beta / np.pi**2) ** 2 * (pair.sin_i + pair.sin_o) / (pair.cos_i + pair.cos_o)
            aside = aside * _one_minus_abs_cos(pair)
            glow = 1 - cos_phi * (2 * beta / np.pi) ** 2
            total = self._c1 + self._c2 * toward[:, None] + self._c3 * aside[:, None] + self._inter * glow[:, None]
            value: Float64Array = self._scale * np.maximum(total, 0.0)
        return value


def _c2_angles(pair: PairGeometry, beta: Float64Array, beta_to_horizon: Float64Array) -> Float64Array:
    """C2 without its sigma: sin alpha, less (2 beta/pi)^3 where cos phi < 0.

    Near the horizon both are 1 and tan beta, which multiplies their difference, has no bound: there it is
    (1 - (2 beta/pi)^3) - (1 - sin alpha) with 2 beta/pi = 1 - x, each bracket without cancellation.
    """
    sin_alpha, cos_alpha = np.maximum(pair.sin_i, pair.sin_o), np.minimum(pair.cos_i, pair.cos_o)
    x = beta_to_horizon * (2 / np.pi)
    low = x * (3 - x * (3 - x)) - cos_alpha * cos_alpha / (1 + sin_alpha)
    away = np.where(beta < 1, sin_alpha - (beta * (2 / np.pi)) ** 3, low)
    return np.where(pair.cos_delta_phi >= 0, sin_alpha, away)


def _one_minus_abs_cos(pair: PairGeometry) -> Float64Array:
    """1 - |cos phi|, with its digits where phi is near 0 or pi and the tangent beside it is large.

    From 2 sin_i sin_o (1 + cos phi) = |(wi + wo)_xy|^2 - (sin_i - sin_o)^2 and the same with minus signs; near the
    horizon the difference of sines is (cos_o^2 - cos_i^2)/(sin_i + sin_o), small beside the first term.
    """
    cos_i, cos_o, cos_phi = pair.cos_i, pair.cos_o, pair.cos_delta_phi
    product = pair.sin_i * pair.sin_o
    grazing = product > 0.5  # elsewhere the tangent is moderate and the plain difference will do
    total = cos_i + cos_o
    sines = (cos_o - cos_i) * total / np.where(grazing, pair.sin_i + pair.sin_o, 1.0)
    ahead = pair.tan2_h * total * total
    back = 4 * pair.sin2_d - (cos_i - cos_o) ** 2
    exact = (np.where(cos_phi < 0, ahead, back) - sines * sines) / np.where(grazing, 2 * product, 1.0)
    return np.where(grazing, np.clip(exact, 0.0, 1.0), 1 - np.abs(cos_phi))
