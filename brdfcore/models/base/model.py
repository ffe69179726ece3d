"""What every analytic model is: declared parameters, a formula of the pair geometry, and two tiers of precision."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, partial
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB, VALUE, Channels
from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI, FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.geometry import PairGeometry, angles_from_vectors, pair_from_angles, pair_from_vectors
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.kernels.machine import blocks

Float64Array = npt.NDArray[np.float64]

#: Added to the parameters of every model that names a fast kernel.
PRECISION = Parameter(
    "precision",
    "",
    "exact computes in float64, fast in float32 by a compiled parallel kernel, to 2e-5 of max(f, 1e-6 of the peak)",
    "exact",
    kind="choice",
    choices=("exact", "fast"),
)
#: cos theta below which the fast tier leaves directions given as vectors to the exact formula: float64 angles, off by
#: 2e-16 rad, move the half vector by 2e-16/cos theta, which has to stay small beside the narrowest lobe, 1e-8.
_LOW_COS = 0.01


@dataclass(frozen=True, slots=True)
class FastArguments:
    """What a fast kernel reads of a model.

    factor, base  float64 (channels,) or (1,): f = factor lobe + base.
    numbers       float32 (channels, k), see the kernel.
    choices       whole numbers that choose among the kernel's formulas.
    """

    factor: Float64Array
    base: Float64Array
    numbers: npt.NDArray[np.float32]
    choices: tuple[int, ...]


class Model(Brdf):
    """An analytic BRDF. A subclass gives `name`, `PARAMETERS`, documentation and `_value`.

    precision="exact" computes in float64 whatever the input; float32 in gives float32 out, rounded once at the end.
    precision="fast", for the subclasses that name a kernel in `FAST` and give `_fast_arguments`: float32 with
    polynomials for the elementary functions, in a compiled parallel kernel (the `core` extra; `MissingExtraError`
    without it). Small differences of angles are formed in the input's dtype, so the width of a lobe does not matter.
    Error at most 2e-5 of max(f, 1e-6 of the peak); the lobes in `kernels.models` name the exceptions.
    From vectors it costs nearly what the exact tier does, as checking and normalising them in float64 is most of the
    work. Albedos are those of the exact tier.
    """

    name: ClassVar[str]
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    #: One sentence for lists, the formula as text, and its source with DOI.
    SUMMARY: ClassVar[str] = ""
    FORMULA: ClassVar[str] = ""
    REFERENCE: ClassVar[str] = ""
    #: "module:kernel" of the fast tier, "" if there is none.
    FAST: ClassVar[str] = ""
    _checks_domain = True

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if cls.FAST and PRECISION not in cls.PARAMETERS:
            cls.PARAMETERS = (*cls.PARAMETERS, PRECISION)

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__()
        self.parameters = resolve(self.name, self.PARAMETERS, parameters)
        self.metadata = {"model": self.name, "parameters": {k: _jsonable(v) for k, v in self.parameters.items()}}
        self._fast = self.parameters.get("precision") == "fast"
        if self._fast:
            _kernel(self.FAST)  # a missing extra is said now, not at the first look-up

    def __reduce__(self) -> tuple[Any, ...]:  # what a model caches, compiled kernels among it, does not travel
        return _remade, (type(self), dict(self.parameters), self.metadata, self.report)

    @abstractmethod
    def _value(self, pair: PairGeometry) -> Float64Array:
        """f_r of n pairs, (n, channels) or (n, 1), float64."""

    def _fast_arguments(self) -> FastArguments:
        """What the kernel named by `FAST` reads."""
        raise NotImplementedError

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        if self._fast:
            arguments = self._fast_by_dtype[theta_i.dtype]
            kernel = _kernel(self.FAST)
            return bool(kernel(theta_i.size, theta_i, theta_o, delta_phi, out.reshape(-1), *arguments) == 0)
        return blocks.run(partial(self._evaluate_block, theta_i, theta_o, delta_phi, out), theta_i.size)

    def _evaluate_block(
        self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray, start: int, stop: int
    ) -> bool:
        angles = theta_i[start:stop], theta_o[start:stop], delta_phi[start:stop]
        if not in_plain_domain(*angles):
            return False
        pair = pair_from_angles(*(x.astype(np.float64, copy=False) for x in angles))
        self._store(self._value(pair), out[start:stop])
        return True

    def _evaluate_vectors(self, wi: Float64Array, wo: Float64Array, out: FloatArray) -> None:
        blocks.run(partial(self._evaluate_vectors_block, wi, wo, out), wi.shape[0])

    def _evaluate_vectors_block(
        self, wi: Float64Array, wo: Float64Array, out: FloatArray, start: int, stop: int
    ) -> bool:
        i, o = wi[start:stop], wo[start:stop]
        if not self._fast:
            self._store(self._value(pair_from_vectors(i, o)), out[start:stop])
            return True
        # float64 angles also for float32 vectors, whose differences float32 angles would round away
        values = np.empty(out[start:stop].shape)
        self._evaluate(*angles_from_vectors(i, o), values)
        # towards the horizon an angle has not the digits of the vector's z
        low = (i[:, 2] < _LOW_COS * np.linalg.norm(i, axis=1)) | (o[:, 2] < _LOW_COS * np.linalg.norm(o, axis=1))
        if low.any():
            values[low] = self._value(pair_from_vectors(i[low], o[low]))
        self._store(values, out[start:stop])
        return True

    @staticmethod
    def _store(values: Float64Array, out: FloatArray) -> None:
        with np.errstate(over="ignore", under="ignore"):  # float32 rounds a peak above 3e38 to inf, as it should
            out[...] = values

    def _albedo(
        self, theta_i: npt.ArrayLike, points: int, azimuths: int, tolerance: float | None, budget: int
    ) -> tuple[FloatArray, FloatArray]:
        if not self._fast:
            return super()._albedo(theta_i, points, azimuths, tolerance, budget)
        # rounding of 1e-7 a point would keep a refined integral from settling
        return self._exact_tier._albedo(theta_i, points, azimuths, tolerance, budget)

    @cached_property
    def _exact_tier(self) -> Model:
        exact: Model = object.__new__(type(self))
        exact.__dict__.update(self.__dict__, _fast=False)
        return exact

    @cached_property
    def _fast_by_dtype(self) -> dict[np.dtype[Any], tuple[Any, ...]]:
        from brdfcore.kernels.base.pair_geometry import angle_constants
        from brdfcore.kernels.models.lobe_blocks import ends

        a = self._fast_arguments()
        count = len(self.channels)
        return {
            np.dtype(t): (angle_constants(t), ends(a.factor, a.base, count, t), a.numbers, *a.choices)
            for t in (np.float32, np.float64)
        }


@cache
def _kernel(path: str) -> Callable[..., Any]:
    import_module("brdfcore.kernels.machine.jit")  # first: without numba its error names the extra
    module, _, name = path.partition(":")
    kernel: Callable[..., Any] = getattr(import_module(module), name)
    return kernel


def in_plain_domain(theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> bool:
    """Whether a block needs no `conventions.check_domain`. Extremes with NaN are NaN, which compares false; beside a
    numpy number the Python number HALF_PI takes its type, so that each type has its own pi/2."""
    return bool(
        theta_i.min() >= 0
        and theta_i.max() <= HALF_PI
        and theta_o.min() >= 0
        and theta_o.max() <= HALF_PI
        and delta_phi.min() >= -DELTA_PHI_DIRECT
        and delta_phi.max() <= DELTA_PHI_DIRECT
    )


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


def _remade(cls: type[Model], parameters: dict[str, Any], metadata: dict[str, Any], report: dict[str, Any]) -> Model:
    """A model from a pickle, without repeating the warnings of its first making."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        made = cls(**parameters)
    made.metadata, made.report = metadata, report
    return made
