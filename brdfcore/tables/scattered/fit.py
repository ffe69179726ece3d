"""Predict f_r between scattered measurements: radial basis functions in half/difference coordinates and log space.

f is interpolated as asinh(f/d): the logarithm where f is above d, linear through 0 below, so that zeros and negative
noise stay what they are. Coordinates: theta_h on a logarithmic scale that resolves the lobe, theta_d, theta_i and
theta_o; one more, odd in delta_phi, where both sides were measured; two alone for measurements in the plane of
incidence, which do not tell how f goes on out of it (`tables.scattered.in_plane`). The scales, d, the basis function
and its smoothing are chosen by cross-validation.

Interpolation: `tables.scattered.radial`, and of many measurements from the nearest alone
`scipy.interpolate.RBFInterpolator` (G. Fasshauer, Meshfree Approximation Methods with MATLAB, 2007, DOI
10.1142/6437).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.tables.scattered.coverage import sideways
from brdfcore.tables.scattered.in_plane import Plane, assumption, misfits, not_ruled_out, off_mirror
from brdfcore.tables.scattered.radial import Radial

Float64Array = npt.NDArray[np.float64]

#: Measurements above which each value is predicted from its nearest ones instead of all, and their number.
ALL_AT_ONCE, NEIGHBOURS = 2_500, 64
#: Measurements that settings are chosen on, and the share of them that is held out; seeded.
_CHOSEN_ON, _HELD_OUT, _SEED = 1_200, 0.25, 20_261_122
#: A prediction may pass the largest measured value of its channel by this factor: a lobe may peak between samples.
HEADROOM = 2.0


@dataclass(frozen=True)
class Settings:
    """How measurements are predicted.

    width      rad; theta_h is resolved linearly below it, logarithmically above.
    stretch    weight of that coordinate beside the angles.
    kernel     basis function, of `radial.Radial`.
    smoothing  on the diagonal of its equations.
    noise      "relative": the same smoothing everywhere, as fits errors proportional to f; "additive": times
               10 d^2/(f^2 + d^2), as fits errors of one size, which only small values feel.
    floor      d of asinh(f/d) as a share of the median measurement.
    plane      of measurements in the plane of incidence only: what keeps its value out of it, of `in_plane.ASSUMED`.
    power      p of f (cos(theta_i) cos(theta_o))^p, which then keeps it.
    """

    width: float = 0.05
    stretch: float = 1.0
    kernel: str = "thin_plate_spline"
    smoothing: float = 1e-3
    noise: str = "additive"
    floor: float = 0.1
    plane: str = "f"
    power: float = 0.0

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


#: Tried from left to right: first the coordinates, then the basis function, then d.
_COORDINATES = tuple((w, s) for w in (0.3, 0.05, 0.01, 0.002) for s in (1.0, 3.0))
_BASES = (
    ("thin_plate_spline", 1e-3, "relative"),
    ("thin_plate_spline", 1e-2, "relative"),
    ("thin_plate_spline", 1e-1, "relative"),
    ("thin_plate_spline", 1e-2, "additive"),
    ("linear", 0.0, "relative"),
    ("linear", 3e-2, "relative"),
    ("linear", 3e-2, "additive"),
)
_FLOORS = (0.01,)
#: What misses the measured energy itself by 1 % counts as a held-out error of .1 %: a lobe is not smoothed away.
_ENERGY_WEIGHT = 0.1
#: A setting later in the list has to be better by this factor: chance picks no odd one.
_BETTER = 0.98
#: Extent, against the largest, below which measurements do not extend in a direction of the coordinates.
_FLAT = 1e-6
#: Smoothing of points with no noise to speak of: keeps the equations solvable where geometries nearly meet.
_LEAST_SMOOTHING = 1e-8


class Predictor:
    """f_r anywhere from measurements at `angles` (n, 3) with `values` (n, channels); no two at the same angles."""

    def __init__(
        self, angles: Float64Array, values: Float64Array, bilateral: bool, in_plane: bool, settings: Settings
    ) -> None:
        self.bilateral, self.in_plane, self.settings = bilateral, in_plane, settings
        self._grazing = float(np.cos(min(angles[:, :2].max(), HALF_PI - 1e-3)))
        values = values * self._factor(angles[:, 0], angles[:, 1])
        typical = np.abs(values).mean(axis=1)
        found = typical[typical > 0]
        self.floor = settings.floor * float(np.median(found)) if found.size else 1.0
        transformed = np.arcsinh(values / self.floor)
        highest = np.arcsinh(HEADROOM * values.max(axis=0) / self.floor)
        self._limits = np.minimum(transformed.min(axis=0), 0), np.maximum(highest, transformed.max(axis=0))
        features = self._features(*angles.T)
        self._range = features.min(axis=0), features.max(axis=0)
        # coordinates that never change, or only together, would make the linear part of the interpolator singular
        self._centre = features.mean(axis=0)
        _, sizes, axes = np.linalg.svd(features - self._centre, full_matrices=False)
        self._axes = axes[sizes > _FLAT * sizes[0]].T
        local = len(angles) > ALL_AT_ONCE
        # the nearest measurements may lie in a plane: no linear part for them
        linear = settings.kernel == "thin_plate_spline" or (not local and len(angles) > 4 * (self._axes.shape[1] + 1))
        smoothing, degree = self._smoothing(typical), 1 if linear else 0
        self._own = self._factor(angles[:, 0], angles[:, 1])
        self.radial: Radial | None = None
        if local:
            from scipy.interpolate import RBFInterpolator

            self._interpolator: Any = RBFInterpolator(  # type: ignore[call-overload]  # a kernel of `_BASES`
                self._flattened(features),
                transformed,
                kernel=settings.kernel,
                smoothing=smoothing,
                degree=degree,
                neighbors=NEIGHBOURS,
            )
        else:
            flat = self._flattened(features)
            self.radial = self._interpolator = Radial(flat, transformed, settings.kernel, smoothing, degree)

    def _flattened(self, features: Float64Array) -> Float64Array:
        return np.asarray((features - self._centre) @ self._axes)

    def _smoothing(self, typical: Float64Array) -> Float64Array | float:
        if self.settings.noise == "relative" or self.settings.smoothing == 0:
            return self.settings.smoothing
        share = 10 / ((typical / self.floor) ** 2 + 1)
        return np.asarray(self.settings.smoothing * share + _LEAST_SMOOTHING)

    def _features(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        from brdfcore.kernels.tables.half_coordinates import coordinates_numpy

        u, w, _ = coordinates_numpy(theta_i, theta_o, delta_phi, True, True)
        return self.features(np.arctan(np.sqrt(u)), np.arccos(np.sqrt(w)), theta_i, theta_o, delta_phi)

    def features(
        self,
        theta_h: Float64Array,
        theta_d: Float64Array,
        theta_i: Float64Array,
        theta_o: Float64Array,
        delta_phi: Float64Array,
    ) -> Float64Array:
        """Coordinates of pairs of directions, below the horizon too, (n, k)."""
        width = self.settings.width
        lobe = self.settings.stretch * np.arcsinh(theta_h / width) / np.arcsinh(HALF_PI / width)
        if self.in_plane and self.settings.plane == "lobe":
            away = off_mirror(theta_i, theta_o, delta_phi)
            lobe = self.settings.stretch * np.arcsinh(away / width) / np.arcsinh(np.pi / width)
            return np.stack([lobe, theta_i], axis=1)
        if self.in_plane:
            return np.stack([lobe, theta_d], axis=1)
        columns = [lobe, theta_d, theta_i, theta_o]
        if not self.bilateral:
            columns.append(sideways(theta_i, theta_o, delta_phi))
        return np.stack(columns, axis=1)

    def _factor(self, theta_i: Float64Array, theta_o: Float64Array) -> Float64Array:
        """What f is multiplied by before it is interpolated, (n, 1): (cos(theta_i) cos(theta_o))^p, each cosine held at
        its smallest measured value beyond the most grazing angle."""
        if not (self.in_plane and self.settings.power):
            return np.ones((1, 1))
        cosines = np.prod([np.maximum(np.cos(t), self._grazing) for t in (theta_i, theta_o)], axis=0)
        return np.asarray(cosines**self.settings.power)[:, None]

    def __call__(
        self, features: Float64Array, theta_i: Float64Array, theta_o: Float64Array
    ) -> tuple[Float64Array, int]:
        """(f_r (n, channels), how many values were held to `HEADROOM` times the largest measured one).

        Coordinates beyond the range of the measured ones are held at its limits: f goes on as it was there.
        """
        found = self._interpolator(self._flattened(np.clip(features, *self._range)))
        limited = int((found > self._limits[1]).sum())
        return self._restored(found) / self._factor(theta_i, theta_o), limited

    def _restored(self, found: Float64Array) -> Float64Array:
        return np.asarray(np.sinh(np.clip(found, *self._limits)) * self.floor)

    def fitted(self, angles: Float64Array) -> Float64Array:
        """f_r at the measurements themselves, whose `angles` (n, 3) these are, (n, channels)."""
        return self.at(*angles.T) if self.radial is None else self._restored(self.radial.fitted) / self._own

    def without(self, part: npt.NDArray[np.intp], others: npt.NDArray[np.intp]) -> tuple[Float64Array, Float64Array]:
        """f_r at the measurements `part` and `others`, by index, as all but `part` say; of one with `radial` only."""
        assert self.radial is not None
        own = np.broadcast_to(self._own, (len(self.radial.values), 1))
        return tuple(
            self._restored(found) / own[rows]
            for found, rows in zip(self.radial.without(part, others), (part, others), strict=True)
        )  # type: ignore[return-value]

    def at(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        """f_r of pairs of directions, (n, channels)."""
        return self(self._features(theta_i, theta_o, delta_phi), theta_i, theta_o)[0]


def choose(
    angles: Float64Array,
    values: Float64Array,
    bilateral: bool,
    in_plane: bool,
    smoothing: float | None = None,
    plane: str = "auto",
) -> tuple[Settings, float]:
    """(settings, their mean relative error on a seeded held-out quarter); `smoothing` as given, `plane` as asked.

    The smallest of that error plus a tenth of the L1 error (weight c_o) on the other three quarters. The relative error
    of a geometry is sum |f' - f| / sum |f| over its channels, at most 1.
    """
    rng = np.random.default_rng(_SEED)
    order = rng.permutation(len(angles))[:_CHOSEN_ON]
    held, kept = np.split(order, [int(_HELD_OUT * order.size)])
    local = len(angles) > ALL_AT_ONCE
    assumed = assumption(angles, values, plane)._asdict() if in_plane else {"name": Settings.plane, "power": 0.0}
    outside: dict[str, Any] = {"plane": assumed["name"], "power": assumed["power"]}
    robust = Settings(kernel="linear", smoothing=3e-2 if smoothing is None else smoothing, noise="relative", **outside)
    best = robust if local else Settings(smoothing=Settings.smoothing if smoothing is None else smoothing, **outside)
    if held.size < 4 or kept.size < 12:
        return robust, float("nan")

    cosine = np.cos(angles[kept, 1])
    energy = float(cosine @ np.abs(values[kept]).sum(axis=1)) or 1.0

    def errors(settings: Settings) -> tuple[float, float]:
        try:
            predictor = Predictor(angles[kept], values[kept], bilateral, in_plane, settings)
        except np.linalg.LinAlgError:  # measurements that lie too regularly for this basis
            return np.inf, np.inf
        found = float(relative_errors(values[held], predictor.at(*angles[held].T)).mean())
        lost = float(cosine @ np.abs(predictor.fitted(angles[kept]) - values[kept]).sum(axis=1)) / energy
        return found + _ENERGY_WEIGHT * lost, found

    least = errors(best)
    stages: list[list[dict[str, Any]]] = [
        [{"width": w, "stretch": s} for w, s in _COORDINATES],
        [
            {"kernel": k, "smoothing": s if smoothing is None else smoothing, "noise": n}
            for k, s, n in _BASES
            if not local or k == "linear"
        ],
        [{"floor": f} for f in _FLOORS],
    ]
    for stage in stages:
        start = best
        for change in stage:
            candidate = replace(start, **change)
            if candidate == start:
                continue
            found = errors(candidate)
            if found[0] < _BETTER * least[0]:
                best, least = candidate, found
    return (best, least[1]) if np.isfinite(least[0]) else (robust, float("nan"))


def assumptions_apart(
    angles: Float64Array, values: Float64Array, settings: Settings
) -> Callable[[Float64Array], Float64Array]:
    """Of measurements in the plane of incidence: how far f is from that of any other assumption which they do not rule
    out, at angles (n, 3), relative to |f|, the channels' mean, (n,)."""
    mean = values.mean(axis=1, keepdims=True)
    chosen = Predictor(angles, mean, True, True, settings)
    open_ = not_ruled_out(misfits(angles, values), Plane(settings.plane, settings.power))
    others = [Predictor(angles, mean, True, True, replace(settings, plane=p.name, power=p.power)) for p in open_]

    def apart(places: Float64Array) -> Float64Array:
        own = chosen.at(*places.T)[:, 0]
        far = np.max([np.abs(other.at(*places.T)[:, 0] - own) for other in others], axis=0)
        return np.asarray(far / (np.abs(own) + 0.01 * chosen.floor))

    return apart


def relative_errors(truth: Float64Array, predicted: Float64Array) -> Float64Array:
    """sum |f' - f| / sum |f| over the channels, (n,), at most 1; 0 where both are 0."""
    size = np.abs(truth).sum(axis=1)
    difference = np.abs(predicted - truth).sum(axis=1)
    ratio = np.divide(difference, size, out=np.where(difference > 0, np.inf, 0.0), where=size > 0)
    return np.asarray(np.minimum(ratio, 1.0))
