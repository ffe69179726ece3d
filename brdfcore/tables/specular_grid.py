"""A grid around the mirror direction: theta_i, angular distance from the mirror direction, azimuth about it.

The coordinates of goniometer files (Zemax, LightTools, the ISO and ASTM plots of BSDF against the angle from specular):
a lobe stays at distance 0 whatever theta_i, and nodes may be as dense there as the lobe is narrow.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.parameters import Parameter
from brdfcore.base.status import Status
from brdfcore.metrics import ALBEDO_SLACK
from brdfcore.tables.base.mirror_coordinates import (
    about_mirror,
    above_horizon,
    default_nodes,
    node_directions,
    slice_cosines,
)
from brdfcore.tables.base.table import (
    DELTA_NODES,
    BuildOptions,
    Progress,
    Table,
    checked_delta,
    interpolated_delta,
    sampled_delta,
)

Float64Array = npt.NDArray[np.float64]

#: Nodes of theta_i, azimuth over half a turn, distance, where no shape is asked for.
DEFAULT_SHAPE = (28, 19, 40)
#: Distance from a node, rad, at which a direction is the node: files print angles to 1e-6 rad.
_AT_NODE = 2e-6
#: Nodes of a sampled source this close to the horizon, rad, are left to continuation: f may grow like 1/cos there and
#: is infinite, or rounding noise, in it.
GRAZING = float(np.radians(0.5))
_MOST_VALUES = 2**31 - 1
#: Directions evaluated at a time: bounds the memory of the eight corners.
_CHUNK = 65_536
_ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)


class SpecularGrid(Table):
    """f_r on nodes of (theta_i, azimuth about the mirror direction, distance from it), trilinear.

    With S the mirror direction of wi: distance r = angle(wo, S); azimuth 0 from S towards the normal (for theta_i = 0,
    towards wi's azimuth), counter-clockwise seen from outside, so that 0 < delta_phi < pi has 0 < azimuth < pi.
    Between nodes of theta_i f is a mean at equal r and azimuth, each slice weighed also by the cosines c_i c_o of its
    own directions there, none below `mirror_coordinates.LEAST_COSINE`: what reflects more light counts more, and what
    is constant is held exactly. Along r and azimuth f itself is interpolated. Beyond the
    first and last theta_i the nearest slice is continued. At theta_i = 0, where azimuth has no meaning, the slice is
    constant in it.

    Arrays:

        values   float64 (K, A, R, C)  at r = 0 equal for all azimuths
        filled   uint8 (K, A, R)       1 where the source has no value: below the horizon, or a hole; 2 in a slice that
                                       stands in at theta_i = 0
        theta_i  float64 (K,)          rad, ascending
        azimuth  float64 (A,)          rad, 0 to pi if bilateral, else 0 to 2 pi with equal first and last nodes
        radial   float64 (R,)          rad, from 0
        delta    float64 (n, C)        optional, as in `AngleGrid`
    """

    name = "specular_grid"
    SUMMARY = "grid of theta_i and the angles about the mirror direction, for goniometer files and exchange"
    PARAMETERS = (
        Parameter("shape", "", "nodes of theta_i, azimuth over half a turn, distance", "28,19,40", kind="text"),
        Parameter("interpolation", "", "between the nodes", "linear", kind="choice", choices=("linear",)),
    )
    EVALUATION_VERSION = OLDEST_EVALUATION = 2  # 1 was up to 43 % too high between two theta_i near the horizon
    #: For exchange: at equal size and speed `half_difference` is better.
    FOR_AUTO: ClassVar[bool] = False

    def __init__(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        channels: Channels,
        flags: Mapping[str, bool],
        delta: Float64Array | None = None,
    ) -> None:
        super().__init__(channels, flags)
        self.values, self.filled = arrays["values"], arrays["filled"]
        self.theta_i, self.azimuth, self.radial = (arrays[n] for n in ("theta_i", "azimuth", "radial"))
        self.delta = delta
        self.has_delta = delta is not None

    # ---- look-up ------------------------------------------------------------------------------

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        for start in range(0, theta_i.size, _CHUNK):
            piece = slice(start, start + _CHUNK)
            angles = (np.minimum(a[piece].astype(np.float64), top) for a, top in (
                (theta_i, HALF_PI), (theta_o, HALF_PI), (delta_phi, np.inf)
            ))  # fmt: skip
            out[piece] = self._looked_up(*angles)
        return True

    def _looked_up(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        azimuth, radial = about_mirror(theta_i, theta_o, delta_phi)
        (k, u), (a, v), (r, w) = self._places(theta_i, azimuth, radial)
        flat = self.values.reshape(-1, self.values.shape[3])
        n_a, n_r = self.values.shape[1:3]
        found, total = np.zeros((theta_i.size, flat.shape[1])), np.zeros(theta_i.size)
        for slice_, share in ((k, 1 - u), (np.minimum(k + 1, self.theta_i.size - 1), u)):
            node = (slice_ * n_a + a) * n_r + r
            low = flat[node] + w[:, None] * (flat[node + 1] - flat[node])
            high = flat[node + n_r] + w[:, None] * (flat[node + n_r + 1] - flat[node + n_r])
            weight = share * slice_cosines(self.theta_i[slice_], azimuth, radial)
            found += weight[:, None] * (low + v[:, None] * (high - low))
            total += weight
        return found / total[:, None]

    def _places(
        self, theta_i: Float64Array, azimuth: Float64Array, radial: Float64Array
    ) -> tuple[tuple[npt.NDArray[np.int64], Float64Array], ...]:
        """(cell, position in it) along theta_i, azimuth and distance."""
        turned = np.abs(azimuth) if self.bilateral else np.where(azimuth < 0, azimuth + 2 * np.pi, azimuth)
        return tuple(
            _place(x, nodes) for x, nodes in ((theta_i, self.theta_i), (turned, self.azimuth), (radial, self.radial))
        )

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        """FILLED where a filled node has most weight, EXTRAPOLATED where one has some and beyond the theta_i nodes."""
        angles = [np.minimum(a.astype(np.float64), top) for a, top in (
            (theta_i, HALF_PI), (theta_o, HALF_PI), (delta_phi, np.inf)
        )]  # fmt: skip
        azimuth, radial = about_mirror(*angles)
        (k, u), (a, v), (r, w) = self._places(angles[0], azimuth, radial)
        weight, lent = np.zeros(theta_i.shape), np.zeros(theta_i.shape)
        measured = np.ones(theta_i.shape, np.bool_)
        for q in range(8):
            i, j, m = q >> 2, q >> 1 & 1, q & 1
            part = (u if i else 1 - u) * (v if j else 1 - v) * (w if m else 1 - w)
            kind = self.filled[np.minimum(k + i, self.theta_i.size - 1), a + j, r + m]
            weight += part * (kind == 1)
            lent += part * (kind == 2)
        for x, nodes, cell in (
            (angles[0], self.theta_i, k), (np.abs(azimuth), self.azimuth, a), (radial, self.radial, r)
        ):  # fmt: skip
            near = np.minimum(np.abs(x - nodes[cell]), np.abs(x - nodes[np.minimum(cell + 1, nodes.size - 1)]))
            measured &= (near <= _AT_NODE) | (radial <= _AT_NODE if nodes is self.azimuth else False)
        codes = np.where(measured, np.uint8(Status.MEASURED), np.uint8(Status.INTERPOLATED))
        beyond = (angles[0] < self.theta_i[0] - _AT_NODE) | (angles[0] > self.theta_i[-1] + _AT_NODE)
        codes[(weight + lent > 1e-9) | beyond] = Status.EXTRAPOLATED
        codes[weight > 0.5] = Status.FILLED
        return codes.astype(np.uint8)

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if self.delta is None:
            return super()._delta_reflectance(theta_i)
        return interpolated_delta(self.delta, theta_i)

    # ---- making one ---------------------------------------------------------------------------

    @classmethod
    def from_nodes(
        cls,
        theta_i: Float64Array,
        azimuth: Float64Array,
        radial: Float64Array,
        values: Float64Array,
        channels: Channels,
        *,
        bilateral: bool,
        holes: str = "continue",
    ) -> tuple[Self, list[str]]:
        """A table of values (K, A, R, C) at nodes, NaN where there is none, and what was done to them, in sentences.

        Nodes below the horizon and holes take the value of the nearest node towards the mirror direction
        (holes="continue") or 0 ("zero"). Without a node at theta_i = 0 the first slice, averaged over azimuth, stands
        there. Flags other than bilateral and non_negative are False. Raises `InputError` if a slice has no value at
        the mirror direction.
        """
        values, done = values.copy(), []
        below = ~above_horizon(theta_i, azimuth, radial)
        given = np.isfinite(values).all(axis=3)
        dropped = int((given & below).sum())
        given &= ~below
        if dropped:
            done.append(f"{dropped} values below the horizon not used")
        if not given[:, :, 0].any(axis=1).all():
            k = int(np.argmin(given[:, :, 0].any(axis=1)))
            raise InputError(
                "no_mirror_value",
                f"no value at the mirror direction of theta_i = {np.degrees(theta_i[k]):.4g} degrees",
                where="values",
                expected="one at distance 0 for each theta_i",
            )
        values[~given] = np.nan
        spread = np.nanmax(values[:, :, 0], axis=1) - np.nanmin(values[:, :, 0], axis=1)
        equal = spread.max(axis=1) == 0  # their mean could differ in its last bit
        values[:, :, 0] = np.where(
            equal[:, None], np.nanmax(values[:, :, 0], axis=1), np.nanmean(values[:, :, 0], axis=1)
        )[:, None]
        if not equal.all():
            done.append(f"values at the mirror direction that differ by up to {spread.max():.3g}/sr averaged")
        if theta_i[0] == 0:  # azimuth has no meaning there: what was measured at some stands for all
            known = given[0].any(axis=0)
            values[0][:, known] = _over_azimuth(values[0][:, known], given[0][:, known])
            given[0] = known
        for r in range(1, radial.size):
            missing = ~given[:, :, r]
            values[:, :, r][missing] = values[:, :, r - 1][missing] if holes == "continue" else 0.0
        filled = (~given).astype(np.uint8)
        filled[:, :, 0] = 0
        if theta_i[0] > 0:
            done.append(
                f"nothing measured below theta_i = {np.degrees(theta_i[0]):.4g} degrees: the first slice, averaged "
                "over azimuth, stands at 0"
            )
            theta_i = np.concatenate([[0.0], theta_i])
            first = np.where(
                filled[0, :, :].all(axis=0), True, filled[0] == 0
            )  # a distance without any is averaged too
            values = np.concatenate([_over_azimuth(values[0], first)[None], values])
            filled = np.concatenate([np.full_like(filled[:1], 2), filled])
        hole = int(((filled == 1) & above_horizon(theta_i, azimuth, radial)).sum())
        if hole:
            how = "continued outwards from the nearest one measured" if holes == "continue" else "set to 0"
            done.append(f"{hole} directions without a value {how}")
        arrays: dict[str, npt.NDArray[Any]] = {"values": values, "filled": filled}
        arrays |= {"theta_i": theta_i, "azimuth": azimuth, "radial": radial}
        flags = {"bilateral": bilateral, "reciprocal": False, "energy_conserving": False}
        table = cls(arrays, channels, {**flags, "non_negative": bool((values >= 0).all())})
        return table, done

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Sample `source` at the nodes; see `Table.build`."""
        if options.interpolation != "linear" or options.fold - {"bilateral"}:
            raise InputError(
                "bad_option",
                "specular_grid offers interpolation='linear', and fold='bilateral' only",
                where="fold" if options.fold else "interpolation",
            )
        bilateral = source.bilateral or "bilateral" in options.fold
        shape = options.shape or DEFAULT_SHAPE
        turns = 1 if bilateral else 2
        size = len(source.channels) * turns
        for n in shape:
            size *= n
        if len(shape) != 3 or min(shape) < 3 or size > _MOST_VALUES:
            raise InputError(
                "bad_shape",
                f"shape = {list(shape)}: expected 3 numbers of nodes (theta_i, azimuth, distance), each at least 3, "
                "with fewer than 2^31 values in all",
                where="shape",
                got=list(shape),
                expected="3 whole numbers >= 3",
            )
        nodes = default_nodes((shape[0], turns * (shape[1] - 1) + 1, shape[2]), bilateral)
        values = _sampled(source, nodes, "bilateral" in options.fold and not source.bilateral, progress)
        table, _ = cls.from_nodes(*nodes, values, source.channels, bilateral=bilateral)
        done = [f"averaged over the {name} symmetry, as asked" for name in sorted(options.fold)]
        negative = int((table.values < 0).sum())
        if options.negatives == "zero" and negative:
            table.values = np.maximum(table.values, 0)
            table.non_negative = True
            done.append(f"{negative} negative node values set to zero, as asked")
        table.delta = sampled_delta(source)
        table.has_delta = table.delta is not None
        if source.energy_conserving:
            table.energy_conserving = bool((table.albedo(np.radians(_ENERGY_ANGLES)) <= 1 + ALBEDO_SLACK).all())
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {**source.report, "done": [*source.report.get("done", []), *done]}
        return table

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        if max_bytes is None:
            scales: Iterable[float] = (0.6, 1.0, 1.5, 2.0)
        else:
            turns = 1 if source.bilateral or "bilateral" in options.fold else 2
            each = (8 * len(source.channels) + 1) * turns
            beside = 8 * DELTA_NODES * len(source.channels) if source.has_delta else 0
            scales = ((max(max_bytes - beside, 1) / (each * float(np.prod(DEFAULT_SHAPE)))) ** (1 / 3) * 0.98,)
        shapes = [tuple(max(3, int(n * scale)) for n in DEFAULT_SHAPE) for scale in scales]
        return [replace(options, shape=shape) for shape in shapes]

    # ---- arrays -------------------------------------------------------------------------------

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        arrays = {n: getattr(self, n) for n in ("values", "filled", "theta_i", "azimuth", "radial")}
        if self.delta is not None:
            arrays["delta"] = self.delta
        return arrays

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        ranges = {"theta_i": HALF_PI, "azimuth": np.pi if flags["bilateral"] else 2 * np.pi, "radial": np.pi}
        kinds = {
            "values": ("f8", 4),
            "filled": ("u1", 3),
            "theta_i": ("f8", 1),
            "azimuth": ("f8", 1),
            "radial": ("f8", 1),
        }
        for name, (dtype, ndim) in kinds.items():
            array = arrays.get(name)
            if array is None or array.dtype != np.dtype(dtype) or array.ndim != ndim or not np.isfinite(array).all():
                got = "nothing" if array is None else f"{array.dtype} {array.shape}"
                raise _bad(name, got, f"finite {np.dtype(dtype)} with {ndim} dimension(s)")
        shape = tuple(arrays[n].size for n in ranges)
        if arrays["values"].shape != (*shape, len(channels)) or arrays["filled"].shape != shape or min(shape) < 2:
            raise _bad("values", str(arrays["values"].shape), f"{(*shape, len(channels))}, at least 2 nodes an axis")
        for name, last in ranges.items():
            nodes = arrays[name]
            good = nodes[0] >= 0 and nodes[-1] <= last + 1e-12 and (np.diff(nodes) > 0).all()
            ends = name == "theta_i" or (nodes[0] == 0 and (name == "radial" or abs(nodes[-1] - last) < 1e-12))
            if not good or not ends:
                raise _bad(name, str(nodes[:8].tolist())[:80], f"ascending angles, 0 to {last:.6g}")
        if flags["non_negative"] and arrays["values"].min() < 0:
            raise _bad(
                "values", f"as low as {arrays['values'].min()}", "no value below 0, as the flag non_negative says"
            )
        return cls(arrays, channels, flags, checked_delta(cls.name, arrays, len(channels)))

    @cached_property
    def directions(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """(theta_i, theta_o, delta_phi) of every node, (K, A, R); theta_o may be below the horizon."""
        return node_directions(self.theta_i, self.azimuth, self.radial)


def _sampled(
    source: Brdf, nodes: tuple[Float64Array, Float64Array, Float64Array], fold: bool, progress: Progress | None
) -> Float64Array:
    """f_r of `source` at the nodes, NaN below the horizon, (K, A, R, C)."""
    values = np.full((*(n.size for n in nodes), len(source.channels)), np.nan)
    above = above_horizon(*nodes, inset=GRAZING)
    for k in range(nodes[0].size):
        i, o, d = (x[0][above[k]] for x in node_directions(nodes[0][k : k + 1], *nodes[1:]))
        o = np.minimum(o, HALF_PI)
        f = source.evaluate(i, o, d).astype(np.float64)
        if fold:
            f = 0.5 * (f + source.evaluate(i, o, -d))
        if not np.isfinite(f).all() or np.abs(f).max() > 1e100:
            n = int(np.argwhere(~(np.abs(f) <= 1e100))[0][0])
            degrees = [round(float(np.degrees(x[n])), 6) for x in (i, o, d)]
            raise InputError(
                "source_not_finite",
                f"the source is not finite at theta_i, theta_o, delta_phi = {degrees} degrees",
                where="source",
                got=degrees,
                expected="finite values",
            )
        values[k][above[k]] = f
        if progress is not None:
            progress(k + 1, nodes[0].size, "sampling the source")
    return values


def _over_azimuth(values: Float64Array, given: npt.NDArray[np.bool_]) -> Float64Array:
    """(A, R, C): at each distance the mean of the values `given` (A, R), to the bit where they are equal."""
    low, high = (np.where(given[..., None], values, end) for end in (np.inf, -np.inf))
    mean = np.where(given[..., None], values, 0.0).sum(axis=0) / given.sum(axis=0)[:, None]
    equal = low.min(axis=0) == high.max(axis=0)
    return np.broadcast_to(np.where(equal, high.max(axis=0), mean), values.shape).copy()


def _place(x: Float64Array, nodes: Float64Array) -> tuple[npt.NDArray[np.int64], Float64Array]:
    cell = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    return cell, np.clip((x - nodes[cell]) / (nodes[cell + 1] - nodes[cell]), 0, 1)


def _bad(field: str, got: str, expected: str) -> FileFormatError:
    return FileFormatError(
        "bad_field", f"specular_grid: {field} is {got}; expected {expected}", where=field, got=got, expected=expected
    )
