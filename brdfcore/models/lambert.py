"""Lambert's perfectly diffuse reflector."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.base.geometry import PairGeometry
from brdfcore.base.parameters import Parameter
from brdfcore.models.base.model import Model, channels_for, in_plain_domain


class Lambert(Model):
    """f = reflectance/pi, 1/sr, for every pair of directions.

    reflectance: the directional-hemispherical reflectance, [0, 1], a number or one per channel.
    Raises `InputError` outside that range.
    Source: J. H. Lambert, Photometria, 1760; F. Nicodemus et al., NBS Monograph 160, 1977, doi:10.6028/NBS.MONO.160.
    """

    name: ClassVar[str] = "lambert"
    _smooth_elsewhere = True
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter("reflectance", "rho", "directional-hemispherical reflectance", 0.5, bounds=(0.0, 1.0)),
    )
    SUMMARY: ClassVar[str] = "Perfectly diffuse: the same radiance in every direction."
    FORMULA: ClassVar[str] = "f = reflectance/pi"
    REFERENCE: ClassVar[str] = "F. Nicodemus et al., NBS Monograph 160, 1977, doi:10.6028/NBS.MONO.160"

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        reflectance = self.parameters["reflectance"]
        self.channels = channels_for(self.name, reflectance)
        self._f = np.atleast_1d(np.asarray(reflectance, dtype=np.float64)) / np.pi

    def _value(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        return np.broadcast_to(self._f, (pair.cos_i.size, self._f.size))

    def _evaluate_block(
        self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray, start: int, stop: int
    ) -> bool:
        # the same without the geometry, which a constant does not need
        if not in_plain_domain(theta_i[start:stop], theta_o[start:stop], delta_phi[start:stop]):
            return False
        out[start:stop] = self._f
        return True
