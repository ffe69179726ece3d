"""The GGX microfacet model with exact Fresnel and Smith's masking."""

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


class GGX(Model):
    """f = diffuse/pi + specular F(cos theta_d) D(theta_h) G/(4 cos theta_i cos theta_o), 1/sr.

    D of Trowbridge and Reitz, F exact by the ior (1 without one), G Smith's: height-correlated 1/(1 + L_i + L_o), or
    the separable product 1/((1 + L_i)(1 + L_o)) of the 2007 paper for correlated=False.

    Parameters (a number, or a list of one per channel, unless said otherwise)
    ----------
    diffuse, specular : >= 0, so that the albedo at normal incidence is at most 1 (`InputError`). Where it passes 1
        towards the horizon, `energy_conserving` is False, and `metadata["energy"]` says from which angle on.
    roughness (alias alpha) : alpha in [1e-8, 10], the square of a renderer's perceptual roughness.
    ior, exterior_ior : see `optical_constants.parse_ior`.
    wavelengths : nm, with a named ior: one channel each (`optical_constants.tabulated`).
    correlated : True or False.

    f is reciprocal and, where diffuse + specular is at most 1, conserves energy (single scattering: a rough surface
    also loses some). Error 1e-12 of f.
    Source: T. Trowbridge and K. Reitz, JOSA 65, 1975, doi:10.1364/JOSA.65.000531; B. Walter et al., EGSR 2007,
    doi:10.2312/EGWR/EGSR07/195-206; E. Heitz, JCGT 3(2), 2014, https://jcgt.org/published/0003/02/03.
    """

    name: ClassVar[str] = "ggx"
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        lobe.DIFFUSE,
        lobe.SPECULAR,
        Parameter(
            "roughness",
            "alpha",
            "width of the facets' normals: half of them are flatter than tan theta_h = alpha",
            0.1,
            bounds=(1e-8, 10.0),  # below, one bit of an angle moves the lobe's flank by itself
            aliases=("alpha",),
        ),
        IOR,
        EXTERIOR_IOR,
        WAVELENGTHS,
        Parameter("correlated", "", "height-correlated masking, else the separable product", True, kind="flag"),
    )
    SUMMARY: ClassVar[str] = "Microfacet lobe with long tails: most metals and glazes."
    FORMULA: ClassVar[str] = "f = diffuse/pi + specular F D G/(4 cos theta_i cos theta_o)"
    REFERENCE: ClassVar[str] = "B. Walter et al., EGSR 2007, doi:10.2312/EGWR/EGSR07/195-206"
    FAST: ClassVar[str] = "brdfcore.kernels.models.microfacet_lobe:microfacet"

    _analytic: bool = True

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        p = self.parameters
        index = material_index(self.name, p["ior"], p["wavelengths"])
        self.metadata["parameters"]["ior"] = ior_to_json(p["ior"])
        self._fresnel = fresnel.make(self.name, "auto", index, p["exterior_ior"])
        self.metadata["fresnel"] = self._fresnel.kind
        outside = None if index is None else p["exterior_ior"]
        self.channels = channels_of(
            self.name, p["wavelengths"], p["diffuse"], p["specular"], p["roughness"], index, outside
        )
        self._m = lobe.per_channel(p["roughness"])
        self._distribution = microfacet.ggx(self._m)
        self._factor = self._distribution.scale * lobe.per_channel(p["specular"])
        self._base = lobe.per_channel(p["diffuse"]) / np.pi
        lobe.check_albedo(self)

    def _fast_arguments(self) -> FastArguments:
        from brdfcore.kernels.models.microfacet_lobe import microfacet_choices, microfacet_numbers

        f, masking = self._fresnel, "smith" if self.parameters["correlated"] else "smith_ggx_separable"
        numbers = microfacet_numbers(self._m, "ggx", (f.kind, f.ior, f.exterior_ior), len(self.channels))
        return FastArguments(self._factor, self._base, numbers, microfacet_choices("ggx", masking, f.kind))

    def _value(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        cos_i, cos_o, sin_i, sin_o, tan2_h = (
            x[:, None] for x in (pair.cos_i, pair.cos_o, pair.sin_i, pair.sin_o, pair.tan2_h)
        )
        with np.errstate(under="ignore"):  # far from a sharp lobe f is 0 to all digits
            if self.parameters["correlated"]:
                visibility = microfacet.smith("ggx", self._m, cos_i, cos_o, sin_i, sin_o)
            else:
                visibility = microfacet.smith_separable(self._m, cos_i, cos_o, sin_i, sin_o)
            root = self._distribution.root(tan2_h)
            middle = visibility * self._fresnel(pair.cos_d, pair.sin2_d) * self._factor
            value: npt.NDArray[np.float64] = (root * middle) * root + self._base
        return value
