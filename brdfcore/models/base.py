"""What every analytic model is: declared parameters, a formula of the pair geometry, float64 inside."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.brdf import RGB, VALUE, Brdf, Channels
from brdfcore.conventions import FloatArray
from brdfcore.errors import InputError
from brdfcore.geometry import PairGeometry, pair_from_angles, pair_from_vectors
from brdfcore.parameters import Parameter, resolve


class Model(Brdf):
    """An analytic BRDF. A subclass gives `name`, `PARAMETERS`, documentation and `_value`.

    Computed in float64 whatever the input; float32 in gives float32 out, rounded once at the end.
    """

    name: ClassVar[str]
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    #: One sentence for lists, the formula as text, and its source with DOI.
    SUMMARY: ClassVar[str] = ""
    FORMULA: ClassVar[str] = ""
    REFERENCE: ClassVar[str] = ""

    def __init__(self, **parameters: Any) -> None:
        super().__init__()
        self.parameters = resolve(self.name, self.PARAMETERS, parameters)
        self.metadata = {"model": self.name, "parameters": {k: _jsonable(v) for k, v in self.parameters.items()}}

    @abstractmethod
    def _value(self, pair: PairGeometry) -> npt.NDArray[np.float64]:
        """f_r of n pairs, (n, channels) or (n, 1), float64."""

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        pair = pair_from_angles(*(x.astype(np.float64, copy=False) for x in (theta_i, theta_o, delta_phi)))
        self._store(self._value(pair), out)
        return True

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        self._store(self._value(pair_from_vectors(wi, wo)), out)

    @staticmethod
    def _store(values: npt.NDArray[np.float64], out: FloatArray) -> None:
        with np.errstate(over="ignore", under="ignore"):  # float32 rounds a peak above 3e38 to inf, as it should
            out[...] = values


def channels_for(owner: str, *values: Any) -> Channels:
    """Channels that parameters of these sizes need: one value, or as many as the longest list.

    Three are R, G, B; other counts are numbered. Lists of different lengths are an `InputError`.
    """
    sizes = {np.size(v) for v in values if v is not None and np.size(v) > 1}
    if not sizes:
        return VALUE
    if len(sizes) > 1:
        raise InputError(
            "channels_differ",
            f"{owner}: parameters are given for {sorted(sizes)} channels; give one number each, or lists of one length",
            where=owner,
            got=sorted(sizes),
        )
    count = sizes.pop()
    return RGB if count == 3 else Channels([f"c{k}" for k in range(count)])


def _jsonable(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [_jsonable(x) for x in value.tolist()]
    if isinstance(value, complex):
        return {"n": value.real, "k": value.imag}
    if isinstance(value, (list, tuple)):
        return [_jsonable(x) for x in value]
    return value
