"""MERL's layout: a plain lattice over theta_h (square-root spaced), theta_d and phi_d, f_r itself at its nodes.

The layout of the MERL database (W. Matusik, H. Pfister, M. Brand, L. McMillan, "A data-driven reflectance model", ACM
Trans. Graph. 22(3), 2003, DOI 10.1145/882262.882343) as a representation: what an exchange with other tools needs, and
the yardstick that `half_difference` is measured against.

Cells and nodes. A direction belongs to the cell that the floor of its coordinate names, and the value of a cell stands
for its middle. An interpolation that takes value i for the point i, the lower edge of cell i, shifts the material by
half a cell, towards the mirror direction: a sharp lobe comes out narrower and its energy is lost. Here "nearest" is the
usual practice, floor, and the other interpolations place the nodes in the middle of their cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.geometry import angles_from_vectors
from brdfcore.base.parameters import Parameter, shown
from brdfcore.base.status import Status
from brdfcore.metrics import ALBEDO_SLACK, reciprocity_defect
from brdfcore.tables.base.sampled import (
    INTERPOLATION,
    SampledTable,
    bad_field,
    check_interpolation,
    stored_interpolation,
    without_subnormals,
)
from brdfcore.tables.base.table import DELTA_NODES, BuildOptions, Progress, checked_delta, sampled_delta

#: Cells of theta_h, theta_d and phi_d in the files of the MERL database.
MERL_SHAPE = (90, 90, 180)
#: Where in its cell a value belongs, by name: the part of the cell below it.
CELLS = {"centre": 0.5, "lower_edge": 0.0}
#: Cells of theta_h that `candidates` tries for a tolerance; as many of theta_d, twice as many of phi_d.
LADDER = (32, 64, 90, 128)
#: theta_i, degrees, at which a table built from an energy conserving source is checked.
_ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)
#: Cells evaluated at a time while building: bounds the memory whatever the shape.
_CHUNK = 262_144
#: Most values: the kernels index in int32.
_MOST_VALUES = 2**31 - 1


class HalfAngleGrid(SampledTable):
    """f_r on a lattice of half and difference angles, float32; nearest cell, trilinear or monotone cubic.

    values : float32 (n_theta_h, n_theta_d, n_phi_d, channels), all finite; coordinates: `kernels.tables.half_angle`.
    filled : uint8 (n,), optional: a bit for each cell in that order, the first the highest of its byte, set where the
        source has no value and the cell holds a continuation (`continued`): where its middle is below the horizon of
        either direction, and where a file marks it. `status` reads it.
    delta : float64 (n, channels), optional, as in `AngleGrid`.
    cells : "centre" or "lower_edge", the point of its cell that a value belongs to.

    Reciprocal by construction. Look-ups in float32 for float32 angles, else in float64.
    """

    name = "half_angle_grid"
    SUMMARY = "MERL's layout: theta_h (square-root spaced), theta_d, phi_d, float32; for reciprocal materials"
    PARAMETERS = (
        Parameter("shape", "", "cells of theta_h, theta_d, phi_d", "90,90,180", kind="text"),
        INTERPOLATION,
    )
    #: For exchange: at equal size `half_difference` is more accurate.
    FOR_AUTO = False
    _checks_domain = True

    def __init__(
        self,
        values: npt.NDArray[np.float32],
        channels: Channels,
        flags: Mapping[str, bool],
        *,
        filled: npt.NDArray[np.uint8] | None = None,
        delta: npt.NDArray[np.float64] | None = None,
        interpolation: str = "linear",
        cells: str = "centre",
    ) -> None:
        super().__init__(channels, flags, interpolation, delta)
        # read-only memory is another type to the compiler, which would take seconds for its version
        self.values = np.require(values, requirements=("C", "A", "W"))
        self.filled, self.cells = filled, cells
        self._flat = self.values.reshape(-1)
        _, n_d, n_p, _ = values.shape
        self._steps = (np.int32(n_d * n_p), np.int32(n_p))

    @cached_property
    def _scales(self) -> dict[np.dtype[Any], Any]:
        from brdfcore.kernels.tables.half_angle import half_angle_scale

        shape = self.values.shape[:3]
        return {np.dtype(t): half_angle_scale(shape, CELLS[self.cells], t) for t in (np.float32, np.float64)}

    @cached_property
    def _kernel(self) -> Any:
        from brdfcore.kernels.tables import half_angle

        if self.interpolation == "monotone_cubic":
            return half_angle.cubic
        count = {1: "one", 3: "three"}.get(len(self.channels), "many")
        return getattr(half_angle, f"{self.interpolation}_{count}")

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        scale = self._scales[theta_i.dtype]
        outside = self._kernel(
            theta_i.size, theta_i, theta_o, delta_phi, self._flat, out.reshape(-1), scale, *self._steps
        )
        return bool(outside == 0)

    @cached_property
    def filled_cells(self) -> npt.NDArray[np.bool_]:
        """`filled` unpacked, (n_theta_h, n_theta_d, n_phi_d)."""
        shape = self.values.shape[:3]
        if self.filled is None:
            return np.zeros(shape, np.bool_)
        return np.unpackbits(self.filled, count=int(np.prod(shape))).astype(np.bool_).reshape(shape)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        """FILLED in a filled cell; EXTRAPOLATED where one has a part in the value, and past the last nodes."""
        from brdfcore.kernels.tables import half_angle_numpy as half_angle

        n_h, n_d, n_p = self.values.shape[:3]
        shift = CELLS[self.cells]
        theta_h, theta_d, _ = half_angle.half_angles(theta_i, theta_o, delta_phi)
        h, d, p = half_angle.indices_numpy(theta_i, theta_o, delta_phi, (n_h, n_d, n_p), shift)
        codes = np.full(theta_i.shape, Status.INTERPOLATED, np.uint8)
        if self.interpolation != "nearest":
            beyond = n_h * np.sqrt(theta_h / HALF_PI) - shift > n_h - 1
            beyond |= theta_d * (n_d / HALF_PI) - shift > n_d - 1
            leaning = half_angle.linear_numpy(h, d, p, self.filled_cells[..., None])[:, 0] > 0
            codes[beyond | leaning] = Status.EXTRAPOLATED
        codes[half_angle.nearest_numpy(h, d, p, self.filled_cells)] = Status.FILLED
        return codes

    # ---- build --------------------------------------------------------------------------------

    @classmethod
    def can_hold(cls, source: Brdf) -> bool:
        """Half a turn of phi_d holds a reciprocal material only; any other has to be asked for with fold=."""
        return source.reciprocal

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Sample `source` in the middle of each cell, those below the horizon `continued`; see `Table.build`."""
        shape = _checked_shape(options, len(source.channels))
        check_interpolation(cls.name, options.interpolation)
        if not source.reciprocal and "reciprocal" not in options.fold:
            defect = reciprocity_defect(source)
            raise InputError(
                "not_reciprocal",
                f"the material is not reciprocal (L1 defect {defect:.3g}): this layout keeps one value for both "
                "orders of the directions; pass fold='reciprocal' for their mean, or choose another representation",
                where="fold",
                got=defect,
                expected="a reciprocal material, or fold='reciprocal'",
            )
        values, valid = _sample(source, shape, options.fold, progress)
        filled = int(valid.size - valid.sum())
        continued(values, valid)
        done = [f"averaged over the {name} symmetry, as asked" for name in sorted(options.fold)]
        if filled:
            done.append(f"{filled} of {valid.size} cells with their middle below the horizon continued along theta_h")
        negative = int((values < 0).sum())
        if options.negatives == "zero" and negative:
            values = np.maximum(values, 0)
            done.append(f"{negative} negative node values set to zero, as asked")
        flags = {
            "bilateral": source.bilateral or "bilateral" in options.fold,
            "reciprocal": True,
            "energy_conserving": source.energy_conserving,
            "non_negative": bool((values >= 0).all()),
        }
        table = cls(
            values, source.channels, flags, filled=np.packbits(~valid) if filled else None,
            delta=sampled_delta(source), interpolation=options.interpolation,
        )  # fmt: skip
        if flags["energy_conserving"]:  # interpolating a lobe between nodes may add energy: measure, don't inherit
            table.energy_conserving = bool((table.albedo(np.radians(_ENERGY_ANGLES)) <= 1 + ALBEDO_SLACK).all())
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {**source.report, "done": [*source.report.get("done", []), *done]}
        if negative and options.negatives == "keep":
            table.report["negative_nodes"] = negative
        return table

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        ladder: Iterable[int] = LADDER
        if max_bytes is not None:
            each = 4 * len(source.channels) + 0.125  # a bit a cell says whether it is filled
            beside = 8 * DELTA_NODES * len(source.channels) if source.has_delta else 0
            room = min(max_bytes - beside, 4 * _MOST_VALUES)
            n = max(2, int((max(room, 1) / (2 * each)) ** (1 / 3)) + 1)
            while n > 2 and 2 * n**3 * each + 1 > room:
                n -= 1
            ladder = (n,)
        return [replace(options, shape=(n, n, 2 * n)) for n in ladder]

    # ---- arrays -------------------------------------------------------------------------------

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        arrays: dict[str, npt.NDArray[Any]] = {"values": self.values}
        if self.filled is not None:
            arrays["filled"] = self.filled
        return self._with_delta(arrays)

    def attributes(self) -> dict[str, Any]:
        return {"interpolation": self.interpolation, "cells": self.cells}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        values, filled = arrays.get("values"), arrays.get("filled")
        if values is None or values.dtype != np.float32 or values.ndim != 4 or not np.isfinite(values).all():
            got = "nothing" if values is None else f"{values.dtype} {values.shape}"
            raise bad_field(cls.name, "values", got, "finite float32 (n_theta_h, n_theta_d, n_phi_d, channels)")
        if min(values.shape[:3]) < 2 or values.shape[3] != len(channels) or values.size > _MOST_VALUES:
            expected = f"at least 2 cells an axis, {len(channels)} channel(s), < 2^31 values"
            raise bad_field(cls.name, "values", str(values.shape), expected)
        if flags["non_negative"] and values.min() < 0:
            expected = "no value below 0, as the flag non_negative says"
            raise bad_field(cls.name, "values", f"as low as {values.min()}", expected)
        size = -(-int(np.prod(values.shape[:3])) // 8)
        if filled is not None and (filled.dtype != np.uint8 or filled.shape != (size,)):
            raise bad_field(cls.name, "filled", f"{filled.dtype} {filled.shape}", f"uint8 ({size},): a bit a cell")
        cells = attributes.get("cells", "centre")
        if not isinstance(cells, str) or cells not in CELLS:
            raise bad_field(cls.name, "cells", shown(cells), " or ".join(CELLS))
        return cls(
            values, channels, flags, filled=filled, delta=checked_delta(cls.name, arrays, len(channels)),
            interpolation=stored_interpolation(cls.name, attributes), cells=cells,
        )  # fmt: skip


def continued(values: npt.NDArray[np.float32], valid: npt.NDArray[np.bool_]) -> None:
    """Give every cell that is not valid the value of the nearest valid one: in place.

    Along theta_h the next lower, else the next higher; where a whole column has none, from the next lower theta_d, else
    the next higher. At least one cell must be valid. Zeros instead would bleed into the cells above the horizon.
    """
    known = valid
    for axis in (0, 1):
        for direction in (1, -1):
            if known.all():
                return
            view = values if direction == 1 else np.flip(values, axis)
            seen = known if direction == 1 else np.flip(known, axis)
            place = np.arange(seen.shape[axis]).reshape([-1 if k == axis else 1 for k in range(3)])
            source = np.maximum.accumulate(np.where(seen, place, -1), axis)
            take = (source >= 0) & ~seen
            cells = list(np.nonzero(take))
            into = tuple(cells)
            cells[axis] = source[take]
            view[into] = view[tuple(cells)]
            reached = seen | (source >= 0)
            known = reached if direction == 1 else np.flip(reached, axis)


def cell_angles(
    shape: tuple[int, int, int], rows: slice, cells: str = "centre"
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """(theta_i, theta_o, delta_phi, valid) of the nodes of some rows of theta_h, each (rows, n_d, n_p), float64.

    valid: whether both directions are above the horizon; where not, the angles are 0.
    """
    n_h, n_d, n_p = shape
    shift = CELLS[cells]
    theta_h = (HALF_PI * ((np.arange(n_h)[rows] + shift) / n_h) ** 2)[:, None, None]
    theta_d = (HALF_PI * (np.arange(n_d) + shift) / n_d)[None, :, None]
    phi_d = (np.pi * (np.arange(n_p) + shift) / n_p)[None, None, :]
    # wi and its mirror image about the half vector, which is turned from the normal towards +x
    across, along = np.sin(theta_d) * np.cos(phi_d), np.cos(theta_d) + 0 * phi_d
    side = np.sin(theta_d) * np.sin(phi_d) + 0 * theta_h
    pairs = []
    for sign in (1, -1):
        x = np.cos(theta_h) * (sign * across) + np.sin(theta_h) * along
        z = np.cos(theta_h) * along - np.sin(theta_h) * (sign * across)
        pairs.append(np.stack([x, sign * side, z], axis=-1))
    wi, wo = pairs
    valid = (wi[..., 2] > 0) & (wo[..., 2] > 0)
    found = angles_from_vectors(wi.reshape(-1, 3), wo.reshape(-1, 3))
    theta_i, theta_o, delta_phi = (np.where(valid, a.reshape(valid.shape), 0) for a in found)
    return theta_i, theta_o, delta_phi, valid


def _checked_shape(options: BuildOptions, channels: int) -> tuple[int, int, int]:
    shape = options.shape or MERL_SHAPE
    size = channels
    for n in shape:
        size *= n
    if len(shape) != 3 or min(shape) < 2 or size > _MOST_VALUES:
        raise InputError(
            "bad_shape",
            f"shape = {list(shape)}: expected 3 numbers of cells (theta_h, theta_d, phi_d), each at least 2, "
            f"with fewer than 2^31 values in all; this is {size}",
            where="shape",
            got=list(shape),
            expected="3 whole numbers >= 2",
        )
    return (shape[0], shape[1], shape[2])


def _sample(
    source: Brdf, shape: tuple[int, int, int], fold: frozenset[str], progress: Progress | None
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """f_r of `source` in the middle of the cells, folds applied, and which of them are above the horizon."""
    n_h, n_d, n_p = shape
    values = np.zeros((*shape, len(source.channels)), np.float32)
    valid = np.zeros(shape, np.bool_)
    rows = max(1, _CHUNK // (n_d * n_p))
    for start in range(0, n_h, rows):
        part = slice(start, min(start + rows, n_h))
        *angles, good = cell_angles(shape, part)
        theta_i, theta_o, delta_phi = (a[good] for a in angles)
        f = source.evaluate(theta_i, theta_o, delta_phi)
        with np.errstate(over="ignore", invalid="ignore"):  # reported as not finite below
            if "reciprocal" in fold and not source.reciprocal:
                f = 0.5 * (f + source.evaluate(theta_o, theta_i, -delta_phi))
            if "bilateral" in fold and not source.bilateral:
                g = source.evaluate(theta_i, theta_o, -delta_phi)
                if "reciprocal" in fold and not source.reciprocal:
                    g = 0.5 * (g + source.evaluate(theta_o, theta_i, delta_phi))
                f = 0.5 * (f + g)
            single = without_subnormals(f.astype(np.float32))
        if not np.isfinite(single).all():
            k, c = (int(x) for x in np.argwhere(~np.isfinite(single))[0])
            degrees = [round(float(np.degrees(a[k])), 6) for a in (theta_i, theta_o, delta_phi)]
            raise InputError(
                "source_not_finite",
                f"the source is {float(f[k, c])} at theta_i, theta_o, delta_phi = {degrees} degrees; "
                "a float32 lattice cannot hold it",
                where="source",
                got=str(float(f[k, c])),
                expected="finite float32 values",
            )
        values[part][good] = single
        valid[part] = good
        if progress is not None:
            progress(part.stop, n_h, "sampling the source")
    return values, valid
