"""Directions drawn through tables of quantiles, and the density of the draw.

The half vector of a draw is at azimuth phi from wi and at zeta = sin^2(theta_h/2), relative to its largest value for
that azimuth, `horizon`: every draw is above the horizon. phi is a quantile at u2, zeta one at u1 given phi. The tables
hold quantiles, linear between even places; between angles of incidence too, so that a lobe that moves or widens from
one to the next does so in between, and no node is searched for.

Arrays (flat float32, C order), K nodes of y(theta_i) = 1 - (1 - sin theta_i)^(1/4), even in y:

    azimuth  (K, M + 1)          phi at u2 = m/M, from -pi to pi
    polar    (K, M + 1, N + 3)   zeta at u1 = 1 - (1 - n/N)^2, given phi of that m; from 0 to 1, and one node more at
                                 each end, mirrored, for the cells beside

A cell beside a much narrower one spans decades: it begins in a lobe and ends far out of it. Within a cell zeta grows
as the 16th power of a place that is even in u1, which is nearly its exponential, from the density of the narrower
neighbour on; between neighbours of its own width it grows evenly (`_graded`).

Density over solid angles of wo: 1 / (dphi/du2 dzeta/du1 2 horizon 4 (wi.h)), as dwh = 2 d(sin^2(theta_h/2)) dphi and
dwo = 4 (wi.h) dwh. Kernels work in the type of the vectors; `draw_numpy` is the twin of `draw`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.kernels.machine.jit import inline, kernel, merged, prange
from brdfcore.kernels.machine.vectorised import load, load_pair, sin, store


class QuantileScale(NamedTuple):
    """Constants of a draw, in the dtype of the vectors."""

    zero: Any
    half: Any
    one: Any
    two: Any
    eight: Any
    sixteen: Any
    least: Any
    half_pi: Any
    pi: Any
    last_k: Any
    last_m: Any
    last_n: Any


def quantile_scale(incidences: int, azimuths: int, polar: int, dtype: npt.DTypeLike) -> QuantileScale:
    """The constants for K = incidences, M = azimuths, N = polar."""
    number: Any = np.dtype(dtype).type
    return QuantileScale(
        *(number(x) for x in (0, 0.5, 1, 2, 8, 16, 1e-9, np.pi / 2, np.pi, incidences - 1, azimuths, polar))
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
def _slice(c, s, scale):
    """Slice below the incidence and the weight of the next."""
    place = (scale.one - np.sqrt(c / np.sqrt(scale.one + s))) * scale.last_k
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
    near = c * c / (rho + abs(b))
    minus = near if b > scale.zero else rho - b
    plus = rho + b if b > scale.zero else near
    cos_half = np.sqrt(scale.half * plus / rho)
    return scale.half * (scale.half * minus / rho) / (scale.one + cos_half)


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
def _grading(before, low, high, after, scale):
    """(from the low end, c, P(c)) of a cell: ratio R = 2 width/narrower neighbour - 1 of the densities at its ends, from
    whichever end that neighbour is at, c = R^(1/16), P(x) = (x + 1)(x^2 + 1)(x^4 + 1)(x^8 + 1) = (x^16 - 1)/(x - 1)."""
    width, left, right = high - low, low - before, after - high
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
    t = scale.one + x * (ratio - scale.one) / whole
    t2 = t * t
    t4 = t2 * t2
    t8 = t4 * t4
    share = x * (t + scale.one) * (t2 + scale.one) * (t4 + scale.one) * (t8 + scale.one) / whole
    return share if upward else scale.one - share, scale.sixteen * t8 * t4 * t2 * t / whole


@merged
def _drawn(x, y, z, u1, u2, azimuth, polar, scale):
    """(above, wo, density) of one draw."""
    above, c, s, cos_p, sin_p = _frame(x, y, z, scale)
    k, w = _slice(c, s, scale)
    v = u2 * scale.last_m
    i = np.floor(v)
    i = i if i < scale.last_m - scale.one else scale.last_m - scale.one
    root = np.sqrt(scale.one - u1)
    t = (scale.one - root) * scale.last_n
    j = np.floor(t)
    j = j if j < scale.last_n - scale.one else scale.last_n - scale.one
    phi_0, phi_1 = _azimuth(azimuth, k, w, np.int64(i), scale)
    before, zeta_0, zeta_1, after = _polar(polar, k, w, np.int64(i), v - i, np.int64(j), scale)
    upward, ratio, whole = _grading(before, zeta_0, zeta_1, after, scale)
    share, slope = _graded(t - j, upward, ratio, whole, scale)
    phi = phi_0 + (phi_1 - phi_0) * (v - i)
    zeta = zeta_0 + (zeta_1 - zeta_0) * share
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
    density = scale.two * root / (area * scale.eight * edge * dot)
    return above, wo_x * cos_p - wo_y * sin_p, wo_x * sin_p + wo_y * cos_p, wo_z, density


@kernel
def draw(wi, u, azimuth, polar, wo, density, scale):
    """wi (3 n,), u (2 n,) -> wo (3 n,), density (n,); 0 and the normal where wi has z <= 0."""
    for p in prange(density.size):
        above, x, y, z, d = _drawn(
            load(wi, p * 3), load(wi, p * 3 + 1), load(wi, p * 3 + 2),
            load(u, p * 2), load(u, p * 2 + 1), azimuth, polar, scale,
        )  # fmt: skip
        store(wo, p * 3, x if above else scale.zero)
        store(wo, p * 3 + 1, y if above else scale.zero)
        store(wo, p * 3 + 2, z if above else scale.one)
        store(density, p, d if above else scale.zero)
    return 0


@kernel
def weigh(values, wo, density, channels, scale):
    """values (n C,) of f_r times cos theta_o / density in place; 0 where the density is."""
    for p in prange(density.size):
        d = density[p]
        factor = wo[p * 3 + 2] / d if d > scale.zero else scale.zero
        for c in range(channels):
            values[p * channels + c] *= factor
    return 0


@inline
def _place(azimuth, polar, k, w, phi, zeta, scale):
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
    upward, ratio, whole = _grading(before, zeta_0, zeta_1, after, scale)
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
    root = scale.one - (scale.one * low + part) / scale.last_n
    root = root if root > scale.zero else scale.zero
    return (phi_1 - phi_0) * scale.last_m * (zeta_1 - zeta_0) * slope * scale.last_n, scale.two * root


@kernel
def density(wi, wo, azimuth, polar, out, scale):
    """Density at given directions, 1/sr: wi, wo (3 n,) -> out (n,); 0 where either has z <= 0."""
    for p in prange(out.size):
        above, c, s, cos_p, sin_p = _frame(wi[p * 3], wi[p * 3 + 1], wi[p * 3 + 2], scale)
        x, y, z = wo[p * 3], wo[p * 3 + 1], wo[p * 3 + 2]
        length = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        found = scale.zero
        if above and z > scale.zero:
            k, w = _slice(c, s, scale)
            h_x, h_y, h_z = x * cos_p + y * sin_p + s, y * cos_p - x * sin_p, z + c
            across2 = h_x * h_x + h_y * h_y
            tan2 = across2 / (h_z * h_z)
            secant = np.sqrt(scale.one + tan2)
            half = scale.half * tan2 / (secant * (scale.one + secant))
            across = np.sqrt(across2)
            cos_phi = h_x / across if across > scale.zero else scale.one
            edge = _horizon(c, s, cos_phi, scale)
            phi = np.arctan2(h_y, h_x)
            area, steep = _place(azimuth, polar, k, w, phi, half / edge, scale)
            dot = scale.half * h_z * secant
            found = steep / (area * scale.eight * edge * dot)
        out[p] = found
    return 0


# ---- twins ----------------------------------------------------------------------------------------


def draw_numpy(
    wi: FloatArray, u: FloatArray, azimuth: npt.NDArray[np.float32], polar: npt.NDArray[np.float32]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The twin of `draw`, of unit wi (n, 3) with z > 0, u (n, 2), tables in their shapes; library functions, float64."""
    wi, u = np.asarray(wi, np.float64), np.asarray(u, np.float64)
    theta_i, turn = np.arctan2(np.hypot(wi[:, 0], wi[:, 1]), wi[:, 2]), np.arctan2(wi[:, 1], wi[:, 0])
    k, w = _cell(1 - (1 - np.sin(theta_i)) ** 0.25, polar.shape[0] - 1)
    i, at_v = _cell(u[:, 1], polar.shape[1] - 1)
    j, at_t = _cell(1 - np.sqrt(1 - u[:, 0]), polar.shape[2] - 3)
    ends = [_mixed(azimuth, w, k, i + a) for a in (0, 1)]
    rows = [[_mixed(polar, w, k, i + a, j + b) for a in (0, 1)] for b in range(4)]
    zeta = [a * (1 - at_v) + b * at_v for a, b in rows]
    widths = np.diff(zeta, axis=0)
    upward = widths[0] <= widths[2]
    ratio = np.maximum(2 * widths[1] / np.maximum(np.minimum(widths[0], widths[2]), 1e-9 * widths[1]) - 1, 1)
    c = ratio ** (1 / 16)
    x = np.where(upward, at_t, 1 - at_t)
    t = 1 + x * (c - 1)
    even = ratio < 1 + 1e-9
    share = np.where(even, x, (t**16 - 1) / np.where(even, 1, ratio - 1))
    slope = np.where(even, 1, 16 * (c - 1) * t**15 / np.where(even, 1, ratio - 1))
    at_zeta = zeta[1] + widths[1] * np.where(upward, share, 1 - share)
    phi = ends[0] * (1 - at_v) + ends[1] * at_v
    edge = np.sin(0.25 * np.arctan2(np.cos(theta_i), -np.sin(theta_i) * np.cos(phi))) ** 2
    theta_h = 2 * np.arcsin(np.sqrt(at_zeta * edge))
    s = np.sin(theta_h)
    h = np.stack([s * np.cos(phi + turn), s * np.sin(phi + turn), np.cos(theta_h)], axis=-1)
    dot = (h * wi).sum(axis=-1)
    area = (ends[1] - ends[0]) * (polar.shape[1] - 1) * widths[1] * slope * (polar.shape[2] - 3)
    return 2 * dot[:, None] * h - wi, 2 * np.sqrt(1 - u[:, 0]) / (area * 8 * edge * dot)


def _cell(place: FloatArray, last: int) -> tuple[npt.NDArray[np.intp], FloatArray]:
    x = np.clip(place, 0, 1) * last
    i = np.minimum(x.astype(np.intp), last - 1)
    return i, x - i


def _mixed(table: npt.NDArray[np.float32], w: FloatArray, k: npt.NDArray[np.intp], *rest: Any) -> FloatArray:
    low, high = (table[(k + step, *rest)].astype(np.float64) for step in (0, 1))
    return np.asarray(low + (high - low) * w)
