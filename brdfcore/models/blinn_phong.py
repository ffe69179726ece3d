"""Blinn's half-vector form of Phong's lobe, as published and normalised."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.geometry import PairGeometry
from brdfcore.base.parameters import Parameter
from brdfcore.models.base import lobe
from brdfcore.models.base.model import FastArguments, Model, channels_for


class BlinnPhong(Model):
    """f = diffuse/pi + specular lobe, 1/sr, with the cosine n.h = cos theta_h to the half vector.

    convention "normalised": lobe = (n + 2)(n + 4)/(8 pi (2^(-n/2) + n)) (n.h)^n, which reflects `specular` exactly at
    normal incidence; reciprocal, conserves energy.
    convention "published": lobe = (n.h)^n/cos theta_i, the BRDF of reflected light k_s (n.h)^n; neither reciprocal
    nor energy conserving, without bound at grazing incidence.

    Parameters (a number, or a list of one per channel)
    ----------
    diffuse, specular : >= 0. Their sum may not pass 1 if normalised (`InputError`); as published it is a UserWarning.
    exponent : n in [0, 2e16], dimensionless; about four times Phong's for a highlight of the same width.

    Error 1e-12 of f.
    Source: J. Blinn, Models of Light Reflection for Computer Synthesized Pictures, SIGGRAPH 1977,
    doi:10.1145/965141.563893; normalisation: F. Giesen, Phong and Blinn-Phong Normalization Factors, 2009,
    https://www.farbrausch.de/~fg/stuff/phong.pdf.
    """

    name: ClassVar[str] = "blinn_phong"
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        lobe.DIFFUSE,
        lobe.SPECULAR,
        Parameter(
            "exponent",
            "n",
            "exponent of the cosine between normal and half vector",
            400.0,
            bounds=(0.0, 2e16),  # above, one bit of an angle moves the lobe's flank by itself
        ),
        Parameter(
            "convention",
            "",
            "normalised as a BRDF, or as published in 1977",
            "normalised",
            kind="choice",
            choices=("normalised", "published"),
        ),
    )
    SUMMARY: ClassVar[str] = "Cosine power of the half vector: Phong's lobe with a microfacet's shape."
    FORMULA: ClassVar[str] = "f = diffuse/pi + specular (n + 2)(n + 4)/(8 pi (2^(-n/2) + n)) (n.h)^n"
    REFERENCE: ClassVar[str] = "J. Blinn, SIGGRAPH 1977, doi:10.1145/965141.563893"
    FAST: ClassVar[str] = "brdfcore.kernels.models.blinn_phong:blinn_phong"

    _analytic: bool = True

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        p = self.parameters
        self.channels = channels_for(self.name, p["diffuse"], p["specular"], p["exponent"])
        self._normalised = p["convention"] == "normalised"
        self.energy_conserving = self.reciprocal = self._normalised
        lobe.check_sum(self.name, p, self.energy_conserving)
        n = lobe.per_channel(p["exponent"])
        self._quarter_exponent = 0.25 * n
        self._factor = lobe.per_channel(p["specular"])
        if self._normalised:
            with np.errstate(under="ignore"):
                self._factor = self._factor * (n + 2) * (n + 4) / (8 * np.pi * (np.exp2(-0.5 * n) + n))
        self._base = lobe.per_channel(p["diffuse"]) / np.pi

    def _fast_arguments(self) -> FastArguments:
        from brdfcore.kernels.models.blinn_phong import VARIANTS
        from brdfcore.kernels.models.lobe_blocks import per_channel

        numbers = per_channel([-self._quarter_exponent], len(self.channels))
        return FastArguments(self._factor, self._base, numbers, (VARIANTS[self.parameters["convention"]],))

    def _value(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        with np.errstate(under="ignore"):  # far from the lobe f is 0 to all digits
            # (n.h)^n = (1 + t^2)^(-n/2) as a square: it may underflow before it is divided by a small cosine
            root = np.exp(-self._quarter_exponent * np.log1p(pair.tan2_h[:, None]))
            middle = self._factor if self._normalised else self._factor / pair.cos_i[:, None]
            value: npt.NDArray[np.float64] = (root * middle) * root + self._base
        return value
