"""The look-ups of `trilinear` and of the nearest node over the array-API standard: any library, with derivatives.

Nodes: values (n_i, n_o, n_d, C), uniform over theta_i, theta_o in [0, pi/2] and delta_phi in [0, pi] if bilateral, else
[0, 2 pi]. NaN outside the plain domain (from angles), 0 below the horizon (from vectors).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from brdfcore.kernels.tables.array_steps import (
    at_most,
    cell,
    in_domain,
    index_type,
    limits,
    root,
    taken,
    trilinear,
    unit_vectors,
)


@dataclass(frozen=True)
class GridSettings:
    """Symmetry, and whether the nearest node is taken instead of a value between nodes."""

    bilateral: bool
    nearest: bool


def from_angles(
    xp: Any, theta_i: Any, theta_o: Any, delta_phi: Any, nodes: dict[str, Any], settings: GridSettings
) -> Any:
    """f_r (N, C) at angles (N,)."""
    inside, a, b, c = in_domain(xp, theta_i, theta_o, delta_phi)
    f = _look_up(xp, a, b, c, nodes["values"], settings)
    return xp.where(inside[:, None], f, xp.full_like(f, xp.nan))


def from_vectors(xp: Any, wi: Any, wo: Any, nodes: dict[str, Any], settings: GridSettings) -> Any:
    """f_r (N, C) of vectors (N, 3)."""
    v = unit_vectors(xp, wi, wo)
    (ix, iy, iz), (ox, oy, oz) = v.wi, v.wo
    cross, dot = ix * oy - iy * ox, ix * ox + iy * oy
    least = limits(xp, cross).least
    dot = xp.where((xp.abs(cross) > least) | (xp.abs(dot) > least), dot, xp.ones_like(dot))  # no azimuth: 0
    a, b = xp.atan2(root(xp, ix * ix + iy * iy), iz), xp.atan2(root(xp, ox * ox + oy * oy), oz)
    f = _look_up(xp, a, b, xp.atan2(cross, dot), nodes["values"], settings)
    f = xp.where(v.above[:, None], f, xp.zeros_like(f))
    return xp.where(v.usable[:, None], f, xp.full_like(f, xp.nan))


def _look_up(xp: Any, a: Any, b: Any, c: Any, values: Any, settings: GridSettings) -> Any:
    if settings.bilateral:
        c, span = xp.abs(c), np.pi
    else:
        c, span = xp.where(c < 0, c + limits(xp, c).turn, c), 2 * np.pi
    cells = []
    for angle, whole, n in zip((a, b, c), (np.pi / 2, np.pi / 2, span), values.shape[:3]):
        at, part = cell(xp, at_most(xp, angle * float((n - 1) / whole), float(n - 1)), n)
        if settings.nearest:
            at = at + xp.astype(part >= 0.5, index_type(xp))
        cells.append((at, part))
    (i, j, l), parts = zip(*cells)  # noqa: E741
    if settings.nearest:
        node = (i * values.shape[1] + j) * values.shape[2] + l
        return taken(xp, xp.reshape(values, (-1, values.shape[3])), node)
    return trilinear(xp, values, (i, j, l), parts)
