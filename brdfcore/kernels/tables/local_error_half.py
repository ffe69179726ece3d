"""The stored error of a table by half vector: as `local_error`, in cells of theta_i, theta_h and its azimuth.

A cell is found without a square root of what cancels, an arc tangent or a branch: theta_h by sqrt(tan(theta_h / 2)),
its azimuth by the quadrant of (x - y, x + y).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from brdfcore.kernels.machine.jit import inline, kernel, with_names
from brdfcore.kernels.machine.vectorised import load, stepped
from brdfcore.kernels.tables import local_error
from brdfcore.kernels.tables.local_error import _LAST_STEP, _PI, _STEPS_A_RADIAN, _TURN, _sin

_HALF, _TWO, _LEAST, _QUARTER_TURN = (np.float32(x) for x in (0.5, 2, 1e-30, np.pi / 2))
_ONE, _THREE, _FOUR = np.int32(1), np.int32(3), np.int32(4)
_NONE = np.int32(0)


class HalfCells(NamedTuple):
    """Constants of a look-up: cells of theta_h, as float32 and as the last one."""

    count: Any
    last: Any


@inline
def cell_of(theta_i, theta_o, delta_phi, row_i, map_o, bases, scale):
    """(number of the cell, step of theta_i); angles float32 inside the domain, |delta_phi| <= 3 pi."""
    step = min(np.int32(theta_i * _STEPS_A_RADIAN), _LAST_STEP)
    turn = abs(delta_phi)
    turn = turn if turn <= _PI else abs(_TURN - turn)
    sin_i, sin_o = _sin(theta_i), _sin(theta_o)
    away = _sin(max(_HALF * (_PI - turn), np.float32(0)))
    x = (sin_i - sin_o) + _TWO * sin_o * away * away
    y = _TWO * sin_o * away * _sin(_HALF * turn)
    z = _sin(max(_QUARTER_TURN - theta_i, np.float32(0))) + _sin(max(_QUARTER_TURN - theta_o, np.float32(0)))
    flat = x * x + y * y
    u = np.sqrt(np.sqrt(flat) / max(z + np.sqrt(flat + z * z), _LEAST))
    k = min(np.int32(u * scale.count), scale.last)
    quarter = _ONE if y > abs(x) else _NONE
    eighth = _THREE - quarter if x < np.float32(0) else quarter
    return stepped(load(row_i, step), np.int32(k * _FOUR + eighth)), step


_names = {**vars(local_error), "__name__": __name__, "cell_of": cell_of}
numbers, widths_one, widths_three, widths_many = (
    kernel(with_names(k.python, _names))
    for k in (local_error.numbers, local_error.widths_one, local_error.widths_three, local_error.widths_many)
)
