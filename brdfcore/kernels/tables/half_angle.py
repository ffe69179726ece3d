"""Look-ups in a plain lattice over the half and difference angles: nearest cell, linear, monotone cubic.

Coordinates (S. Rusinkiewicz, "A new change of variables for efficient BRDF representation", EGWR 1998, DOI
10.1007/978-3-7091-6453-2_2), with A = (theta_i + theta_o)/2, B = (theta_i - theta_o)/2 and S = cos A cos B, so that
no term cancels:

    theta_h = atan t,              t^2 = tan^2 B + s_i s_o cos^2(delta_phi/2) / S^2
    theta_d = 2 atan(sin theta_d / (1 + cos theta_d)),  sin^2 theta_d = sin^2 B + s_i s_o sin^2(delta_phi/2),
                                                        cos theta_d = S sqrt(1 + t^2)
    phi_d   = atan2(-s_i s_o sin delta_phi, 2 sin A sin B cos theta_d) modulo pi: wi about the half vector

Exchanging the directions adds pi to phi_d, so one half turn holds a reciprocal BRDF. Where theta_h or theta_d is 0
phi_d has no meaning and is 0.

The lattice: cell i of theta_h covers (pi/2)(i/n_h)^2 ... (pi/2)((i+1)/n_h)^2, cells of theta_d over [0, pi/2] and of
phi_d over [0, pi) are equal. A value belongs to a point of its cell, `shift`: 1/2, its middle, or 0, its lower edge.
The index of a direction is its coordinate in cells, less the shift; theta_h and theta_d below the first and above the
last node take that node, phi_d is periodic.

All kernels return the number of inputs outside the plain domain, as `kernels.tables.trilinear`; table float32, flat,
C order (n_h, n_d, n_p, channels), size below 2^31; out flat. Their twins in numpy: `kernels.tables.half_angle_numpy`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI
from brdfcore.kernels.base.pair_geometry import HORIZON_COS
from brdfcore.kernels.machine.jit import inline, kernel, prange
from brdfcore.kernels.machine.vectorised import atan, count_unless, load, sin, store
from brdfcore.kernels.tables.interpolation import CUBIC_BLOCK, tricubic

#: Points a block: counted in int32, long enough that the blocks cost nothing.
_BLOCK = 2_048
#: What pi lacks as float64, and pi/2.
_PI_LOW, _HALF_PI_LOW = 1.2246467991473532e-16, 6.123233995736766e-17


class HalfAngleScale(NamedTuple):
    """Constants of a look-up in the dtype of the angles."""

    zero: Any
    half: Any
    one: Any
    two: Any
    half_pi: Any
    half_pi_low: Any
    pi: Any
    pi_low: Any
    turn: Any
    theta_max: Any
    delta_phi_max: Any
    horizon_cos: Any
    n_h: Any
    per_d: Any
    per_p: Any
    n_p: Any
    last_h: Any
    last_d: Any
    shift: Any


def half_angle_scale(shape: tuple[int, int, int], shift: float, dtype: npt.DTypeLike) -> HalfAngleScale:
    """The constants for `shape` = (n_h, n_d, n_p) cells and the place of a node in its cell."""
    number: Any = np.dtype(dtype).type
    double = number is np.float64
    half_pi, pi = number(HALF_PI), number(np.pi)
    n_h, n_d, n_p = shape
    values: tuple[Any, ...] = (
        0, 0.5, 1, 2,
        half_pi, HALF_PI - float(half_pi) + (_HALF_PI_LOW if double else 0),
        pi, np.pi - float(pi) + (_PI_LOW if double else 0), 2 * np.pi,
        HALF_PI, DELTA_PHI_DIRECT, HORIZON_COS,
        n_h, n_d / HALF_PI, n_p / np.pi, n_p, n_h - 1, n_d - 1, shift,
    )  # fmt: skip
    return HalfAngleScale(*(number(v) for v in values))


@inline
def _indices(theta_i, theta_o, delta_phi, s):
    """inside and the three fractional indices: theta_h and theta_d within [0, n - 1], phi_d within [0, n)."""
    zero = s.zero
    half = s.half
    one = s.one
    # a comparison with NaN is false, so NaN counts as outside
    inside = (theta_i >= zero) & (theta_i <= s.theta_max) & (theta_o >= zero) & (theta_o <= s.theta_max)
    inside = inside & (abs(delta_phi) <= s.delta_phi_max)
    a = theta_i if inside else zero
    b = theta_o if inside else zero
    c = delta_phi if inside else zero
    turned = abs(c)
    over = turned > s.pi
    turned = abs(s.turn - turned) if over else turned
    # angles from the horizon keep the cosines' relative accuracy there; they end at the float64 horizon
    from_i = (s.half_pi - a) + s.half_pi_low
    from_o = (s.half_pi - b) + s.half_pi_low
    from_i = from_i if from_i > s.horizon_cos else s.horizon_cos
    from_o = from_o if from_o > s.horizon_cos else s.horizon_cos
    product = sin(a) * sin(b)
    sin_b = sin(half * (a - b))
    cos_b = np.sqrt(one - sin_b * sin_b)
    middle = half * (a + b)
    sin_a = sin(middle if middle < s.half_pi else s.half_pi)
    total = sin(half * (from_i + from_o)) * cos_b
    sin_half = sin(half * turned)
    cos_half = sin(half * ((s.pi - turned) + s.pi_low))
    tan_b = sin_b / cos_b
    ratio = cos_half / total
    t2 = tan_b * tan_b + product * (ratio * ratio)
    t = np.sqrt(t2)
    sin2_d = sin_b * sin_b + product * (sin_half * sin_half)
    sin2_d = sin2_d if sin2_d < one else one
    cos_d = total * np.sqrt(one + t2)
    cos_d = cos_d if cos_d < one else one

    steep = t > one
    angle = atan(one / t if steep else t)
    theta_h = s.half_pi - angle if steep else angle
    h = s.n_h * np.sqrt(theta_h / s.half_pi) - s.shift
    d = s.two * atan(np.sqrt(sin2_d) / (one + cos_d)) * s.per_d - s.shift
    # both carry the factor 2 sin theta_h sin theta_d
    up = s.two * product * (sin_half * cos_half)
    past = up < zero  # float32's pi is past pi
    up = abs(up)
    along = s.two * sin_a * sin_b * cos_d
    size = abs(along)
    high = up > size
    small = size if high else up
    large = up if high else size
    angle = atan(small / large if large > zero else zero)
    angle = s.half_pi - angle if high else angle
    angle = s.pi - angle if along < zero else angle
    # sin(delta_phi) < 0; past half a turn its sign turns, past a whole one again
    backward = (((c < zero) ^ over) ^ (abs(c) > s.turn)) ^ past
    angle = angle if backward else s.pi - angle
    p = angle * s.per_p - s.shift

    h = h if h > zero else zero
    h = h if h < s.last_h else s.last_h
    d = d if d > zero else zero
    d = d if d < s.last_d else s.last_d
    p = p + s.n_p if p < zero else p
    p = p - s.n_p if p >= s.n_p else p  # -1e-20 + n is n
    return inside, h, d, p


@inline
def _cell(position, last, one):
    """Cell of a position within [0, last], the last one closed."""
    cell = np.floor(position)
    return cell if cell < last - one else last - one


@inline
def _nearest(theta_i, theta_o, delta_phi, s, step_h, step_d):
    """inside, offset of the node whose cell the directions are in."""
    inside, h, d, p = _indices(theta_i, theta_o, delta_phi, s)
    # with the node in the middle of its cell this is the cell of the coordinate: floor(index + 1/2)
    i = np.floor(h + s.half)
    j = np.floor(d + s.half)
    l = np.floor(p + s.half)  # noqa: E741
    l = l if l < s.n_p else s.zero  # noqa: E741
    return inside, np.int32(np.int32(np.int32(i) * step_h) + np.int32(np.int32(j) * step_d) + np.int32(l))


@kernel
def nearest_one(theta_i, theta_o, delta_phi, table, out, s, step_h, step_d):
    """One channel; out (n,)."""
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, node = _nearest(load(theta_i, k), load(theta_o, k), load(delta_phi, k), s, step_h, step_d)
            bad = count_unless(bad, inside)
            store(out, k, load(table, node))
        outside += bad
    return outside


@kernel
def nearest_three(theta_i, theta_o, delta_phi, table, out, s, step_h, step_d):
    """Three channels side by side; out (3 n,)."""
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, node = _nearest(load(theta_i, k), load(theta_o, k), load(delta_phi, k), s, step_h, step_d)
            bad = count_unless(bad, inside)
            store(out, 3 * k, load(table, np.int32(3 * node)))
            store(out, 3 * k + 1, load(table, np.int32(3 * node + 1)))
            store(out, 3 * k + 2, load(table, np.int32(3 * node + 2)))
        outside += bad
    return outside


@kernel
def nearest_many(theta_i, theta_o, delta_phi, table, out, s, step_h, step_d):
    """Any number of channels side by side; out (n channels,)."""
    channels = out.size // max(theta_i.size, 1)
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, node = _nearest(load(theta_i, k), load(theta_o, k), load(delta_phi, k), s, step_h, step_d)
        outside += np.int64(0) if inside else np.int64(1)
        for c in range(channels):
            store(out, k * channels + c, load(table, node * channels + c))
    return outside


@inline
def _corners(theta_i, theta_o, delta_phi, s, step_h, step_d):
    """inside, offset of the first node of the cell, distance to the next along phi_d, and the position in the cell."""
    inside, h, d, p = _indices(theta_i, theta_o, delta_phi, s)
    i = _cell(h, s.last_h, s.one)
    j = _cell(d, s.last_d, s.one)
    l = np.floor(p)  # noqa: E741
    node = np.int32(np.int32(np.int32(i) * step_h) + np.int32(np.int32(j) * step_d) + np.int32(l))
    beside = np.int32(1) if l + s.one < s.n_p else np.int32(-np.int32(l))
    return inside, node, beside, h - i, d - j, p - l


@inline
def _linear(table, at, row_h, row_d, beside, u, v, w):
    """One channel; `at` and the steps in values."""
    zero = w - w
    low_0 = _between(zero + load(table, at), zero + load(table, np.int32(at + beside)), w)
    at_1 = np.int32(at + row_d)
    low_1 = _between(zero + load(table, at_1), zero + load(table, np.int32(at_1 + beside)), w)
    at_2 = np.int32(at + row_h)
    high_0 = _between(zero + load(table, at_2), zero + load(table, np.int32(at_2 + beside)), w)
    at_3 = np.int32(at_2 + row_d)
    high_1 = _between(zero + load(table, at_3), zero + load(table, np.int32(at_3 + beside)), w)
    return _between(_between(low_0, low_1, v), _between(high_0, high_1, v), u)


@inline
def _between(a, b, t):
    return a + t * (b - a)


@kernel
def linear_one(theta_i, theta_o, delta_phi, table, out, s, step_h, step_d):
    """One channel; out (n,)."""
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, at, beside, u, v, w = _corners(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k), s, step_h, step_d
            )
            bad = count_unless(bad, inside)
            store(out, k, _linear(table, at, step_h, step_d, beside, u, v, w))
        outside += bad
    return outside


@kernel
def linear_three(theta_i, theta_o, delta_phi, table, out, s, step_h, step_d):
    """Three channels side by side; out (3 n,)."""
    outside = np.int64(0)
    row_h = np.int32(3 * step_h)
    row_d = np.int32(3 * step_d)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, at, beside, u, v, w = _corners(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k), s, step_h, step_d
            )
            bad = count_unless(bad, inside)
            at = np.int32(3 * at)
            beside = np.int32(3 * beside)
            store(out, 3 * k, _linear(table, at, row_h, row_d, beside, u, v, w))
            store(out, 3 * k + 1, _linear(table, np.int32(at + 1), row_h, row_d, beside, u, v, w))
            store(out, 3 * k + 2, _linear(table, np.int32(at + 2), row_h, row_d, beside, u, v, w))
        outside += bad
    return outside


@kernel
def linear_many(theta_i, theta_o, delta_phi, table, out, s, step_h, step_d):
    """Any number of channels side by side; out (n channels,)."""
    channels = np.int32(out.size // max(theta_i.size, 1))
    outside = np.int64(0)
    for k in prange(theta_i.size):
        inside, at, beside, u, v, w = _corners(
            load(theta_i, k), load(theta_o, k), load(delta_phi, k), s, step_h, step_d
        )
        outside += np.int64(0) if inside else np.int64(1)
        at = np.int32(at * channels)
        beside = np.int32(beside * channels)
        for c in range(channels):
            value = _linear(
                table, np.int32(at + c), np.int32(step_h * channels), np.int32(step_d * channels), beside, u, v, w
            )
            store(out, k * channels + c, value)
    return outside


@inline
def _axes(theta_i, theta_o, delta_phi, s, step_h, step_d, channels):
    """inside and the three axes of `interpolation.tricubic`, offsets in values.

    At theta_h = 0 and theta_d = 0 a reciprocal BRDF is even, at the upper ends the lattice ends; phi_d is periodic.
    """
    inside, h, d, p = _indices(theta_i, theta_o, delta_phi, s)
    i = _cell(h, s.last_h, s.one)
    j = _cell(d, s.last_d, s.one)
    l = np.floor(p)  # noqa: E741
    x = _even(np.int32(i), h - i, np.int32(s.last_h), np.int32(step_h * channels))
    y = _even(np.int32(j), d - j, np.int32(s.last_d), np.int32(step_d * channels))
    z = _periodic(np.int32(l), p - l, np.int32(s.n_p), np.int32(channels))
    return inside, x, y, z


@inline
def _even(k, t, last, step):
    zero, one = np.int32(0), np.int32(1)
    before = np.int32(k - one) if k > zero else zero
    after = np.int32(k + np.int32(2)) if k + one < last else last
    return (
        np.int32(before * step), np.int32(k * step), np.int32(np.int32(k + one) * step), np.int32(after * step),
        t, False, k + one == last,
    )  # fmt: skip


@inline
def _periodic(k, t, n, step):
    one = np.int32(1)
    before = np.int32(k - one) if k > np.int32(0) else np.int32(n - one)
    after = np.int32(k + one) if k + one < n else np.int32(k + one - n)
    beyond = np.int32(after + one) if after + one < n else np.int32(after + one - n)
    return (
        np.int32(before * step), np.int32(k * step), np.int32(after * step), np.int32(beyond * step),
        t, False, False,
    )  # fmt: skip


@kernel
def cubic(theta_i, theta_o, delta_phi, table, out, s, step_h, step_d):
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
                    load(theta_i, k), load(theta_o, k), load(delta_phi, k), s, step_h, step_d, channels
                )
                bad = count_unless(bad, inside)
                store(out, k * channels + c, tricubic(table, np.int32(c), x, y, z, number))
        outside += bad
    return outside
