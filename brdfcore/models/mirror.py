"""The perfect mirror: all of it is a delta, none of it a value."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.geometry import PairGeometry
from brdfcore.base.parameters import Parameter
from brdfcore.models.base import fresnel
from brdfcore.models.base.model import Model, in_plain_domain
from brdfcore.models.base.optical_constants import (
    EXTERIOR_IOR,
    IOR,
    WAVELENGTHS,
    channels_of,
    ior_to_json,
    material_index,
)


class Mirror(Model):
    """A smooth surface: `delta_reflectance(theta_i)` is `reflectance`, or Fresnel's for `ior`; `evaluate` is 0.

    reflectance: [0, 1], a number or one per channel; 1 if neither it nor ior is given.
    ior: see `optical_constants.parse_ior`; exact reflectance, relative to `exterior_ior`.
    wavelengths: nm, with a named ior: one channel each (`optical_constants.tabulated`).
    Raises `InputError` if both are given.
    Source: M. Born and E. Wolf, Principles of Optics, 7th ed., section 1.5, doi:10.1017/CBO9781139644181.
    """

    name: ClassVar[str] = "mirror"
    _smooth_elsewhere = True
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter("reflectance", "rho", "reflectance at every angle; give it or ior", None, bounds=(0.0, 1.0)),
        IOR,
        EXTERIOR_IOR,
        WAVELENGTHS,
    )
    SUMMARY: ClassVar[str] = "Perfectly smooth: reflects into the mirror direction only."
    FORMULA: ClassVar[str] = "delta_reflectance = reflectance, or F(cos theta_i; ior)"
    REFERENCE: ClassVar[str] = "M. Born and E. Wolf, Principles of Optics, section 1.5, doi:10.1017/CBO9781139644181"
    has_delta: bool = True

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        reflectance, ior = self.parameters["reflectance"], self.parameters["ior"]
        if reflectance is not None and ior is not None:
            raise InputError(
                "bad_parameter",
                "mirror: reflectance and ior are both given, and each alone says how much is reflected; give one",
                where="reflectance",
            )
        wavelengths = self.parameters["wavelengths"]
        index = material_index(self.name, ior, wavelengths)
        outside = self.parameters["exterior_ior"]
        self.metadata["parameters"]["ior"] = ior_to_json(ior)
        self.channels = channels_of(self.name, wavelengths, reflectance, index, None if ior is None else outside)
        self._fresnel = fresnel.make(self.name, "auto", index, outside)
        self._scale = np.atleast_1d(np.asarray(1.0 if reflectance is None else reflectance, dtype=np.float64))

    def _value(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        return np.zeros((pair.cos_i.size, 1))

    def _evaluate_block(
        self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray, start: int, stop: int
    ) -> bool:
        # the same without the geometry, which nothing depends on
        if not in_plain_domain(theta_i[start:stop], theta_o[start:stop], delta_phi[start:stop]):
            return False
        out[start:stop] = 0
        return True

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        values = self._scale * self._fresnel(np.cos(theta_i), np.sin(theta_i) ** 2)
        return np.array(np.broadcast_to(values, (theta_i.size, len(self.channels))))
