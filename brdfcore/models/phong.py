"""Phong's lobe about the mirror direction, as published and normalised."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.geometry import PairGeometry
from brdfcore.base.parameters import Parameter
from brdfcore.models.base import lobe
from brdfcore.models.base.model import FastArguments, Model, channels_for


class Phong(Model):
    """f = diffuse/pi + specular lobe, 1/sr, the lobe 0 for r.v <= 0; r mirrors wi about the normal, v = wo.

    convention "normalised": lobe = (n + 2)/(2 pi) (r.v)^n (Lafortune and Willems); reciprocal, conserves energy, and
    at normal incidence reflects `specular` exactly.
    convention "published": lobe = (r.v)^n/cos theta_i, the BRDF of Phong's reflected light k_s (r.v)^n; neither
    reciprocal nor energy conserving, without bound at grazing incidence.

    Parameters (a number, or a list of one per channel)
    ----------
    diffuse, specular : >= 0. Their sum may not pass 1 if normalised (`InputError`); as published it is a UserWarning.
    exponent : n in [0, 2e16], dimensionless.

    Near r.v = 0, where the lobe ends, the error is 1e-12 of max(f, 1e-3 of the peak); elsewhere 1e-12 of f.
    Source: B. T. Phong, Illumination for Computer Generated Pictures, Commun. ACM 18(6), 1975,
    doi:10.1145/360825.360839; E. Lafortune and Y. Willems, Using the Modified Phong Reflectance Model for Physically
    Based Rendering, Report CW 197, K.U. Leuven, 1994.
    """

    name: ClassVar[str] = "phong"
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        lobe.DIFFUSE,
        lobe.SPECULAR,
        Parameter(
            "exponent",
            "n",
            "exponent of the cosine to the mirror direction",
            100.0,
            bounds=(0.0, 2e16),  # above, one bit of an angle moves the lobe's flank by itself
        ),
        Parameter(
            "convention",
            "",
            "normalised as a BRDF, or as published in 1975",
            "normalised",
            kind="choice",
            choices=("normalised", "published"),
        ),
    )
    SUMMARY: ClassVar[str] = "Cosine power about the mirror direction: plastic of the first computer pictures."
    FORMULA: ClassVar[str] = "f = diffuse/pi + specular (n + 2)/(2 pi) max(r.v, 0)^n"
    REFERENCE: ClassVar[str] = "B. T. Phong, Commun. ACM 18(6), 1975, doi:10.1145/360825.360839"
    FAST: ClassVar[str] = "brdfcore.kernels.models.phong:phong"

    _analytic: bool = True

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        p = self.parameters
        self.channels = channels_for(self.name, p["diffuse"], p["specular"], p["exponent"])
        self._normalised = p["convention"] == "normalised"
        self.energy_conserving = self.reciprocal = self._normalised
        lobe.check_sum(self.name, p, self.energy_conserving)
        exponent = lobe.per_channel(p["exponent"])
        self._half_exponent = 0.5 * exponent
        self._factor = lobe.per_channel(p["specular"])
        if self._normalised:
            self._factor = self._factor * (exponent + 2) / (2 * np.pi)
        self._base = lobe.per_channel(p["diffuse"]) / np.pi

    def _fast_arguments(self) -> FastArguments:
        from brdfcore.kernels.models.lobe_blocks import per_channel
        from brdfcore.kernels.models.phong import VARIANTS

        numbers = per_channel([self._half_exponent], len(self.channels))
        return FastArguments(self._factor, self._base, numbers, (VARIANTS[self.parameters["convention"]],))

    def _value(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        gap = pair.one_minus_rv[:, None]
        with np.errstate(under="ignore"):  # far from the lobe f is 0 to all digits
            # near the mirror direction 1 - r.v has the digits, near the lobe's end r.v itself
            r_v = (pair.cos_i * pair.cos_o - pair.sin_i * pair.sin_o * pair.cos_delta_phi)[:, None]
            near = gap < 0.5
            lit = near | (r_v > 0)
            log_rv = np.where(near, np.log1p(-np.where(near, gap, 0.0)), np.log(np.where(lit, r_v, 1.0)))
            # (r.v)^n as a square: it may underflow before it is divided by a small cosine
            root = np.where(lit, np.exp(self._half_exponent * log_rv), 0.0)
            middle = self._factor if self._normalised else self._factor / pair.cos_i[:, None]
            value: npt.NDArray[np.float64] = (root * middle) * root + self._base
        return value
