"""The Cook-Torrance microfacet model with its published and its energy-conserving normalisation."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.geometry import PairGeometry
from brdfcore.base.parameters import Parameter
from brdfcore.models.base import fresnel, lobe, microfacet
from brdfcore.models.base.model import FastArguments, Model
from brdfcore.models.base.optical_constants import (
    EXTERIOR_IOR,
    IOR,
    WAVELENGTHS,
    channels_of,
    ior_to_json,
    material_index,
)

#: 4 k of f = k F D G/(cos_i cos_o), D with unit projected area; G/(4 cos_i cos_o) is formed as one (`microfacet`).
CONVENTIONS = {"normalised": 1.0, "slides": 4 / np.pi, "published": 4.0}


class CookTorrance(Model):
    """f = diffuse/pi + specular k F(cos theta_d) D(theta_h) G/(cos theta_i cos theta_o), 1/sr.

    Parameters (a number, or a list of one per channel, unless said otherwise)
    ----------
    diffuse, specular : >= 0. Their sum may not pass 1 where the model conserves energy (`InputError`); elsewhere it
        is a UserWarning.
    roughness (alias alpha) : m in [1e-8, 10]; rms slope for beckmann, alpha for ggx. It is not a renderer's
        perceptual roughness, whose square it is.
    distribution : "beckmann", "blinn", "gaussian" or "ggx", each with unit projected area.
    masking : "vgroove", height-correlated "smith" (beckmann and ggx only), or "none".
    fresnel : "auto" (exact, by the ior; F = 1 without one), "conductor", "conductor_approximate" (warns where it is
        .01 off), "dielectric", "schlick" or "none".
    ior, exterior_ior : see `optical_constants.parse_ior`.
    wavelengths : nm, with a named ior: one channel each (`optical_constants.tabulated`).
    convention : k = 1/4 "normalised"; 1 "published" (the 1982 paper's D lacks a pi and has a factor 1/pi, which is
        the same); 1/pi "slides", D with its pi and the factor as well.

    `energy_conserving` is True for the normalised convention with vgroove or smith masking. f is reciprocal.
    Source: R. Cook and K. Torrance, A Reflectance Model for Computer Graphics, ACM TOG 1(1), 1982,
    doi:10.1145/357290.357293; k = 1/4: B. Walter et al., EGSR 2007, doi:10.2312/EGWR/EGSR07/195-206.
    """

    name: ClassVar[str] = "cook_torrance"
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        lobe.DIFFUSE,
        lobe.SPECULAR,
        Parameter(
            "roughness",
            "m",
            "rms slope of the facets (alpha of ggx)",
            0.1,
            bounds=(1e-8, 10.0),  # below, one bit of an angle moves the lobe's flank by itself
            aliases=("alpha",),
        ),
        Parameter(
            "distribution",
            "D",
            "distribution of the facets' normals",
            "beckmann",
            kind="choice",
            choices=tuple(microfacet.DISTRIBUTIONS),
        ),
        Parameter(
            "masking",
            "G",
            "masking and shadowing of facets by each other",
            "vgroove",
            kind="choice",
            choices=("vgroove", "smith", "none"),
        ),
        Parameter("fresnel", "F", "reflectance of a facet", "auto", kind="choice", choices=fresnel.KINDS),
        IOR,
        EXTERIOR_IOR,
        WAVELENGTHS,
        Parameter(
            "convention",
            "k",
            "normalisation: 1/4, 1/pi of lecture slides, or 1 as published in 1982",
            "normalised",
            kind="choice",
            choices=tuple(CONVENTIONS),
        ),
    )
    SUMMARY: ClassVar[str] = "Microfacet lobe of metals and glossy plastics, with a diffuse part."
    FORMULA: ClassVar[str] = "f = diffuse/pi + specular k F D G/(cos theta_i cos theta_o)"
    REFERENCE: ClassVar[str] = "R. Cook and K. Torrance, ACM TOG 1(1), 1982, doi:10.1145/357290.357293"
    FAST: ClassVar[str] = "brdfcore.kernels.models.microfacet_lobe:microfacet"

    _analytic: bool = True

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        p = self.parameters
        index = material_index(self.name, p["ior"], p["wavelengths"])
        self.metadata["parameters"]["ior"] = ior_to_json(p["ior"])
        self._fresnel = fresnel.make(self.name, p["fresnel"], index, p["exterior_ior"])
        self.metadata["fresnel"] = self._fresnel.kind
        uses_ior = self._fresnel.ior is not None
        self.channels = channels_of(
            self.name,
            p["wavelengths"],
            p["diffuse"],
            p["specular"],
            p["roughness"],
            index if uses_ior else None,
            p["exterior_ior"] if uses_ior else None,
        )
        self.energy_conserving = p["convention"] == "normalised" and p["masking"] != "none"
        lobe.check_sum(self.name, p, self.energy_conserving)
        if p["masking"] == "smith":
            microfacet.require_smith(self.name, p["distribution"])
        self._m = lobe.per_channel(p["roughness"])
        self._distribution = microfacet.DISTRIBUTIONS[p["distribution"]](self._m)
        self._factor = self._distribution.scale * CONVENTIONS[p["convention"]] * lobe.per_channel(p["specular"])
        self._base = lobe.per_channel(p["diffuse"]) / np.pi

    def _fast_arguments(self) -> FastArguments:
        from brdfcore.kernels.models.microfacet_lobe import microfacet_choices, microfacet_numbers

        f, distribution = self._fresnel, self.parameters["distribution"]
        numbers = microfacet_numbers(self._m, distribution, (f.kind, f.ior, f.exterior_ior), len(self.channels))
        choices = microfacet_choices(distribution, self.parameters["masking"], f.kind)
        return FastArguments(self._factor, self._base, numbers, choices)

    def _value(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        tan2_h = pair.tan2_h[:, None]
        with np.errstate(under="ignore"):  # far from the lobe f is 0 to all digits
            root = self._distribution.root(tan2_h)
            middle = self._visibility(pair) * self._fresnel(pair.cos_d, pair.sin2_d) * self._factor
            # D = scale root^2 with the small cosines between its factors: see `microfacet.Distribution`
            value: npt.NDArray[np.float64] = (root * middle) * root + self._base
        return value

    def _visibility(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        cos_i, cos_o = pair.cos_i[:, None], pair.cos_o[:, None]
        masking = self.parameters["masking"]
        if masking == "vgroove":
            return microfacet.vgroove(cos_i, cos_o, pair.tan2_h[:, None])
        if masking == "none":
            return microfacet.unmasked(cos_i, cos_o)
        sines = pair.sin_i[:, None], pair.sin_o[:, None]
        return microfacet.smith(self.parameters["distribution"], self._m, cos_i, cos_o, *sines)
