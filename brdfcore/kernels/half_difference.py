"""Look-ups in half/difference coordinates: one guide along theta_h, three warped axes, half-precision nodes.

Coordinates of a pair of directions, all found without an inverse trigonometric function (A = (theta_i + theta_o)/2,
B = (theta_i - theta_o)/2, e = delta_phi - pi, S = cos A cos B):

    t^2 = tan^2 theta_h = tan^2 B + s_i s_o cos^2(delta_phi/2) / S^2          x = t/(1 + t)           in [0, 1]
    sin^2 theta_d = sin^2 B + s_i s_o sin^2(delta_phi/2), cos theta_d = S sqrt(1 + t^2)
                                                                             y = tan(theta_d/2)      in [0, 1]
    tan phi_d = s_i s_o |sin delta_phi| / (cos theta_d 2 sin A sin B)        z = its diamond angle   in [0, 2]

The diamond angle |sin|/(|sin| + |cos|), continued by 2 - z past 90 degrees, replaces phi_d: monotone, no arctangent.
z is folded to [0, 1] for a reciprocal table (swapping the directions turns phi_d into pi - phi_d) and carries the
sign of sin(delta_phi), in [-2, 2], for one that is not bilateral.

Each axis has a map from its coordinate to the node number, tabulated and linear between: any spacing of the nodes
costs one look-up. The map of x, and the guide beside it, lie on a grid that is uniform in the bits of the float32 x:
64 steps to the octave, from 2^-14, so that a lobe of any width has its own steps.

    f_r = guide(x) K values(x, y, z),  K = (k0 c_i + k1 c_o + k2) / (k3 c_i c_o + k4 (c_i + c_o) + k5)

All kernels return the number of inputs outside the plain domain, as `kernels.trilinear`; out is flat.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.conventions import DELTA_PHI_DIRECT, HALF_PI, FloatArray
from brdfcore.kernels.jit import inline, kernel, prange
from brdfcore.kernels.vectorised import count_unless, float_bits, load, load_halves, sin, store

#: cos of the float64 nearest pi/2: the horizon, where cosines end.
HORIZON_COS = 6.123233995736766e-17
#: x below 2^-OCTAVES is one point of the guide; steps of the guide an octave.
OCTAVES, STEPS = 14, 64
GUIDE_NODES = OCTAVES * STEPS + 1
_FIRST_BITS = (127 - OCTAVES) << 23
_STEP_BITS = 23 - 6
_LAST_BITS = GUIDE_NODES - 1 << _STEP_BITS
#: What `load_halves` leaves to be multiplied.
_HALF_SCALE = 2.0**112


#: Points a block: counted in int32, long enough that the blocks cost nothing.
_BLOCK = 2_048


class HalfScale(NamedTuple):
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
    steps_y: Any
    steps_z: Any
    last_z: Any
    shift_z: Any
    last_h: Any
    last_d: Any
    last_p: Any
    k0: Any
    k1: Any
    k2: Any
    k3: Any
    k4: Any
    k5: Any
    value: Any
    fraction: Any


def half_scale(
    shape: tuple[int, int, int],
    steps: tuple[int, int, int],
    factor: tuple[float, ...],
    value: float,
    bilateral: bool,
    dtype: npt.DTypeLike,
) -> HalfScale:
    """Constants for nodes `shape`; `steps` of the map of y, of a unit of z and of the whole map of z; the coefficients
    k0 .. k5 of K; `value`, a factor of all nodes."""
    number: Any = np.dtype(dtype).type
    hi_half, hi = number(HALF_PI), number(np.pi)
    last_h, last_d, last_p = (n - 1 for n in shape)
    values: tuple[Any, ...] = (
        0, 0.5, 1, 2, hi_half, HALF_PI - float(hi_half) + (6.123233995736766e-17 if number is np.float64 else 0),
        hi, np.pi - float(hi) + (1.2246467991473532e-16 if number is np.float64 else 0), 2 * np.pi,
        HALF_PI, DELTA_PHI_DIRECT, HORIZON_COS, *steps, 0 if bilateral else 2, last_h, last_d, last_p,
        *factor, value * _HALF_SCALE, 2.0**-_STEP_BITS,
    )  # fmt: skip
    return HalfScale(*(number(v) for v in values))


@inline
def _coordinates(theta_i, theta_o, delta_phi, scale, bilateral, reciprocal):
    """inside, x, y, z and the factor K of one pair of directions."""
    zero = scale.zero
    half = scale.half
    one = scale.one
    # a comparison with NaN is false, so NaN counts as outside
    inside = (theta_i >= zero) & (theta_i <= scale.theta_max) & (theta_o >= zero) & (theta_o <= scale.theta_max)
    inside = inside & (abs(delta_phi) <= scale.delta_phi_max)
    a = theta_i if inside else zero
    b = theta_o if inside else zero
    c = delta_phi if inside else zero
    turned = abs(c)
    over = turned > scale.pi
    turned = abs(scale.turn - turned) if over else turned
    # angles from the horizon keep the cosines' relative accuracy there; they end at the float64 horizon
    from_i = (scale.half_pi - a) + scale.half_pi_low
    from_o = (scale.half_pi - b) + scale.half_pi_low
    from_i = from_i if from_i > scale.horizon_cos else scale.horizon_cos
    from_o = from_o if from_o > scale.horizon_cos else scale.horizon_cos
    cos_i = sin(from_i)
    cos_o = sin(from_o)
    product = sin(a) * sin(b)
    sin_b = sin(half * (a - b))
    cos_b = np.sqrt(one - sin_b * sin_b)
    sin_a = sin(half * (a + b) if half * (a + b) < scale.half_pi else scale.half_pi)
    s = sin(half * (from_i + from_o)) * cos_b
    sin_half = sin(half * turned)
    cos_half = sin(half * ((scale.pi - turned) + scale.pi_low))
    tan_b = sin_b / cos_b
    ratio = cos_half / s
    t2 = tan_b * tan_b + product * (ratio * ratio)
    t = np.sqrt(t2)
    x = t / (one + t)
    sin2_d = sin_b * sin_b + product * (sin_half * sin_half)
    sin2_d = sin2_d if sin2_d < one else one
    cos_d = s * np.sqrt(one + t2)
    cos_d = cos_d if cos_d < one else one
    y = np.sqrt(sin2_d) / (one + cos_d)
    # phi_d: both numbers carry the factor 2 sin theta_h sin theta_d; where that is 0 phi_d has no meaning and is 90
    up = scale.two * product * (sin_half * cos_half)
    up = up if up > zero else zero
    along = scale.two * sin_a * sin_b * cos_d
    both = abs(along) + up
    z = up / both if both > zero else one
    # folds as selections, not branches: a loop with branches in it is compiled twice or not as vectors at all
    z = scale.two - z if (along < zero) & (not reciprocal) else z
    # sin(delta_phi) < 0; past half a turn its sign turns, past a whole one again
    backward = ((c < zero) ^ over) ^ (abs(c) > scale.turn)
    z = -z if backward & (not bilateral) else z
    k = (scale.k0 * cos_i + scale.k1 * cos_o + scale.k2) / (
        scale.k3 * (cos_i * cos_o) + scale.k4 * (cos_i + cos_o) + scale.k5
    )
    return inside, x, y, z, k


@inline
def _place(theta_i, theta_o, delta_phi, guide, map_y, map_z, scale, bilateral, reciprocal, shape_d, shape_p):
    """inside, first node's number, positions in the cell, and guide K.

    `scale.value` is applied to the value first: its 2^112 times K at the horizon would overflow float32.
    """
    inside, x, y, z, k = _coordinates(theta_i, theta_o, delta_phi, scale, bilateral, reciprocal)
    bits = np.int32(float_bits(np.float32(x)) - np.int32(_FIRST_BITS))
    bits = bits if bits > np.int32(0) else np.int32(0)
    bits = bits if bits < np.int32(_LAST_BITS - 1) else np.int32(_LAST_BITS - 1)
    step = np.int32(bits >> np.int32(_STEP_BITS))
    part = np.float32(np.int32(bits & np.int32((1 << _STEP_BITS) - 1))) * scale.fraction
    first = np.int32(step * 2)
    g0 = load(guide, first)
    h0 = load(guide, np.int32(first + 1))
    g1 = load(guide, np.int32(first + 2))
    h1 = load(guide, np.int32(first + 3))
    strength = g0 + part * (g1 - g0)
    h = h0 + part * (h1 - h0)
    d = _mapped(map_y, y * scale.steps_y, scale.steps_y, scale)
    p = _mapped(map_z, (z + scale.shift_z) * scale.steps_z, scale.last_z, scale)
    i = np.floor(h)
    i = i if i < scale.last_h - scale.one else scale.last_h - scale.one
    j = np.floor(d)
    j = j if j < scale.last_d - scale.one else scale.last_d - scale.one
    l = np.floor(p)  # noqa: E741
    l = l if l < scale.last_p - scale.one else scale.last_p - scale.one  # noqa: E741
    node = np.int32(np.int32(np.int32(np.int32(i) * shape_d) + np.int32(j)) * shape_p) + np.int32(l)
    return inside, node, h - i, d - j, p - l, strength * k


@inline
def _mapped(table, position, steps, scale):
    """The map of an axis at `position` of `steps`."""
    position = position if position < steps else steps
    cell = np.floor(position)
    cell = cell if cell < steps - scale.one else steps - scale.one
    low = load(table, np.int32(cell))
    high = load(table, np.int32(np.int32(cell) + 1))
    return low + (position - cell) * (high - low)


@inline
def _mix(low_0, low_1, high_0, high_1, u, v):
    low = low_0 + v * (low_1 - low_0)
    high = high_0 + v * (high_1 - high_0)
    return low + u * (high - low)


@kernel
def half_one(theta_i, theta_o, delta_phi, values, guide, map_y, map_z, out, scale, bilateral, reciprocal, n_d, n_p):
    """One channel; out (n,)."""
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, node, u, v, w, factor = _place(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k),
                guide, map_y, map_z, scale, bilateral, reciprocal, n_d, n_p,
            )  # fmt: skip
            bad = count_unless(bad, inside)
            a0, a1 = load_halves(values, np.int32(node), w)
            b0, b1 = load_halves(values, np.int32(node + n_p), w)
            c0, c1 = load_halves(values, np.int32(node + n_d * n_p), w)
            d0, d1 = load_halves(values, np.int32(node + n_d * n_p + n_p), w)
            value = _mix(a0 + w * (a1 - a0), b0 + w * (b1 - b0), c0 + w * (c1 - c0), d0 + w * (d1 - d0), u, v)
            store(out, k, value * scale.value * factor)
        outside += bad
    return outside


@inline
def _three(values, p, w):
    r0, g0 = load_halves(values, np.int32(p), w)
    b0, r1 = load_halves(values, np.int32(p + 2), w)
    g1, b1 = load_halves(values, np.int32(p + 4), w)
    return r0 + w * (r1 - r0), g0 + w * (g1 - g0), b0 + w * (b1 - b0)


@kernel
def half_three(theta_i, theta_o, delta_phi, values, guide, map_y, map_z, out, scale, bilateral, reciprocal, n_d, n_p):
    """Three channels side by side; out (3 n,)."""
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, node, u, v, w, factor = _place(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k),
                guide, map_y, map_z, scale, bilateral, reciprocal, n_d, n_p,
            )  # fmt: skip
            bad = count_unless(bad, inside)
            p = node * 3
            row_d = n_p * 3
            row_h = n_d * row_d
            r0, g0, b0 = _three(values, p, w)
            r1, g1, b1 = _three(values, p + row_d, w)
            r2, g2, b2 = _three(values, p + row_h, w)
            r3, g3, b3 = _three(values, p + row_h + row_d, w)
            store(out, 3 * k, _mix(r0, r1, r2, r3, u, v) * scale.value * factor)
            store(out, 3 * k + 1, _mix(g0, g1, g2, g3, u, v) * scale.value * factor)
            store(out, 3 * k + 2, _mix(b0, b1, b2, b3, u, v) * scale.value * factor)
        outside += bad
    return outside


@kernel
def half_many(theta_i, theta_o, delta_phi, values, guide, map_y, map_z, out, scale, bilateral, reciprocal, n_d, n_p):
    """Any number of channels side by side; out (n channels,)."""
    channels = out.size // max(theta_i.size, 1)
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, node, u, v, w, factor = _place(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k),
                guide, map_y, map_z, scale, bilateral, reciprocal, n_d, n_p,
            )  # fmt: skip
            bad = count_unless(bad, inside)
            row_d = n_p * channels
            row_h = n_d * row_d
            for s in range(channels):
                p = node * channels + s
                low_0 = _along(values, p, channels, w)
                low_1 = _along(values, p + row_d, channels, w)
                high_0 = _along(values, p + row_h, channels, w)
                high_1 = _along(values, p + row_h + row_d, channels, w)
                store(out, k * channels + s, _mix(low_0, low_1, high_0, high_1, u, v) * scale.value * factor)
        outside += bad
    return outside


@inline
def _along(values, p, channels, w):
    low, _ = load_halves(values, np.int32(p), w)
    high, _ = load_halves(values, np.int32(p + channels), w)
    return low + w * (high - low)


def coordinates_numpy(
    theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, bilateral: bool, reciprocal: bool
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """(x, y, z) by library functions in float64: the twin of `_coordinates`, and what tables are built with."""
    a, b = (np.minimum(np.asarray(t, np.float64), HALF_PI) for t in (theta_i, theta_o))
    c = np.asarray(delta_phi, np.float64)
    sin_half, cos_half = np.abs(np.sin(0.5 * c)), np.abs(np.cos(0.5 * c))
    sin_b, cos_b = np.sin(0.5 * (a - b)), np.cos(0.5 * (a - b))
    s = np.maximum(np.cos(0.5 * (a + b)), HORIZON_COS) * cos_b
    product = np.sin(a) * np.sin(b)
    t2 = (sin_b / cos_b) ** 2 + product * (cos_half / s) ** 2
    t = np.sqrt(t2)
    cos_d = np.minimum(s * np.sqrt(1 + t2), 1)
    y = np.sqrt(np.minimum(sin_b**2 + product * sin_half**2, 1)) / (1 + cos_d)
    up = 2 * product * sin_half * cos_half
    along = 2 * np.sin(0.5 * (a + b)) * sin_b * cos_d
    both = np.abs(along) + up
    z = np.divide(up, both, out=np.ones_like(up), where=both > 0)
    if not reciprocal:
        z = np.where(along >= 0, z, 2 - z)
    if not bilateral:
        z = np.where(np.sin(c) < 0, -z, z)
    return t / (1 + t), y, z


def half_numpy(
    theta_i: FloatArray,
    theta_o: FloatArray,
    delta_phi: FloatArray,
    values: npt.NDArray[np.int16],
    guide: npt.NDArray[np.float32],
    map_y: npt.NDArray[np.float32],
    map_z: npt.NDArray[np.float32],
    out: FloatArray,
    scale: HalfScale,
    bilateral: bool,
    reciprocal: bool,
    n_d: int,
    n_p: int,
) -> int:
    """The twin of the kernels: the same tables, every step in float64 by library functions."""
    with np.errstate(invalid="ignore"):
        inside = (theta_i >= 0) & (theta_i <= scale.theta_max) & (theta_o >= 0) & (theta_o <= scale.theta_max)
        inside &= np.abs(delta_phi) <= DELTA_PHI_DIRECT
    a, b, c = (np.where(inside, angle, 0).astype(np.float64) for angle in (theta_i, theta_o, delta_phi))
    x, y, z = coordinates_numpy(a, b, c, bilateral, reciprocal)
    grid = guide_grid()
    strength, h = (np.interp(x, grid, column.astype(np.float64)) for column in guide.reshape(-1, 2).T)
    d = np.interp(y * float(scale.steps_y), np.arange(map_y.size), map_y)
    shifted = z if bilateral else z + 2
    p = np.interp(shifted * float(scale.steps_z), np.arange(map_z.size), map_z)
    cos_i, cos_o = (np.maximum(np.sin(HALF_PI - np.minimum(t, HALF_PI)), HORIZON_COS) for t in (a, b))
    k0, k1, k2, k3, k4, k5 = (float(k) for k in scale[19:25])
    k = (k0 * cos_i + k1 * cos_o + k2) / (k3 * cos_i * cos_o + k4 * (cos_i + cos_o) + k5)
    n_h = int(scale.last_h) + 1
    nodes = values.view(np.float16).astype(np.float64).reshape(n_h, n_d, n_p, -1)
    (i, u), (j, v), (l, w) = (  # noqa: E741
        _cell(at, n) for at, n in ((h, n_h), (d, n_d), (p, n_p))
    )
    found = np.zeros((a.size, nodes.shape[-1]))
    for q in range(8):
        up_h, up_d, up_p = q >> 2, q >> 1 & 1, q & 1
        weight = (u if up_h else 1 - u) * (v if up_d else 1 - v) * (w if up_p else 1 - w)
        found += weight[:, None] * nodes[i + up_h, j + up_d, l + up_p]
    out[...] = (found * (strength * k * float(scale.value) / _HALF_SCALE)[:, None]).reshape(-1)
    return int(np.count_nonzero(~inside))


def _cell(position: FloatArray, nodes: int) -> tuple[npt.NDArray[np.int64], FloatArray]:
    cell = np.minimum(np.floor(position), nodes - 2)
    return cell.astype(np.int64), position - cell


def guide_grid() -> npt.NDArray[np.float64]:
    """x of the guide's nodes: 0 (for all below 2^-14 the first), then 64 steps an octave up to 1."""
    octave, step = np.divmod(np.arange(GUIDE_NODES), STEPS)
    return np.asarray(2.0 ** (octave - OCTAVES) * (1 + step / STEPS), np.float64)
