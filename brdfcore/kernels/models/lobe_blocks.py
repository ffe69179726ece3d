"""What the fast lobe kernels share: the division of a batch, the rows of a block's scratch memory, the result.

A block of points passes through short loops (geometry, lobe, result), each over all its points. Which loop runs is
chosen once a block, so every combination of options is compiled together, once; and each loop is short enough to
become vector instructions. Rows lie in one flat float32 array at constant distances: the compiler then knows that
they don't overlap.

f = ((root factor) root) middle + base for every lobe, the exponential or power shared out over two roots. `middle` is
finite (1e32 at the horizon) and comes last: 0 is never multiplied by infinity, and infinity is only what rounds to it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from brdfcore.base.conventions import FloatArray
from brdfcore.kernels.base.pair_geometry import half_vector, split
from brdfcore.kernels.machine.elementary import ONE, ZERO, elementwise, select
from brdfcore.kernels.machine.jit import inline
from brdfcore.kernels.machine.vectorised import load, store

#: Points of a block: the rows below are 23 kB of the nearest cache's 32. Measured: 128 is 6 % slower, 512 25 %.
BLOCK = 256
#: Points that one thread takes at a time.
CHUNK = 32 * BLOCK
#: Start of each row in the scratch memory: what `split` and `half_vector` return, then what the lobes make of it.
(
    OUTSIDE, THETA_I, THETA_O, HORIZON_I, HORIZON_O, HALF_D, HALF_TO_MIRROR, HALF_TO_RETRO,
    COS_I, COS_O, SIN_I, SIN_O, TAN2_H, SIN2_HALF_D, SIN2_TO_MIRROR,
    COS_D, SIN2_D, ONE_MINUS_RV, SIN2_TO_RETRO, ROOT, MIDDLE, FRESNEL, SCRATCH,
) = (row * BLOCK for row in range(23))  # fmt: skip


@intrinsic
def read(typing_context, array, index):
    """array[index], index >= 0, of an array that the kernel may also write: no promise as `vectorised.load` makes."""

    def generate(context, builder, signature, args):
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.load(cgutils.gep_inbounds(builder, data, args[1]))

    return array.dtype(array, types.intp), generate


@elementwise
def result(root, middle, factor, base):
    """f from float32 root and middle, in the dtype of factor and base."""
    return ((root * factor) * root) * middle + base


@inline
def fill_geometry(theta_i, theta_o, delta_phi, first, count, constants, scratch):
    """Rows OUTSIDE to SIN2_TO_MIRROR of a block; returns the number of points outside the domain.

    Three short loops: a long one has more values alive than registers, and less of it runs side by side. The
    last counts apart because 64-bit numbers among the others would halve their vectors.
    """
    for k in range(count):
        inside, a, b, horizon_i, horizon_o, half_d, to_mirror, to_retro = split(
            load(theta_i, first + k), load(theta_o, first + k), load(delta_phi, first + k), constants
        )
        store(scratch, OUTSIDE + k, select(inside, ZERO, ONE))
        store(scratch, THETA_I + k, a)
        store(scratch, THETA_O + k, b)
        store(scratch, HORIZON_I + k, horizon_i)
        store(scratch, HORIZON_O + k, horizon_o)
        store(scratch, HALF_D + k, half_d)
        store(scratch, HALF_TO_MIRROR + k, to_mirror)
        store(scratch, HALF_TO_RETRO + k, to_retro)
    _fill_half_vector(scratch, count)
    outside = np.int64(0)
    for k in range(count):
        outside += np.int64(read(scratch, OUTSIDE + k))
    return outside


@inline
def _fill_half_vector(scratch, count):
    for k in range(count):
        cos_i, cos_o, sin_i, sin_o, tan2_h, sin2_half_d, sin2_to_mirror = half_vector(
            read(scratch, THETA_I + k), read(scratch, THETA_O + k),
            read(scratch, HORIZON_I + k), read(scratch, HORIZON_O + k),
            read(scratch, HALF_D + k), read(scratch, HALF_TO_MIRROR + k),
        )  # fmt: skip
        store(scratch, COS_I + k, cos_i)
        store(scratch, COS_O + k, cos_o)
        store(scratch, SIN_I + k, sin_i)
        store(scratch, SIN_O + k, sin_o)
        store(scratch, TAN2_H + k, tan2_h)
        store(scratch, SIN2_HALF_D + k, sin2_half_d)
        store(scratch, SIN2_TO_MIRROR + k, sin2_to_mirror)


@inline
def store_result(scratch, row, out, first, count, channel, channels, factor, base):
    """One channel of a block into out (n channels,); three channels wait in `row` (3 BLOCK,) for `interleave`."""
    if channels == 1:
        for k in range(count):
            store(out, first + k, result(read(scratch, ROOT + k), read(scratch, MIDDLE + k), factor, base))
    elif channels == 3:
        place = channel * BLOCK
        for k in range(count):
            store(row, place + k, result(read(scratch, ROOT + k), read(scratch, MIDDLE + k), factor, base))
    else:
        place = first * channels + channel
        for k in range(count):
            value = result(read(scratch, ROOT + k), read(scratch, MIDDLE + k), factor, base)
            store(out, place + k * channels, value)


@inline
def interleave(row, out, first, count):
    """Three channels of a block side by side into out; one loop, so that whole vectors are written."""
    place = 3 * first
    for k in range(count):
        store(out, place + 3 * k, read(row, k))
        store(out, place + 3 * k + 1, read(row, BLOCK + k))
        store(out, place + 3 * k + 2, read(row, 2 * BLOCK + k))


def ends(factor: npt.ArrayLike, base: npt.ArrayLike, channels: int, dtype: npt.DTypeLike) -> FloatArray:
    """(factor, base) a channel in `dtype`, (channels, 2); a factor past float32's range is its largest number.

    It stays finite because 0 times infinity is no number; the product with a peak still rounds to infinity.
    """
    limit = float(np.finfo(np.dtype(dtype)).max)
    both = np.stack([np.broadcast_to(np.minimum(x, limit), (channels,)) for x in (factor, base)], axis=1)
    return np.ascontiguousarray(both.astype(dtype))


def per_channel(columns: list[Any], channels: int) -> npt.NDArray[np.float32]:
    """Numbers a channel as float32 (channels, len(columns)); each column (channels,), (1,) or a number."""
    return np.stack([np.broadcast_to(np.asarray(c, np.float64), (channels,)) for c in columns], axis=1).astype(
        np.float32
    )
