"""A compiled kernel from the loops of one lobe, and its numpy twin from the same elementwise functions.

A file of this folder holds one lobe, f = ((root factor) root) middle + base, and a model names its kernel in `FAST`:

    @inline
    def fill(scratch, count, numbers, variant):   # rows ROOT and MIDDLE of a block, see `lobe_blocks`
        ...

    def values(rows, numbers, variant):           # (root, middle) of whole arrays, rows a `Rows`
        ...

    lobe, lobe_numpy = lobe_kernel(fill), lobe_twin(values)

Kernel and twin have one signature and the same bits. Arguments, C channels:

    theta_i, theta_o, delta_phi  (n,) of one float dtype
    out                          (n C,), flat, of that dtype
    constants                    `pair_geometry.angle_constants` of that dtype
    ends                         (C, 2) of that dtype: factor (normalisation in it) and base
    numbers                      float32 (C, k), what the lobe reads of a channel
    variant                      int64, which of the lobe's formulas

Returned: the number of inputs outside the plain domain (theta outside [0, pi/2] of its type, |delta_phi| > 3 pi, NaN);
such points get the value at theta = 0.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.kernels.base.pair_geometry import AngleConstants, half_vector, split
from brdfcore.kernels.machine.jit import Kernel, inline, prange
from brdfcore.kernels.models import lobe_blocks
from brdfcore.kernels.models.lobe_blocks import BLOCK, CHUNK, fill_geometry, interleave, result, store_result

Float32Array = npt.NDArray[np.float32]


class Rows(NamedTuple):
    """The geometry of n pairs, float32 (n,): the rows of `lobe_blocks` by their names."""

    theta_i: Float32Array
    theta_o: Float32Array
    horizon_i: Float32Array
    horizon_o: Float32Array
    half_to_retro: Float32Array
    cos_i: Float32Array
    cos_o: Float32Array
    sin_i: Float32Array
    sin_o: Float32Array
    tan2_h: Float32Array
    sin2_half_d: Float32Array
    sin2_to_mirror: Float32Array


def lobe_kernel(fill: Any, prepare: Any = None) -> Kernel:
    """The kernel of a lobe. fill, prepare: `jit.inline` functions of one module; `prepare(scratch, count)` fills rows
    that all channels share, once a block."""
    # a copy of the loops whose globals are this lobe's: a closure would compile as well, and not be cached, as numba
    # keys what is closed over by a pickle that differs from one process to the next
    chunk = inline(_with_globals(_chunk, fill, fill=fill, prepare=prepare or _nothing))
    return Kernel(_with_globals(_lobe, fill, chunk=chunk))


def _with_globals(function: Callable[..., Any], lobe: Any, **names: Any) -> Callable[..., Any]:
    """`function` with `names` among its globals, named after the lobe and its file's text: what its cache goes by."""
    source = lobe.py_func
    file = Path(inspect.getfile(source))
    # typed at a prompt it has no file, and is compiled anew in each process
    text = hashlib.sha256(file.read_bytes() if file.is_file() else os.urandom(16)).hexdigest()[:8]
    copy = types.FunctionType(function.__code__, {**globals(), **names}, function.__name__)
    copy.__module__ = source.__module__
    copy.__qualname__ = f"{source.__module__.rpartition('.')[2]}_{source.__name__.strip('_')}_{text}{function.__name__}"
    return copy


@inline
def _nothing(scratch, count):
    pass


def _chunk(theta_i, theta_o, delta_phi, out, constants, ends, numbers, variant, start, stop):
    scratch = np.empty(lobe_blocks.SCRATCH, np.float32)
    row = np.empty(3 * BLOCK, out.dtype)
    channels = numbers.shape[0]
    outside = np.int64(0)
    for first in range(start, stop, BLOCK):
        count = min(stop - first, BLOCK)
        outside += fill_geometry(theta_i, theta_o, delta_phi, first, count, constants, scratch)
        prepare(scratch, count)  # noqa: F821
        for c in range(channels):
            fill(scratch, count, numbers[c], variant)  # noqa: F821
            store_result(scratch, row, out, first, count, c, channels, ends[c, 0], ends[c, 1])
        if channels == 3:
            interleave(row, out, first, count)
    return outside


def _lobe(theta_i, theta_o, delta_phi, out, constants, ends, numbers, variant):
    outside = np.int64(0)
    for part in prange((theta_i.size + CHUNK - 1) // CHUNK):
        outside += chunk(  # noqa: F821
            theta_i, theta_o, delta_phi, out, constants, ends, numbers, variant,
            part * CHUNK, min(part * CHUNK + CHUNK, theta_i.size),
        )  # fmt: skip
    return outside


def lobe_twin(values: Callable[[Rows, Float32Array, int], tuple[Any, Any]]) -> Callable[..., int]:
    """The kernel's twin on whole arrays; `values` gives root and middle of one channel."""

    def twin(
        theta_i: FloatArray,
        theta_o: FloatArray,
        delta_phi: FloatArray,
        out: FloatArray,
        constants: AngleConstants,
        ends: FloatArray,
        numbers: Float32Array,
        variant: int,
    ) -> int:
        found = out.reshape(theta_i.size, -1)
        # a quotient or product past float32 on the side that `select` drops is no error
        with np.errstate(all="ignore"):
            inside, a, b, horizon_i, horizon_o, half_d, to_mirror, to_retro = split(
                theta_i, theta_o, delta_phi, constants
            )
            half = half_vector(a, b, horizon_i, horizon_o, half_d, to_mirror)
            rows = Rows(a, b, horizon_i, horizon_o, to_retro, *half)
            for c, row in enumerate(numbers):
                found[:, c] = result(*values(rows, row, variant), ends[c, 0], ends[c, 1])
        return int(np.count_nonzero(~inside))

    return twin
