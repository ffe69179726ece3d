"""Look-ups in a table over (theta_i, theta_o, delta_phi) other than the trilinear one: nearest node, monotone cubic.

Arguments and result as in `kernels.tables.trilinear`, placement included. delta_phi goes on by symmetry at 0 and pi if
bilateral, else periodically (its first and last nodes are equal); theta ends at both ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.kernels.machine.jit import inline, kernel, prange
from brdfcore.kernels.machine.vectorised import count_unless, load, store
from brdfcore.kernels.tables.interpolation import CUBIC_BLOCK, tricubic, tricubic_numpy
from brdfcore.kernels.tables.trilinear import GridScale, _place

_HALF = np.float32(0.5)


@inline
def _nearest(theta_i, theta_o, delta_phi, scale, step_i, step_o, bilateral):
    """inside, number of the nearest node; halfway, the farther from 0."""
    inside, i, j, l, u, v, w = _place(theta_i, theta_o, delta_phi, scale, bilateral)  # noqa: E741
    i = np.int32(i + 1) if u >= _HALF else i
    j = np.int32(j + 1) if v >= _HALF else j
    l = np.int32(l + 1) if w >= _HALF else l  # noqa: E741
    return inside, np.int32(i * step_i + j * step_o + l)


@kernel
def nearest_one(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """One channel; out (n,)."""
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, node = _nearest(
            load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, step_i, step_o, bilateral
        )
        outside += np.int64(0) if inside else np.int64(1)
        store(out, k, load(table, node))
    return outside


@kernel
def nearest_three(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """Three channels side by side; out (3 n,)."""
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, node = _nearest(
            load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, step_i, step_o, bilateral
        )
        outside += np.int64(0) if inside else np.int64(1)
        store(out, 3 * k, load(table, 3 * node))
        store(out, 3 * k + 1, load(table, 3 * node + 1))
        store(out, 3 * k + 2, load(table, 3 * node + 2))
    return outside


@kernel
def nearest_many(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """Any number of channels side by side; out (n channels,)."""
    channels = out.size // max(theta_i.size, 1)
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, node = _nearest(
            load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, step_i, step_o, bilateral
        )
        outside += np.int64(0) if inside else np.int64(1)
        for s in range(channels):
            store(out, k * channels + s, load(table, node * channels + s))
    return outside


@inline
def _ended(k, t, last, step):
    """Axis of theta, which ends at both ends: cell k of the nodes 0 ... last."""
    zero, one = np.int32(0), np.int32(1)
    before = np.int32(k - one) if k > zero else zero
    after = np.int32(k + np.int32(2)) if k + one < last else last
    step = np.int32(step)
    return (
        np.int32(before * step), np.int32(k * step), np.int32((k + one) * step), np.int32(after * step),
        t, k == zero, k + one == last,
    )  # fmt: skip


@inline
def _around(k, t, last, bilateral, step):
    """Axis of delta_phi: beyond an end the node mirrored at it, or the one a turn away."""
    zero, one = np.int32(0), np.int32(1)
    low = one if bilateral else np.int32(last - one)
    high = np.int32(last - one) if bilateral else one
    before = np.int32(k - one) if k > zero else low
    after = np.int32(k + np.int32(2)) if k + one < last else high
    step = np.int32(step)
    return (
        np.int32(before * step), np.int32(k * step), np.int32((k + one) * step), np.int32(after * step),
        t, False, False,
    )  # fmt: skip


@inline
def _axes(theta_i, theta_o, delta_phi, scale, step_i, step_o, bilateral, channels):
    """inside and the three axes of a look-up, offsets in values."""
    inside, i, j, l, u, v, w = _place(theta_i, theta_o, delta_phi, scale, bilateral)  # noqa: E741
    x = _ended(i, u, np.int32(scale.last_i), step_i * channels)
    y = _ended(j, v, np.int32(scale.last_o), step_o * channels)
    z = _around(l, w, np.int32(scale.last_d), bilateral, channels)
    return inside, x, y, z


@kernel
def cubic(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """Any number of channels side by side; out (n channels,)."""
    number = out.dtype.type
    channels = np.int32(out.size // max(theta_i.size, 1))
    outside = np.int64(0)
    for block in prange((theta_i.size + CUBIC_BLOCK - 1) // CUBIC_BLOCK):
        bad = np.int32(0)
        # one channel after the other: placing again costs a tenth of the rest, which stays in vectors this way
        for c in range(channels):
            bad = np.int32(0)
            for k in range(block * CUBIC_BLOCK, min(theta_i.size, block * CUBIC_BLOCK + CUBIC_BLOCK)):
                inside, x, y, z = _axes(
                    load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, step_i, step_o, bilateral, channels
                )
                bad = count_unless(bad, inside)
                store(out, k * channels + c, tricubic(table, np.int32(c), x, y, z, number))
        outside += bad
    return outside


def nearest_numpy(
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
    """The twin of the nearest kernels, operation by operation."""
    inside, cells, parts = placed_numpy(theta_i, theta_o, delta_phi, scale, bilateral)
    i, j, l = (cell + (part >= _HALF) for cell, part in zip(cells, parts))  # noqa: E741
    nodes = table.reshape(-1, out.size // max(theta_i.size, 1))
    out[...] = nodes[i * np.int64(step_i) + j * np.int64(step_o) + l].reshape(out.shape)
    return int(np.count_nonzero(~inside))


def cubic_numpy(
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
    """The twin of the cubic kernels, operation by operation."""
    inside, (i, j, l), (u, v, w) = placed_numpy(theta_i, theta_o, delta_phi, scale, bilateral)  # noqa: E741

    def ended(k: npt.NDArray[np.int64], t: FloatArray, last: int, step: Any) -> tuple[Any, ...]:
        offsets = (np.maximum(k - 1, 0), k, k + 1, np.minimum(k + 2, last))
        return (*(o * np.int64(step) for o in offsets), t, k == 0, k + 1 == last)

    last = int(scale.last_d)
    before = np.where(l > 0, l - 1, 1 if bilateral else last - 1)
    after = np.where(l + 1 < last, l + 2, last - 1 if bilateral else 1)
    z = (before, l, l + 1, after, w, False, False)
    nodes = table.reshape(-1, out.size // max(theta_i.size, 1))
    x, y = ended(i, u, int(scale.last_i), step_i), ended(j, v, int(scale.last_o), step_o)
    out[...] = tricubic_numpy(nodes, x, y, z, out.dtype.type).reshape(out.shape)
    return int(np.count_nonzero(~inside))


def placed_numpy(
    theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, scale: GridScale, bilateral: bool
) -> tuple[npt.NDArray[np.bool_], list[npt.NDArray[np.int64]], list[FloatArray]]:
    """The twin of `trilinear._place`: inside, cells and positions in them."""
    with np.errstate(invalid="ignore", over="ignore"):
        inside = (theta_i >= 0) & (theta_i <= scale.theta_max) & (theta_o >= 0) & (theta_o <= scale.theta_max)
        inside &= np.abs(delta_phi) <= scale.delta_phi_max
    a, b, c = (np.where(inside, x, theta_i.dtype.type(0)) for x in (theta_i, theta_o, delta_phi))
    if bilateral:
        c = np.abs(c)
        c = np.where(c <= scale.half_turn, c, np.abs(scale.turn - c))
    else:
        c = c - scale.turn * np.floor(c / scale.turn)
    cells, parts = [], []
    for angle, per, last in (
        (a, scale.per_i, scale.last_i),
        (b, scale.per_o, scale.last_o),
        (c, scale.per_d, scale.last_d),
    ):
        position = np.minimum(angle * per, last)
        cell = np.clip(position.astype(np.int64), 0, int(last) - 1)
        cells.append(cell)
        parts.append((position - cell.astype(np.float32)).astype(theta_i.dtype))
    return inside, cells, parts
