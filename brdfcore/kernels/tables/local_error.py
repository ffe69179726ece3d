"""The stored error of a table at n pairs of directions: one cell a pair, looked up and multiplied with the value there.

Cells: `tables.base.error_cells`. The kernels make half-widths of values f_r:

    u = relative(cell, channel) by_step(theta_i) factor(channel) (|f| + floor(channel))

Arguments: angles (n,) of one float dtype, inside the plain domain; values and out (n channels,) of it, two arrays;
relative float32 (cells,) or (cells channels,), by_step float32 (`STEPS`,) by step of theta_i, floors and factors
(channels,) of that dtype; row_i and map_o int32 (`STEPS`,), the cell of a step of theta_i, times those of theta_o, and
of theta_o; the cells' bases.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from brdfcore.kernels.machine.jit import inline, kernel, prange
from brdfcore.kernels.machine.vectorised import float_bits, load, stepped, store

#: Uniform steps of a polar angle over [0, pi/2], in which the edges of cells lie.
STEPS = 1_024
_STEPS_A_RADIAN = np.float32(STEPS / (np.pi / 2))
_LAST_STEP = np.int32(STEPS - 1)
_PI, _TURN, _QUARTER = (np.float32(x) for x in (np.pi, 2 * np.pi, np.pi / 2))
#: Pairs in each piece of the parallel loop: in a plain one within it the compiler makes vector instructions.
_BLOCK = 1_024
_ZERO, _ONE = np.int32(0), np.int32(1)
_TWELFTH, _FOURTH_ORDER = np.float32(1 / 12), np.float32(1 / 360)
_SIN_3, _SIN_5, _SIN_7 = (np.float32(x) for x in (-1 / 6, 1 / 120, -1 / 5_040))


class CellScale(NamedTuple):
    """Constants of a look-up: bits of a squared distance that one cell spans; the first cell."""

    shift: Any
    first: Any


@inline
def _sin(x):
    """sin x to 2e-4 of it, 0 <= x <= pi/2: cells have no sharper edges."""
    s = x * x
    return x * (np.float32(1) + s * (_SIN_3 + s * (_SIN_5 + s * _SIN_7)))


@inline
def cell_of(theta_i, theta_o, delta_phi, row_i, map_o, bases, scale):
    """(number of the cell, step of theta_i); angles float32 inside the domain, |delta_phi| <= 3 pi."""
    step = min(np.int32(theta_i * _STEPS_A_RADIAN), _LAST_STEP)
    place = stepped(load(row_i, step), load(map_o, min(np.int32(theta_o * _STEPS_A_RADIAN), _LAST_STEP)))
    turn = abs(delta_phi)
    turn = turn if turn <= _PI else abs(_TURN - turn)
    mirror = turn > _QUARTER
    y = _PI - turn if mirror else turn
    apart = theta_i - theta_o
    a, b = apart * apart, y * y
    chord = b * (np.float32(1) - b * (_TWELFTH - b * _FOURTH_ORDER))
    square = a * (np.float32(1) - a * _TWELFTH) + _sin(theta_i) * _sin(theta_o) * chord
    k = max(np.int32((float_bits(square) >> scale.shift) - scale.first), _ZERO)
    return stepped(stepped(load(bases, place), np.int32(k << _ONE)), _ONE if mirror else _ZERO), step


@kernel
def numbers(theta_i, theta_o, delta_phi, out, row_i, map_o, bases, scale):
    """The cell of each pair into out (n,) int32."""
    for k in prange(theta_i.size):
        cell, _ = cell_of(
            np.float32(theta_i[k]), np.float32(theta_o[k]), np.float32(delta_phi[k]), row_i, map_o, bases, scale
        )
        out[k] = cell
    return 0


@inline
def _width(f, relative, floor, factor):
    return relative * factor * (abs(f) + floor)


@kernel
def widths_one(
    theta_i, theta_o, delta_phi, values, out, relative, row_i, map_o, bases, by_step, floors, factors, scale
):
    """One channel; from values (n,) to out (n,)."""
    floor, factor = floors[0], factors[0]
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            cell, step = cell_of(
                np.float32(load(theta_i, k)), np.float32(load(theta_o, k)), np.float32(load(delta_phi, k)),
                row_i, map_o, bases, scale,
            )  # fmt: skip
            store(out, k, _width(load(values, k), load(by_step, step) * load(relative, cell), floor, factor))
    return 0


@kernel
def widths_three(
    theta_i, theta_o, delta_phi, values, out, relative, row_i, map_o, bases, by_step, floors, factors, scale, stride
):
    """Three channels side by side; relative (cells,) and stride 0, or (3 cells,) and stride 1."""
    row = np.int32(2) * stride + _ONE
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            cell, step = cell_of(
                np.float32(load(theta_i, k)), np.float32(load(theta_o, k)), np.float32(load(delta_phi, k)),
                row_i, map_o, bases, scale,
            )  # fmt: skip
            share, first = load(by_step, step), np.int32(cell * row)
            r = share * load(relative, first)
            g = share * load(relative, stepped(first, stride))
            b = share * load(relative, stepped(first, np.int32(stride + stride)))
            store(out, 3 * k, _width(load(values, 3 * k), r, load(floors, 0), load(factors, 0)))
            store(out, 3 * k + 1, _width(load(values, 3 * k + 1), g, load(floors, 1), load(factors, 1)))
            store(out, 3 * k + 2, _width(load(values, 3 * k + 2), b, load(floors, 2), load(factors, 2)))
    return 0


@kernel
def widths_many(
    theta_i, theta_o, delta_phi, values, out, relative, row_i, map_o, bases, by_step, floors, factors, scale, stride
):
    """Any number of channels side by side; relative (cells,) and stride 0, or (cells channels,) and stride 1."""
    channels = floors.size
    row = (channels - 1) * stride + 1
    for k in prange(theta_i.size):
        cell, step = cell_of(
            np.float32(load(theta_i, k)), np.float32(load(theta_o, k)), np.float32(load(delta_phi, k)),
            row_i, map_o, bases, scale,
        )  # fmt: skip
        share = load(by_step, step)
        for s in range(channels):
            found = share * load(relative, cell * row + s * stride)
            store(
                out, k * channels + s, _width(load(values, k * channels + s), found, load(floors, s), load(factors, s))
            )
    return 0
