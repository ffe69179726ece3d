"""Trilinear look-ups in a table over (theta_i, theta_o, delta_phi) with uniform nodes.

Each kernel has a numpy twin of the same signature and bits. All return the number of inputs outside the plain
domain (theta outside [0, pi/2] of its type, |delta_phi| > 3 pi, NaN); such points get a value that means nothing and
no read leaves the table.

Arguments: theta_i, theta_o, delta_phi (n,) of one float dtype; table float32, flat, C order (n_i, n_o, n_d,
channels), size below 2^31; out (n channels,), flat; scale, a `GridScale` of that dtype; steps between nodes of
theta_i and theta_o, in nodes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI, FloatArray
from brdfcore.kernels.machine.jit import inline, kernel, prange
from brdfcore.kernels.machine.vectorised import load, load_pair, store


class GridScale(NamedTuple):
    """Constants of a look-up, in the dtype of the angles: nodes a radian, last nodes, periods."""

    per_i: Any
    per_o: Any
    per_d: Any
    last_i: Any
    last_o: Any
    last_d: Any
    half_turn: Any
    turn: Any
    theta_max: Any
    delta_phi_max: Any


def grid_scale(shape: tuple[int, int, int], bilateral: bool, dtype: npt.DTypeLike) -> GridScale:
    """The constants for a table of `shape` = (n_i, n_o, n_d): theta over [0, pi/2], delta_phi over [0, pi] if
    bilateral, else over [0, 2 pi]."""
    n_i, n_o, n_d = shape
    number: Any = np.dtype(dtype).type
    span = np.pi if bilateral else 2 * np.pi
    values: tuple[float, ...] = (
        (n_i - 1) / (np.pi / 2),
        (n_o - 1) / (np.pi / 2),
        (n_d - 1) / span,
        n_i - 1,
        n_o - 1,
        n_d - 1,
        np.pi,
        2 * np.pi,
        HALF_PI,
        DELTA_PHI_DIRECT,
    )
    return GridScale(*(number(v) for v in values))


@inline
def _place(theta_i, theta_o, delta_phi, scale, bilateral):
    """Cell and position in it of one pair of directions: inside, i, j, l, u, v, w."""
    # a comparison with NaN is false, so NaN counts as outside
    inside = (theta_i >= 0) & (theta_i <= scale.theta_max) & (theta_o >= 0) & (theta_o <= scale.theta_max)
    inside = inside & (abs(delta_phi) <= scale.delta_phi_max)
    if bilateral:
        c = abs(delta_phi)
        c = c if c <= scale.half_turn else abs(scale.turn - c)
    else:
        c = delta_phi - scale.turn * np.floor(delta_phi / scale.turn)
    x = min(theta_i * scale.per_i, scale.last_i)
    y = min(theta_o * scale.per_o, scale.last_o)
    z = min(c * scale.per_d, scale.last_d)
    zero = np.int32(0)
    i = min(max(np.int32(x), zero), np.int32(scale.last_i) - np.int32(1))
    j = min(max(np.int32(y), zero), np.int32(scale.last_o) - np.int32(1))
    l = min(max(np.int32(z), zero), np.int32(scale.last_d) - np.int32(1))  # noqa: E741
    return inside, i, j, l, x - np.float32(i), y - np.float32(j), z - np.float32(l)


@inline
def _mix(low_0, low_1, high_0, high_1, u, v):
    """Along theta_o, then along theta_i."""
    low = low_0 + v * (low_1 - low_0)
    high = high_0 + v * (high_1 - high_0)
    return low + u * (high - low)


@kernel
def trilinear_one(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """One channel; out (n,)."""
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, i, j, l, u, v, w = _place(  # noqa: E741
            load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, bilateral
        )
        outside += np.int64(0) if inside else np.int64(1)
        p = i * step_i + j * step_o + l
        a0, a1 = load_pair(table, p, w)
        b0, b1 = load_pair(table, p + step_o, w)
        c0, c1 = load_pair(table, p + step_i, w)
        d0, d1 = load_pair(table, p + step_i + step_o, w)
        value = _mix(a0 + w * (a1 - a0), b0 + w * (b1 - b0), c0 + w * (c1 - c0), d0 + w * (d1 - d0), u, v)
        store(out, k, value)
    return outside


@inline
def _three(table, p, w):
    """Three channels between two nodes: six neighbouring numbers."""
    r0, g0 = load_pair(table, p, w)
    b0, r1 = load_pair(table, p + 2, w)
    g1, b1 = load_pair(table, p + 4, w)
    return r0 + w * (r1 - r0), g0 + w * (g1 - g0), b0 + w * (b1 - b0)


@kernel
def trilinear_three(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """Three channels, stored side by side at each node; out (3 n,)."""
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, i, j, l, u, v, w = _place(  # noqa: E741
            load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, bilateral
        )
        outside += np.int64(0) if inside else np.int64(1)
        p = (i * step_i + j * step_o + l) * 3
        r0, g0, b0 = _three(table, p, w)
        r1, g1, b1 = _three(table, p + 3 * step_o, w)
        r2, g2, b2 = _three(table, p + 3 * step_i, w)
        r3, g3, b3 = _three(table, p + 3 * step_i + 3 * step_o, w)
        store(out, 3 * k, _mix(r0, r1, r2, r3, u, v))
        store(out, 3 * k + 1, _mix(g0, g1, g2, g3, u, v))
        store(out, 3 * k + 2, _mix(b0, b1, b2, b3, u, v))
    return outside


@kernel
def trilinear_many(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """Any number of channels, stored side by side at each node; out (n channels,)."""
    channels = out.size // max(theta_i.size, 1)
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, i, j, l, u, v, w = _place(  # noqa: E741
            load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, bilateral
        )
        outside += np.int64(0) if inside else np.int64(1)
        first = (i * step_i + j * step_o + l) * channels
        row_o = step_o * channels
        row_i = step_i * channels
        for s in range(channels):
            p = first + s
            low_0 = _along(table, p, channels, w)
            low_1 = _along(table, p + row_o, channels, w)
            high_0 = _along(table, p + row_i, channels, w)
            high_1 = _along(table, p + row_i + row_o, channels, w)
            store(out, k * channels + s, _mix(low_0, low_1, high_0, high_1, u, v))
    return outside


@inline
def _along(table, p, channels, w):
    """One channel between two nodes, in the type of w."""
    one = w - w + np.float32(1)
    low = one * load(table, p)
    return low + w * (one * load(table, p + channels) - low)


def trilinear_numpy(
    theta_i: FloatArray,
    theta_o: FloatArray,
    delta_phi: FloatArray,
    table: npt.NDArray[np.float32],
    out: FloatArray,
    scale: GridScale,
    step_i: Any,
    step_o: Any,
    bilateral: bool,
) -> int:
    """The twin of all three kernels, operation by operation."""
    channels = out.size // max(theta_i.size, 1)
    number = theta_i.dtype.type
    with np.errstate(invalid="ignore", over="ignore"):
        inside = (theta_i >= 0) & (theta_i <= scale.theta_max) & (theta_o >= 0) & (theta_o <= scale.theta_max)
        inside &= np.abs(delta_phi) <= scale.delta_phi_max
        a, b, c = (np.where(inside, x, number(0)) for x in (theta_i, theta_o, delta_phi))
        if bilateral:
            c = np.abs(c)
            c = np.where(c <= scale.half_turn, c, np.abs(scale.turn - c))
        else:
            c = c - scale.turn * np.floor(c / scale.turn)
    x = np.minimum(a * scale.per_i, scale.last_i)
    y = np.minimum(b * scale.per_o, scale.last_o)
    z = np.minimum(c * scale.per_d, scale.last_d)
    index = []
    for position, last in ((x, scale.last_i), (y, scale.last_o), (z, scale.last_d)):
        index.append(np.clip(position.astype(np.int32), 0, np.int32(last) - 1))
    i, j, l = index  # noqa: E741
    u, v, w = ((p - n.astype(np.float32)).astype(number)[:, None] for p, n in ((x, i), (y, j), (z, l)))
    nodes = table.reshape(-1, channels).astype(number)
    p = i * np.int64(step_i) + j * np.int64(step_o) + l

    def along_delta_phi(at: npt.NDArray[np.int64]) -> FloatArray:
        mixed: FloatArray = nodes[at] + w * (nodes[at + 1] - nodes[at])
        return mixed

    low_0, low_1 = along_delta_phi(p), along_delta_phi(p + step_o)
    high_0, high_1 = along_delta_phi(p + step_i), along_delta_phi(p + step_i + step_o)
    low = low_0 + v * (low_1 - low_0)
    high = high_0 + v * (high_1 - high_0)
    out[...] = (low + u * (high - low)).reshape(out.shape)
    return int(np.count_nonzero(~inside))
