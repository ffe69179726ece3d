"""The compiled lobe of `strangers.Sheen`."""

from __future__ import annotations

from typing import Any

import numpy as np

from brdfcore.kernels.machine.elementary import ONE, elementwise
from brdfcore.kernels.machine.jit import inline
from brdfcore.kernels.machine.vectorised import store
from brdfcore.kernels.models import lobe_blocks as rows
from brdfcore.kernels.models.lobe_kernel import Float32Array, Rows, lobe_kernel, lobe_twin


@elementwise
def _middle(t2: Any) -> Any:
    return ONE / (ONE + t2)


@inline
def _fill(scratch: Any, count: Any, numbers: Any, variant: Any) -> Any:
    for k in range(count):
        store(scratch, rows.ROOT + k, ONE)
        store(scratch, rows.MIDDLE + k, _middle(rows.read(scratch, rows.TAN2_H + k)))


def _values(g: Rows, numbers: Float32Array, variant: int) -> tuple[Any, Any]:
    return np.ones_like(g.cos_i), _middle(g.tan2_h)


sheen, sheen_numpy = lobe_kernel(_fill), lobe_twin(_values)
