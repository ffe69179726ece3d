"""The representation for scattered measurements: every measured geometry kept, a lattice beside them for look-ups."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.errors import FileFormatError, InputError, LimitError
from brdfcore.base.parameters import Parameter
from brdfcore.base.status import Status
from brdfcore.metrics import measured_flags
from brdfcore.tables.base.half_lattice import HalfLattice, lattice_arrays
from brdfcore.tables.base.table import BuildOptions, Progress
from brdfcore.tables.scattered.coverage import Coverage
from brdfcore.tables.scattered.fit import Predictor, Settings, assumptions_apart, choose
from brdfcore.tables.scattered.held_out import OFF, given_back, half_widths, held_out
from brdfcore.tables.scattered.lattice import Policy, lattice_shape, layout_of, meet, nodes_of
from brdfcore.tables.scattered.residuals import LONGEST_REACH, Residuals

Float64Array = npt.NDArray[np.float64]

#: Most geometries regridded, and most nodes of the lattice, times channels: minutes and gigabytes beyond.
MAX_POINTS, MAX_NODES = 200_000, 20_000_000
#: Fewest geometries: with less nothing is known between them.
MIN_POINTS = 8
#: Largest f_r taken, 1/sr: a mirror seen under a tenth of a microradian.
LARGEST_VALUE = 1e15
HOLES = ("continue", "nearest", "zero")


class Scattered(HalfLattice):
    """Scattered measurements regridded to half/difference coordinates; the geometries stay beside the lattice.

    `status` tells measured, interpolated, extrapolated and filled apart (`tables.scattered.coverage`). Between the
    measurements f is predicted by `tables.scattered.fit`; the lattice of predicted nodes is looked up as
    `half_difference` is.

    Arrays beside those of `half_difference`:

        angles    float64 (n, 3)  theta_i, theta_o, delta_phi of each row, rad, repeats and both sides as measured
        measured  float64 (n, C)  its f_r in 1/sr

    Where the lattice misses measured geometries its residuals are given back around them (`scattered.residuals`), with
    three arrays more. A value at a measured geometry that is farther than `OFF` from the file is SMOOTHED.
    """

    name = "scattered"
    SUMMARY = "scattered measurements, all kept, and a half/difference lattice predicted from them"
    PARAMETERS = (
        Parameter("shape", "", "nodes along theta_h, theta_d and half a turn of phi_d", "64,28,24", kind="text"),
        Parameter("interpolation", "", "between the nodes", "linear", kind="choice", choices=("linear",)),
    )

    EVALUATION_VERSION = 2

    angles: Float64Array
    measured: Float64Array
    policy: Policy
    settings: Settings
    residuals: Residuals | None

    def _keep(
        self,
        angles: Float64Array,
        measured: Float64Array,
        policy: Policy,
        settings: Settings,
        residuals: Residuals | None,
    ) -> Self:
        self.angles, self.measured, self.policy, self.settings = angles, measured, policy, settings
        self.residuals = residuals
        # the lattice is asked from angles alone where something is added to it
        self._takes_vectors = residuals is None
        return self

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        inside = super()._evaluate(theta_i, theta_o, delta_phi, out)
        if inside and self.residuals is not None:
            lowest = min(0.0, float(self.measured.min()))
            self.residuals.add_to(theta_i, theta_o, delta_phi, out, two_sided=not self.bilateral, lowest=lowest)
        return inside

    @cached_property
    def coverage(self) -> Coverage:
        """Which pairs of directions the measurements cover."""
        return Coverage(self.angles, self.policy.gap, self.bilateral)

    @cached_property
    def off(self) -> Float64Array:
        """How far the table is from each row of the file, relative to it, the worst channel, (n,); inf from a 0."""
        difference = np.abs(self.evaluate(*self.angles.T) - self.measured)
        size = np.abs(self.measured)
        worst = np.divide(difference, size, out=np.where(difference > 0, np.inf, 0.0), where=size > 0)
        return np.asarray(worst.max(axis=1))

    def smoothed(self) -> dict[str, Any]:
        """How many rows of the file the table does not return to `OFF`, of how many, and how far it is from them."""
        off = self.off[self.off > OFF]
        far = {f"off by, {name}": float(f"{q:.3g}") for name, q in (("median", np.median(off)), ("at most", off.max()))
               if np.isfinite(q)} if off.size else {}  # fmt: skip
        return {"rows": int(off.size), "of": len(self.angles), **far}

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        angles = [a.astype(np.float64, copy=False) for a in (theta_i, theta_o, delta_phi)]
        codes = self.coverage.status(*angles)
        measured = np.flatnonzero(codes == Status.MEASURED)
        if measured.size:
            # repeats of one geometry are told apart by nothing: the farthest of them counts
            rows = self.coverage.nearest(*(a[measured] for a in angles))
            codes[measured[self._smoothed_rows[rows]]] = Status.SMOOTHED
        return codes

    @cached_property
    def _smoothed_rows(self) -> npt.NDArray[np.bool_]:
        points = np.rint(self.angles / _SAME_GEOMETRY)
        group = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)
        return np.asarray(np.bincount(group, self.off > OFF)[group] > 0)

    @property
    def measured_against(self) -> bool:
        return True  # measurements are not exact between them

    # ---- build --------------------------------------------------------------------------------

    @classmethod
    def from_points(
        cls,
        angles: Float64Array,
        values: Float64Array,
        channels: Channels,
        *,
        bilateral: bool,
        policy: Policy,
        instrument: Float64Array | None = None,
        progress: Progress | None = None,
    ) -> Self:
        """Regrid measurements at `angles` (n, 3) in rad with `values` (n, channels) in 1/sr; repeats are averaged.

        bilateral   whether -delta_phi means the same as delta_phi.
        instrument  half-widths (n, channels) of 95 % intervals that the file states, 1/sr.
        `report["done"]` says what was changed or filled. Raises `InputError` for too few geometries or a shape that
        can't be, `LimitError` for too many.
        """
        points, means, group = merged(angles, values, bilateral)
        if instrument is not None:
            instrument = merged(angles, instrument, bilateral)[1]
        n = len(points)
        if n < MIN_POINTS:
            raise InputError(
                "too_few_geometries",
                f"{n} geometries measured: at least {MIN_POINTS} are needed to say anything between them",
                where="measurements",
                got=n,
                expected=f"at least {MIN_POINTS}",
            )
        shape = lattice_shape(policy.shape, bilateral)
        if n > MAX_POINTS or np.prod([float(s) for s in shape]) * len(channels) > MAX_NODES:
            raise LimitError(
                "too_large",
                f"{n} geometries, a lattice of {list(shape)} nodes and {len(channels)} channels: at most {MAX_POINTS} "
                f"geometries and {MAX_NODES} values are taken",
                where="measurements",
                got=n,
                limit=MAX_POINTS,
            )
        largest = float(np.abs(means).max())
        if not largest <= LARGEST_VALUE:
            raise LimitError(
                "value_too_large",
                f"a value of {largest:.3g}/sr: no instrument resolves more than {LARGEST_VALUE:g}/sr; is the unit "
                "or the column right?",
                where="measurements",
                got=largest,
                limit=LARGEST_VALUE,
            )
        if progress is not None:
            progress(0, 1, "choosing the interpolator")
        coverage = Coverage(angles, policy.gap, bilateral)
        settings, error = choose(points, means, bilateral, coverage.in_plane, policy.smoothing, policy.plane)
        predictor = Predictor(points, means, bilateral, coverage.in_plane, settings)
        layout = layout_of(bilateral)
        nodes, done = nodes_of(predictor, layout, shape, coverage, values, policy, progress)
        meet(nodes, layout, points, predictor.fitted(points))
        if n < len(angles):
            done.insert(0, f"{len(angles)} rows averaged into {n} geometries")
        arrays, scale, guide = lattice_arrays(nodes, layout)
        flags = {**dict.fromkeys(FLAGS, False), "bilateral": bilateral}
        table = cls(arrays, scale, guide, layout.factor, False, channels, flags)
        rows = np.ascontiguousarray(angles), np.ascontiguousarray(values)
        table._keep(*rows, policy, settings, None)
        if progress is not None:
            progress(0, 1, "predicting each geometry from the others")
        once = Coverage(points, policy.gap, bilateral)
        found = held_out(predictor, points, means, once)
        left = means - table.evaluate(*points.T)
        wanted = given_back(found, means, left)
        if wanted.any():
            table._keep(*rows, policy, settings, Residuals.of(points, left, wanted, min(policy.gap, LONGEST_REACH)))
        if found is not None:
            apart = assumptions_apart(points, means, settings) if coverage.in_plane else None
            table.local_error = half_widths(found, values, group, once, table.nbytes, instrument, apart)
        measured = measured_flags(table)
        table.reciprocal, table.energy_conserving = measured["reciprocal"], measured["energy_conserving"]
        table.non_negative = bool((arrays["values"] >= 0).all())
        table.report = {
            "done": done,
            "smoothed": table.smoothed(),
            "interpolation": {
                **settings.to_json(),
                "held-out error": None if np.isnan(error) else float(f"{error:.3g}"),
                "in the plane of incidence only": coverage.in_plane,
            },
        }
        return table

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Measure `source` at the geometries of a goniometer, or take those it was measured at, and regrid them."""
        if options.interpolation != "linear":
            raise InputError(
                "bad_option",
                f"interpolation = {options.interpolation!r}: scattered offers 'linear'",
                where="interpolation",
                got=options.interpolation,
                expected="linear",
            )
        bilateral = source.bilateral or "bilateral" in options.fold
        policy = Policy(negatives=options.negatives, shape=options.shape)
        if isinstance(source, Scattered):
            angles, values = source.angles, source.measured
            policy = Policy(source.policy.holes, options.negatives, source.policy.smoothing, source.policy.gap,
                            options.shape or source.policy.shape, source.policy.plane)  # fmt: skip
        else:
            angles = goniometer(bilateral)
            values = source.evaluate(*angles.T).astype(np.float64)
        if "reciprocal" in options.fold:
            raise InputError(
                "bad_option", "fold = 'reciprocal': scattered measurements are not averaged over it", where="fold"
            )
        table = cls.from_points(angles, values, source.channels, bilateral=bilateral, policy=policy, progress=progress)
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {
            **source.report, **table.report, "done": [*source.report.get("done", []), *table.report["done"]]
        }  # fmt: skip
        return table

    @classmethod
    def can_hold(cls, source: Brdf) -> bool:
        return isinstance(source, Scattered)

    # ---- arrays -------------------------------------------------------------------------------

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        left = {} if self.residuals is None else self.residuals.arrays()
        return {**super().to_arrays(), "angles": self.angles, "measured": self.measured, **left}

    def attributes(self) -> dict[str, Any]:
        policy = {"holes": self.policy.holes, "negatives": self.policy.negatives, "gap": self.policy.gap}
        policy |= {"smoothing": self.policy.smoothing, "shape": list(self.policy.shape or ())}
        policy |= {"plane": self.policy.plane}
        return {**super().attributes(), "policy": policy, "settings": self.settings.to_json()}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        table = super().from_arrays(arrays, attributes, channels, flags)
        for name, width in (("angles", 3), ("measured", len(channels))):
            array = arrays.get(name)
            fits = array is not None and array.dtype == np.float64 and array.ndim == 2 and array.shape[1] == width
            if array is None or not fits or not np.isfinite(array).all() or not 1 <= len(array) <= MAX_POINTS:
                got = "nothing" if array is None else f"{array.dtype} {array.shape}"
                raise cls._bad(name, got, f"finite float64 (n, {width})")
        angles = np.require(arrays["angles"], requirements=("C", "A", "W"))
        measured = np.require(arrays["measured"], requirements=("C", "A", "W"))
        if len(angles) != len(measured):
            raise cls._bad("measured", f"{len(measured)} rows", f"{len(angles)}, as many as angles")
        if (angles[:, :2] < 0).any() or (angles[:, :2] > HALF_PI).any():
            raise cls._bad("angles", "a polar angle outside [0, pi/2]", "polar angles within it")
        residuals = Residuals.from_arrays(arrays, len(channels), MAX_POINTS)
        if isinstance(residuals, str):
            raise cls._bad(residuals, "missing or of another shape", "what fits `kept`")
        return table._keep(angles, measured, *_settings_of(cls, attributes), residuals)


def _settings_of(cls: type[Scattered], attributes: Mapping[str, Any]) -> tuple[Policy, Settings]:
    """Policy and settings as `attributes` holds them; `FileFormatError` where they do not fit."""
    try:
        given = dict(attributes["policy"])
        shape = tuple(int(n) for n in given.pop("shape"))
        policy = Policy(**given, shape=shape or None)
        settings = Settings(**attributes["settings"])
        good = policy.holes in HOLES and policy.negatives in ("keep", "zero") and 0 < float(policy.gap) <= HALF_PI
        good = good and all(isinstance(x, (int, float)) for x in (settings.width, settings.stretch, settings.floor))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        good = False
    if not good:
        bad: FileFormatError = cls._bad("policy", "missing or malformed", "how the measurements were regridded")
        raise bad
    return policy, settings


#: Geometries closer than this in every angle, rad, are one; `formats.base.measurements.SAME_ANGLE`.
_SAME_GEOMETRY = 1e-4


def merged(
    angles: Float64Array, values: Float64Array, fold: bool
) -> tuple[Float64Array, Float64Array, npt.NDArray[np.intp]]:
    """(angles, means, number of each row's geometry): each geometry once, repeats averaged, in the order of their
    first; with `fold` delta_phi and -delta_phi are one, and delta_phi >= 0."""
    turned = angles.copy()
    if fold:
        turned[:, 2] = np.abs(turned[:, 2])
    turned[np.minimum(turned[:, 0], turned[:, 1]) < _SAME_GEOMETRY, 2] = 0  # no azimuth at the normal
    keys = np.rint(turned / _SAME_GEOMETRY)
    _, first, group, count = np.unique(keys, axis=0, return_index=True, return_inverse=True, return_counts=True)
    sums = np.zeros((count.size, values.shape[1]))
    np.add.at(sums, group.reshape(-1), values)
    order = np.argsort(first)
    return turned[first[order]], (sums / count[:, None])[order], np.argsort(order)[group.reshape(-1)]


def goniometer(bilateral: bool) -> Float64Array:
    """Geometries (n, 3) at which a `Brdf` is measured that is not a measurement: 10, 8 and 15 degrees apart, closer at
    the mirror direction; to 80 degrees of incidence."""
    lights, viewers = np.radians(np.arange(0, 81, 10.0)), np.radians(np.arange(0, 81, 8.0))
    turns = np.radians(np.arange(0 if bilateral else -165, 181, 15.0))
    grid = np.stack(np.meshgrid(lights[1:], viewers[1:], turns, indexing="ij"), axis=-1).reshape(-1, 3)
    at_normal = [(0.0, o, 0.0) for o in viewers] + [(i, 0.0, 0.0) for i in lights[1:]]
    lobe = [
        (i, np.clip(i + np.radians(d), 0, HALF_PI), np.pi) for i in lights[1:] for d in (-7, -4, -2, -1, 0, 1, 2, 4, 7)
    ]
    angles = np.concatenate([grid, at_normal, lobe])
    _, first = np.unique(np.rint(angles / 1e-4), axis=0, return_index=True)
    return np.ascontiguousarray(angles[np.sort(first)])
