"""Trilinear look-ups in a table over (theta_i, theta_o, delta_phi) with uniform nodes.

Each kernel has a numpy twin of the same signature and bits. All return the number of inputs outside the plain
domain (theta outside [0, THETA_MAX], |delta_phi| > 3 pi, NaN); such points get a value that means nothing and
no read leaves the table.

Arguments: theta_i, theta_o, delta_phi (n,) of one float dtype; table float32, flat, C order (n_i, n_o, n_d,
channels), size below 2^31; out (n, channels) or, for one channel, (n,); scale, a `GridScale` of that dtype.
"""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from brdfcore.conventions import DELTA_PHI_DIRECT, THETA_MAX, FloatArray
from brdfcore.kernels.jit import kernel, prange


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
        THETA_MAX,
        DELTA_PHI_DIRECT,
    )
    return GridScale(*(number(v) for v in values))


@intrinsic
def _load_pair(typing_context, array, index):
    """Two neighbouring float32 as one 64-bit load: half the gathers, and gathers are what a look-up costs."""

    def generate(context, builder, signature, args):
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        pointer = cgutils.gep_inbounds(builder, data, args[1])
        wide = builder.bitcast(pointer, ir.IntType(64).as_pointer())
        pair = builder.load(wide, align=4, typ=ir.IntType(64))  # neighbours need not be 8-byte aligned
        low = builder.trunc(pair, ir.IntType(32))
        high = builder.trunc(builder.lshr(pair, ir.Constant(ir.IntType(64), 32)), ir.IntType(32))
        if sys.byteorder == "big":
            low, high = high, low
        parts = [builder.bitcast(part, ir.FloatType()) for part in (low, high)]
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(types.float32, 2)(array, types.intp), generate


@kernel
def trilinear_one(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """One channel; out (n,)."""
    last_i = np.int32(scale.last_i) - np.int32(1)
    last_o = np.int32(scale.last_o) - np.int32(1)
    last_d = np.int32(scale.last_d) - np.int32(1)
    zero = np.int32(0)
    outside = np.int64(0)
    for k in prange(theta_i.size):
        a = theta_i[k]
        b = theta_o[k]
        c = delta_phi[k]
        # a comparison with NaN is false, so NaN counts as outside
        inside = (a >= 0) & (a <= scale.theta_max) & (b >= 0) & (b <= scale.theta_max) & (abs(c) <= scale.delta_phi_max)
        outside += np.int64(0) if inside else np.int64(1)
        if bilateral:
            c = abs(c)
            c = c if c <= scale.half_turn else abs(scale.turn - c)
        else:
            c = c - scale.turn * np.floor(c / scale.turn)
        x = min(a * scale.per_i, scale.last_i)
        y = min(b * scale.per_o, scale.last_o)
        z = min(c * scale.per_d, scale.last_d)
        i = min(max(np.int32(x), zero), last_i)
        j = min(max(np.int32(y), zero), last_o)
        l = min(max(np.int32(z), zero), last_d)  # noqa: E741
        u = x - np.float32(i)
        v = y - np.float32(j)
        w = z - np.float32(l)
        p = i * step_i + j * step_o + l
        a0, a1 = _load_pair(table, p)
        b0, b1 = _load_pair(table, p + step_o)
        c0, c1 = _load_pair(table, p + step_i)
        d0, d1 = _load_pair(table, p + step_i + step_o)
        low_0 = a0 + w * (a1 - a0)
        low_1 = b0 + w * (b1 - b0)
        high_0 = c0 + w * (c1 - c0)
        high_1 = d0 + w * (d1 - d0)
        low = low_0 + v * (low_1 - low_0)
        high = high_0 + v * (high_1 - high_0)
        out[k] = low + u * (high - low)
    return outside


@kernel
def trilinear_many(theta_i, theta_o, delta_phi, table, out, scale, step_i, step_o, bilateral):
    """Any number of channels, stored side by side at each node; out (n, channels)."""
    channels = np.int32(out.shape[1])
    last_i = np.int32(scale.last_i) - np.int32(1)
    last_o = np.int32(scale.last_o) - np.int32(1)
    last_d = np.int32(scale.last_d) - np.int32(1)
    zero = np.int32(0)
    outside = np.int64(0)
    for k in prange(theta_i.size):
        a = theta_i[k]
        b = theta_o[k]
        c = delta_phi[k]
        inside = (a >= 0) & (a <= scale.theta_max) & (b >= 0) & (b <= scale.theta_max) & (abs(c) <= scale.delta_phi_max)
        outside += np.int64(0) if inside else np.int64(1)
        if bilateral:
            c = abs(c)
            c = c if c <= scale.half_turn else abs(scale.turn - c)
        else:
            c = c - scale.turn * np.floor(c / scale.turn)
        x = min(a * scale.per_i, scale.last_i)
        y = min(b * scale.per_o, scale.last_o)
        z = min(c * scale.per_d, scale.last_d)
        i = min(max(np.int32(x), zero), last_i)
        j = min(max(np.int32(y), zero), last_o)
        l = min(max(np.int32(z), zero), last_d)  # noqa: E741
        u = x - np.float32(i)
        v = y - np.float32(j)
        w = z - np.float32(l)
        p = (i * step_i + j * step_o + l) * channels
        row_o = step_o * channels
        row_i = step_i * channels
        for s in range(channels):
            q = p + s
            low_0 = table[q] + w * (table[q + channels] - table[q])
            q += row_o
            low_1 = table[q] + w * (table[q + channels] - table[q])
            q = p + s + row_i
            high_0 = table[q] + w * (table[q + channels] - table[q])
            q += row_o
            high_1 = table[q] + w * (table[q + channels] - table[q])
            low = low_0 + v * (low_1 - low_0)
            high = high_0 + v * (high_1 - high_0)
            out[k, s] = low + u * (high - low)
    return outside


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
    """The twin of both kernels, operation by operation."""
    channels = 1 if out.ndim == 1 else out.shape[1]
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
    nodes = table.reshape(-1, channels)
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
