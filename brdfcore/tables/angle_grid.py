"""The plain grid: f_r at uniform nodes of (theta_i, theta_o, delta_phi), interpolated between them.

The representation everybody builds first. Right for rough materials, fast, and wrong on sharp lobes: the
mirror direction runs diagonally through the grid, so a lobe narrower than a cell is smeared along it and
comes out as a row of beads. `tabulate` measures how wrong and says so.
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
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter
from brdfcore.metrics import ALBEDO_SLACK
from brdfcore.tables.base.sampled import (
    INTERPOLATION,
    SampledTable,
    bad_field,
    check_interpolation,
    stored_interpolation,
    without_subnormals,
)
from brdfcore.tables.base.table import (
    DELTA_NODES,
    ArrayLookUp,
    BuildOptions,
    Progress,
    checked_delta,
    sampled_delta,
)

#: Nodes of theta that `candidates` tries: 11 degrees to half a degree; delta_phi gets twice as many cells.
LADDER = (9, 13, 19, 28, 46, 61, 91, 136, 181)
#: Part of a cell by which the node at the horizon is sampled above it; see `_sampled_theta`.
GRAZING_INSET = 0.25
#: theta_i, degrees, at which a table built from an energy conserving source is checked.
ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)
#: Directions evaluated at a time while building: bounds the memory whatever the shape.
_CHUNK = 262_144
#: Most values: the kernels index in int32.
_MOST_VALUES = 2**31 - 1


class AngleGrid(SampledTable):
    """f_r on a uniform grid of angles, float32, C channels; nearest node, trilinear or monotone cubic.

    Node values are f_r at the nodes, but for the last theta: it holds f_r a quarter of a cell above the horizon.

    values : float32 (n_theta_i, n_theta_o, n_delta_phi, channels), both ends of each axis included: theta over
        [0, pi/2]; delta_phi over [0, pi] if bilateral, else over [0, 2 pi] with equal first and last nodes.
    delta : float64 (n, channels), optional: reflectance of the mirror part at n uniform theta_i of [0, pi/2], linear;
        n does not depend on the other nodes.

    Look-ups in float32 for float32 angles (the angle itself is then known to 6e-8), else in float64.
    """

    name = "angle_grid"
    SUMMARY = "uniform grid of (theta_i, theta_o, delta_phi), float32"
    PARAMETERS = (
        Parameter("shape", "", "nodes along theta_i, theta_o, delta_phi, both ends included", "90,90,181", kind="text"),
        INTERPOLATION,
    )
    _checks_domain = True

    def __init__(
        self,
        values: npt.NDArray[np.float32],
        channels: Channels,
        flags: Mapping[str, bool],
        delta: npt.NDArray[np.float64] | None = None,
        interpolation: str = "linear",
    ) -> None:
        super().__init__(channels, flags, interpolation, delta)
        # read-only memory is another type to the compiler, which would take seconds for its version
        self.values = np.require(values, requirements=("C", "A", "W"))
        _, n_o, n_d, _ = values.shape
        self._flat = self.values.reshape(-1)
        self._steps = (n_o * n_d, n_d)

    @cached_property
    def _scales(self) -> dict[np.dtype[Any], Any]:
        from brdfcore.kernels.tables.trilinear import grid_scale

        shape = self.values.shape[:3]
        return {np.dtype(t): grid_scale(shape, self.bilateral, t) for t in (np.float32, np.float64)}

    @cached_property
    def _kernel(self) -> Any:
        from brdfcore.kernels.tables import angle_lattice, trilinear

        if self.interpolation == "monotone_cubic":
            return angle_lattice.cubic
        count = {1: "one", 3: "three"}.get(len(self.channels), "many")
        if self.interpolation == "linear":
            return getattr(trilinear, f"trilinear_{count}")
        return getattr(angle_lattice, f"nearest_{count}")

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        scale = self._scales[theta_i.dtype]
        outside = self._kernel(
            theta_i.size, theta_i, theta_o, delta_phi, self._flat, out.reshape(-1), scale, *self._steps, self.bilateral
        )
        return bool(outside == 0)

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Sample `source` at the nodes; see `Table.build`."""
        bilateral = source.bilateral or "bilateral" in options.fold
        shape = _checked_shape(options, bilateral, len(source.channels))
        check_interpolation(cls.name, options.interpolation)
        symmetric = shape[0] == shape[1]
        if "reciprocal" in options.fold and not symmetric:
            raise InputError(
                "bad_shape",
                f"fold='reciprocal' needs as many theta_i as theta_o nodes; got {shape[0]} and {shape[1]}",
                where="shape",
            )
        values = _sample(source, shape, bilateral, progress)
        if "bilateral" in options.fold and not source.bilateral:
            values = 0.5 * (values + _sample(source, shape, bilateral, progress, mirrored=True))
        if "reciprocal" in options.fold and not source.reciprocal:
            # f(o, i, -delta_phi): with a whole turn stored, -delta_phi is the axis backwards
            swapped = values.transpose(1, 0, 2, 3)
            values = 0.5 * (values + (swapped if bilateral else swapped[:, :, ::-1]))
        done = [f"averaged over the {name} symmetry, as asked" for name in sorted(options.fold)]
        negative = int((values < 0).sum())
        if options.negatives == "zero" and negative:
            values = np.maximum(values, 0)
            done.append(f"{negative} negative node values set to zero, as asked")
        flags = {
            "bilateral": bilateral,
            "reciprocal": symmetric and (source.reciprocal or "reciprocal" in options.fold),
            "energy_conserving": source.energy_conserving,
            "non_negative": bool((values >= 0).all()),
        }
        table = cls(values, source.channels, flags, sampled_delta(source), options.interpolation)
        if flags["energy_conserving"]:  # interpolating a lobe between nodes may add energy: measure, don't inherit
            albedo = table.albedo(np.radians(ENERGY_ANGLES))
            table.energy_conserving = bool((albedo <= 1 + ALBEDO_SLACK).all())
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {**source.report, "done": [*source.report.get("done", []), *done]}
        if negative and options.negatives == "keep":
            table.report["negative_nodes"] = negative
        return table

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        turns = 1 if source.bilateral or "bilateral" in options.fold else 2
        ladder: Iterable[int] = LADDER
        each = 4 * len(source.channels)
        beside = 8 * DELTA_NODES * len(source.channels) if source.has_delta else 0
        if max_bytes is not None:
            room = min(max_bytes - beside, 4 * _MOST_VALUES)
            # n x n x (2 n - 1) nodes, the largest n that fits
            n = max(2, int((max(room, 1) / (each * 2 * turns)) ** (1 / 3)) + 1)
            while n > 2 and each * n * n * (turns * 2 * (n - 1) + 1) > room:
                n -= 1
            ladder = (n,)
        shapes = [(n, n, turns * 2 * (n - 1) + 1) for n in ladder]
        return [replace(options, shape=s, nbytes=each * s[0] * s[1] * s[2] + beside) for s in shapes]

    def array_look_up(self) -> ArrayLookUp:
        from brdfcore.kernels.tables import trilinear_arrays

        if self.interpolation == "monotone_cubic":
            raise InputError(
                "no_array_function",
                "an angle_grid with monotone_cubic interpolation has no function of arrays; use linear",
                where="interpolation",
                got=self.interpolation,
                expected="linear or nearest",
            )
        settings = trilinear_arrays.GridSettings(self.bilateral, self.interpolation == "nearest")
        return ArrayLookUp(trilinear_arrays, {"values": self.values}, settings)

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        return self._with_delta({"values": self.values})

    def attributes(self) -> dict[str, Any]:
        # none for the linear one: tables from before there were others keep their id
        return {} if self.interpolation == "linear" else {"interpolation": self.interpolation}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        values = arrays.get("values")
        if values is None or values.dtype != np.float32 or values.ndim != 4:
            got = "nothing" if values is None else f"{values.dtype} {values.shape}"
            raise bad_field(cls.name, "values", got, "float32 (n_theta_i, n_theta_o, n_delta_phi, channels)")
        if min(values.shape[:3]) < 2 or values.shape[3] != len(channels) or values.size > _MOST_VALUES:
            raise bad_field(
                cls.name,
                "values",
                str(values.shape),
                f"at least 2 nodes an axis, {len(channels)} channel(s), < 2^31 values",
            )
        if flags["non_negative"] and values.min() < 0:
            raise bad_field(
                cls.name, "values", f"as low as {values.min()}", "no value below 0, as the flag non_negative says"
            )
        delta = checked_delta(cls.name, arrays, len(channels))
        return cls(values, channels, flags, delta, stored_interpolation(cls.name, attributes))


def _checked_shape(options: BuildOptions, bilateral: bool, channels: int) -> tuple[int, int, int]:
    shape = options.shape or (91, 91, 181 if bilateral else 361)
    size = channels
    for n in shape:
        size *= n
    if len(shape) != 3 or min(shape) < 2 or size > _MOST_VALUES:
        raise InputError(
            "bad_shape",
            f"shape = {list(shape)}: expected 3 numbers of nodes (theta_i, theta_o, delta_phi), each at least 2, "
            f"with fewer than 2^31 values in all; this is {size}",
            where="shape",
            got=list(shape),
            expected="3 whole numbers >= 2",
        )
    return (shape[0], shape[1], shape[2])


def _sampled_theta(n: int) -> npt.NDArray[np.float64]:
    """The n uniform nodes of [0, pi/2], the last one moved a quarter of a cell up from the horizon.

    Towards the horizon f grows like 1/cos theta (microfacet models, and measurements divided by the cosine), so
    its value there is infinite or rounding noise. Over the last cell, of width h, linear interpolation from
    A/h to v carries the energy of A/x exactly, int (A/x) x dx = A h, when v = 4 A/h: the value at x = h/4.
    """
    theta = np.linspace(0, np.pi / 2, n)
    theta[-1] -= GRAZING_INSET * theta[1]
    return theta


def _sample(
    source: Brdf, shape: tuple[int, int, int], bilateral: bool, progress: Progress | None, *, mirrored: bool = False
) -> npt.NDArray[np.float32]:
    """f_r of `source` at the nodes, float32, (n_i, n_o, n_d, channels)."""
    n_i, n_o, n_d = shape
    theta_i, theta_o = _sampled_theta(n_i), _sampled_theta(n_o)
    delta_phi = np.linspace(0, np.pi if bilateral else 2 * np.pi, n_d)
    values = np.empty((n_i, n_o, n_d, len(source.channels)), np.float32)
    rows = max(1, _CHUNK // (n_o * n_d))
    for start in range(0, n_i, rows):
        stop = min(start + rows, n_i)
        angles = (theta_i[start:stop, None, None], theta_o[None, :, None], -delta_phi if mirrored else delta_phi)
        part = source.evaluate(*angles)
        with np.errstate(over="ignore"):  # reported as not finite below
            values[start:stop] = part
        without_subnormals(values[start:stop])
        if not np.isfinite(values[start:stop]).all():
            i, o, d, c = (int(k) for k in np.argwhere(~np.isfinite(values[start:stop]))[0])
            got = float(part[i, o, d, c])
            degrees = [round(float(np.degrees(x)), 6) for x in (theta_i[start + i], theta_o[o], delta_phi[d])]
            raise InputError(
                "source_not_finite",
                f"the source is {got} at theta_i, theta_o, delta_phi = {degrees} degrees; "
                "a float32 grid cannot hold it",
                where="source",
                index=[start + i, o, d, c],
                got=str(got),
                expected="finite float32 values",
            )
        if progress is not None:
            progress(stop, n_i, "sampling the source")
    if not bilateral:
        values[:, :, -1] = values[:, :, 0]  # 0 and 2 pi are one direction
    return values
