"""Monotone cubic interpolation on a lattice, at fractional indices: what the look-ups of every lattice share.

Along one axis: cubic Hermite pieces whose slope at a node is that of the parabola through it and its neighbours,
(p + q)/2 with p and q the differences on its two sides, limited to three times the smaller of the two and 0 where they
have opposite signs (F. N. Fritsch, R. E. Carlson, "Monotone piecewise cubic interpolation", SIAM J. Numer. Anal. 17,
1980, DOI 10.1137/0717021: with both slopes of a piece between 0 and 3 times its difference the piece is monotone).
Third order where the nodes are monotone.

Over three axes the rule is applied to one axis after the other. Each step answers with a value between two of the
values it is given, those of the two nodes around the point; so by induction the result lies between the smallest and
the largest of the eight nodes of the cell: no overshoot, and nothing negative from nodes that are not. The limiter is
not linear, so the order of the axes matters a little; the mean of both orders of the first two is taken, which keeps a
table that is symmetric in them symmetric. Along lines of nodes the result has a continuous derivative; between them it
is continuous, with a bend where a limiter begins to act.

An axis is a tuple (k0, k1, k2, k3, t, first, last): the offsets of four neighbouring nodes, position t in [0, 1]
between k1 and k2, and whether the axis ends there: `first`, no node before k1, and the slope is that of the first
difference; `last`, none after k2. Where it goes on by symmetry or periodically the offsets say so.

Elementwise, see `elementary`: the functions run inside compiled loops and on numpy arrays, to the same bits.
"""

from __future__ import annotations

import numpy as np

from brdfcore.kernels.machine.elementary import elementwise, select
from brdfcore.kernels.machine.jit import inline
from brdfcore.kernels.machine.vectorised import load

#: Points of a block that a cubic kernel goes over once a channel: the nodes of a block stay in the second cache.
CUBIC_BLOCK = 256


@elementwise
def limited(p, q, half, three):
    """Slope at a node between the differences p and q: their mean, within 3 min(|p|, |q|), 0 at an extremum."""
    size_p, size_q = abs(p), abs(q)
    most = three * select(size_p < size_q, size_p, size_q)
    mean = half * (p + q)
    mean = select(mean > most, most, mean)
    mean = select(mean < -most, -most, mean)
    return select((p > 0) & (q > 0) | (p < 0) & (q < 0), mean, p - p)


@elementwise
def hermite(a, b, c, d, t, first, last, half, three):
    """Value at t in [0, 1] between b and c of the nodes a, b, c, d; never outside [min(b, c), max(b, c)]."""
    s = c - b
    before = select(first, s, b - a)
    after = select(last, s, d - c)
    slope_b = limited(before, s, half, three)
    slope_c = limited(s, after, half, three)
    both = slope_b + slope_c
    value = b + t * (slope_b + t * ((three * s - slope_b - both) + t * (both - (s + s))))
    # the exact value is within; rounding alone may pass by an ulp, and below 0 that is a wrong sign
    low, high = select(b < c, b, c), select(b < c, c, b)
    value = select(value > low, value, low)
    return select(value < high, value, high)


@inline
def _line(table, at, axis, number):
    half = number(0.5)
    three = number(3)
    a = number(load(table, np.int32(at + axis[0])))
    b = number(load(table, np.int32(at + axis[1])))
    c = number(load(table, np.int32(at + axis[2])))
    d = number(load(table, np.int32(at + axis[3])))
    return hermite(a, b, c, d, axis[4], axis[5], axis[6], half, three)


@inline
def _across(a, b, c, d, axis, number):
    return hermite(a, b, c, d, axis[4], axis[5], axis[6], number(0.5), number(3))


@inline
def _plane(table, at, y, z, number):
    """The four lines of one index of the first axis, interpolated along the third."""
    return (
        _line(table, np.int32(at + y[0]), z, number),
        _line(table, np.int32(at + y[1]), z, number),
        _line(table, np.int32(at + y[2]), z, number),
        _line(table, np.int32(at + y[3]), z, number),
    )


@inline
def tricubic(table, at, x, y, z, number):
    """Value of a flat `table` at `at` plus the offsets of three axes; `number` the type to compute in."""
    p = _plane(table, np.int32(at + x[0]), y, z, number)
    q = _plane(table, np.int32(at + x[1]), y, z, number)
    r = _plane(table, np.int32(at + x[2]), y, z, number)
    s = _plane(table, np.int32(at + x[3]), y, z, number)
    one = _across(
        _across(p[0], p[1], p[2], p[3], y, number),
        _across(q[0], q[1], q[2], q[3], y, number),
        _across(r[0], r[1], r[2], r[3], y, number),
        _across(s[0], s[1], s[2], s[3], y, number),
        x,
        number,
    )
    other = _across(
        _across(p[0], q[0], r[0], s[0], x, number),
        _across(p[1], q[1], r[1], s[1], x, number),
        _across(p[2], q[2], r[2], s[2], x, number),
        _across(p[3], q[3], r[3], s[3], x, number),
        y,
        number,
    )
    return number(0.5) * (one + other)


def tricubic_numpy(table, x, y, z, number):
    """The twin of `tricubic`: `table` (nodes, channels), axes of arrays (n,); (n, channels), operation by operation."""
    half, three = number(0.5), number(3)
    (*x_at, u, x_first, x_last), (*y_at, v, y_first, y_last), (*z_at, w, z_first, z_last) = x, y, z

    def along(four, t, first, last):
        first, last = (np.asarray(flag)[..., None] for flag in (first, last))
        return hermite(*four, t[:, None], first, last, half, three)

    lines = [[along([table[i + j + k].astype(number) for k in z_at], w, z_first, z_last) for j in y_at] for i in x_at]
    one = along([along(row, v, y_first, y_last) for row in lines], u, x_first, x_last)
    other = along([along(column, u, x_first, x_last) for column in zip(*lines)], v, y_first, y_last)
    return half * (one + other)
