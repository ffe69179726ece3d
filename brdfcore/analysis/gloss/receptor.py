"""Flux from one direction into a rectangular aperture: over the half vector, graded to the mirror direction.

A rectangle of directions is a pyramid with its apex at the specimen: four planes through the origin. Along a ray of
half vectors h ~ n + rho u(phi) the reflected direction is inside a plane of normal N while
2 (w.h)(h.N) - (w.N) h.h >= 0, a quadratic in rho, so that the limits of integration are exact for every azimuth:
a lobe of any width is integrated to its own pole, and an aperture of any size to its own edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.geometry import outgoing_from_half
from brdfcore.base.quadrature import composite, gauss_legendre

Float64Array = npt.NDArray[np.float64]

#: Fractions of the angle between two corners of the aperture at which its panels end: finer towards the corners, since
#: seen from a grazing mirror direction the far side of the aperture subtends a small angle.
_BETWEEN_CORNERS = np.array([0.0, 1 / 16, 1 / 4, 1 / 2, 3 / 4, 15 / 16, 1.0])
#: Panels over rho shrink geometrically by four from the edge of the aperture to a millionth of it: a lobe of roughness
#: 1e-7 is resolved. Those within a sixtieth take `_INNER_NODES` at most: only a smooth, sharp lobe has anything there.
_GRADED = np.concatenate([[0.0], np.geomspace(1e-6, 1.0, 11)])
_INNER, _INNER_NODES = 8, 8
#: Panels, in geometric progression, of a ray that begins apart from the mirror direction.
_APART = 3
#: A point this close to a side's plane, as a cosine, lies on it: rounding, far below an aperture's size.
_ON_A_SIDE = 1e-9
#: Values evaluated at a time: memory stays below 100 MB.
_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle of directions, radians: its centre in the plane of incidence, its full widths along and across it.

    centre  polar angle of the centre on the mirror side (negative: on the side of the light).
    along   full angle between the two sides that the plane of incidence crosses.
    across  full angle between the other two, seen from the specimen along the centre line.
    """

    centre: float
    along: float
    across: float

    @property
    def axes(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """(centre, along, across): unit vectors; the light is in the half plane x > 0."""
        s, c = np.sin(self.centre), np.cos(self.centre)
        return np.array([-s, 0.0, c]), np.array([-c, 0.0, -s]), np.array([0.0, 1.0, 0.0])

    @property
    def planes(self) -> Float64Array:
        """Inward normals of the four sides, (4, 3)."""
        centre, along, across = self.axes
        a, b = np.tan(0.5 * self.along), np.tan(0.5 * self.across)
        return np.stack([a * centre - along, a * centre + along, b * centre - across, b * centre + across])

    @property
    def corners(self) -> Float64Array:
        """The four corners, (4, 3), not unit vectors."""
        centre, along, across = self.axes
        a, b = np.tan(0.5 * self.along), np.tan(0.5 * self.across)
        return np.stack([centre + i * a * along + j * b * across for i in (-1, 1) for j in (-1, 1)])


def received(b: Brdf, light: Float64Array, aperture: Rectangle, n_phi: int, n_rho: int) -> tuple[Float64Array, int]:
    """(int f_r cos_o dwo over the aperture, (channels,); evaluations), light from the unit vector `light`.

    The regular part only. `n_phi`, `n_rho` Gauss-Legendre nodes on each panel over azimuth and rho = tan theta_h.
    """
    theta_i = float(np.arctan2(np.hypot(light[0], light[1]), light[2]))
    turn = -float(np.arctan2(light[1], light[0]))
    normals, corners = (_turned(v, turn) for v in (aperture.planes, aperture.corners))
    phi, w_phi = _azimuths(theta_i, normals, corners, n_phi)
    row, low, high = _spans(theta_i, np.vstack([normals, [0.0, 0.0, 1.0]]), phi)
    total = np.zeros(len(b.channels))
    if not row.size:
        return total, 0
    spent = 0
    for chosen, panels in ((low == 0, _from_pole(n_rho)), (low > 0, _apart(n_rho))):
        index, start, stop = row[chosen], low[chosen], high[chosen]
        spent += index.size * panels.nodes
        rows = max(_CHUNK // (panels.nodes * len(b.channels)), 1)
        for first in range(0, index.size, rows):
            part = np.s_[first : first + rows]
            rho, w_rho = panels.between(start[part], stop[part])
            azimuth = phi[index[part], None]
            theta_o, delta_phi, dot = outgoing_from_half(theta_i, np.arctan(rho), azimuth)
            theta_o = np.minimum(theta_o, np.pi / 2)  # a node before the horizon may land past it by rounding
            f = b.evaluate(theta_i, theta_o.reshape(-1), delta_phi.reshape(-1))
            # dwo = 4 (wo.h) dwh, dwh = rho/(1 + rho^2)^(3/2) drho dphi
            weight = w_phi[index[part], None] * w_rho * 4 * dot * rho / (1 + rho * rho) ** 1.5 * np.cos(theta_o)
            total += weight.reshape(-1) @ f
    return total, spent


def _turned(v: Float64Array, angle: float) -> Float64Array:
    """Vectors (n, 3) turned about the normal."""
    s, c = np.sin(angle), np.cos(angle)
    return np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]], axis=1)


def _azimuths(
    theta_i: float, normals: Float64Array, corners: Float64Array, n: int
) -> tuple[Float64Array, Float64Array]:
    """Nodes and weights over the azimuth of the half vector, a whole turn.

    Panels end where a limit of rho has a kink: at the aperture's corners, where it meets the horizon, and where a ray
    only touches one of its sides.
    """
    w = np.array([np.sin(theta_i), 0.0, np.cos(theta_i)])
    level = np.cross(normals, [0.0, 0.0, 1.0])
    level = np.concatenate([level, -level])[np.tile(np.linalg.norm(level, axis=1) > 0, 2)]
    level = level[(level @ normals.T >= -_ON_A_SIDE).all(axis=1)]
    outer = np.concatenate([corners[corners[:, 2] >= 0], level])
    half = w + outer / np.linalg.norm(outer, axis=1)[:, None]
    ends = np.concatenate([np.arctan2(half[:, 1], half[:, 0]), _touching(theta_i, normals)])
    ends = np.unique(np.remainder(ends, 2 * np.pi)) if ends.size else np.zeros(1)
    ends = np.concatenate([ends, [ends[0] + 2 * np.pi]])
    edges = ends[:-1, None] + np.diff(ends)[:, None] * _BETWEEN_CORNERS[:-1]
    return composite(np.concatenate([edges.reshape(-1), ends[-1:]]), n)


def _touching(theta_i: float, normals: Float64Array) -> Float64Array:
    """Azimuths at which a ray touches a side of the aperture without crossing it.

    A quarter of the discriminant in `_spans` is A + B cos(2 phi) + C sin(2 phi), with p = c N_x - s N_z, q = c N_y.
    """
    s, c = np.sin(theta_i), np.cos(theta_i)
    x, y, z = normals.T
    along = x * s + z * c
    p, q = c * x - s * z, c * y
    a = 0.5 * (p * p + q * q) + along * (s * x + 2 * c * z - along)
    b, d = 0.5 * (p * p - q * q) + along * s * x, p * q + along * s * y
    size = np.hypot(b, d)
    with np.errstate(divide="ignore", invalid="ignore"):
        opening = np.arccos(-a / size)  # nan where the ray of no azimuth touches
    twice = np.arctan2(d, b) + np.multiply.outer([-1, 1, -1, 1], opening)
    phi = 0.5 * twice + np.array([0, 0, np.pi, np.pi])[:, None]
    across, towards = x * np.cos(phi) + y * np.sin(phi), s * np.cos(phi)
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = -(c * across + towards * z) / (2 * towards * across - along)
    good = np.isfinite(rho) & (rho > 0)
    phi, rho = phi[good], rho[good]
    h = np.stack([rho * np.cos(phi), rho * np.sin(phi), np.ones_like(rho)], axis=1)
    h /= np.linalg.norm(h, axis=1)[:, None]
    w = np.array([s, 0.0, c])
    wo = 2 * (h @ w)[:, None] * h - w
    kept: Float64Array = phi[(wo @ normals.T >= -_ON_A_SIDE).all(axis=1) & (wo[:, 2] >= 0)]
    return kept


def _spans(
    theta_i: float, normals: Float64Array, phi: Float64Array
) -> tuple[npt.NDArray[np.intp], Float64Array, Float64Array]:
    """The pieces of each azimuth's ray rho > 0 that are mirrored into all the planes: (index of phi, from, to).

    With h = n + rho u: A rho^2 + B rho + C = 2 (c + rho s cos phi)(N_z + rho N.u) - (1 + rho^2) w.N.
    """
    s, c = np.sin(theta_i), np.cos(theta_i)
    across = normals[:, 0:1] * np.cos(phi) + normals[:, 1:2] * np.sin(phi)
    towards = s * np.cos(phi)
    along = (normals[:, 0] * s + normals[:, 2] * c)[:, None]
    a2 = 2 * towards * across - along
    a1 = 2 * (c * across + towards * normals[:, 2:3])
    a0 = 2 * c * normals[:, 2:3] - along
    ends = np.concatenate([np.zeros((1, phi.size)), *_roots(a2, a1, a0)])
    ends = np.sort(ends, axis=0)
    low, high = ends[:-1], ends[1:]
    with np.errstate(invalid="ignore"):  # inf - inf, where a root is missing
        middle = 0.5 * (low + high)
        inside = (a2[:, None] * middle**2 + a1[:, None] * middle + a0[:, None] >= 0).all(axis=0)
        piece, row = np.nonzero(inside & (high > low) & np.isfinite(high))
    return row, low[piece, row], high[piece, row]


def _roots(a2: Float64Array, a1: Float64Array, a0: Float64Array) -> Iterator[Float64Array]:
    """Roots > 0 of a2 x^2 + a1 x + a0, inf where there is none: q = -(a1 + sign(a1) sqrt(..))/2 cancels nothing."""
    square = a1 * a1 - 4 * a2 * a0
    q = -0.5 * (a1 + np.copysign(np.sqrt(np.maximum(square, 0.0)), a1))
    for above, below in ((q, a2), (a0, q)):
        with np.errstate(over="ignore"):  # a root beyond float64 is none
            root = np.divide(above, below, out=np.full_like(q, np.inf), where=(below != 0) & (square >= 0))
        yield np.where(root > 0, root, np.inf)


@dataclass(frozen=True, slots=True)
class _Panels:
    """Gauss-Legendre nodes t in [0, 1] with weights, and whether a span from a to b is a + (b - a) t or a (b/a)^t."""

    t: Float64Array
    w: Float64Array
    geometric: bool

    @property
    def nodes(self) -> int:
        return self.t.size

    def between(self, low: Float64Array, high: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Nodes and weights over each [low, high], (rows, nodes)."""
        if not self.geometric:
            width = (high - low)[:, None]
            return low[:, None] + width * self.t, width * self.w
        ratio = np.log(high / low)[:, None]
        rho = low[:, None] * np.exp(ratio * self.t)
        return rho, rho * ratio * self.w


def _from_pole(n: int) -> _Panels:
    parts = [composite(_GRADED[: _INNER + 1], min(n, _INNER_NODES)), composite(_GRADED[_INNER:], n)]
    t, w = (np.concatenate(x) for x in zip(*parts))
    return _Panels(t, w, False)


def _apart(n: int) -> _Panels:
    return _Panels(*composite(np.linspace(0.0, 1.0, _APART + 1), n), True)


def rectangle_nodes(
    along: float, across: float, n_along: int, n_across: int, *, half: bool
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Nodes (x, y) in the tangent plane of a rectangle of directions of full angles `along`, `across`, and weights.

    The weights are solid angle over that of the rectangle: they add up to 1. An angle of 0 is a single node. `half`:
    only y >= 0, weighted twice.
    """
    x, w_x = _nodes(np.tan(0.5 * along), n_along)
    y, w_y = _nodes(np.tan(0.5 * across), n_across, half=half)
    x, y = (v.reshape(-1) for v in np.meshgrid(x, y, indexing="ij"))
    weight = np.outer(w_x, w_y).reshape(-1) / (1 + x * x + y * y) ** 1.5
    return x, y, weight / weight.sum()


def _nodes(end: float, n: int, *, half: bool = False) -> tuple[Float64Array, Float64Array]:
    if end == 0:
        return np.zeros(1), np.ones(1)
    return gauss_legendre(n, 0.0 if half else -end, end)
