"""How far a table is off, direction by direction: the half-width of a 95 % interval, learnt when it was built.

    u(theta_i, theta_o, delta_phi) = relative(cell) by_incidence(theta_i) factor(channel) (|f_r| + floor(channel))

`build.local_error` learns it from fresh directions and calibrates it on others; `tables.base.error_cells` says what a
cell is. It is stored beside the table and is no part of its id: no value depends on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import FileFormatError
from brdfcore.tables.base.error_cells import BY_DISTANCE, INCIDENCES, LEVELS, Cells, cells, map_of, mean_by_incidence

Float64Array = npt.NDArray[np.float64]

#: Half-width relative to |f_r|: 2^((code - ZERO) / PARTS), 9 % from one to the next, 3e-8 to 118; code 0 is 0.
_ZERO_CODE, _PARTS = 200, 8
#: Part of the errors that an interval holds; part of a table's bytes that intervals may take.
LEVEL, SHARE = 0.95, 0.1
#: Part of held-out errors that calibration aims at: in a range of theta_i, and in each part of it, as an error varies
#: between a table's own nodes.
HELD_LEVEL, PART_LEVEL = 0.957, 0.95
#: |f_r| below which an error no longer falls with it, relative to the channel's median.
_FLOOR = 1e-3
#: Smallest factor of an incidence.
_LEAST_FACTOR = 0.25
#: Last bits that a look-up may be off by, whatever the table: of the type of the angles.
ROUNDING = 8.0
_KINDS = {"codes": np.uint8, "by_incidence": np.float32, "floors": np.float32, "factors": np.float32}


class LocalError:
    """Half-widths by cell.

    codes         uint8 (cells, 1 or channels)
    by_incidence  float32 (42,)        factor of each range of `error_cells.INCIDENCES`
    floors        float32 (channels,)  1/sr, added to |f_r|: an error does not vanish with f_r
    factors       float32 (channels,)
    """

    def __init__(self, level: int, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        self.level = level
        self.arrays = {name: np.require(arrays[name], requirements=("C", "A", "W")) for name in _KINDS}

    @property
    def cells(self) -> Cells:
        return cells(self.level)

    @property
    def nbytes(self) -> int:
        """Bytes of what is stored."""
        return sum(a.nbytes for a in self.arrays.values())

    @cached_property
    def _shared(self) -> dict[np.dtype[Any], tuple[Any, ...]]:
        """What a kernel takes beside angles and values, by their dtype."""
        found, c = {}, self.cells
        width = self.arrays["codes"].shape[1]
        rows, map_o, bases, scale = c.found_by
        by_step = self.arrays["by_incidence"][map_of(INCIDENCES)]
        for dtype in (np.float32, np.float64):
            # a look-up in this type rounds too
            relative = np.maximum(decoded(), ROUNDING * np.finfo(dtype).eps)[self.arrays["codes"].reshape(-1)]
            parts = (relative.astype(np.float32), rows, map_o, bases, by_step)
            numbers = [self.arrays[name].astype(dtype) for name in ("floors", "factors")]
            stride = () if numbers[0].size == 1 else (np.int32(width > 1),)
            found[np.dtype(dtype)] = (*parts, *numbers, scale, *stride)
        return found

    def half_widths(
        self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, values: FloatArray, out: FloatArray
    ) -> None:
        """From f_r in `values` (n, channels) to half-widths in `out`, another array; angles (n,) in the plain domain.
        All contiguous and of one dtype."""
        kernels = self.cells.kernels
        kernel = {1: kernels.widths_one, 3: kernels.widths_three}.get(out.shape[1], kernels.widths_many)
        parts = self._shared[out.dtype]
        kernel(theta_i.size, theta_i, theta_o, delta_phi, values.reshape(-1), out.reshape(-1), *parts)

    def attributes(self) -> dict[str, Any]:
        return {"level": self.level}

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, npt.NDArray[Any]], attributes: Mapping[str, Any], channels: int
    ) -> LocalError:
        """The inverse of `arrays` and `attributes`; `FileFormatError` for what no table can have."""
        level = attributes.get("level")
        if isinstance(level, bool) or not isinstance(level, int) or not 0 <= level < LEVELS:
            raise _bad("level", repr(level)[:40], f"a whole number below {LEVELS}")
        count = cells(level).count
        shapes: dict[str, tuple[tuple[int, ...], ...]] = {
            "codes": ((count, 1), (count, channels)),
            "by_incidence": ((len(INCIDENCES) + 1,),),
            "floors": ((channels,),),
            "factors": ((channels,),),
        }
        for name, kind in _KINDS.items():
            array = arrays.get(name)
            if array is None or array.dtype != kind or array.shape not in shapes[name]:
                got = "nothing" if array is None else f"{array.dtype} {array.shape}"
                raise _bad(name, got, f"{np.dtype(kind)} {' or '.join(map(str, shapes[name]))}")
            if array.dtype.kind == "f" and not (np.isfinite(array) & (array >= 0)).all():
                raise _bad(name, "negative or not finite", "finite numbers >= 0")
        return cls(level, arrays)


def encoded(relative: Float64Array) -> npt.NDArray[np.uint8]:
    """Codes of relative half-widths, rounded up; what is not finite gets the largest."""
    with np.errstate(divide="ignore"):
        code = np.ceil(np.log2(np.where(np.isfinite(relative), relative, np.inf)) * _PARTS - 1e-9) + _ZERO_CODE
    return np.where(relative == 0, 0, np.clip(code, 1, 255)).astype(np.uint8)


def decoded() -> Float64Array:
    """Relative half-width of each code."""
    values = 2.0 ** ((np.arange(256) - _ZERO_CODE) / _PARTS)
    values[0] = 0.0
    return np.asarray(values, np.float64)


def fitting(nbytes: int, channels: int, *, by_half: bool = False) -> tuple[int, int]:
    """(level of the cells, codes in each) of the most cells within `SHARE` of a table's bytes; at least the first level
    by distance, or by half vector."""
    room = SHARE * nbytes - 4 * (len(INCIDENCES) + 1 + 2 * channels)
    levels = range(BY_DISTANCE, LEVELS) if by_half else range(BY_DISTANCE)
    choices = [(level, wide) for level in levels for wide in sorted({1, channels})]
    # codes of each channel before finer cells: channels differ more within a cell than neighbouring cells do
    fits = [(w > 1 and n > levels[2], n, w) for n, w in choices if cells(n).count * w <= room]
    _, level, wide = max(fits, default=(False, levels[0], 1))
    return level, wide


def quantile(scores: Float64Array, level: float = LEVEL) -> Float64Array:
    """The `level` quantile of n exchangeable scores along axis 1, as conformal prediction takes it; (rows, columns)."""
    n = scores.shape[1]
    rank = min(int(np.ceil(level * (n + 1))), n) - 1
    return np.asarray(np.partition(scores, rank, axis=1)[:, rank])


def made_of(level: int, wide: int, values: Float64Array, error: Float64Array, each: int) -> LocalError:
    """From values and errors, (cells each, channels), at `each` directions of every cell; not yet calibrated."""
    count, channels = cells(level).count, values.shape[1]
    floors, factors = floors_of(values), np.ones(channels)
    relative = error / (np.abs(values) + floors)
    if wide == 1 and channels > 1:
        typical = np.median(relative, axis=0)
        known = (typical > 0) & np.isfinite(typical)
        factors[known] = typical[known] / (typical[known].mean() if known.any() else 1)
        relative = relative / factors
    arrays: dict[str, npt.NDArray[Any]] = {
        "codes": encoded(quantile(relative.reshape(count, -1, wide))),
        "by_incidence": np.ones(len(INCIDENCES) + 1, np.float32),
        "floors": floors.astype(np.float32),
        "factors": factors.astype(np.float32),
    }
    return LocalError(level, arrays)


def floors_of(values: Float64Array) -> Float64Array:
    """What is added to |f_r| of each channel."""
    return np.asarray(np.maximum(_FLOOR * np.median(np.abs(values), axis=0), 1e-30))


def calibrated(
    learnt: LocalError, factor: Float64Array, cell: npt.NDArray[Any], own: Float64Array | None
) -> LocalError:
    """`learnt` times `factor` (incidences,); the source's `own` relative half-widths (n, channels or 1), at directions
    in the cells `cell` (n,), are added in squares."""
    # errors far below what codes hold would leave no room for the source's own
    by_incidence = np.where(np.isfinite(factor), np.maximum(factor, _LEAST_FACTOR), 1.0)
    arrays = {**learnt.arrays, "by_incidence": by_incidence.astype(np.float32)}
    if own is not None:
        wide, count = arrays["codes"].shape[1], np.bincount(cell, minlength=learnt.cells.count)
        columns = own.T if wide > 1 else own.mean(axis=1)[None]
        rows = np.stack([np.bincount(cell, x, learnt.cells.count) / np.maximum(count, 1) for x in columns], axis=1)
        share = mean_by_incidence(learnt.level, by_incidence)[:, None]
        arrays["codes"] = encoded(np.hypot(decoded()[arrays["codes"]] * share, rows) / share)
    return LocalError(learnt.level, arrays)


def _bad(field: str, got: str, expected: str) -> FileFormatError:
    where = f"uncertainty/{field}"
    return FileFormatError(
        "bad_field", f"{where} is {got}; expected {expected}", where=where, got=got, expected=expected
    )
