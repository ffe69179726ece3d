"""Blinn's lobe in float32; formulas as in `models.blinn_phong`, signature and bits as in `lobe_kernel`.

numbers (C, 1): -n/4. Error: 2e-5 of max(f, 1e-6 of the peak).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from brdfcore.kernels.machine.elementary import ONE, elementwise, exp, log1p
from brdfcore.kernels.machine.jit import inline
from brdfcore.kernels.machine.vectorised import store
from brdfcore.kernels.models import lobe_blocks as rows
from brdfcore.kernels.models.lobe_blocks import read
from brdfcore.kernels.models.lobe_kernel import Float32Array, Rows, lobe_kernel, lobe_twin

#: published: divided by cos theta_i.
VARIANTS = {"normalised": 0, "published": 1}


@elementwise
def lobe_root(t2, number):
    """(n.h)^(n/2) = (1 + t^2)^(-n/4)."""
    return exp(log1p(t2) * number)


@inline
def _fill(scratch, count, numbers, variant):
    number = numbers[0]
    for k in range(count):
        store(scratch, rows.ROOT + k, lobe_root(read(scratch, rows.TAN2_H + k), number))
    if variant == 1:
        for k in range(count):
            store(scratch, rows.MIDDLE + k, ONE / read(scratch, rows.COS_I + k))
    else:
        for k in range(count):
            store(scratch, rows.MIDDLE + k, ONE)


def _values(g: Rows, numbers: Float32Array, variant: int) -> tuple[Any, Any]:
    return lobe_root(g.tan2_h, numbers[0]), ONE / g.cos_i if variant == 1 else np.ones_like(g.cos_i)


blinn_phong, blinn_phong_numpy = lobe_kernel(_fill), lobe_twin(_values)
