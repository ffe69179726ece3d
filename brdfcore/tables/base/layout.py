"""Where the nodes of a half/difference table lie, and what they are multiplied with: guides, maps, growth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.base.geometry import angles_from_vectors

Float64Array = npt.NDArray[np.float64]

#: Coefficients (k0 .. k5) of K = (k0 c_i + k1 c_o + k2) / (k3 c_i c_o + k4 (c_i + c_o) + k5), by name: how f may grow
#: towards the horizon. Tried in this order; a later one has to be better.
FACTORS: dict[str, tuple[float, ...]] = {
    "sum": (0, 0, 1, 0, 1, 0),  # 1/(c_i + c_o): microfacet models, finite while one direction is
    "viewer": (1, 0, 0, 1, 0, 0),  # 1/c_o: measurements divided by the viewer's cosine
    "both": (1, 1, 0, 1, 0, 0),  # 1/c_i + 1/c_o
    "none": (0, 0, 1, 0, 0, 1),
}
#: Steps of the map of z, a unit.
STEPS_Z = 64
#: Largest 16-bit number.
_MOST_WORD = 65_535
#: Least range of the guides' exponents, so that a constant guide has a step.
_LEAST_RANGE = 1.0


@dataclass
class Layout:
    """Where nodes lie: each map gives node position / last node, rising from 0 to 1."""

    guide_h: Float64Array  # exponents of 2, on grid_u()
    guide_d: Float64Array  # exponents of 2, on grid_w()
    map_h: Float64Array  # on grid_u()
    map_d: Float64Array  # on grid_w(); falls from 1 to 0, as theta_d does
    map_p: Float64Array  # on STEPS_Z uniform steps a unit of z
    factor: str
    mirror: int  # what u is: 0 about theta_h, 1 about the mirror direction; `lobe_grid` has more
    bilateral: bool
    reciprocal: bool

    def grids(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Coordinates at which the maps are tabulated."""
        from brdfcore.kernels.tables.half_difference import grid_u, grid_w

        low, high = (0.0 if self.bilateral else -2.0), (1.0 if self.reciprocal else 2.0)
        return grid_u(), grid_w(), np.linspace(low, high, self.map_p.size)

    def positions(self, coordinates: tuple[Float64Array, ...], shape: tuple[int, int, int]) -> list[Float64Array]:
        """Node positions of coordinates (u, w, z)."""
        maps = (self.map_h, self.map_d, self.map_p)
        return [np.interp(c, g, m) * (n - 1) for c, g, m, n in zip(coordinates, self.grids(), maps, shape)]

    def coordinates(self, places: list[Float64Array], shape: tuple[int, int, int]) -> list[Float64Array]:
        """(u, w, z) of node positions, each axis apart: the inverse of `positions`."""
        found = []
        for place, grid, along, n in zip(places, self.grids(), (self.map_h, self.map_d, self.map_p), shape):
            order = slice(None, None, 1 if along[-1] >= along[0] else -1)
            found.append(np.interp(place / (n - 1), along[order], grid[order]))
        return found

    def angles(
        self, u: Float64Array, w: Float64Array, z: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """(theta_i, theta_o, delta_phi) of coordinates (u, w, z)."""
        return angles_of(u, w, z, bool(self.mirror))

    def growth(self, theta_i: Float64Array, theta_o: Float64Array, u: Float64Array, w: Float64Array) -> Float64Array:
        """2^(guide_h(u) + guide_d(w)) K(theta_i, theta_o): what the nodes are multiplied with."""
        grid_u, grid_w, _ = self.grids()
        exponent = np.interp(u, grid_u, self.guide_h) + np.interp(w, grid_w, self.guide_d)
        return np.asarray(np.exp2(exponent) * grazing(self.factor, theta_i, theta_o))

    def words(self) -> tuple[dict[str, npt.NDArray[np.uint16]], float, float]:
        """The maps and guides as 16-bit numbers, and the guides' lowest sum of exponents and their step."""
        low_h, low_d = float(self.guide_h.min()), float(self.guide_d.min())
        step = max(float(np.ptp(self.guide_h)), float(np.ptp(self.guide_d)), _LEAST_RANGE) / _MOST_WORD
        scaled = {
            "guide_h": (self.guide_h - low_h) / step,
            "guide_d": (self.guide_d - low_d) / step,
            "map_h": self.map_h * (_MOST_WORD + 1),
            "map_d": self.map_d * (_MOST_WORD + 1),
            "map_p": self.map_p * (_MOST_WORD + 1),
        }
        rounded = {name: np.minimum(np.rint(x), _MOST_WORD).astype(np.uint16) for name, x in scaled.items()}
        return rounded, low_h + low_d, step

    def rounded(self) -> Layout:
        """What `words` leaves of this layout: nodes are fitted to what a look-up will see."""
        words, low, step = self.words()
        map_h, map_d, map_p = (words[name] / (_MOST_WORD + 1) for name in ("map_h", "map_d", "map_p"))
        guide_h, guide_d = (words[name].astype(np.float64) * step for name in ("guide_h", "guide_d"))
        return replace(self, guide_h=guide_h + low, guide_d=guide_d, map_h=map_h, map_d=map_d, map_p=map_p)


def grazing(factor: str, theta_i: Float64Array, theta_o: Float64Array) -> Float64Array:
    """K of `FACTORS`."""
    k0, k1, k2, k3, k4, k5 = FACTORS[factor]
    c_i, c_o = (np.maximum(np.sin(HALF_PI - t), 6.123233995736766e-17) for t in (theta_i, theta_o))
    return np.asarray((k0 * c_i + k1 * c_o + k2) / (k3 * c_i * c_o + k4 * (c_i + c_o) + k5))


def angles_of(
    u: Float64Array, w: Float64Array, z: Float64Array, mirror: bool = False
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(theta_i, theta_o, delta_phi) of coordinates (u, w, z); thetas beyond pi/2 are below the horizon.

    wi = Ry(theta_h) d, wo = Ry(theta_h) (-d_x, -d_y, d_z) with d at (theta_d, phi_d).
    """
    folded = np.where(np.abs(z) <= 1, np.abs(z), 2 - np.abs(z))
    phi_d = np.arctan2(folded, 1 - folded)
    phi_d = np.where(np.abs(z) <= 1, phi_d, np.pi - phi_d)
    sin_d, cos_d = np.sqrt(1 - w), np.sqrt(w)
    d_x, d_y = sin_d * np.cos(phi_d), sin_d * np.sin(phi_d)
    # about the mirror direction: u = sin^2 theta_h (cos^2 theta_d + sin^2 theta_d cos^2 phi_d)
    sin2_h = np.minimum(u / np.maximum(w + (1 - w) * np.cos(phi_d) ** 2, 1e-300), 1) if mirror else u / (1 + u)
    sin_h, cos_h = np.sqrt(sin2_h), np.sqrt(1 - sin2_h) if mirror else np.sqrt(1 / (1 + u))
    wi = np.stack([cos_h * d_x + sin_h * cos_d, d_y, cos_h * cos_d - sin_h * d_x], axis=-1).reshape(-1, 3)
    wo = np.stack([sin_h * cos_d - cos_h * d_x, -d_y, cos_h * cos_d + sin_h * d_x], axis=-1).reshape(-1, 3)
    theta_i, theta_o, delta_phi = angles_from_vectors(wi, wo)
    delta_phi = np.where(z.reshape(-1) < 0, -np.abs(delta_phi), np.abs(delta_phi))
    return theta_i.reshape(u.shape), theta_o.reshape(u.shape), delta_phi.reshape(u.shape)
