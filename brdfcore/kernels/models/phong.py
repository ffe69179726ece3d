"""Phong's lobe in float32; formulas as in `models.phong`, signature and bits as in `lobe_kernel`.

numbers (C, 1): n/2. Error: 2e-5 of max(f, 1e-6 of the peak), but where the lobe ends, r.v < .05: there differences of
float32 numbers near 1 leave 1e-7 of the peak (2e-5 of max(f, 1e-2 of the peak); for n < 1 the slope has no bound).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from brdfcore.kernels.base.pair_geometry import one_minus_rv
from brdfcore.kernels.machine.elementary import ONE, ZERO, elementwise, exp, log1p, select
from brdfcore.kernels.machine.jit import inline
from brdfcore.kernels.machine.vectorised import store
from brdfcore.kernels.models import lobe_blocks as rows
from brdfcore.kernels.models.lobe_blocks import read
from brdfcore.kernels.models.lobe_kernel import Float32Array, Rows, lobe_kernel, lobe_twin

#: published: divided by cos theta_i.
VARIANTS = {"normalised": 0, "published": 1}


@elementwise
def lobe_root(gap, half_exponent):
    """(r.v)^(n/2), gap = 1 - r.v; 0 for r.v <= 0."""
    lit = gap < ONE
    root = exp(log1p(-select(lit, gap, ZERO)) * half_exponent)
    return select(lit, root, ZERO)


@inline
def _prepare(scratch, count):
    for k in range(count):
        sin_i, sin_o = read(scratch, rows.SIN_I + k), read(scratch, rows.SIN_O + k)
        gap = one_minus_rv(sin_i, sin_o, read(scratch, rows.SIN2_HALF_D + k), read(scratch, rows.SIN2_TO_MIRROR + k))
        store(scratch, rows.ONE_MINUS_RV + k, gap)


@inline
def _fill(scratch, count, numbers, variant):
    half_exponent = numbers[0]
    for k in range(count):
        store(scratch, rows.ROOT + k, lobe_root(read(scratch, rows.ONE_MINUS_RV + k), half_exponent))
    if variant == 1:
        for k in range(count):
            store(scratch, rows.MIDDLE + k, ONE / read(scratch, rows.COS_I + k))
    else:
        for k in range(count):
            store(scratch, rows.MIDDLE + k, ONE)


def _values(g: Rows, numbers: Float32Array, variant: int) -> tuple[Any, Any]:
    gap = one_minus_rv(g.sin_i, g.sin_o, g.sin2_half_d, g.sin2_to_mirror)
    return lobe_root(gap, numbers[0]), ONE / g.cos_i if variant == 1 else np.ones_like(g.cos_i)


phong, phong_numpy = lobe_kernel(_fill, _prepare), lobe_twin(_values)
