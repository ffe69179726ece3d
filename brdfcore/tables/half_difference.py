"""The representation for lobes: half/difference coordinates, a guide along theta_h, fitted half-precision nodes.

In these coordinates the mirror direction is one face of the lattice, theta_h = 0, so a lobe of any width lies along
an axis (S. Rusinkiewicz, "A new change of variables for efficient BRDF representation", EGWR 1998,
DOI 10.1007/978-3-7091-6453-2_2). The guide takes the lobe's shape out; what is left varies slowly.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from brdfcore.brdf import Brdf, Channels
from brdfcore.conventions import FloatArray
from brdfcore.errors import FileFormatError, InputError
from brdfcore.metrics import ALBEDO_SLACK
from brdfcore.parameters import Parameter
from brdfcore.status import Status
from brdfcore.tables.base import (
    DELTA_NODES,
    BuildOptions,
    Progress,
    Table,
    checked_delta,
    interpolated_delta,
    sampled_delta,
)
from brdfcore.tables.half_fit import FACTORS, Fitter, Layout, shape_for

#: Largest magnitude of a stored node: below float16's 65,504, so that rounding can't reach infinity.
_LARGEST = 60_000.0
#: Nodes a channel that `candidates` tries for a tolerance.
LADDER = (8_000, 24_000, 64_000, 128_000, 256_000, 512_000)
_ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)


class HalfDifference(Table):
    """f_r = guide(theta_h) K(theta_i, theta_o) values(theta_h, theta_d, phi_d), trilinear in warped coordinates.

    Coordinates, maps and K: `kernels.half_difference`. Folded by the source's flags: phi_d over a quarter turn if
    bilateral and reciprocal, half a turn if bilateral, else a whole one.

    Arrays:

        values  float16 (n_h, n_d, n_p, C)  nodes, times `scale`: relative precision 2^-11, and half the bytes
        guide   float32 (897, 2)            guide and node position over theta_h, 64 steps an octave of x
        map_y   float32 (129,)              node position over tan(theta_d/2)
        map_z   float32 (n,)                node position over phi_d's diamond angle, 64 steps a quarter turn

    Interpolated values never exceed the largest node of the cell, times guide and K there. Look-ups run in the type
    of the angles.
    """

    name = "half_difference"
    SUMMARY = "half/difference coordinates with a guide along theta_h, float16 nodes, trilinear"
    PARAMETERS = (
        Parameter("shape", "", "nodes along theta_h, theta_d, phi_d", "80,40,40", kind="text"),
        Parameter("interpolation", "", "between the nodes", "linear", kind="choice", choices=("linear",)),
    )
    _checks_domain = True

    def __init__(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        scale: float,
        factor: str,
        channels: Channels,
        flags: Mapping[str, bool],
        delta: npt.NDArray[np.float64] | None = None,
    ) -> None:
        super().__init__(channels, flags)
        self.values, self.guide, self.map_y, self.map_z = (
            np.require(arrays[name], requirements=("C", "A", "W")) for name in ("values", "guide", "map_y", "map_z")
        )
        self.scale, self.factor, self.delta = scale, factor, delta
        self.has_delta = delta is not None
        #: phi_d is folded by these; the flags say what holds, the fold what is stored.
        n_z = self.map_z.size - 1
        self._reciprocal_fold = n_z == _steps_z(self.bilateral, True)
        self._flat = (
            self.values.reshape(-1).view(np.int16),
            self.guide.reshape(-1),
            self.map_y,
            self.map_z,
        )

    @cached_property
    def _scales(self) -> dict[np.dtype[Any], Any]:
        from brdfcore.kernels.half_difference import half_scale
        from brdfcore.tables.half_fit import STEPS_Z

        shape = self.values.shape[:3]
        steps = (self.map_y.size - 1, STEPS_Z, self.map_z.size - 1)
        return {
            np.dtype(t): half_scale(shape, steps, FACTORS[self.factor], 1 / self.scale, self.bilateral, t)
            for t in (np.float32, np.float64)
        }

    @cached_property
    def _kernel(self) -> Any:
        from brdfcore.kernels import half_difference as kernels

        return {1: kernels.half_one, 3: kernels.half_three}.get(len(self.channels), kernels.half_many)

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        n_d, n_p = (np.int32(n) for n in self.values.shape[1:3])
        outside = self._kernel(
            theta_i.size, theta_i, theta_o, delta_phi, *self._flat, out.reshape(-1), self._scales[theta_i.dtype],
            self.bilateral, self._reciprocal_fold, n_d, n_p,
        )  # fmt: skip
        return bool(outside == 0)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return np.full(theta_i.shape, Status.INTERPOLATED, np.uint8)

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if self.delta is None:
            return super()._delta_reflectance(theta_i)
        return interpolated_delta(self.delta, theta_i)

    # ---- build --------------------------------------------------------------------------------

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Fit nodes to `source`; see `tables.half_fit` and `Table.build`."""
        if options.interpolation != "linear":
            raise InputError(
                "bad_option",
                f"interpolation = {options.interpolation!r}: half_difference offers 'linear'",
                where="interpolation",
                got=options.interpolation,
                expected="linear",
            )
        bilateral, reciprocal = _folds(source, options)
        fold_reciprocal = reciprocal and bilateral  # a quarter turn is only stored of a table that is both
        shape = options.shape or shape_for(LADDER[3], bilateral, fold_reciprocal)[0]
        if len(shape) != 3 or min(shape) < 3 or np.prod([float(n) for n in shape]) * len(source.channels) >= 2**31:
            raise InputError(
                "bad_shape",
                f"shape = {list(shape)}: expected 3 numbers of nodes (theta_h, theta_d, phi_d), each at least 3, "
                "with fewer than 2^31 values in all",
                where="shape",
                got=list(shape),
                expected="3 whole numbers >= 3",
            )

        fitter, layout = options.prepared or _prepared(source, options, progress)
        told = None if progress is None else lambda done, total: progress(done, total, "fitting the nodes")
        nodes = fitter.nodes(layout, (shape[0], shape[1], shape[2]), told)
        done = [f"averaged over the {name} symmetry, as asked" for name in sorted(options.fold)]
        negative = int((nodes < 0).sum())
        if negative and (options.negatives == "zero" or source.non_negative):
            nodes = np.maximum(nodes, 0)  # a fit may dip below a source that does not
            if not source.non_negative:
                done.append(f"{negative} negative nodes set to zero, as asked")
        scale = _LARGEST / max(float(np.abs(nodes).max()), 1e-300)
        maps = (layout.map_x, layout.map_y, layout.map_z)
        last = [n - 1 for n in shape]
        arrays = {
            "values": (nodes * scale).astype(np.float16),
            "guide": np.stack([layout.guide, maps[0] * last[0]], axis=1).astype(np.float32),
            "map_y": (maps[1] * last[1]).astype(np.float32),
            "map_z": (maps[2] * last[2]).astype(np.float32),
        }
        flags = {
            "bilateral": bilateral,
            "reciprocal": fold_reciprocal and layout.factor in ("sum", "both", "none"),
            "energy_conserving": source.energy_conserving,
            "non_negative": bool((arrays["values"] >= 0).all()),
        }
        table = cls(arrays, scale, layout.factor, source.channels, flags, sampled_delta(source))
        if flags["energy_conserving"]:
            table.energy_conserving = bool((table.albedo(np.radians(_ENERGY_ANGLES)) <= 1 + ALBEDO_SLACK).all())
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {**source.report, "done": [*source.report.get("done", []), *done]}
        return table

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        bilateral, reciprocal = _folds(source, options)
        reciprocal = reciprocal and bilateral
        options = replace(options, prepared=_prepared(source, options))
        if max_bytes is None:
            return [replace(options, shape=shape_for(n, bilateral, reciprocal)[0]) for n in LADDER]
        beside = 4 * (2 * 897 + 129 + 1 + _steps_z(bilateral, reciprocal)) + (
            DELTA_NODES * 8 * len(source.channels) if source.has_delta else 0
        )
        nodes = max((max_bytes - beside) // (2 * len(source.channels)), 64)
        return [replace(options, shape=shape) for shape in shape_for(nodes, bilateral, reciprocal)]

    # ---- arrays -------------------------------------------------------------------------------

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        arrays = {"values": self.values, "guide": self.guide, "map_y": self.map_y, "map_z": self.map_z}
        if self.delta is not None:
            arrays["delta"] = self.delta
        return arrays

    def attributes(self) -> dict[str, Any]:
        return {"scale": self.scale, "factor": self.factor}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        from brdfcore.kernels.half_difference import GUIDE_NODES
        from brdfcore.tables.half_fit import STEPS_Y

        types = {
            "values": (np.float16, 4),
            "guide": (np.float32, 2),
            "map_y": (np.float32, 1),
            "map_z": (np.float32, 1),
        }
        for name, (dtype, ndim) in types.items():
            array = arrays.get(name)
            if array is None or array.dtype != dtype or array.ndim != ndim or not np.isfinite(array).all():
                got = "nothing" if array is None else f"{array.dtype} {array.shape}"
                raise _bad(name, got, f"finite {np.dtype(dtype)} with {ndim} dimension(s)")
        values, bilateral = arrays["values"], bool(flags["bilateral"])
        if min(values.shape[:3]) < 3 or values.shape[3] != len(channels) or values.size >= 2**31:
            raise _bad("values", str(values.shape), f"at least 3 nodes an axis, {len(channels)} channel(s)")
        allowed = {_steps_z(bilateral, r) + 1 for r in ((True, False) if bilateral else (False,))}
        for name, sizes, nodes in (
            ("guide", {GUIDE_NODES}, values.shape[0]),
            ("map_y", {STEPS_Y + 1}, values.shape[1]),
            ("map_z", allowed, values.shape[2]),
        ):
            array = arrays[name]
            positions = array[:, -1] if array.ndim == 2 and array.shape[1] == 2 else array.reshape(-1)
            if len(array) not in sizes or array.size != len(array) * array.ndim:
                raise _bad(name, str(array.shape), f"a length in {sorted(sizes)}")
            # no look-up can leave the table: positions lie between its nodes
            if positions.min() < 0 or positions.max() > nodes - 1:
                raise _bad(name, f"node positions {positions.min()} to {positions.max()}", f"0 to {nodes - 1}")
        if flags["non_negative"] and values.min() < 0:
            raise _bad("values", f"as low as {values.min()}", "no value below 0, as the flag non_negative says")
        delta = checked_delta(cls.name, arrays, len(channels))
        scale, factor = attributes.get("scale"), attributes.get("factor")
        if not isinstance(scale, (int, float)) or not 1e-30 < scale < 1e30:
            raise _bad("scale", repr(scale)[:40], "a number between 1e-30 and 1e30")
        if factor not in FACTORS:
            raise _bad("factor", repr(factor)[:40], ", ".join(FACTORS))
        return cls(arrays, float(scale), str(factor), channels, flags, delta)


def _folds(source: Brdf, options: BuildOptions) -> tuple[bool, bool]:
    """(bilateral, reciprocal) of the table: what the source has, and what was asked for."""
    return source.bilateral or "bilateral" in options.fold, source.reciprocal or "reciprocal" in options.fold


def _prepared(source: Brdf, options: BuildOptions, progress: Progress | None = None) -> tuple[Fitter, Layout]:
    """The source as the table will see it, folds applied, and where its nodes belong."""
    bilateral, reciprocal = _folds(source, options)

    def sample(theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.float64]:
        f = source.evaluate(theta_i, theta_o, delta_phi)
        if bilateral and not source.bilateral:
            f = 0.5 * (f + source.evaluate(theta_i, theta_o, -delta_phi))
        if reciprocal and not source.reciprocal:
            g = source.evaluate(theta_o, theta_i, -delta_phi)
            if bilateral and not source.bilateral:
                g = 0.5 * (g + source.evaluate(theta_o, theta_i, delta_phi))
            f = 0.5 * (f + g)
        if not np.isfinite(f).all():
            k = int(np.argwhere(~np.isfinite(f))[0][0])
            degrees = [round(float(np.degrees(a[k])), 6) for a in (theta_i, theta_o, delta_phi)]
            raise InputError(
                "source_not_finite",
                f"the source is not finite at theta_i, theta_o, delta_phi = {degrees} degrees",
                where="source",
                got=degrees,
                expected="finite values",
            )
        return f.astype(np.float64, copy=False)

    if progress is not None:
        progress(0, 1, "placing the nodes")
    fitter = Fitter(source, sample, bilateral, bilateral and reciprocal)
    layout = fitter.layout()
    if progress is not None:
        progress(1, 1, "placing the nodes")
    return fitter, layout


def _steps_z(bilateral: bool, reciprocal: bool) -> int:
    from brdfcore.tables.half_fit import STEPS_Z

    return STEPS_Z * (1 if reciprocal else 2) * (1 if bilateral else 2)


def _bad(field: str, got: str, expected: str) -> FileFormatError:
    return FileFormatError(
        "bad_field", f"half_difference: {field} is {got}; expected {expected}", where=field, got=got, expected=expected
    )
