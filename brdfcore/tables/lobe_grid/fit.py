"""Build a lobe grid: the centre, guides and spacings for which the worst incidence is best, and fitted nodes.

As `tables.base.half_fit`, with three differences. Each range of theta_i counts by its own energy, as an error by angle
of incidence does; the draws are about the source's lobes, whatever their width (`metrics.lobes`); and where the source
itself is made of slices of theta_i (a measured file), nodes lie on these, between which it is linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.kernels.tables.lobe_grid import HALF, LIGHT, MIRROR, angles_of, coordinates_numpy, grid_u, grid_w
from brdfcore.metrics.lobes import Lobes
from brdfcore.tables.base.folding import Sample
from brdfcore.tables.base.half_fit import Fitter, interpolate
from brdfcore.tables.base.layout import FACTORS, STEPS_Z, Layout, grazing
from brdfcore.tables.base.seen import Seen

Float64Array = npt.NDArray[np.float64]

#: Draws that spacings are found on, as many in each range of theta_i; edges of these, degrees.
_DRAWS, _SEED = 24_000, 4_801
_EDGES = np.radians([0, 4, 8, 13, 18, 24, 30, 36, 42, 48, 54, 59, 64, 68, 72, 76, 79, 82, 84, 86, 88, 89.8])
_BANDS = _EDGES.size - 1
#: What errors in the last two ranges count: they may be four times those of the others.
_COUNTS = np.array([1.0] * (_BANDS - 2) + [0.25, 0.25])
#: Shape of the lattice on which centre, factor and spacing are compared.
_COARSE = (22, 12, 12)
_ROUNDS, _COARSE_STEPS = 4, 12
#: Nodes along distance, theta_i and azimuth (over half a turn), where nothing else is known; they are changed by no
#: more than _LEAN, from what _FINER times the nodes of one axis gains.
PROPORTIONS, _LEAN, _FINER = (2.0, 1.2, 1.0), 1.7, 1.4
#: Two factors are compared after moving the nodes, unless one has less than this part of the other's error before.
_SURE = 0.5
#: Below this error on the small lattice no other centre is tried.
_GOOD = 0.08
#: theta_i, degrees, over which the guide along the distance is a mean.
_SOME = (1.0, 5.0, 12.0, 20.0, 30.0, 40.0, 50.0, 60.0, 68.0, 74.0, 79.0, 84.0)
#: Directions this close to the horizon are not drawn, rad.
_INSET = float(np.radians(0.1))
#: Below this theta_i, rad, azimuth is on its way to having no meaning.
_POLE = float(np.radians(3.0))


class LobeLayout(Layout):
    """A layout over the coordinates of `kernels.tables.lobe_grid`."""

    def grids(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        low = 0.0 if self.bilateral else -2.0
        return grid_u(), grid_w(), np.linspace(low, 2.0, self.map_p.size)

    def angles(
        self, u: Float64Array, w: Float64Array, z: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        return angles_of(u, w, z, self.mirror)

    def aligned(self, nodes: int, knots: Sequence[float]) -> Layout:
        """With nodes of theta_i, `nodes` in all, on the `knots`, rad: each on the nearest one, in order."""
        last = nodes - 1
        inside = [t for t in knots if 1e-3 < t < HALF_PI - 1e-3]
        if not inside or len(inside) > last // 2:
            return self
        rising = self.map_d[::-1]
        at = np.interp(np.tan(0.5 * (HALF_PI - np.asarray(inside))), grid_w(), self.map_d) * last
        to = np.rint(at).astype(np.int64)
        for k in range(to.size):
            to[k] = max(to[k], (to[k - 1] if k else 0) + 1)
        for k in reversed(range(to.size)):
            to[k] = min(to[k], (to[k + 1] if k < to.size - 1 else last) - 1)
        moved = np.interp(rising * last, [0.0, *at, float(last)], [0.0, *to, float(last)])[::-1] / last
        return replace(self, map_d=moved)


class LobeFitter(Fitter):
    """One source on its way to a lobe grid."""

    pole = _POLE

    def __init__(
        self, sample: Sample, channels: int, bilateral: bool, seen: Seen, lobes: Lobes, knots: Sequence[float]
    ) -> None:
        self.sample, self.bilateral, self.reciprocal, self.seen = sample, bilateral, False, seen
        self.channels, self.lobes, self.knots = channels, lobes, knots
        rng = np.random.default_rng(_SEED)
        low, high = seen.light[0], min(seen.light[1], float(_EDGES[-1]))
        place = np.interp([low, high], _EDGES, np.arange(_BANDS + 1))
        theta_i = np.interp(place[0] + (place[1] - place[0]) * rng.random(_DRAWS), np.arange(_BANDS + 1), _EDGES)
        drawn = lobes.draw(theta_i, rng)
        used = (drawn.weight > 0) & (drawn.theta_o < HALF_PI - _INSET)
        used &= (drawn.theta_o >= seen.view[0]) & (drawn.theta_o <= seen.view[1])
        seen.check_enough(int(used.sum()))
        self.theta_i, self.theta_o, self.delta_phi = drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used]
        self.values = sample(self.theta_i, self.theta_o, self.delta_phi)
        energy = drawn.weight[used] * np.abs(self.values).sum(axis=1)
        self.band = np.clip(np.searchsorted(_EDGES, self.theta_i, side="right") - 1, 0, _BANDS - 1)
        total = np.bincount(self.band, energy, _BANDS)
        share = drawn.weight[used] / np.maximum(total, 1e-300)[self.band]
        self.share = _COUNTS[self.band] * share
        self._sampled: dict[tuple[int, int, int], tuple[Float64Array, ...]] = {}
        self._places: dict[int, tuple[Float64Array, Float64Array, Float64Array]] = {}

    def _at(self, centre: int) -> tuple[Float64Array, Float64Array, Float64Array]:
        if centre not in self._places:
            angles = (self.theta_i, self.theta_o, self.delta_phi)
            self._places[centre] = coordinates_numpy(*angles, self.bilateral, False, centre)
        return self._places[centre]

    # ---- layout -------------------------------------------------------------------------------

    def layout(self) -> Layout:
        """The centre, factor and spacing with the smallest error on a small lattice."""
        found: list[tuple[float, Layout]] = []
        for centre in (HALF, MIRROR, LIGHT):
            found.append(self._best_about(centre))
            if found[-1][0] < _GOOD:
                break
        return min(found, key=lambda each: each[0])[1]

    def _best_about(self, centre: int) -> tuple[float, Layout]:
        """The factor with the smallest error, and then the spacing."""
        found = []
        for factor in FACTORS:
            layout = self._start(factor, centre)
            found.append((self._error(layout, _COARSE)[0], layout))
        found.sort(key=lambda each: each[0])
        best = found[0]
        for error, layout in found[: 1 if found[0][0] < _SURE * found[1][0] else 2]:
            for _ in range(_ROUNDS):
                layout = self._moved(layout, _COARSE)
                error = self._error(layout, _COARSE)[0]
                if error < best[0]:
                    best = (error, layout)
        return best

    def proportions(self, layout: Layout) -> tuple[float, float, float]:
        """How many nodes an axis needs beside the others: n_k ~ sqrt(a_k) in the error sum a_k / n_k^2."""
        base = self._error(layout, _COARSE)[0]
        needs = []
        for axis in range(3):
            shape = list(_COARSE)
            shape[axis] = round(_FINER * shape[axis])
            gain = base - self._error(layout, (shape[0], shape[1], shape[2]))[0]
            needs.append(_COARSE[axis] * np.sqrt(max(gain, 0.05 * base)))
        middle = float(np.prod(needs)) ** (1 / 3)
        usual = float(np.prod(PROPORTIONS)) ** (1 / 3)
        h, d, p = (float(np.clip(n / middle / (u / usual), 1 / _LEAN, _LEAN)) * u for n, u in zip(needs, PROPORTIONS))
        return h, d, p

    def _start(self, factor: str, mirror: int) -> Layout:
        t = np.sqrt(grid_u())
        z = np.linspace(0.0 if self.bilateral else -2.0, 2.0, (2 if self.bilateral else 4) * STEPS_Z + 1)
        quarter = np.floor(np.abs(z))
        part = np.abs(z) - quarter
        phi = np.sign(z) * (quarter * 0.5 * np.pi + np.arctan2(part, 1 - part))
        theta_i = HALF_PI - 2 * np.arctan(grid_w())
        x = t / (1 + t)
        even = 0.6 * np.maximum(np.log2(x) + 10, 0) / 10 + 0.4 * x
        even += self.lobes.energy_within(mirror, t)
        guide_h, guide_d = self._guides(t, grid_w(), factor, mirror)
        return LobeLayout(
            guide_h=guide_h,
            guide_d=guide_d,
            map_h=(even - even[0]) / (even[-1] - even[0]),
            map_d=theta_i / theta_i[0],
            map_p=(phi - phi[0]) / (phi[-1] - phi[0]),
            factor=factor,
            mirror=mirror,
            bilateral=self.bilateral,
            reciprocal=False,
        )

    def _least(self, size: Float64Array) -> float:
        """A spike may hold more than 1e6 times what lies beside it: what is typical there still counts."""
        typical = float(np.median(size[size > 0])) if size.any() else 0.0
        return min(1e-6 * float(np.mean(size)), max(1e-3 * typical, 2.0**-57 * float(size.max(initial=0.0))))

    def _some(self) -> Float64Array:
        return np.tan(0.5 * (HALF_PI - np.radians(_SOME)))

    def _over(self, u: Float64Array, w: Float64Array, factor: str, mirror: int) -> tuple[Float64Array, Float64Array]:
        key = (u.size, w.size, mirror)
        if key not in self._sampled:
            phi = (np.arange(12) + 0.5) / 12 * np.pi
            size = np.sin(phi) / (np.sin(phi) + np.abs(np.cos(phi)))
            z = np.where(phi <= HALF_PI, size, 2 - size)
            if not self.bilateral:
                z = np.concatenate([z, -z])
            at_u, at_w, at_z = np.meshgrid(u, w, z, indexing="ij")
            theta_i, theta_o, delta_phi = angles_of(at_u, at_w, at_z, mirror)
            above = (theta_i < HALF_PI - 1e-5) & (theta_o < HALF_PI - 1e-5)
            weight, f = np.zeros(theta_i.shape), np.zeros(theta_i.shape)
            weight[above] = np.cos(theta_o[above]) * np.cos(theta_i[above]) ** 0.25
            f[above] = self.sample(theta_i[above], theta_o[above], delta_phi[above]).mean(axis=1)
            self._sampled[key] = (theta_i, np.minimum(theta_o, HALF_PI), f, weight)
        theta_i, theta_o, f, weight = self._sampled[key]
        return f / grazing(factor, theta_i, theta_o), weight

    def _coordinates(self, layout: Layout) -> tuple[Float64Array, Float64Array, Float64Array]:
        return self._at(layout.mirror)

    def _error(self, layout: Layout, shape: tuple[int, int, int]) -> tuple[float, Float64Array]:
        """Mean of the worst and the mean range's error of a lattice of this shape, and each draw's part."""
        nodes = self.nodes(layout, shape, steps=_COARSE_STEPS)
        at = self._at(layout.mirror)
        found = interpolate(nodes, layout.positions(at, shape))
        found *= layout.growth(self.theta_i, self.theta_o, *at[:2])[:, None]
        errors = np.abs(found - self.values).sum(axis=1) * self.share
        each = np.bincount(self.band, errors, _BANDS)
        return 0.5 * float(each.max()) + 0.5 * float(each.mean()), errors

    def _pole_mean(self, nodes: Float64Array, layout: Layout, shape: tuple[int, int, int]) -> Float64Array:
        """Of the slice at theta_i = 0 the mean over the azimuth itself, not over its nodes."""
        z = layout.coordinates([np.arange(float(n)) for n in shape], shape)[2]
        quarter = np.floor(np.abs(z))
        part = np.abs(z) - quarter
        phi = np.sign(z) * (quarter * HALF_PI + np.arctan2(part, 1 - part))
        width = np.gradient(phi) * np.where((np.arange(phi.size) % (phi.size - 1)) == 0, 0.5, 1.0)
        return np.asarray((nodes * (width / width.sum())[:, None]).sum(axis=1, keepdims=True))

    def _importance(self, theta_i: Float64Array, theta_o: Float64Array) -> Float64Array:
        return np.asarray(np.cos(theta_o) + 1e-3)


def shape_for(
    nodes: int, bilateral: bool, proportions: tuple[float, float, float] = PROPORTIONS
) -> tuple[int, int, int]:
    """A shape of at most `nodes` nodes."""
    turns = 1 if bilateral else 2
    h, d, p = proportions
    unit = (nodes / (h * d * p * turns)) ** (1 / 3)
    sizes = [max(4, int(h * unit)), max(4, int(d * unit)), max(4, int(p * unit * turns))]
    while np.prod(sizes) > nodes and max(sizes) > 4:
        sizes[int(np.argmax(sizes))] -= 1
    return sizes[0], sizes[1], sizes[2]
