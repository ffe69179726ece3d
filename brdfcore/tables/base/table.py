"""What every stored representation is: a `Brdf` made of named arrays, with an identity and a known error."""

from __future__ import annotations

import hashlib
import json
import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.parameters import Parameter
from brdfcore.base.registry import FORMATS
from brdfcore.metrics.lobes import Lobes
from brdfcore.tables.base.local_error import ROUNDING, LocalError
from brdfcore.tables.base.seen import EVERYWHERE, Seen
from brdfcore.version import __version__

#: Called as progress(done, total, stage) while a table is built and measured.
Progress = Callable[[int, int, str], None]

#: theta_i nodes of a stored delta part, a quarter of a degree apart whatever the grid: Fresnel's reflectance between
#: them is good to 1e-4 (glass) to 2e-3 (an index of 1.01), but for the kink of total reflection.
DELTA_NODES = 361
#: Pairs of directions whose values wait at a time, while their half-widths are found: they stay in a cache.
_PAIRS_AT_ONCE = 65_536
#: A delta reflectance may pass 1 by this much: rounding.
_DELTA_SLACK = 1e-9


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """What `tabulate` was asked for; see there. shape None means the representation's default."""

    shape: tuple[int, ...] | None = None
    interpolation: str = "linear"
    negatives: str = "keep"
    fold: frozenset[str] = frozenset()
    #: What a representation's `candidates` finds out about the source once for all of them; opaque to others.
    prepared: Any = None
    #: Where the source has its lobes, if that was found already.
    lobes: Lobes | None = None
    #: Angles that the table is wanted for; a representation that gains nothing by it leaves this aside.
    seen: Seen = EVERYWHERE
    #: Expected bytes of the table, 0 if the representation can't say: what is fast enough goes by them.
    nbytes: int = 0


class ArrayLookUp(NamedTuple):
    """A look-up over the array-API standard: `from_angles(xp, theta_i, theta_o, delta_phi, nodes, settings)` and
    `from_vectors(xp, wi, wo, nodes, settings)` of a `module`, angles (N,), vectors (N, 3); the `nodes` by name."""

    module: Any
    nodes: dict[str, npt.NDArray[Any]]
    settings: Any


class Table(Brdf):
    """A representation that is stored: arrays, attributes, flags, an id and a measured error.

    A subclass keeps every array that a look-up reads in `to_arrays()` and every number that changes an
    answer in `attributes()`; store, id and nbytes follow from these two.

    id, nbytes and answers belong to the arrays as they were given: to change a value, make another table.

    error   dict of the measured error against the source (`build.tabulate` fills it), {} if never measured.
    local_error  how far it is off, by direction (`build.local_error` fills it); None: what `uncertainty` does then is
            said there.
    source  dict with name, format, sha256 of what the table was built from.

    >>> table = bc.tabulate(bc.model("lambert"), "angle_grid", shape=(4, 4, 5))
    >>> table.nbytes, len(table.id), table.error["l1"] < 1e-6  # 4 x 4 x 5 nodes, float32
    (320, 64, True)
    """

    #: Registry name.
    name: ClassVar[str]
    #: Raised whenever `_evaluate` answers differently for the same arrays.
    EVALUATION_VERSION: ClassVar[int] = 1
    #: Files of an older one are refused: their look-ups were wrong.
    OLDEST_EVALUATION: ClassVar[int] = 1
    #: What `tabulate` may be asked for, beside source and channels.
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    #: One sentence for lists.
    SUMMARY: ClassVar[str] = ""
    #: Whether "auto" considers it: False for what another representation is always better at.
    FOR_AUTO: ClassVar[bool] = True
    #: Relative rounding of the stored nodes of a file's own table.
    NODES_ROUNDED: ClassVar[float] = 0.0
    #: Bytes have to grow by at least the excess of an error over a tolerance to this power: steps of `candidates` that
    #: are nearer are left out. 0: each is tried.
    STEP: ClassVar[float] = 0.9
    #: Whether its error goes by the half vector, not by the distance to the mirror direction: cells of `local_error`.
    OFF_BY_HALF_VECTOR: ClassVar[bool] = False
    _fixed = True

    def __init__(self, channels: Channels, flags: Mapping[str, bool]) -> None:
        super().__init__()
        self.channels = channels
        self.bilateral = bool(flags["bilateral"])
        self.reciprocal = bool(flags["reciprocal"])
        self.energy_conserving = bool(flags["energy_conserving"])
        self.non_negative = bool(flags["non_negative"])
        self.error: dict[str, Any] = {}
        self.local_error: LocalError | None = None
        self.source: dict[str, Any] = {}

    @abstractmethod
    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Every array a look-up touches, by name; not copied."""

    def attributes(self) -> dict[str, Any]:
        """JSON-ready settings that change an answer, e.g. the interpolation."""
        return {}

    @classmethod
    @abstractmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        """The inverse of `to_arrays` and `attributes`; raises `FileFormatError` where they do not fit together."""

    def array_look_up(self) -> ArrayLookUp:
        """Its look-up over the array-API standard, which `brdfcore.array_function` wraps."""
        raise InputError(
            "no_array_function",
            f"{self.name} has no function of arrays; tabulate the material as half_difference, lobe_grid, angle_grid "
            "or vndf_warp",
            where="table",
            got=self.name,
            expected="half_difference, lobe_grid, angle_grid or vndf_warp",
        )

    @classmethod
    @abstractmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Sample `source`; raises `InputError` where the options or the source do not suit."""

    @classmethod
    def can_hold(cls, source: Brdf) -> bool:
        """Whether `build` can represent `source` at all; what "auto" considers."""
        return True

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        """Options to try, smallest first, with their expected `nbytes`; with `max_bytes`, the best that should fit."""
        return (options,)

    @classmethod
    def largest_gain(cls, interpolation: str, ratio: float) -> float:
        """Factor that the error may fall by from one table to one of `ratio` times its bytes, at most; inf: unknown."""
        return math.inf

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        if self.local_error is None and self.measured_against:
            raise InputError(
                "missing_uncertainty",
                f"this {self.name} table holds no uncertainty: an older version made it, or it was made from a table "
                "without; make it again from its source (brdf tabulate SOURCE -o FILE)",
                where="uncertainty",
                got=None,
                expected="a table made by this version",
            )
        some = np.empty((min(len(out), _PAIRS_AT_ONCE), out.shape[1]), out.dtype)
        for start in range(0, len(out), _PAIRS_AT_ONCE):
            angles = [a[start : start + _PAIRS_AT_ONCE] for a in (theta_i, theta_o, delta_phi)]
            width = out[start : start + _PAIRS_AT_ONCE]
            values = some[: len(width)]
            if not self._evaluate(angles[0], angles[1], angles[2], values):
                return False
            if self.local_error is None:
                rounding = max(ROUNDING * float(np.finfo(out.dtype).eps), self.NODES_ROUNDED)
                np.multiply(np.abs(values), out.dtype.type(rounding), out=width)
            else:
                self.local_error.half_widths(angles[0], angles[1], angles[2], values, width)
        return True

    @property
    def measured_against(self) -> bool:
        """Whether there is a source that the table differs from; a table as a file holds it has none."""
        return bool(self.error)

    @property
    def flags(self) -> dict[str, bool]:
        return {name: getattr(self, name) for name in FLAGS}

    @property
    def nbytes(self) -> int:
        """Bytes of every array a look-up touches."""
        return sum(a.nbytes for a in self.to_arrays().values())

    @cached_property
    def id(self) -> str:
        """sha256 over all that evaluate() reads, hex: representation and its evaluation version, channels,
        flags, attributes, and each array as name, dtype, shape, bytes."""
        return self.computed_id()

    def computed_id(self) -> str:
        """`id` from the arrays as they are now, whatever happened to them since `id` was first asked for."""
        digest = hashlib.sha256()
        digest.update(json.dumps(self._identity(), sort_keys=True).encode())
        for name, array in sorted(self.to_arrays().items()):
            little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
            digest.update(json.dumps([name, little.dtype.str, list(little.shape)]).encode())
            digest.update(little.data)
        return digest.hexdigest()

    def _identity(self) -> dict[str, Any]:
        return {
            "representation": self.name,
            "evaluation_version": self.EVALUATION_VERSION,
            "channels": self.channels.to_json(),
            "channel_kind": self.channels.kind,
            "flags": self.flags,
            "attributes": self.attributes(),
        }

    def save(self, path: str | PathLike[str]) -> Self:
        """Write an HDF5 file, whole and readable or not at all (`tables.base.file.save`)."""
        from brdfcore.tables.base.file import save

        beside = {"source": self.source, "report": self.report, "error": self.error, "metadata": self.metadata}
        header = {**self._identity(), "id": self.computed_id(), **beside, "code_version": __version__}
        groups: dict[str, Mapping[str, npt.NDArray[Any]]] = {"arrays": self.to_arrays()}
        if self.local_error is not None:
            header["uncertainty"], groups["uncertainty"] = self.local_error.attributes(), self.local_error.arrays
        # by its name, as a representation knows nothing of the reader
        read: Callable[[Path], Self] = FORMATS.load("table")().read
        return save(Path(path), header, groups, read)

    def __reduce__(self) -> tuple[Any, ...]:
        # by its arrays: what was compiled or derived on the way is made anew
        beside = {key: getattr(self, key) for key in ("error", "local_error", "source", "report", "metadata")}
        arrays, attributes = self.to_arrays(), self.attributes()
        return _rebuilt, (type(self), arrays, attributes, self.channels, self.flags, beside)

    def describe(self) -> dict[str, Any]:
        return {
            **super().describe(),
            "representation": self.name,
            "nbytes": self.nbytes,
            "id": self.id,
            "error": self.error,
            "source": self.source,
            "attributes": self.attributes(),
            "shapes": {name: list(a.shape) for name, a in self.to_arrays().items()},
        }


def _rebuilt(
    cls: type[Table],
    arrays: Mapping[str, npt.NDArray[Any]],
    attributes: Mapping[str, Any],
    channels: Channels,
    flags: Mapping[str, bool],
    beside: Mapping[str, Any],
) -> Table:
    table = cls.from_arrays(arrays, attributes, channels, flags)
    for key, value in beside.items():
        setattr(table, key, value)
    return table


def sampled_delta(source: Brdf) -> npt.NDArray[np.float64] | None:
    """The delta part of `source` at `DELTA_NODES` uniform nodes of theta_i in [0, pi/2], (n, channels); None without.

    Raises `InputError` where it is not within [0, 1]: no surface reflects more than it receives.
    """
    if not source.has_delta:
        return None
    delta = source.delta_reflectance(np.linspace(0, np.pi / 2, DELTA_NODES)).astype(np.float64, copy=False)
    if not _is_reflectance(delta):
        got = [float(delta.min()), float(delta.max())]
        raise InputError(
            "bad_delta",
            f"the source's delta reflectance goes from {got[0]:g} to {got[1]:g}; a table holds values within [0, 1]",
            where="source",
            got=[str(x) for x in got],
            expected="[0, 1]",
        )
    return np.clip(delta, 0, 1)


def checked_delta(name: str, arrays: Mapping[str, npt.NDArray[Any]], channels: int) -> npt.NDArray[np.float64] | None:
    """`arrays["delta"]`, if there is one: float64 (n >= 2, channels), within [0, 1]; else `FileFormatError`."""
    delta = arrays.get("delta")
    if delta is None:
        return None
    fits = delta.dtype == np.float64 and delta.ndim == 2 and delta.shape[0] >= 2 and delta.shape[1] == channels
    if not fits or not _is_reflectance(delta):
        got = f"from {delta.min()} to {delta.max()}" if fits else f"{delta.dtype} {delta.shape}"
        expected = f"float64 (n, {channels}) with n >= 2, within [0, 1]"
        raise FileFormatError(
            "bad_field", f"{name}: delta is {got}; expected {expected}", where="delta", got=got, expected=expected
        )
    return delta


def _is_reflectance(delta: npt.NDArray[Any]) -> bool:
    return bool(((delta >= -_DELTA_SLACK) & (delta <= 1 + _DELTA_SLACK)).all())  # false for NaN


def interpolated_delta(delta: npt.NDArray[np.float64], theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Linear between the uniform theta_i nodes of a stored delta part; (n,) -> (n, channels)."""
    nodes = np.linspace(0, np.pi / 2, delta.shape[0])
    return np.stack([np.interp(theta_i, nodes, column) for column in delta.T], axis=-1)
