"""Build a half/difference table: a guide along theta_h, node spacings that follow the error, fitted nodes.

1. Guide. log f/K is split into a function of theta_h and one of (theta_d, phi_d) by alternating means over a fixed set
   of (theta_d, phi_d): no sampling noise, so what the guide leaves is as smooth as the material. It holds the shape
   of the lobe, whatever its width; the table holds what differs from it, which is of order 1.
2. Spacing. On a small lattice, fitted as in 3, the error of seeded directions is binned along each axis and the nodes
   are moved to where it is; the best of a few rounds is kept.
3. Nodes. Least squares on 2 x 2 x 2 Gauss points a cell (`kernels.lattice_fit`), relative to the size of the value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.brdf import Brdf
from brdfcore.conventions import HALF_PI
from brdfcore.directions import mixture
from brdfcore.geometry import angles_from_vectors

Float64Array = npt.NDArray[np.float64]
Sample = Callable[[Float64Array, Float64Array, Float64Array], Float64Array]

#: Coefficients (k0 .. k5) of K = (k0 c_i + k1 c_o + k2) / (k3 c_i c_o + k4 (c_i + c_o) + k5), by name: how f may grow
#: towards the horizon. Tried in this order; a later one has to be better.
FACTORS: dict[str, tuple[float, ...]] = {
    "sum": (0, 0, 1, 0, 1, 0),  # 1/(c_i + c_o): microfacet models, finite while one direction is
    "viewer": (1, 0, 0, 1, 0, 0),  # 1/c_o: measurements divided by the viewer's cosine
    "both": (1, 1, 0, 1, 0, 0),  # 1/c_i + 1/c_o
    "none": (0, 0, 1, 0, 0, 1),
}
#: Steps of the maps of y and of z (a unit of z).
STEPS_Y, STEPS_Z = 128, 64
#: Nodes of the lattice on which factor and spacing are chosen, and rounds of moving them.
_COARSE, _ROUNDS = 9_000, 3
_DRAWS, _DRAW_SEED = 60_000, 7_919
#: Steps of the solver for the final nodes, and where only spacings are compared.
_STEPS, _COARSE_STEPS = 60, 15
#: Directions evaluated at a time.
_CHUNK = 262_144
#: Weight of |difference|^2 between neighbours against the median node's own.
_SMOOTHNESS = 1e-4
#: Below this share of its median magnitude a value counts as that large when errors are made relative.
_FLOOR = 0.1


@dataclass
class Layout:
    """Where nodes lie: each map gives node position / last node, rising from 0 to 1."""

    guide: Float64Array  # on guide_grid()
    map_x: Float64Array  # on guide_grid()
    map_y: Float64Array  # on STEPS_Y uniform steps of y
    map_z: Float64Array  # on STEPS_Z uniform steps a unit of z
    factor: str
    bilateral: bool
    reciprocal: bool

    def grids(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Coordinates at which the maps are tabulated."""
        from brdfcore.kernels.half_difference import guide_grid

        low, high = (0.0 if self.bilateral else -2.0), (1.0 if self.reciprocal else 2.0)
        return guide_grid(), np.linspace(0, 1, self.map_y.size), np.linspace(low, high, self.map_z.size)

    def positions(self, coordinates: tuple[Float64Array, ...], shape: tuple[int, int, int]) -> list[Float64Array]:
        """Node positions of coordinates (x, y, z)."""
        maps = (self.map_x, self.map_y, self.map_z)
        return [np.interp(c, g, m) * (n - 1) for c, g, m, n in zip(coordinates, self.grids(), maps, shape)]

    def growth(self, theta_i: Float64Array, theta_o: Float64Array, x: Float64Array) -> Float64Array:
        """guide(x) K(theta_i, theta_o): what the nodes are multiplied with."""
        strength = np.interp(x, self.grids()[0], self.guide)
        return np.asarray(strength * grazing(self.factor, theta_i, theta_o))


def grazing(factor: str, theta_i: Float64Array, theta_o: Float64Array) -> Float64Array:
    """K of `FACTORS`."""
    k0, k1, k2, k3, k4, k5 = FACTORS[factor]
    c_i, c_o = (np.maximum(np.sin(HALF_PI - t), 6.123233995736766e-17) for t in (theta_i, theta_o))
    return np.asarray((k0 * c_i + k1 * c_o + k2) / (k3 * c_i * c_o + k4 * (c_i + c_o) + k5))


def angles_of(x: Float64Array, y: Float64Array, z: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(theta_i, theta_o, delta_phi) of coordinates (x, y, z); thetas beyond pi/2 are below the horizon.

    wi = Ry(theta_h) d, wo = Ry(theta_h) (-d_x, -d_y, d_z) with d at (theta_d, phi_d).
    """
    theta_h = np.arctan2(x, 1 - x)
    theta_d = 2 * np.arctan(y)
    folded = np.where(np.abs(z) <= 1, np.abs(z), 2 - np.abs(z))
    phi_d = np.arctan2(folded, 1 - folded)
    phi_d = np.where(np.abs(z) <= 1, phi_d, np.pi - phi_d)
    sin_d, cos_d = np.sin(theta_d), np.cos(theta_d)
    d_x, d_y = sin_d * np.cos(phi_d), sin_d * np.sin(phi_d)
    sin_h, cos_h = np.sin(theta_h), np.cos(theta_h)
    wi = np.stack([cos_h * d_x + sin_h * cos_d, d_y, cos_h * cos_d - sin_h * d_x], axis=-1).reshape(-1, 3)
    wo = np.stack([sin_h * cos_d - cos_h * d_x, -d_y, cos_h * cos_d + sin_h * d_x], axis=-1).reshape(-1, 3)
    theta_i, theta_o, delta_phi = angles_from_vectors(wi, wo)
    delta_phi = np.where(z.reshape(-1) < 0, -np.abs(delta_phi), np.abs(delta_phi))
    return theta_i.reshape(x.shape), theta_o.reshape(x.shape), delta_phi.reshape(x.shape)


class Fitter:
    """One source on its way to a table."""

    def __init__(self, source: Brdf, sample: Sample, bilateral: bool, reciprocal: bool) -> None:
        from brdfcore.kernels.half_difference import coordinates_numpy

        self.sample, self.bilateral, self.reciprocal = sample, bilateral, reciprocal
        self.channels = len(source.channels)
        drawn = mixture(_DRAWS, _DRAW_SEED)
        used = (drawn.weight > 0) & (np.maximum(drawn.theta_i, drawn.theta_o) < np.radians(89.5))
        self.theta_i, self.theta_o, self.delta_phi = drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used]
        self.values = sample(self.theta_i, self.theta_o, self.delta_phi)
        self.at = coordinates_numpy(self.theta_i, self.theta_o, self.delta_phi, bilateral, reciprocal)
        lobe = drawn.lobe[used]
        cosines = np.cos(self.theta_i) * np.cos(self.theta_o)
        energy = cosines * np.abs(self.values).sum(axis=1)
        # each half of the draws counts for itself: an error far from the lobe is not excused by the lobe's energy
        self.share = cosines / np.where(lobe, max(energy[lobe].sum(), 1e-300), max(energy[~lobe].sum(), 1e-300))
        self.lobe = lobe

    # ---- guide and spacing --------------------------------------------------------------------

    def layout(self) -> Layout:
        """The factor and spacing with the smallest error on a small lattice."""
        shape = shape_for(_COARSE, self.bilateral, self.reciprocal)[0]
        best: tuple[float, Layout] | None = None
        for factor in FACTORS:
            layout = self._start(factor)
            error = self._error(layout, shape)[0]
            if best is None or error < 0.97 * best[0]:
                best = (error, layout)
        assert best is not None
        layout = best[1]
        for _ in range(_ROUNDS):
            layout = self._moved(layout, shape)
            error = self._error(layout, shape)[0]
            if error < best[0]:
                best = (error, layout)
        return best[1]

    def _start(self, factor: str) -> Layout:
        from brdfcore.kernels.half_difference import OCTAVES, guide_grid

        x = guide_grid()
        octaves = np.maximum(np.log2(np.maximum(x, 2.0**-OCTAVES)) + 10, 0) / 10
        z_low, z_high = (0.0 if self.bilateral else -2.0), (1.0 if self.reciprocal else 2.0)
        z = np.linspace(z_low, z_high, round((z_high - z_low) * STEPS_Z) + 1)
        quarter = np.floor(np.abs(z))
        part = np.abs(z) - quarter
        phi = np.sign(z) * (quarter * HALF_PI + np.arctan2(part, 1 - part))
        y = np.linspace(0, 1, STEPS_Y + 1)
        return Layout(
            guide=self._guide(x, factor),
            map_x=0.6 * octaves + 0.4 * (x - x[0]) / (1 - x[0]),
            map_y=np.arctan(y) * 4 / np.pi,
            map_z=(phi - phi[0]) / (phi[-1] - phi[0]),
            factor=factor,
            bilateral=self.bilateral,
            reciprocal=self.reciprocal,
        )

    def _guide(self, x: Float64Array, factor: str) -> Float64Array:
        """exp of the theta_h part of log f/K, over a fixed set of theta_d and phi_d above the horizon."""
        y = np.tan(0.5 * np.radians([1.0, 5.0, 12.0, 20.0, 30.0, 40.0, 50.0, 60.0, 68.0, 74.0, 79.0]))
        phi = (np.arange(12) + 0.5) / 12 * np.pi
        z = np.where(phi <= HALF_PI, 1.0, -1.0) * (np.sin(phi) / (np.sin(phi) + np.abs(np.cos(phi))) - 1) + 1
        if not self.bilateral:
            z = np.concatenate([z, -z])
        inner = np.minimum(x, 1 - 1e-9)
        grid = np.meshgrid(inner, y, z, indexing="ij")
        theta_i, theta_o, delta_phi = angles_of(*grid)
        above = (theta_i < HALF_PI - 1e-3) & (theta_o < HALF_PI - 1e-3)
        weight = np.where(above, np.cos(np.where(above, theta_i, 0)) * np.cos(np.where(above, theta_o, 0)), 0)
        f = np.zeros(theta_i.shape)
        i, o, d = theta_i[above], theta_o[above], delta_phi[above]
        f[above] = self.sample(i, o, d).mean(axis=1) / grazing(factor, i, o)
        floor = 1e-6 * float(np.mean(np.abs(f[above]))) or 1.0
        log = np.log(np.maximum(f, floor))
        rest = np.zeros(theta_i.shape[1:])
        along = np.zeros(x.size)
        for _ in range(4):
            along = (weight * (log - rest)).sum(axis=(1, 2)) / np.maximum(weight.sum(axis=(1, 2)), 1e-300)
            rest = (weight * (log - along[:, None, None])).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
        reached = weight.sum(axis=(1, 2)) > 1e-6
        along = np.interp(x, x[reached], along[reached])
        return np.asarray(np.exp(along))

    def _moved(self, layout: Layout, shape: tuple[int, int, int]) -> Layout:
        """Nodes moved towards the error: density multiplied by the square root of the error between two nodes."""
        _, errors = self._error(layout, shape)
        maps = []
        places = layout.positions(self.at, shape)
        for place, old, n in zip(places, (layout.map_x, layout.map_y, layout.map_z), shape):
            cell = np.minimum(place.astype(np.int64), n - 2)
            binned = np.bincount(cell, errors, n - 1)
            found = np.convolve(np.pad(binned, 1, mode="edge"), [0.25, 0.5, 0.25], "valid")
            share = np.sqrt(found + 0.03 * found.mean())
            new = np.concatenate([[0.0], np.cumsum(share)]) / share.sum()
            maps.append(np.interp(old * (n - 1), np.arange(n), new))
        return Layout(layout.guide, maps[0], maps[1], maps[2], layout.factor, self.bilateral, self.reciprocal)

    def _error(self, layout: Layout, shape: tuple[int, int, int]) -> tuple[float, Float64Array]:
        """The worse half's L1 of a lattice of this shape, and each draw's part in it."""
        nodes = self.nodes(layout, shape, steps=_COARSE_STEPS)
        found = interpolate(nodes, layout.positions(self.at, shape))
        found *= layout.growth(self.theta_i, self.theta_o, self.at[0])[:, None]
        errors = np.abs(found - self.values).sum(axis=1) * self.share
        return max(float(errors[self.lobe].sum()), float(errors[~self.lobe].sum())), errors

    # ---- nodes --------------------------------------------------------------------------------

    def nodes(
        self,
        layout: Layout,
        shape: tuple[int, int, int],
        progress: Callable[[int, int], None] | None = None,
        steps: int = _STEPS,
    ) -> Float64Array:
        """Fitted nodes, (n_h, n_d, n_p, channels); `steps` of the solver at most."""
        from brdfcore.kernels.lattice_fit import add_smoothness, assemble, solve

        n = int(np.prod(shape))
        matrix, right = np.zeros((n, 27)), np.zeros((n, self.channels))
        inside = np.array([0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)])
        maps = (layout.map_x, layout.map_y, layout.map_z)
        along = [(np.arange(m - 1)[:, None] + inside).reshape(-1) for m in shape]
        points = [np.interp(a / (m - 1), f, g) for a, m, f, g in zip(along, shape, maps, layout.grids())]
        rows = max(1, _CHUNK // (points[1].size * points[2].size))
        typical = None
        for start in range(0, points[0].size, rows):
            part = slice(start, start + rows)
            place = np.stack(np.meshgrid(along[0][part], along[1], along[2], indexing="ij"), axis=-1).reshape(-1, 3)
            x, y, z = (g.reshape(-1) for g in np.meshgrid(points[0][part], points[1], points[2], indexing="ij"))
            theta_i, theta_o, delta_phi = angles_of(x, y, z)
            above = (theta_i < HALF_PI - 1e-5) & (theta_o < HALF_PI - 1e-5)
            if not above.any():
                continue
            theta_i, theta_o, place = theta_i[above], theta_o[above], place[above]
            values = self.sample(theta_i, theta_o, delta_phi[above])
            values = values / layout.growth(theta_i, theta_o, x[above])[:, None]
            size = np.abs(values).mean(axis=1)
            if typical is None:  # a lobe may underflow over most of the lattice
                typical = float(np.median(size[size > 0])) if (size > 0).any() else 1.0
            weight = (np.cos(theta_i) * np.cos(theta_o) + 1e-3) / (size**2 + (_FLOOR * typical) ** 2)
            cell = place.astype(np.int64)
            assemble.serial(cell, place - cell, weight, values, matrix, right, shape[1], shape[2])
            if progress is not None:
                progress(min(start + rows, points[0].size), points[0].size)
        own = matrix[:, 13]
        add_smoothness(matrix, shape, _SMOOTHNESS * float(np.median(own[own > 0])))
        begin = np.full((n, self.channels), typical or 0.0)
        nodes = solve(matrix, right, begin, shape, steps).reshape(*shape, self.channels)
        if not self.bilateral:  # z = -2 and z = 2 are one direction: no step at delta_phi = pi
            nodes[:, :, 0] = nodes[:, :, -1] = 0.5 * (nodes[:, :, 0] + nodes[:, :, -1])
        # phi_d has no meaning at h = n and at wi = wo: one value each, or a direction would answer by its rounding
        nodes[0] = nodes[0].mean(axis=1, keepdims=True)
        nodes[:, 0] = nodes[:, 0].mean(axis=1, keepdims=True)
        return nodes


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
