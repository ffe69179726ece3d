"""Look-ups in half/difference coordinates: guides along theta_h and theta_d, three warped axes, half-precision nodes.

Coordinates u, w, z of a pair of directions: `kernels.tables.half_coordinates`. Each axis has a map from its coordinate
to the node position, tabulated as 16-bit numbers and linear between: any spacing of the nodes costs one load of two
neighbours. The maps of u and w are uniform in the bits of the float32 coordinate:
32 steps to the octave of u from 2^-28 to 2^12, so that a lobe of any width has its own steps; 16 to the octave of w
from 2^-20. Beside each lies a guide, in logarithms.

    f_r = 2^(guide_h(u) + guide_d(w)) K values(u, w, z)

All kernels return the number of inputs outside the plain domain, as `kernels.tables.trilinear`; out is flat.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI, FloatArray
from brdfcore.kernels.machine.jit import inline, kernel, prange
from brdfcore.kernels.machine.vectorised import (
    count_unless,
    float_bits,
    fma,
    load,
    load_halves,
    load_words,
    power_of_two,
    stepped,
    store,
)
from brdfcore.kernels.tables.half_coordinates import (
    HORIZON_COS,
    HalfScale,
    coordinates_numpy,
    from_angles,
    from_vectors,
    half_scale,
)

#: u below 2^FIRST_U and above 2^LAST_U is one point each of the guide; steps an octave. The same for w, to 1.
FIRST_U, LAST_U, STEPS_U = -28, 12, 32
FIRST_W, LAST_W, STEPS_W = -20, 0, 16
#: A map's numbers are 16-bit: parts of WORDS of the way to the last node, which is so never reached and needs no care.
WORDS = 65_536
#: For the same reason z ends this much below its last step; seven times the rounding of float32 there.
SHORT = 1 - 2.0**-21
#: What `load_halves` leaves to be multiplied.
_HALF_SCALE = 2.0**112
#: Points a block: counted in int32, long enough that the blocks cost nothing.
_BLOCK = 2_048

_U_FIRST, _U_LAST, _U_SHIFT = (127 + FIRST_U) << 23, (LAST_U - FIRST_U) << 23, 23 - 5
_W_FIRST, _W_LAST, _W_SHIFT = (127 + FIRST_W) << 23, (LAST_W - FIRST_W) << 23, 23 - 4


def table_scale(
    shape: tuple[int, int, int],
    steps_z: int,
    guide: tuple[float, float],
    factor: tuple[float, ...],
    mirror: bool,
    value: float,
    bilateral: bool,
    dtype: npt.DTypeLike,
) -> HalfScale:
    """Constants for nodes `shape`; `steps_z` of the map of z a unit; the `guide`'s lowest exponent and step; the
    coefficients k0 .. k5 of K; `mirror`, the kind of u; `value`, a factor of all nodes."""
    table = (
        *guide, *((n - 1) / WORDS for n in shape), steps_z * SHORT, 0 if bilateral else 2,
        value * _HALF_SCALE, 2.0**-_U_SHIFT, 2.0**-_W_SHIFT,
    )  # fmt: skip
    return half_scale(factor, mirror, table, dtype)


@inline
def _step(x, first, last, shift):
    """Step of a map that is uniform in the bits of x, and the bits beyond it."""
    bits = np.int32(float_bits(np.float32(x)) - np.int32(first))
    bits = bits if bits > np.int32(0) else np.int32(0)
    bits = bits if bits < np.int32(last - 1) else np.int32(last - 1)
    return np.int32(bits >> np.int32(shift)), np.float32(np.int32(bits & np.int32((1 << shift) - 1)))


@inline
def _mapped(table, step, part):
    low, high = load_words(table, step, part)
    return fma(part, high - low, low)


@inline
def _cell(position):
    """Last node not above `position`, which is never the last of all, and how far beyond it."""
    node = np.floor(position)
    return np.int32(node), position - node


@inline
def _place(u, w, z, k, guide_h, guide_d, map_h, map_d, map_p, scale, n_d, n_p):
    """First node's number, positions in the cell, and 2^guide K.

    `scale.value` is applied to the value first: its 2^112 times K at the horizon would overflow float32.
    """
    step, bits = _step(u, _U_FIRST, _U_LAST, _U_SHIFT)
    part = bits * scale.part_u
    exponent = fma(_mapped(guide_h, step, part), scale.guide_step, scale.guide_low)
    i, at_h = _cell(_mapped(map_h, step, part) * scale.step_h)
    step, bits = _step(w, _W_FIRST, _W_LAST, _W_SHIFT)
    part = bits * scale.part_w
    exponent = fma(_mapped(guide_d, step, part), scale.guide_step, exponent)
    j, at_d = _cell(_mapped(map_d, step, part) * scale.step_d)
    first, beyond = _cell((z + scale.shift_z) * scale.steps_z)
    l, at_p = _cell(_mapped(map_p, first, beyond) * scale.step_p)  # noqa: E741
    node = stepped(np.int32(stepped(np.int32(i * n_d), j) * n_p), l)
    return node, at_h, at_d, at_p, _exp2(exponent, scale) * k


@inline
def _exp2(x, scale):
    """2^x, |x| < 126, to 1.5e-7 of it: a Chebyshev fit (40 digits) of 2^f, |f| <= 1/2."""
    whole = np.floor(x + scale.half)
    f = np.float32(x - whole)
    p = fma(np.float32(0.0013390863364671234), f, np.float32(0.009676031918322054))
    p = fma(p, f, np.float32(0.05550357114219078))
    p = fma(p, f, np.float32(0.2402210748530834))
    p = fma(p, f, np.float32(0.6931471880262288))
    p = fma(p, f, np.float32(1.0))
    return scale.one * (p * power_of_two(np.int32(whole)))


@inline
def _mix(low_0, low_1, high_0, high_1, u, v):
    low = fma(v, low_1 - low_0, low_0)
    high = fma(v, high_1 - high_0, high_0)
    return fma(u, high - low, low)


@inline
def _pair(values, p, w):
    low, high = load_halves(values, p, w)
    return fma(w, high - low, low)


@inline
def _one(values, node, u, v, w, n_d, n_p):
    above = stepped(node, np.int32(n_d * n_p))
    low = _pair(values, node, w), _pair(values, stepped(node, n_p), w)
    high = _pair(values, above, w), _pair(values, stepped(above, n_p), w)
    return _mix(low[0], low[1], high[0], high[1], u, v)


@inline
def _row(values, p, w):
    r0, g0 = load_halves(values, p, w)
    b0, r1 = load_halves(values, stepped(p, np.int32(2)), w)
    g1, b1 = load_halves(values, stepped(p, np.int32(4)), w)
    return fma(w, r1 - r0, r0), fma(w, g1 - g0, g0), fma(w, b1 - b0, b0)


@inline
def _three(values, node, u, v, w, n_d, n_p):
    p = np.int32(node * np.int32(3))
    row = np.int32(n_p * np.int32(3))
    above = stepped(p, np.int32(n_d * row))
    r0, g0, b0 = _row(values, p, w)
    r1, g1, b1 = _row(values, stepped(p, row), w)
    r2, g2, b2 = _row(values, above, w)
    r3, g3, b3 = _row(values, stepped(above, row), w)
    return _mix(r0, r1, r2, r3, u, v), _mix(g0, g1, g2, g3, u, v), _mix(b0, b1, b2, b3, u, v)


@inline
def _along(values, p, channels, w):
    low, _ = load_halves(values, np.int32(p), w)
    high, _ = load_halves(values, np.int32(p + channels), w)
    return fma(w, high - low, low)


@inline
def _any(values, node, s, channels, u, v, w, n_d, n_p):
    p = node * channels + s
    row_d = n_p * channels
    row_h = n_d * row_d
    low = _along(values, p, channels, w), _along(values, p + row_d, channels, w)
    high = _along(values, p + row_h, channels, w), _along(values, p + row_h + row_d, channels, w)
    return _mix(low[0], low[1], high[0], high[1], u, v)


@kernel
def angles_one(
    theta_i, theta_o, delta_phi, values, guide_h, guide_d, map_h, map_d, map_p, out, scale, bilateral, fold, n_d, n_p
):
    """One channel; out (n,)."""
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, x, y, z, factor = from_angles(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, bilateral, fold
            )
            bad = count_unless(bad, inside)
            node, u, v, w, strength = _place(x, y, z, factor, guide_h, guide_d, map_h, map_d, map_p, scale, n_d, n_p)
            store(out, k, _one(values, node, u, v, w, n_d, n_p) * scale.value * strength)
        outside += bad
    return outside


@kernel
def angles_three(
    theta_i, theta_o, delta_phi, values, guide_h, guide_d, map_h, map_d, map_p, out, scale, bilateral, fold, n_d, n_p
):
    """Three channels side by side; out (3 n,)."""
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, x, y, z, factor = from_angles(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, bilateral, fold
            )
            bad = count_unless(bad, inside)
            node, u, v, w, strength = _place(x, y, z, factor, guide_h, guide_d, map_h, map_d, map_p, scale, n_d, n_p)
            r, g, b = _three(values, node, u, v, w, n_d, n_p)
            store(out, 3 * k, r * scale.value * strength)
            store(out, 3 * k + 1, g * scale.value * strength)
            store(out, 3 * k + 2, b * scale.value * strength)
        outside += bad
    return outside


@kernel
def angles_many(
    theta_i, theta_o, delta_phi, values, guide_h, guide_d, map_h, map_d, map_p, out, scale, bilateral, fold, n_d, n_p
):
    """Any number of channels side by side; out (n channels,)."""
    channels = out.size // max(theta_i.size, 1)
    outside = np.int64(0)
    for block in prange((theta_i.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(theta_i.size, block * _BLOCK + _BLOCK)):
            inside, x, y, z, factor = from_angles(
                load(theta_i, k), load(theta_o, k), load(delta_phi, k), scale, bilateral, fold
            )
            bad = count_unless(bad, inside)
            node, u, v, w, strength = _place(x, y, z, factor, guide_h, guide_d, map_h, map_d, map_p, scale, n_d, n_p)
            for s in range(channels):
                found = _any(values, node, s, channels, u, v, w, n_d, n_p)
                store(out, k * channels + s, found * scale.value * strength)
        outside += bad
    return outside


@kernel
def vectors_one(wi, wo, values, guide_h, guide_d, map_h, map_d, map_p, out, scale, bilateral, fold, n_d, n_p):
    """From vectors, wi and wo flat (3 n,); one channel; 0 below the horizon; counts the unusable."""
    outside = np.int64(0)
    for block in prange((out.size + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(out.size, block * _BLOCK + _BLOCK)):
            usable, above, x, y, z, factor = from_vectors(
                load(wi, 3 * k), load(wi, 3 * k + 1), load(wi, 3 * k + 2),
                load(wo, 3 * k), load(wo, 3 * k + 1), load(wo, 3 * k + 2), scale, bilateral, fold,
            )  # fmt: skip
            bad = count_unless(bad, usable)
            node, u, v, w, strength = _place(x, y, z, factor, guide_h, guide_d, map_h, map_d, map_p, scale, n_d, n_p)
            strength = strength if above else scale.zero
            store(out, k, _one(values, node, u, v, w, n_d, n_p) * scale.value * strength)
        outside += bad
    return outside


@kernel
def vectors_three(wi, wo, values, guide_h, guide_d, map_h, map_d, map_p, out, scale, bilateral, fold, n_d, n_p):
    """As `vectors_one`, three channels side by side; out (3 n,)."""
    outside = np.int64(0)
    n = wi.size // 3
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(n, block * _BLOCK + _BLOCK)):
            usable, above, x, y, z, factor = from_vectors(
                load(wi, 3 * k), load(wi, 3 * k + 1), load(wi, 3 * k + 2),
                load(wo, 3 * k), load(wo, 3 * k + 1), load(wo, 3 * k + 2), scale, bilateral, fold,
            )  # fmt: skip
            bad = count_unless(bad, usable)
            node, u, v, w, strength = _place(x, y, z, factor, guide_h, guide_d, map_h, map_d, map_p, scale, n_d, n_p)
            strength = strength if above else scale.zero
            r, g, b = _three(values, node, u, v, w, n_d, n_p)
            store(out, 3 * k, r * scale.value * strength)
            store(out, 3 * k + 1, g * scale.value * strength)
            store(out, 3 * k + 2, b * scale.value * strength)
        outside += bad
    return outside


@kernel
def vectors_many(wi, wo, values, guide_h, guide_d, map_h, map_d, map_p, out, scale, bilateral, fold, n_d, n_p):
    """As `vectors_one`, any number of channels side by side; out (n channels,)."""
    n = wi.size // 3
    channels = out.size // max(n, 1)
    outside = np.int64(0)
    for block in prange((n + _BLOCK - 1) // _BLOCK):
        bad = np.int32(0)
        for k in range(block * _BLOCK, min(n, block * _BLOCK + _BLOCK)):
            usable, above, x, y, z, factor = from_vectors(
                load(wi, 3 * k), load(wi, 3 * k + 1), load(wi, 3 * k + 2),
                load(wo, 3 * k), load(wo, 3 * k + 1), load(wo, 3 * k + 2), scale, bilateral, fold,
            )  # fmt: skip
            bad = count_unless(bad, usable)
            node, u, v, w, strength = _place(x, y, z, factor, guide_h, guide_d, map_h, map_d, map_p, scale, n_d, n_p)
            strength = strength if above else scale.zero
            for s in range(channels):
                found = _any(values, node, s, channels, u, v, w, n_d, n_p)
                store(out, k * channels + s, found * scale.value * strength)
        outside += bad
    return outside


def half_numpy(
    theta_i: FloatArray,
    theta_o: FloatArray,
    delta_phi: FloatArray,
    values: npt.NDArray[np.int16],
    guide_h: npt.NDArray[np.uint16],
    guide_d: npt.NDArray[np.uint16],
    map_h: npt.NDArray[np.uint16],
    map_d: npt.NDArray[np.uint16],
    map_p: npt.NDArray[np.uint16],
    out: FloatArray,
    scale: HalfScale,
    bilateral: bool,
    fold: bool,
    n_d: int,
    n_p: int,
) -> int:
    """The twin of the kernels: the same tables, every step in float64 by library functions."""
    with np.errstate(invalid="ignore"):
        inside = (theta_i >= 0) & (theta_i <= scale.theta_max) & (theta_o >= 0) & (theta_o <= scale.theta_max)
        inside &= np.abs(delta_phi) <= DELTA_PHI_DIRECT
    a, b, c = (np.where(inside, angle, 0).astype(np.float64) for angle in (theta_i, theta_o, delta_phi))
    u, w, z = coordinates_numpy(a, b, c, bilateral, fold, int(scale.mirror))
    n_h = values.size * a.size // (out.size * n_d * n_p)
    words = np.interp(u, grid_u(), guide_h.astype(np.float64)) + np.interp(w, grid_w(), guide_d.astype(np.float64))
    exponent = words * float(scale.guide_step) + float(scale.guide_low)
    steps = (z + float(scale.shift_z)) * float(scale.steps_z)
    places = [
        np.interp(x, grid, words.astype(np.float64)) * (n - 1) / WORDS
        for x, grid, words, n in (
            (u, grid_u(), map_h, n_h),
            (w, grid_w(), map_d, n_d),
            (steps, np.arange(map_p.size), map_p, n_p),
        )
    ]
    cos_i, cos_o = (np.maximum(np.sin(HALF_PI - np.minimum(t, HALF_PI)), HORIZON_COS) for t in (a, b))
    k0, k1, k2, k3, k4, k5 = (float(k) for k in scale[16:22])
    k = (k0 * cos_i + k1 * cos_o + k2) / (k3 * cos_i * cos_o + k4 * (cos_i + cos_o) + k5)
    nodes = values.view(np.float16).astype(np.float64).reshape(n_h, n_d, n_p, -1)
    cells = [np.minimum(np.floor(p), n - 2).astype(np.int64) for p, n in zip(places, (n_h, n_d, n_p))]
    parts = [p - i for p, i in zip(places, cells)]
    found = np.zeros((a.size, nodes.shape[-1]))
    for q in range(8):
        up = (q >> 2, q >> 1 & 1, q & 1)
        weight = np.prod([p if step else 1 - p for p, step in zip(parts, up)], axis=0)
        found += weight[:, None] * nodes[cells[0] + up[0], cells[1] + up[1], cells[2] + up[2]]
    out[...] = (found * (np.exp2(exponent) * k * (float(scale.value) / _HALF_SCALE))[:, None]).reshape(-1)
    return int(np.count_nonzero(~inside))


def _grid(first: int, last: int, steps: int) -> npt.NDArray[np.float64]:
    octave, step = np.divmod(np.arange((last - first) * steps + 1), steps)
    return np.asarray(2.0 ** (octave + first) * (1 + step / steps), np.float64)


def grid_u() -> npt.NDArray[np.float64]:
    """u of the nodes of guide and map: the first stands for all below, the last for all above."""
    return _grid(FIRST_U, LAST_U, STEPS_U)


def grid_w() -> npt.NDArray[np.float64]:
    """w of the nodes of its map, up to 1."""
    return _grid(FIRST_W, LAST_W, STEPS_W)
