"""What `a + b` and `number * brdf` make: combinations that are evaluated by their parts."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf, Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown


class Sum(Brdf):
    """a + b. Reciprocal, bilateral and non-negative if both are; energy conservation is not claimed."""

    def __init__(self, a: Brdf, b: Brdf) -> None:
        super().__init__()
        self.parts = (a, b)
        self.channels = Channels.common(a.channels, b.channels)
        self.bilateral = a.bilateral and b.bilateral
        self.reciprocal = a.reciprocal and b.reciprocal
        self.non_negative = a.non_negative and b.non_negative
        self.energy_conserving = False  # each may reflect all light
        self.has_delta = a.has_delta or b.has_delta
        self._analytic = a._analytic and b._analytic
        self.metadata = {"sum": [a.describe()["metadata"], b.describe()["metadata"]]}

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        a, b = (p.evaluate(theta_i, theta_o, delta_phi) for p in self.parts)
        np.add(a, b, out=out)
        return True

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        parts = []
        for p in self.parts:
            values = np.empty((wi.shape[0], len(p.channels)), out.dtype)
            p._evaluate_vectors(wi, wo, values)
            parts.append(values)
        np.add(parts[0], parts[1], out=out)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        a, b = (p._status(theta_i, theta_o, delta_phi) for p in self.parts)
        return np.maximum(a, b)  # the codes ascend from measured to outside: the weaker of the two

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        a, b = (p._delta_reflectance(theta_i) for p in self.parts)
        return a + b


class Scaled(Brdf):
    """factor * brdf, the factor a number >= 0 or one per channel; the delta part is scaled with it."""

    def __init__(self, part: Brdf, factor: Any) -> None:
        super().__init__()
        try:
            scale = np.atleast_1d(np.asarray(factor, dtype=np.float64))
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError("bad_factor", f"factor: expected numbers, got {shown(factor)}", where="factor") from error
        usable = scale.ndim == 1 and scale.size in (1, len(part.channels))
        if not usable or not (np.isfinite(scale) & (scale >= 0)).all():
            raise InputError(
                "bad_factor",
                f"factor: expected a number >= 0, or {len(part.channels)} of them (one per channel); "
                f"got {shown(factor)}",
                where="factor",
                expected=f"1 or {len(part.channels)} finite numbers >= 0",
            )
        self.part = part
        self.factor = scale
        self.channels = part.channels
        self.bilateral, self.reciprocal, self.non_negative = part.bilateral, part.reciprocal, part.non_negative
        self.energy_conserving = part.energy_conserving and bool((scale <= 1).all())
        self.has_delta = part.has_delta
        self._analytic = part._analytic
        self.metadata = {"scaled": part.describe()["metadata"], "factor": scale.tolist()}
        self.report = part.report

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        self.part.evaluate(theta_i, theta_o, delta_phi, out=out)
        np.multiply(out, self.factor.astype(out.dtype), out=out)
        return True

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        self.part._evaluate_vectors(wi, wo, out)
        np.multiply(out, self.factor.astype(out.dtype), out=out)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return self.part._status(theta_i, theta_o, delta_phi)

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return self.part._delta_reflectance(theta_i) * self.factor

    def _albedo(
        self, theta_i: npt.ArrayLike, points: int, azimuths: int, tolerance: float | None, budget: int
    ) -> tuple[FloatArray, FloatArray]:
        albedo, error = self.part._albedo(theta_i, points, azimuths, tolerance, budget)
        return albedo * self.factor, error * self.factor
