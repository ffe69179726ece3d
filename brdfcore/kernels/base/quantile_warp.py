"""Directions drawn through tables of quantiles, and the density of the draw.

The half vector of a draw is at azimuth phi from wi and at zeta = sin^2(theta_h/2), relative to its largest value for
that azimuth, `horizon`: every draw is above the horizon. phi is a quantile at u2, zeta one at u1 given phi. The tables
hold quantiles, linear between even places; between angles of incidence too, so that a lobe that moves or widens from
one to the next does so in between, and no node is searched for.

Arrays (flat float32, C order), K nodes of y(theta_i) = 1 - (1 - sin theta_i)^(1/4), even in y:

    azimuth  (K, M + 1)          phi, from -pi to pi, at v = 2 m/M - 1 with 2 u2 - 1 = sign(v) (1 - (1 - |v|)^2)
    polar    (K, M + 1, N + 3)   zeta, given phi of that m, from 0 to 1, at x = n/N with u1 = A x + B x^2 up to x = 1/2
                                 and 1 - u1 = (A + B) (1 - x)^2 beyond; and one node more at each end, mirrored
    mass     (N, 2)              u1 of each cell over that of the one before, and over that of the one after

Cells are small where much may change within little energy: at the tails, and at the tip of a lobe.

A cell beside a much narrower one spans decades: it begins in a lobe and ends far out of it. Within a cell zeta grows
as the 16th power of a place that is even in u1, which is nearly its exponential, from the density of the narrower
denser neighbour on; between neighbours of its own density it grows evenly (`_graded`).

Density over solid angles of wo: 1 / (dphi/du2 dzeta/du1 2 horizon 4 (wi.h)), as dwh = 2 d(sin^2(theta_h/2)) dphi and
dwo = 4 (wi.h) dwh. Kernels work in the type of the vectors; `quantile_warp_numpy.draw` is the twin of `draw`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.kernels.machine.jit import inline, kernel, merged, prange
from brdfcore.kernels.machine.vectorised import atan, load, load_pair, sin, store

#: u1 = TIP x + RISE x^2 up to x = 1/2, where it meets 1 - (TIP + RISE) (1 - x)^2 with the same slope: the first cell
#: holds a tenth of what even ones would, and its density does not fall to 0.
TIP = 0.1
RISE = 2 - 1.5 * TIP


class QuantileScale(NamedTuple):
    """Constants of a draw, in the dtype of the vectors."""

    zero: Any
    half: Any
    one: Any
    two: Any
    eight: Any
    sixteen: Any
    least: Any
    shortest: Any
    longest: Any
    tip: Any
    rise: Any
    middle: Any
    per_rise: Any
    per_last: Any
    half_pi: Any
    pi: Any
    last_k: Any
    last_m: Any
    last_n: Any


def quantile_scale(incidences: int, azimuths: int, polar: int, dtype: npt.DTypeLike) -> QuantileScale:
    """The constants for K = incidences, M = azimuths, N = polar."""
    number: Any = np.dtype(dtype).type
    return QuantileScale(
        *(
            number(x)
            for x in (
                0,
                0.5,
                1,
                2,
                8,
                16,
                1e-9,
                1e-12,
                1e12,
                TIP,
                RISE,
                0.5 * TIP + 0.25 * RISE,
                0.5 / RISE,
                0.5 / (TIP + RISE),
                np.pi / 2,
                np.pi,
                incidences - 1,
                azimuths,
                polar,
            )
        )
    )


@merged
def _frame(x, y, z, scale):
    """(above, cos, sin of theta_i, cos, sin of its azimuth); the normal itself where z <= 0."""
    length = np.sqrt(x * x + y * y + z * z)
    above = z > scale.zero
    inverse = scale.one / (length if length > scale.zero else scale.one)
    x, y, z = x * inverse, y * inverse, z * inverse
    s = np.sqrt(x * x + y * y)
    turned = above and s > scale.zero
    across = scale.one / (s if turned else scale.one)
    cos_p = x * across if turned else scale.one
    sin_p = y * across if turned else scale.zero
    return above, z if above else scale.one, s if turned else scale.zero, cos_p, sin_p


@merged
def _slice(s, scale):
    """Slice below the incidence and the weight of the next."""
    rest = scale.one - s
    place = (scale.one - np.sqrt(np.sqrt(rest if rest > scale.zero else scale.zero))) * scale.last_k
    k = np.floor(place)
    k = k if k < scale.last_k - scale.one else scale.last_k - scale.one
    k = k if k > scale.zero else scale.zero
    return np.int64(k), place - k


@merged
def _horizon(c, s, cos_phi, scale):
    """sin^2(theta_h/2) of the half vector whose mirrored direction is at the horizon: A = 2 theta_h is
    atan2(cos_i, -sin_i cos phi), and neither 1 - cos A nor 1 - cos(A/2) may cancel."""
    b = -s * cos_phi
    rho = np.sqrt(c * c + b * b)
    inverse = scale.one / rho
    near = c * c / (rho + abs(b))
    minus = near if b > scale.zero else rho - b
    plus = rho + b if b > scale.zero else near
    cos_half = np.sqrt(scale.half * plus * inverse)
    return scale.half * (scale.half * minus * inverse) / (scale.one + cos_half)


@merged
def _turn(phi, scale):
    """cos, sin of phi in [-pi, pi]."""
    size = abs(phi)
    cos_phi = sin(scale.half_pi - size)
    inner = scale.pi - size if size > scale.half_pi else size
    inner = inner if inner > scale.zero else scale.zero
    sin_phi = sin(inner)
    return cos_phi, -sin_phi if phi < scale.zero else sin_phi


@merged
def _azimuth(azimuth, k, w, i, scale):
    """phi at both ends of a cell."""
    p = k * (np.int64(scale.last_m) + 1) + i
    a0, a1 = load_pair(azimuth, p, w)
    b0, b1 = load_pair(azimuth, p + np.int64(scale.last_m) + 1, w)
    return a0 + (b0 - a0) * w, a1 + (b1 - a1) * w


@merged
def _polar(polar, k, w, i, at_v, j, scale):
    """zeta at four nodes: both ends of cell j and the ones beside them; at_v across the row, w to the next slice."""
    across = np.int64(scale.last_n) + 3
    rows = np.int64(scale.last_m) + 1
    p = (k * rows + i) * across + j
    q = p + rows * across
    c0, c1 = load_pair(polar, p, w)
    c2, c3 = load_pair(polar, p + 2, w)
    d0, d1 = load_pair(polar, p + across, w)
    d2, d3 = load_pair(polar, p + across + 2, w)
    e0, e1 = load_pair(polar, q, w)
    e2, e3 = load_pair(polar, q + 2, w)
    f0, f1 = load_pair(polar, q + across, w)
    f2, f3 = load_pair(polar, q + across + 2, w)
    c0, c1, c2, c3 = c0 + (d0 - c0) * at_v, c1 + (d1 - c1) * at_v, c2 + (d2 - c2) * at_v, c3 + (d3 - c3) * at_v
    e0, e1, e2, e3 = e0 + (f0 - e0) * at_v, e1 + (f1 - e1) * at_v, e2 + (f2 - e2) * at_v, e3 + (f3 - e3) * at_v
    return c0 + (e0 - c0) * w, c1 + (e1 - c1) * w, c2 + (e2 - c2) * w, c3 + (e3 - c3) * w


@merged
def _grading(before, low, high, after, mass, j, scale):
    """(from the low end, R, P(c)) of cell j: R = 2 d - 1, the ratio of the densities at its ends, d that of the denser
    neighbour to its own, from whichever end that is at; c = R^(1/16), P(x) = (x + 1)(x^2 + 1)(x^4 + 1)(x^8 + 1)
    = (x^16 - 1)/(x - 1)."""
    of_left, of_right = load_pair(mass, 2 * j, low)
    width, left, right = high - low, (low - before) * of_left, (after - high) * of_right
    upward = left <= right
    least = left if upward else right
    least = least if least > width * scale.least else width * scale.least
    ratio = scale.two * width / least - scale.one
    ratio = ratio if ratio > scale.one else scale.one
    r8 = np.sqrt(ratio)
    r4 = np.sqrt(r8)
    r2 = np.sqrt(r4)
    c = np.sqrt(r2)
    return upward, ratio, (c + scale.one) * (r2 + scale.one) * (r4 + scale.one) * (r8 + scale.one)


@merged
def _graded(part, upward, ratio, whole, scale):
    """(share of the width, its derivative) at `part` of a cell: x P(t)/P(c) of x = part counted from the narrow end,
    t = 1 + x (c - 1), whose derivative is 16 t^15/P(c)."""
    x = part if upward else scale.one - part
    inverse = scale.one / whole
    t = scale.one + x * (ratio - scale.one) * inverse
    t2 = t * t
    t4 = t2 * t2
    t8 = t4 * t4
    share = x * (t + scale.one) * (t2 + scale.one) * (t4 + scale.one) * (t8 + scale.one) * inverse
    return share if upward else scale.one - share, scale.sixteen * t8 * t4 * t2 * t * inverse


@merged
def _turn_place(u2, scale):
    """Place in the azimuths' table, in [0, 1], and du2 by it."""
    signed = scale.two * u2 - scale.one
    root = np.sqrt(scale.one - abs(signed))
    v = scale.half * (scale.one - root)
    return scale.half - v if signed < scale.zero else scale.half + v, scale.two * root


@merged
def _part_place(u1, scale):
    """Place in a row of zeta, in [0, 1], and du1 by it."""
    near = u1 < scale.middle
    inner = scale.tip * scale.tip + scale.two * scale.two * scale.rise * u1
    # du1 by x on either side: tip + 2 rise x, or 2 (tip + rise) (1 - x)
    slope = np.sqrt(inner if near else scale.two * scale.two * (scale.one - u1) * (scale.tip + scale.rise))
    x = (slope - scale.tip) * scale.per_rise if near else scale.one - slope * scale.per_last
    return (x if x > scale.zero else scale.zero), slope


@merged
def _drawn(x, y, z, u1, u2, azimuth, polar, mass, scale):
    """(above, wo, density) of one draw."""
    above, c, s, cos_p, sin_p = _frame(x, y, z, scale)
    k, w = _slice(s, scale)
    v, turn_slope = _turn_place(u2, scale)
    v = v * scale.last_m
    i = np.floor(v)
    i = i if i < scale.last_m - scale.one else scale.last_m - scale.one
    x, part_slope = _part_place(u1, scale)
    t = x * scale.last_n
    j = np.floor(t)
    j = j if j < scale.last_n - scale.one else scale.last_n - scale.one
    phi_0, phi_1 = _azimuth(azimuth, k, w, np.int64(i), scale)
    before, zeta_0, zeta_1, after = _polar(polar, k, w, np.int64(i), v - i, np.int64(j), scale)
    upward, ratio, whole = _grading(before, zeta_0, zeta_1, after, mass, np.int64(j), scale)
    share, slope = _graded(t - j, upward, ratio, whole, scale)
    phi = phi_0 + (phi_1 - phi_0) * (v - i)
    zeta = zeta_0 + (zeta_1 - zeta_0) * share
    zeta = zeta if zeta > scale.zero else scale.zero  # by rounding, at u1 = 0
    cos_phi, sin_phi = _turn(phi, scale)
    edge = _horizon(c, s, cos_phi, scale)
    half = zeta * edge
    cos_h = scale.one - scale.two * half
    sin_h = scale.two * np.sqrt(half * (scale.one - half))
    dot = s * sin_h * cos_phi + c * cos_h
    wo_x = scale.two * dot * sin_h * cos_phi - s
    wo_y = scale.two * dot * sin_h * sin_phi
    twice = scale.two * sin_h
    wo_z = c * (scale.one - twice * sin_h) + s * twice * cos_h * cos_phi
    area = (phi_1 - phi_0) * scale.last_m * (zeta_1 - zeta_0) * slope * scale.last_n
    density = turn_slope * part_slope / (area * scale.eight * edge * dot)
    return above, wo_x * cos_p - wo_y * sin_p, wo_x * sin_p + wo_y * cos_p, wo_z, density


@kernel
def draw(wi, u, azimuth, polar, mass, wo, density, scale):
    """wi (3 n,), u (2 n,) -> wo (3 n,), density (n,); the normal and 0 where wi has z <= 0.

    Returns how many were no direction of a squared length within [1e-12, 1e12], or no numbers in [0, 1).
    """
    outside = np.int64(0)
    for p in prange(density.size):
        x, y, z = load(wi, p * 3), load(wi, p * 3 + 1), load(wi, p * 3 + 2)
        u1, u2 = load(u, p * 2), load(u, p * 2 + 1)
        length = x * x + y * y + z * z
        # a comparison with NaN is false
        inside = (length >= scale.shortest) & (length <= scale.longest)
        inside = inside & (u1 >= scale.zero) & (u1 < scale.one) & (u2 >= scale.zero) & (u2 < scale.one)
        x = x if inside else scale.zero
        y = y if inside else scale.zero
        z = z if inside else scale.one
        u1 = u1 if inside else scale.zero
        u2 = u2 if inside else scale.zero
        above, o_x, o_y, o_z, d = _drawn(x, y, z, u1, u2, azimuth, polar, mass, scale)
        store(wo, p * 3, o_x if above else scale.zero)
        store(wo, p * 3 + 1, o_y if above else scale.zero)
        store(wo, p * 3 + 2, o_z if above else scale.one)
        store(density, p, d if above else scale.zero)
        outside += np.int64(0) if inside else np.int64(1)
    return outside


@merged
def _polar_angle(x, y, z, scale):
    """theta of a direction with z > 0, else pi/2."""
    across = np.sqrt(x * x + y * y)
    steep = across > z
    tangent = (z if steep else across) / (across if steep else (z if z > scale.zero else scale.one))
    angle = atan(tangent if tangent > scale.zero else scale.zero)
    return scale.half_pi - angle if steep else angle


@kernel
def angles(wi, wo, theta_i, theta_o, delta_phi, scale):
    """theta_i, theta_o, delta_phi (n,) of directions (3 n,) by the kernels' arctangent; pi/2 where z <= 0."""
    for p in prange(theta_i.size):
        a, b, c = load(wi, p * 3), load(wi, p * 3 + 1), load(wi, p * 3 + 2)
        x, y, z = load(wo, p * 3), load(wo, p * 3 + 1), load(wo, p * 3 + 2)
        store(theta_i, p, _polar_angle(a, b, c, scale))
        store(theta_o, p, _polar_angle(x, y, z, scale))
        along, across = a * x + b * y, a * y - b * x
        size_x, size_y = abs(along), abs(across)
        larger = size_x if size_x > size_y else size_y
        smaller = size_y if size_x > size_y else size_x
        turn = atan(smaller / (larger if larger > scale.zero else scale.one))
        turn = scale.half_pi - turn if size_y > size_x else turn
        turn = scale.pi - turn if along < scale.zero else turn
        store(delta_phi, p, -turn if across < scale.zero else turn)
    return 0


@kernel
def weigh(values, wo, density, channels, scale):
    """values (n C,) of f_r times cos theta_o / density in place; 0 where the density is, and below the horizon."""
    for p in prange(density.size):
        d, z = density[p], wo[p * 3 + 2]
        factor = z / d if d > scale.zero and z > scale.zero else scale.zero
        for c in range(channels):
            values[p * channels + c] *= factor
    return 0


@inline
def _place(azimuth, polar, mass, k, w, phi, zeta, scale):
    """dphi/du2 dzeta/du1 at (phi, zeta) as a quotient: the cell is found by halving."""
    columns = np.int64(scale.last_m) + 1
    low, high = np.int64(0), columns - 1
    while high - low > 1:
        middle = (low + high) // 2
        p = k * columns + middle
        at = azimuth[p] + (azimuth[p + columns] - azimuth[p]) * w
        if at <= phi:
            low = middle
        else:
            high = middle
    i = low
    p = k * columns + i
    phi_0 = azimuth[p] + (azimuth[p + columns] - azimuth[p]) * w
    phi_1 = azimuth[p + 1] + (azimuth[p + columns + 1] - azimuth[p + 1]) * w
    at_v = (phi - phi_0) / (phi_1 - phi_0)
    at_v = at_v if at_v > scale.zero else scale.zero
    at_v = at_v if at_v < scale.one else scale.one
    low, high = np.int64(0), np.int64(scale.last_n)
    while high - low > 1:
        middle = (low + high) // 2
        _, at, _, _ = _polar(polar, k, w, i, at_v, middle, scale)
        if at <= zeta:
            low = middle
        else:
            high = middle
    before, zeta_0, zeta_1, after = _polar(polar, k, w, i, at_v, low, scale)
    upward, ratio, whole = _grading(before, zeta_0, zeta_1, after, mass, low, scale)
    share = (zeta - zeta_0) / (zeta_1 - zeta_0)
    share = share if upward else scale.one - share
    share = share if share > scale.zero else scale.zero
    share = share if share < scale.one else scale.one
    # t^16 = 1 + share (R - 1), and x = share P(c)/P(t)
    t8 = np.sqrt(scale.one + share * (ratio - scale.one))
    t4 = np.sqrt(t8)
    t2 = np.sqrt(t4)
    t = np.sqrt(t2)
    part = share * whole / ((t + scale.one) * (t2 + scale.one) * (t4 + scale.one) * (t8 + scale.one))
    slope = scale.sixteen * t8 * t4 * t2 * t / whole
    part = part if upward else scale.one - part
    x = (scale.one * low + part) / scale.last_n
    x = x if x < scale.one else scale.one
    v = abs(scale.two * (scale.one * i + at_v) / scale.last_m - scale.one)
    v = v if v < scale.one else scale.one
    inner, outer = scale.tip + scale.two * scale.rise * x, scale.two * (scale.tip + scale.rise) * (scale.one - x)
    part_slope = inner if x < scale.half else outer
    area = (phi_1 - phi_0) * scale.last_m * (zeta_1 - zeta_0) * slope * scale.last_n
    return area, part_slope * scale.two * (scale.one - v)


@kernel
def density(wi, wo, azimuth, polar, mass, out, scale):
    """Density at given directions, 1/sr: wi, wo (3 n,) -> out (n,); 0 where either has z <= 0."""
    for p in prange(out.size):
        above, c, s, cos_p, sin_p = _frame(wi[p * 3], wi[p * 3 + 1], wi[p * 3 + 2], scale)
        x, y, z = wo[p * 3], wo[p * 3 + 1], wo[p * 3 + 2]
        length = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        found = scale.zero
        if above and z > scale.zero:
            k, w = _slice(s, scale)
            h_x, h_y, h_z = x * cos_p + y * sin_p + s, y * cos_p - x * sin_p, z + c
            across2 = h_x * h_x + h_y * h_y
            tan2 = across2 / (h_z * h_z)
            secant = np.sqrt(scale.one + tan2)
            half = scale.half * tan2 / (secant * (scale.one + secant))
            across = np.sqrt(across2)
            cos_phi = h_x / across if across > scale.zero else scale.one
            edge = _horizon(c, s, cos_phi, scale)
            phi = np.arctan2(h_y, h_x)
            area, steep = _place(azimuth, polar, mass, k, w, phi, half / edge, scale)
            dot = scale.half * h_z * secant
            found = steep / (area * scale.eight * edge * dot)
        out[p] = found
    return 0
