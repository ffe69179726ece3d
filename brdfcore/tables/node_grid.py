"""f_r at given nodes of (theta_i, theta_o, delta_phi), even or not: what a file with a grid of angles says, to the bit.

Files state values at cell centres (MBSDF) or at angles of a goniometer (Speos). Held here, each is answered with the
file's own number at its own geometry; a resampled grid would not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter
from brdfcore.base.status import Status
from brdfcore.tables.base.mirror_coordinates import LEAST_COSINE
from brdfcore.tables.base.sampled import bad_field
from brdfcore.tables.base.table import BuildOptions, Progress, Table

Float64Array = npt.NDArray[np.float64]

#: What is the same from one node of theta_i to the next: theta_o, delta_phi, or the place about the mirror direction.
BETWEEN = ("angles", "mirror")
#: Cells of theta_i, theta_o and half a turn of delta_phi, where no shape is asked for.
DEFAULT_SHAPE = (45, 45, 90)
#: Distance from a node, rad, at which a direction is the node: files print angles to 1e-6 rad.
_AT_NODE = 2e-6
_MOST_VALUES = 2**31 - 1
#: Directions evaluated at a time: bounds the memory of the eight corners.
_CHUNK = 65_536


class NodeGrid(Table):
    """f_r at nodes of (theta_i, theta_o, delta_phi), linear along each; beyond the first and last node its value.

    With between="mirror" a slice of theta_i is taken at the direction that stands about its own mirror direction as wo
    stands about that of wi (turned in the plane of incidence by the difference of the theta_i), and the product
    f c_i c_o, no cosine below `mirror_coordinates.LEAST_COSINE`, is linear between the slices: a lobe stays one lobe
    between two incidences. Along theta_o and delta_phi f itself is linear. With between="angles" f is linear along all
    three axes.

    Arrays:

        values     float32 or float64 (I, O, D, C)
        theta_i    float64 (I,)  rad, ascending, within [0, pi/2]
        theta_o    float64 (O,)  as theta_i
        delta_phi  float64 (D,)  rad, ascending; bilateral: within [0, pi]; else 0 to 2 pi, both ends the same values
        lent       uint8 (I,)    1 where a slice is not the source's own but stands in

    Look-ups in float64.
    """

    name = "node_grid"
    SUMMARY = "f at the uneven nodes of (theta_i, theta_o, delta_phi) that a file has"
    PARAMETERS = (
        Parameter("shape", "", "cells of theta_i, theta_o, half a turn of delta_phi", "45,45,90", kind="text"),
        Parameter("interpolation", "", "between the nodes", "linear", kind="choice", choices=("linear",)),
    )
    #: For files: at equal size `angle_grid` is faster.
    FOR_AUTO: ClassVar[bool] = False

    def __init__(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        channels: Channels,
        flags: Mapping[str, bool],
        between: str = "angles",
    ) -> None:
        super().__init__(channels, flags)
        self.values, self.lent = arrays["values"], arrays["lent"]
        self.theta_i, self.theta_o, self.delta_phi = (arrays[n] for n in ("theta_i", "theta_o", "delta_phi"))
        self.between = between

    @classmethod
    def from_nodes(
        cls,
        theta_i: Float64Array,
        theta_o: Float64Array,
        delta_phi: Float64Array,
        values: npt.NDArray[Any],
        channels: Channels,
        *,
        bilateral: bool,
        between: str = "angles",
    ) -> Self:
        """A table of `values` (I, O, D, C); flags but bilateral and non_negative are False.

        With between="mirror" and no node at theta_i = 0 the first slice, averaged over the azimuth about the normal,
        stands there: f can't depend on an azimuth that wi has not. Raises `FileFormatError` for nodes out of order.
        """
        arrays = {"values": values, "theta_i": theta_i, "theta_o": theta_o, "delta_phi": delta_phi}
        arrays["lent"] = np.zeros(theta_i.size, np.uint8)
        flags = {"bilateral": bilateral, "reciprocal": False, "energy_conserving": False}
        flags["non_negative"] = bool((values >= 0).all())
        made = cls.from_arrays(arrays, {"between": between}, channels, flags)
        if between == "angles" or theta_i[0] == 0:
            return made
        turns = np.linspace(0, np.pi if bilateral else 2 * np.pi, 181 if bilateral else 361)[:-1] + np.radians(0.5)
        nearest = theta_i[0]
        at = made._in_slice(0, nearest, *(x.reshape(-1) for x in np.meshgrid(theta_o, turns, indexing="ij")))
        mean = at.reshape(theta_o.size, turns.size, -1).mean(axis=1)
        first = np.broadcast_to(mean[:, None], values.shape[1:]).astype(values.dtype)
        arrays |= {"values": np.concatenate([first[None], values]), "theta_i": np.concatenate([[0.0], theta_i])}
        arrays["lent"] = np.concatenate([np.ones(1, np.uint8), arrays["lent"]])
        return cls.from_arrays(arrays, {"between": between}, channels, flags)

    # ---- look-up ------------------------------------------------------------------------------

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        for start in range(0, theta_i.size, _CHUNK):
            piece = slice(start, start + _CHUNK)
            i, o = (np.minimum(a[piece].astype(np.float64), HALF_PI) for a in (theta_i, theta_o))
            d = delta_phi[piece].astype(np.float64)
            k, u = _place(i, self.theta_i)
            shares = ((k, 1 - u), (np.minimum(k + 1, self.theta_i.size - 1), u))
            if self.between == "angles":
                out[piece] = sum(share[:, None] * self._bilinear(s, o, d) for s, share in shares)
            else:
                inside = np.clip(i, self.theta_i[0], self.theta_i[-1])
                here = _least(inside) * _least(_turned(inside - i, o, d)[0])
                found = np.zeros((i.size, len(self.channels)))
                for s, share in shares:
                    angle = self.theta_i[s]
                    there, turned = _turned(angle - i, o, d)
                    weight = share * _least(angle) * _least(there) / here
                    found += weight[:, None] * self._bilinear(s, np.minimum(there, HALF_PI), turned)
                out[piece] = found
        return True

    def _in_slice(self, k: int, turn: float, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        """f of slice k, with directions turned by `turn` in the plane of incidence, (n, C)."""
        o, d = _turned(np.full(theta_o.size, turn), theta_o, delta_phi)
        return self._bilinear(np.full(o.size, k), np.minimum(o, HALF_PI), d)

    def _bilinear(self, k: npt.NDArray[np.int64], theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        """f of the slices k at angles, (n, C), linear in theta_o and delta_phi."""
        _, n_o, n_d, n_c = self.values.shape
        flat = self.values.reshape(-1, n_c)
        (o, v), (d, w) = _place(theta_o, self.theta_o), _place(self._folded(delta_phi), self.delta_phi)
        up, right = np.minimum(o + 1, n_o - 1) - o, np.minimum(d + 1, n_d - 1) - d
        node = (k * n_o + o) * n_d + d
        v, w = v[:, None], w[:, None]
        above = node + up * n_d
        low = (1 - w) * flat[node] + w * flat[node + right]
        high = (1 - w) * flat[above] + w * flat[above + right]
        return np.asarray((1 - v) * low + v * high, np.float64)

    def _folded(self, delta_phi: Float64Array) -> Float64Array:
        """delta_phi within the nodes' range."""
        turn = np.abs(delta_phi)
        turn = np.where(turn > 2 * np.pi, turn - 2 * np.pi, turn)
        if self.bilateral:
            return np.where(turn > np.pi, 2 * np.pi - turn, turn)
        return np.where(delta_phi < 0, 2 * np.pi - turn, turn)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        """MEASURED at the source's nodes, EXTRAPOLATED beyond them and beside a slice that stands in."""
        i, o = (np.minimum(a.astype(np.float64), HALF_PI) for a in (theta_i, theta_o))
        d = self._folded(delta_phi.astype(np.float64))
        at_node, beyond = np.ones(i.shape, np.bool_), np.zeros(i.shape, np.bool_)
        own = self.theta_i[self.lent == 0]
        pole = np.minimum(i, o) <= _AT_NODE  # an azimuth without meaning is at any node
        for x, nodes in ((i, own), (o, self.theta_o), (d, self.delta_phi)):
            cell = np.minimum(np.searchsorted(nodes, x), nodes.size - 1)
            near = np.minimum(np.abs(x - nodes[cell]), np.abs(x - nodes[np.maximum(cell - 1, 0)])) <= _AT_NODE
            free = pole if x is d else False
            at_node &= near | free
            beyond |= ((x < nodes[0] - _AT_NODE) | (x > nodes[-1] + _AT_NODE)) & ~np.asarray(free)
        codes = np.where(at_node, np.uint8(Status.MEASURED), np.uint8(Status.INTERPOLATED))
        codes[beyond] = Status.EXTRAPOLATED
        return codes.astype(np.uint8)

    # ---- making one ---------------------------------------------------------------------------

    @classmethod
    def can_hold(cls, source: Brdf) -> bool:
        return isinstance(source, cls)

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Sample `source` in the middle of even cells; see `Table.build`."""
        if options.interpolation != "linear" or options.fold - {"bilateral"}:
            raise InputError(
                "bad_option",
                "node_grid offers interpolation='linear', and fold='bilateral' only",
                where="fold" if options.fold else "interpolation",
            )
        shape = options.shape or DEFAULT_SHAPE
        size = len(source.channels) * (1 if source.bilateral else 2)
        for n in shape:
            size *= n
        if len(shape) != 3 or min(shape) < 2 or size > _MOST_VALUES:
            raise InputError(
                "bad_shape",
                f"shape = {list(shape)}: expected 3 numbers of cells (theta_i, theta_o, half a turn of delta_phi), "
                "each at least 2, with fewer than 2^31 values in all",
                where="shape",
                got=list(shape),
                expected="3 whole numbers >= 2",
            )
        fold = "bilateral" in options.fold and not source.bilateral
        bilateral = source.bilateral or fold
        theta_i, theta_o = (cell_centres(n, HALF_PI) for n in shape[:2])
        delta_phi = cell_centres(shape[2], np.pi)
        if not bilateral:
            delta_phi = np.linspace(0, 2 * np.pi, 2 * shape[2] + 1)
        values = np.empty((theta_i.size, theta_o.size, delta_phi.size, len(source.channels)), np.float32)
        for k, angle in enumerate(theta_i):
            part = source.evaluate(angle, theta_o[:, None], delta_phi)
            if fold:
                part = 0.5 * (part + source.evaluate(angle, theta_o[:, None], -delta_phi))
            with np.errstate(over="ignore"):
                values[k] = part
            if not np.isfinite(values[k]).all():
                raise InputError(
                    "source_not_finite",
                    f"the source is not finite in float32 at theta_i = {np.degrees(angle):.4g} degrees",
                    where="source",
                    got=float(np.degrees(angle)),
                    expected="finite float32 values",
                )
            if progress is not None:
                progress(k + 1, theta_i.size, "sampling the source")
        if not bilateral:
            values[:, :, -1] = values[:, :, 0]
        done = [f"averaged over the {name} symmetry, as asked" for name in sorted(options.fold)]
        negative = int((values < 0).sum())
        if options.negatives == "zero" and negative:
            values = np.maximum(values, 0)
            done.append(f"{negative} negative node values set to zero, as asked")
        table = cls.from_nodes(theta_i, theta_o, delta_phi, values, source.channels, bilateral=bilateral)
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {**source.report, "done": [*source.report.get("done", []), *done]}
        return table

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        scales: Iterable[float] = (0.6, 1.0, 1.5, 2.0)
        if max_bytes is not None:
            each = 4 * len(source.channels) * (1 if source.bilateral else 2)
            scales = ((max(max_bytes - 4096, 1) / (each * float(np.prod(DEFAULT_SHAPE)))) ** (1 / 3) * 0.95,)
        return [replace(options, shape=tuple(max(2, int(n * s)) for n in DEFAULT_SHAPE)) for s in scales]

    # ---- arrays -------------------------------------------------------------------------------

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {n: getattr(self, n) for n in ("values", "theta_i", "theta_o", "delta_phi", "lent")}

    def attributes(self) -> dict[str, Any]:
        return {"between": self.between}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        between = attributes.get("between")
        if not isinstance(between, str) or between not in BETWEEN:
            raise bad_field(cls.name, "between", repr(between)[:40], " or ".join(BETWEEN))
        values, lent = arrays.get("values"), arrays.get("lent")
        if values is None or values.dtype not in (np.float32, np.float64) or values.ndim != 4:
            got = "nothing" if values is None else f"{values.dtype} {values.shape}"
            raise bad_field(cls.name, "values", got, "float32 or float64 (I, O, D, channels)")
        last = np.pi if flags["bilateral"] else 2 * np.pi
        for axis, (name, top) in enumerate((("theta_i", HALF_PI), ("theta_o", HALF_PI), ("delta_phi", last))):
            nodes = arrays.get(name)
            if nodes is None or nodes.dtype != np.float64 or nodes.shape != values.shape[axis : axis + 1]:
                raise bad_field(cls.name, name, "missing, or of another size", f"float64 ({values.shape[axis]},)")
            good = nodes.size > 0 and nodes[0] >= 0 and nodes[-1] <= top and (np.diff(nodes) > 0).all()
            if not good or (name == "delta_phi" and not flags["bilateral"] and not _is_turn(nodes)):
                raise bad_field(cls.name, name, str(nodes[:8].tolist())[:80], f"ascending angles within 0 to {top:.6g}")
        if values.shape[3] != len(channels) or values.size > _MOST_VALUES or not np.isfinite(values).all():
            raise bad_field(cls.name, "values", str(values.shape), f"finite values of {len(channels)} channel(s)")
        if lent is None or lent.dtype != np.uint8 or lent.shape != values.shape[:1] or (lent != 0).all():
            raise bad_field(
                cls.name, "lent", "missing, or of another size", f"uint8 ({values.shape[0]},), one of them 0"
            )
        if flags["non_negative"] and values.min() < 0:
            raise bad_field(cls.name, "values", f"as low as {values.min()}", "none below 0, as non_negative says")
        return cls(arrays, channels, flags, between)


def cell_centres(count: int, whole: float) -> Float64Array:
    """Middles of `count` even cells of [0, whole], rad, by way of degrees as files give them."""
    return np.asarray(np.radians((np.arange(count) + 0.5) * (np.degrees(whole) / count)))


def _is_turn(nodes: Float64Array) -> bool:
    """Whether delta_phi nodes go once around."""
    return bool(nodes.size >= 2 and nodes[0] == 0 and nodes[-1] == 2 * np.pi)


def _place(x: Float64Array, nodes: Float64Array) -> tuple[npt.NDArray[np.int64], Float64Array]:
    """(cell, position in it in [0, 1]); one node alone is a cell of no width."""
    if nodes.size == 1:
        return np.zeros(x.size, np.int64), np.zeros(x.size)
    cell = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    return cell, np.clip((x - nodes[cell]) / (nodes[cell + 1] - nodes[cell]), 0, 1)


def _least(theta: Float64Array) -> Float64Array:
    return np.maximum(np.cos(theta), LEAST_COSINE)


def _turned(turn: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(theta_o up to pi, delta_phi) of wo turned by `turn`, rad, in the plane of incidence, away from the light; where
    `turn` is 0 the angles as they are."""
    s_o, c_o = np.sin(theta_o), np.cos(theta_o)
    along, across = s_o * np.cos(delta_phi), s_o * np.sin(delta_phi)
    s, c = np.sin(turn), np.cos(turn)
    x, z = along * c - c_o * s, along * s + c_o * c
    still = turn == 0
    theta = np.where(still, theta_o, np.arctan2(np.hypot(x, across), z))
    return theta, np.where(still, delta_phi, np.arctan2(across, x))
