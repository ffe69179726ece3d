"""The look-up of `warp` over the array-API standard: any library, with derivatives.

Nodes as `kernels.tables.warp` lists them, in their shapes: spectra (K, N, N, C), theta_i (K,), theta_index (G,), sigma,
ndf, warp (K, n_y, n_x, 2), rows (K, n_y, 2). NaN outside the plain domain (from angles), 0 below the horizon (from
vectors).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from brdfcore.kernels.tables.array_steps import (
    along,
    at_least,
    at_most,
    cell,
    cos,
    cosine,
    in_domain,
    index_type,
    limits,
    root,
    sin,
    taken,
    unit_vectors,
)


def from_angles(
    xp: Any, theta_i: Any, theta_o: Any, delta_phi: Any, nodes: dict[str, Any], settings: Any = None
) -> Any:
    """f_r (N, C) at angles (N,)."""
    inside, a, b, c = in_domain(xp, theta_i, theta_o, delta_phi)
    # H = wi + wo in the frame of wi, by the half of delta_phi: no difference cancels near the mirror direction, and
    # nothing is divided by H_z, which is 0 at the horizon
    cos_i, cos_o, sin_o, apart = cosine(xp, a), cosine(xp, b), sin(xp, b), 0.5 * (a - b)
    sin_half, cos_half = sin(xp, 0.5 * c), cos(xp, 0.5 * c)
    total = cos_i + cos_o
    x = total * sin(xp, apart) / cos(xp, apart) + 2 * sin_o * cos_half * cos_half
    y = 2 * sin_o * sin_half * cos_half
    f = _look_up(xp, a, x, y, total, cos_o, nodes)
    return xp.where(inside[:, None], f, xp.full_like(f, xp.nan))


def from_vectors(xp: Any, wi: Any, wo: Any, nodes: dict[str, Any], settings: Any = None) -> Any:
    """f_r (N, C) of vectors (N, 3)."""
    v = unit_vectors(xp, wi, wo)
    (ix, iy, iz), (hx, hy, _), oz = v.wi, v.sum, v.wo[2]
    sin_i = root(xp, ix * ix + iy * iy)
    some = sin_i > 0
    along_x = xp.where(some, ix / xp.where(some, sin_i, xp.ones_like(sin_i)), xp.ones_like(sin_i))
    along_y = xp.where(some, iy / xp.where(some, sin_i, xp.ones_like(sin_i)), xp.zeros_like(sin_i))
    x, y = hx * along_x + hy * along_y, hy * along_x - hx * along_y
    f = _look_up(xp, xp.atan2(sin_i, iz), x, y, iz + oz, oz, nodes)
    f = xp.where(v.above[:, None], f, xp.zeros_like(f))
    return xp.where(v.usable[:, None], f, xp.full_like(f, xp.nan))


def _look_up(xp: Any, a: Any, x: Any, y: Any, total: Any, cos_o: Any, nodes: dict[str, Any]) -> Any:
    """At theta_i and the half vector (x, y, total), of any length, x in the plane of incidence."""
    spectra, warp, rows, knots = nodes["spectra"], nodes["warp"], nodes["rows"], nodes["theta_i"]
    slices, n_y, n_x, _ = warp.shape
    least = limits(xp, x).least
    some = (xp.abs(x) > least) | (xp.abs(y) > least)
    phi = xp.atan2(y, xp.where(some, x, xp.ones_like(x)))
    theta_h = xp.atan2(root(xp, x * x + y * y), total)

    u = root(xp, theta_h * (2 / np.pi))
    density = _uniform(xp, nodes["ndf"], u)
    area = _uniform(xp, nodes["sigma"], root(xp, a * (2 / np.pi)))
    factor = density / (4 * area) / cos_o

    steps = nodes["theta_index"].shape[0]
    step = xp.clip(xp.floor(a * float(steps / (np.pi / 2))), 0.0, float(steps - 1))
    k = taken(xp, nodes["theta_index"], xp.astype(step, index_type(xp)))
    k = xp.astype(k, index_type(xp))
    k = xp.clip(xp.where(a > taken(xp, knots, k + 1), k + 1, k), 0, slices - 2)
    below, next_one = taken(xp, knots, k), taken(xp, knots, k + 1)
    w = at_most(xp, at_least(xp, (a - below) / (next_one - below), 0.0), 1.0)

    column, u = cell(xp, at_most(xp, u, 1.0) * float(n_x - 1), n_x)
    v = at_most(xp, at_least(xp, 0.5 + phi * float(0.5 / np.pi), 0.0), 1.0) * float(n_y - 1)
    row, v = cell(xp, v, n_y)
    pairs, lines = xp.reshape(warp, (-1, 2)), xp.reshape(rows, (-1, 2))
    line = k * n_y + row
    p = line * n_x + column
    left_0, right_0, left_1, right_1 = (_blend(xp, pairs, p + d, n_y * n_x, w) for d in (0, 1, n_x, n_x + 1))
    row_0, row_1 = (_blend(xp, lines, line + d, n_y, w) for d in (0, 1))
    left = left_0[:, 0] + (left_1[:, 0] - left_0[:, 0]) * v
    right = right_0[:, 0] + (right_1[:, 0] - right_0[:, 0]) * v
    whole = row_0[:, 0] + (row_1[:, 0] - row_0[:, 0]) * v
    part = left_0[:, 1] + (left_1[:, 1] - left_0[:, 1]) * v + u * (left + (right - left) * (0.5 * u)) / float(n_x - 1)
    seen = whole > least
    s = xp.where(seen, part / xp.where(seen, whole, xp.ones_like(whole)), xp.zeros_like(part))
    t = row_0[:, 1] + v * (row_0[:, 0] + (row_1[:, 0] - row_0[:, 0]) * (0.5 * v)) / float(n_y - 1)

    n, channels = spectra.shape[1], spectra.shape[3]
    column, s = cell(xp, at_most(xp, s, 1.0) * float(n - 1), n)
    row, t = cell(xp, at_most(xp, t, 1.0) * float(n - 1), n)
    flat = xp.reshape(spectra, (-1, channels))
    p = (k * n + row) * n + column
    corners = [_blend(xp, flat, p + d, n * n, w) for d in (0, 1, n, n + 1)]
    s, t = s[:, None], t[:, None]
    low = corners[0] + (corners[1] - corners[0]) * s
    return (low + (corners[2] + (corners[3] - corners[2]) * s - low) * t) * factor[:, None]


def _uniform(xp: Any, table: Any, position: Any) -> Any:
    """Linear in a table (n,) over [0, 1]."""
    n = table.shape[0]
    return along(xp, table, *cell(xp, at_most(xp, position, 1.0) * float(n - 1), n))


def _blend(xp: Any, table: Any, at: Any, next_slice: int, w: Any) -> Any:
    """Rows (N, C) of a table, linear between two slices."""
    low = taken(xp, table, at)
    return low + (taken(xp, table, at + next_slice) - low) * w[:, None]
