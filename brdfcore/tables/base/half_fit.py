"""Build a half/difference table: guides along theta_h and theta_d, node spacings that follow the error, fitted nodes.

1. Guides. log2 f/K is split into a function of theta_h and one of (theta_d, phi_d) by alternating means over a fixed
   set of (theta_d, phi_d): no sampling noise, so what the guide leaves is as smooth as the material. It holds the
   shape of the lobe, whatever its width. The second guide is the mean of what is left over theta_d: Fresnel's rise,
   and the growth with which microfacet models and measurements approach the horizon near the mirror direction
   (without it the albedo of gold at 89.9 degrees is off by 14 %). The table holds the rest, which is of order 1.
2. Spacing. On a small lattice, fitted as in 3, the error of seeded directions is binned along each axis and the nodes
   are moved to where it is; the best of a few rounds is kept. A dark direction also counts by its relative error.
3. Nodes. Least squares on 2 x 2 x 2 Gauss points a cell (`kernels.tables.lattice_fit`), relative to the value's size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.directions import DirectionSet, mixture
from brdfcore.tables.base.layout import FACTORS, STEPS_Z, Layout, angles_of, grazing
from brdfcore.tables.base.seen import EVERYWHERE, Seen

Float64Array = npt.NDArray[np.float64]
Sample = Callable[[Float64Array, Float64Array, Float64Array], Float64Array]

#: Octaves that the guide may span: with K and the nodes the value stays within float32.
_OCTAVES = 60
#: Octaves to either side that the guide along theta_d may take.
_DEPTH = 12
#: theta_h, degrees, over which the guide along theta_d is a mean.
_FEW = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0, 22.0, 29.0, 37.0)
#: Nodes of the lattice on which factor and spacing are chosen, and rounds of moving them.
_COARSE, _ROUNDS = 9_000, 3
_DRAWS, _DRAW_SEED = 60_000, 7_919
#: Steps of the solver for the final nodes, and where only spacings are compared.
_STEPS, _COARSE_STEPS = 60, 15
#: The mirror direction's coordinate is taken where it has less than this part of the error.
_MIRROR_GAIN = 0.7
#: Directions evaluated at a time.
_CHUNK = 262_144
#: Weight of |difference|^2 between neighbours against the median node's own.
_SMOOTHNESS = 1e-4
#: Values that differ by no more than this share are one.
_CONSTANT = 1e-9
#: Below this share of its median magnitude a value counts as that large when errors are made relative.
_FLOOR = 0.1
#: Weight of directions that the table is not wanted for: enough to continue sensibly, too little to take from the rest.
_UNSEEN = 1e-3
#: Least share of _DRAWS that has to be within the angles seen, and most that are drawn to have it.
_LEAST_SHARE, _MOST_DRAWS = 0.4, 1_000_000
#: What the mean relative error counts beside L1 when nodes are placed: at 0.3 dark directions halve their error and L1
#: stays as it is. Below _DARKEST of the mean value a direction counts as that bright.
_RELATIVE, _DARKEST = 0.3, 0.001


class Fitter:
    """One source on its way to a table."""

    #: theta_i, rad, below which the last axis has no meaning.
    pole = 0.0

    def __init__(
        self, source: Brdf, sample: Sample, bilateral: bool, reciprocal: bool, seen: Seen = EVERYWHERE
    ) -> None:
        from brdfcore.kernels.tables.half_coordinates import coordinates_numpy

        self.sample, self.bilateral, self.reciprocal, self.seen = sample, bilateral, reciprocal, seen
        self.channels = len(source.channels)
        drawn, used = self._drawn(_DRAWS)
        if (few := used.sum() / _DRAWS) < _LEAST_SHARE:  # a narrow range: as many draws within it as it takes
            drawn, used = self._drawn(min(int(_DRAWS * _LEAST_SHARE / max(few, 1e-9)), _MOST_DRAWS))
        seen.check_enough(int(used.sum()))
        self.theta_i, self.theta_o, self.delta_phi = drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used]
        self.values = sample(self.theta_i, self.theta_o, self.delta_phi)
        angles = (self.theta_i, self.theta_o, self.delta_phi)
        self.at = {kind: coordinates_numpy(*angles, bilateral, reciprocal, kind) for kind in (False, True)}
        lobe = drawn.lobe[used]
        cosines = np.cos(self.theta_i) * np.cos(self.theta_o)
        energy = cosines * np.abs(self.values).sum(axis=1)
        # each half of the draws counts for itself: an error far from the lobe is not excused by the lobe's energy
        self.share = cosines / np.where(lobe, max(energy[lobe].sum(), 1e-300), max(energy[~lobe].sum(), 1e-300))
        self.lobe = lobe
        # and a dark direction counts by its relative error
        size = np.abs(self.values).sum(axis=1)
        dark = np.where(lobe, 0, cosines)
        dark /= max(float(dark.sum()), 1e-300)
        self.relative = dark / np.maximum(size + _DARKEST * float((dark * size).sum()), 1e-300)

    def _drawn(self, count: int) -> tuple[DirectionSet, npt.NDArray[np.bool_]]:
        """Seeded directions, and which of them are seen and above the horizon."""
        drawn = mixture(count, _DRAW_SEED)
        used = (drawn.weight > 0) & (np.maximum(drawn.theta_i, drawn.theta_o) < np.radians(89.5))
        return drawn, used & self.seen.holds(drawn.theta_i, drawn.theta_o)

    # ---- guide and spacing --------------------------------------------------------------------

    def layout(self) -> Layout:
        """The factor and spacing with the smallest error on a small lattice."""
        shape = shape_for(_COARSE, self.bilateral, self.reciprocal)[0]
        best: tuple[float, Layout] | None = None
        for factor in FACTORS:
            layout = self._start(factor, mirror=False)
            error = self._error(layout, shape)[0]
            if best is None or error < 0.97 * best[0]:
                best = (error, layout)
        for factor in {best[1].factor if best else "none", "none"}:
            layout = self._start(factor, mirror=True)
            error = self._error(layout, shape)[0]
            if best is None or error < _MIRROR_GAIN * best[0]:
                best = (error, layout)
        assert best is not None
        layout = best[1]
        for _ in range(_ROUNDS):
            layout = self._moved(layout, shape)
            error = self._error(layout, shape)[0]
            if error < best[0]:
                best = (error, layout)
        return best[1]

    def _start(self, factor: str, mirror: int) -> Layout:
        from brdfcore.kernels.tables.half_difference import grid_u, grid_w

        t = np.sqrt(grid_u())
        x = t / (1 + t)
        octaves = np.maximum(np.log2(x) + 10, 0) / 10
        even = 0.6 * octaves + 0.4 * x
        z_low, z_high = (0.0 if self.bilateral else -2.0), (1.0 if self.reciprocal else 2.0)
        z = np.linspace(z_low, z_high, round((z_high - z_low) * STEPS_Z) + 1)
        quarter = np.floor(np.abs(z))
        part = np.abs(z) - quarter
        phi = np.sign(z) * (quarter * HALF_PI + np.arctan2(part, 1 - part))
        theta_d = np.arccos(np.sqrt(grid_w()))
        guide_h, guide_d = self._guides(t, grid_w(), factor, mirror)
        return Layout(
            guide_h=guide_h,
            guide_d=guide_d,
            map_h=(even - even[0]) / (even[-1] - even[0]),
            map_d=theta_d / theta_d[0],
            map_p=(phi - phi[0]) / (phi[-1] - phi[0]),
            factor=factor,
            mirror=mirror,
            bilateral=self.bilateral,
            reciprocal=self.reciprocal,
        )

    def _guides(self, t: Float64Array, w: Float64Array, factor: str, mirror: int) -> tuple[Float64Array, Float64Array]:
        """The parts of log2 f/K in theta_h and in theta_d, each over a fixed set of the other two coordinates."""
        f, weight = self._over(t * t, self._some(), factor, mirror)
        floor = self._least(np.abs(f[weight > 0])) or 1.0
        log = np.log2(np.maximum(f, floor))
        rest = np.zeros(f.shape[1:])
        along = np.zeros(t.size)
        for _ in range(4):
            along = (weight * (log - rest)).sum(axis=(1, 2)) / np.maximum(weight.sum(axis=(1, 2)), 1e-300)
            rest = (weight * (log - along[:, None, None])).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
        reached = weight.sum(axis=(1, 2)) > 1e-6
        along = np.interp(t, t[reached], along[reached])
        lit = t[along > np.log2(floor) + 3]  # elsewhere the lobe has underflown
        along = np.maximum(along - along.max(), -_OCTAVES)  # the nodes hold the magnitude
        # along theta_d the mean of the ratio, which noise about 0 leaves alone, not that of its logarithm
        few = np.tan(np.radians(_FEW))
        few = few[few <= max(lit.max(initial=0.0), few[0])]
        f, weight = self._over(few * few, w, factor, mirror)
        ratio = f * np.exp2(-np.interp(few, t, along))[:, None, None]
        total = weight.sum(axis=(0, 2))
        mean = (weight * ratio).sum(axis=(0, 2)) / np.maximum(total, 1e-300)
        if self.pole > 0 and (total > 0).any():  # at the horizon itself nothing is above it: as beside it
            there = total > 0
            mean = np.interp(w, w[there], mean[there])
        typical = float(np.median(mean[mean > 0])) if (mean > 0).any() else 1.0
        deep = np.log2(np.clip(mean / typical, 2.0**-_DEPTH, 2.0**_DEPTH))
        return along, deep

    def _least(self, size: Float64Array) -> float:
        """Below this f counts as underflown, or as noise."""
        return 1e-6 * float(np.mean(size))

    def _some(self) -> Float64Array:
        """w over which the guide along theta_h is a mean."""
        return np.cos(np.radians([1.0, 5.0, 12.0, 20.0, 30.0, 40.0, 50.0, 60.0, 68.0, 74.0, 79.0])) ** 2

    def _coordinates(self, layout: Layout) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Of the draws, as this layout has them."""
        return self.at[bool(layout.mirror)]

    def _over(self, u: Float64Array, w: Float64Array, factor: str, mirror: int) -> tuple[Float64Array, Float64Array]:
        """Mean of the channels of f/K on a lattice of u, w and some phi_d, and cosine weights; 0 below the horizon."""
        phi = (np.arange(12) + 0.5) / 12 * np.pi
        z = np.where(phi <= HALF_PI, 1.0, -1.0) * (np.sin(phi) / (np.sin(phi) + np.abs(np.cos(phi))) - 1) + 1
        if not self.bilateral:
            z = np.concatenate([z, -z])
        at_u, at_w, at_z = np.meshgrid(u, w, z, indexing="ij")
        theta_i, theta_o, delta_phi = angles_of(at_u, at_w, at_z, bool(mirror))
        above = (theta_i < HALF_PI - 1e-5) & (theta_o < HALF_PI - 1e-5)
        weight, f = np.zeros(theta_i.shape), np.zeros(theta_i.shape)
        i, o, d = theta_i[above], theta_o[above], delta_phi[above]
        weight[above] = np.cos(i) * np.cos(o)
        f[above] = self.sample(i, o, d).mean(axis=1) / grazing(factor, i, o)
        return f, weight

    def _moved(self, layout: Layout, shape: tuple[int, int, int]) -> Layout:
        """Nodes moved towards the error: density multiplied by the square root of the error between two nodes."""
        _, errors = self._error(layout, shape)
        if not errors.any():  # nothing to gain, or nothing there
            return layout
        maps = []
        places = layout.positions(self._coordinates(layout), shape)
        for place, old, n in zip(places, (layout.map_h, layout.map_d, layout.map_p), shape):
            cell = np.minimum(place.astype(np.int64), n - 2)
            binned = np.bincount(cell, errors, n - 1)
            found = np.convolve(np.pad(binned, 1, mode="edge"), [0.25, 0.5, 0.25], "valid")
            share = np.sqrt(found + 0.03 * found.mean())
            new = np.concatenate([[0.0], np.cumsum(share)]) / share.sum()
            maps.append(np.interp(old * (n - 1), np.arange(n), new))
        return replace(layout, map_h=maps[0], map_d=maps[1], map_p=maps[2])

    def _error(self, layout: Layout, shape: tuple[int, int, int]) -> tuple[float, Float64Array]:
        """The worse half's L1 of a lattice of this shape, and each draw's part in it."""
        nodes = self.nodes(layout, shape, steps=_COARSE_STEPS)
        found = interpolate(nodes, layout.positions(self.at[bool(layout.mirror)], shape))
        found *= layout.growth(self.theta_i, self.theta_o, *self.at[bool(layout.mirror)][:2])[:, None]
        apart = np.abs(found - self.values).sum(axis=1)
        errors = apart * self.share
        relative = _RELATIVE * apart * self.relative
        worst = max(float(errors[self.lobe].sum()), float(errors[~self.lobe].sum()))
        return worst + float(relative.sum()), errors + relative

    # ---- nodes --------------------------------------------------------------------------------

    def nodes(
        self,
        layout: Layout,
        shape: tuple[int, int, int],
        progress: Callable[[int, int], None] | None = None,
        steps: int = _STEPS,
    ) -> Float64Array:
        """Fitted nodes, (n_h, n_d, n_p, channels); `steps` of the solver at most."""
        from brdfcore.kernels.tables.lattice_fit import add_smoothness, assemble, solve

        layout = layout.rounded()
        n = int(np.prod(shape))
        matrix, right = np.zeros((n, 27)), np.zeros((n, self.channels))
        inside = np.array([0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)])
        along = [(np.arange(m - 1)[:, None] + inside).reshape(-1) for m in shape]
        points = layout.coordinates(along, shape)
        rows = max(1, _CHUNK // (points[1].size * points[2].size))
        typical = None
        least, most = np.inf, -np.inf
        for start in range(0, points[0].size, rows):
            part = slice(start, start + rows)
            place = np.stack(np.meshgrid(along[0][part], along[1], along[2], indexing="ij"), axis=-1).reshape(-1, 3)
            u, w, z = (g.reshape(-1) for g in np.meshgrid(points[0][part], points[1], points[2], indexing="ij"))
            theta_i, theta_o, delta_phi = layout.angles(u, w, z)
            above = (theta_i < HALF_PI - 1e-5) & (theta_o < HALF_PI - 1e-5)
            if not above.any():
                continue
            theta_i, theta_o, place = theta_i[above], theta_o[above], place[above]
            values = self.sample(theta_i, theta_o, delta_phi[above])
            values = values / layout.growth(theta_i, theta_o, u[above], w[above])[:, None]
            least, most = np.minimum(least, values.min(axis=0)), np.maximum(most, values.max(axis=0))
            size = np.abs(values).mean(axis=1)
            if typical is None:  # a lobe may underflow over most of the lattice
                typical = float(np.median(size[size > 0])) if (size > 0).any() else 1.0
            weight = self._importance(theta_i, theta_o) / (size**2 + (_FLOOR * typical) ** 2)
            if self.pole > 0:
                weight = self._even(weight, theta_i, above, points[2].size)
            if not self.seen.whole:
                weight *= np.where(self.seen.holds(theta_i, theta_o, swapped=self.reciprocal), 1.0, _UNSEEN)
            cell = place.astype(np.int64)
            assemble.serial(cell, place - cell, weight, values, matrix, right, shape[1], shape[2])
            if progress is not None:
                progress(min(start + rows, points[0].size), points[0].size)
        if np.all(most - least <= _CONSTANT * np.abs(most)):  # what is constant is held exactly
            return np.broadcast_to(0.5 * (least + most), (*shape, self.channels)).copy()
        own = matrix[:, 13]
        add_smoothness(matrix, shape, _SMOOTHNESS * float(np.median(own[own > 0])))
        begin = np.full((n, self.channels), typical or 0.0)
        nodes = solve(matrix, right, begin, shape, steps).reshape(*shape, self.channels)
        if not self.bilateral:  # z = -2 and z = 2 are one direction: no step at delta_phi = pi
            nodes[:, :, 0] = nodes[:, :, -1] = 0.5 * (nodes[:, :, 0] + nodes[:, :, -1])
        # phi_d has no meaning at h = n and at wi = wo: one value each, or a direction would answer by its rounding
        nodes[0] = nodes[0].mean(axis=1, keepdims=True)
        nodes[:, 0] = self._pole_mean(nodes[:, 0], layout, shape)
        return nodes

    def _pole_mean(self, nodes: Float64Array, layout: Layout, shape: tuple[int, int, int]) -> Float64Array:
        """One value for all of the last axis at the first node of the second, (n_h, n_p, C) -> (n_h, 1, C)."""
        return np.asarray(nodes.mean(axis=1, keepdims=True))

    def _importance(self, theta_i: Float64Array, theta_o: Float64Array) -> Float64Array:
        """What the square of a relative error counts."""
        return np.asarray(np.cos(theta_i) * np.cos(theta_o) + 1e-3)

    def _even(
        self, weight: Float64Array, theta_i: Float64Array, above: npt.NDArray[np.bool_], last: int
    ) -> Float64Array:
        """`weight` with one value along the last axis near the pole, where the fit is a mean over it: not a mean of
        relative errors, which would lean towards the small values."""
        whole, near = np.zeros(above.size), np.zeros(above.size, np.bool_)
        whole[above], near[above] = weight, theta_i < self.pole
        lines, seen = whole.reshape(-1, last), above.reshape(-1, last)
        mean = np.where(seen, 1 / np.maximum(lines, 1e-300), 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
        even = np.where(near, np.repeat(1 / np.maximum(mean, 1e-300), last), whole)
        return np.asarray(even[above])


def interpolate(nodes: Float64Array, positions: list[Float64Array]) -> Float64Array:
    """Trilinear between nodes (n_h, n_d, n_p, channels) at node positions; (n, channels)."""
    cells = [np.minimum(p.astype(np.int64), n - 2) for p, n in zip(positions, nodes.shape)]
    parts = [p - c for p, c in zip(positions, cells)]
    found = np.zeros((positions[0].size, nodes.shape[3]))
    for q in range(8):
        up = (q >> 2, q >> 1 & 1, q & 1)
        weight = np.ones(positions[0].size)
        for part, step in zip(parts, up):
            weight = weight * (part if step else 1 - part)
        found += weight[:, None] * nodes[cells[0] + up[0], cells[1] + up[1], cells[2] + up[2]]
    return found


def shape_for(nodes: int, bilateral: bool, reciprocal: bool) -> list[tuple[int, int, int]]:
    """Shapes of at most `nodes` nodes, most for theta_h; two proportions, since materials differ."""
    quarter_turns = (1 if reciprocal else 2) * (1 if bilateral else 2)
    shapes = []
    for h, d, p in ((2.0, 1.0, 0.5), (2.0, 2.0, 0.5)):
        unit = (nodes / (h * d * p * quarter_turns)) ** (1 / 3)
        sizes = [max(4, int(unit * h)), max(4, int(unit * d)), max(4, int(unit * p * quarter_turns))]
        while np.prod(sizes) > nodes and max(sizes) > 4:
            sizes[int(np.argmax(sizes))] -= 1
        shapes.append((sizes[0], sizes[1], sizes[2]))
    return shapes
