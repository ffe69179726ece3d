"""Look-ups through a visible-normal warp: where a pair of directions lies in the table, and the value there.

The per-point work stands once, in `_locate`; the kernels loop it over points, for three channels or any number,
all in the type of the angles, float32 or float64. `warp_numpy` is their twin of the same signature: the same
tables read by library functions in float64, without the kernels' polynomials, so that each checks the other.

Arrays (flat, C order), K = theta_i nodes, (n_y, n_x) = azimuth and polar nodes of the normals, N = nodes an axis
of the sample square, C channels:

    spectra      (K, N, N, C)    values on the sample square
    theta_nodes  (K,)            theta_i of the slices, ascending
    theta_index  (G,) int32      slice of uniform steps of theta_i, `theta_index` here
    sigma, ndf   (n,)            projected area over u(theta_i); distribution of normals over u(theta_h)
    warp         (K, n_y, n_x, 2)  density of visible normals; its integral along the row up to that node
    rows         (K, n_y, 2)     integral of each row; integral over the rows up to it

All kernels return the number of inputs outside the plain domain (theta outside [0, pi/2] of its type, |delta_phi| >
3 pi, NaN); such points are looked up at theta = 0, so no read leaves the tables.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI, PI_LO, FloatArray
from brdfcore.kernels.machine.jit import inline, kernel, merged, prange
from brdfcore.kernels.machine.vectorised import atan, load, load_pair, sin, store

#: cos of the float64 nearest pi/2, the horizon. float32's pi/2 lies beyond it and means the same direction.
HORIZON_COS = 6.123233995736766e-17
#: pi in three parts: an odd multiple up to 3 of the first is exact in float32, of the second to 2e-10.
_PI_PARTS = (3.140625, 0.0009676535846665502, np.pi - 3.140625 - 0.0009676535846665502 + PI_LO)


class WarpScale(NamedTuple):
    """Constants of a look-up, in the dtype of the angles: numbers, then the last node of each axis."""

    zero: Any
    half: Any
    one: Any
    two: Any
    four: Any
    half_pi: Any
    half_pi_low: Any
    pi: Any
    pi_a: Any
    pi_b: Any
    pi_c: Any
    per_turn: Any
    two_over_pi: Any
    horizon_cos: Any
    theta_max: Any
    delta_phi_max: Any
    index_per_radian: Any
    last_index: Any
    last_slice: Any
    last_x: Any
    last_y: Any
    width: Any
    height: Any
    last_sample: Any
    last_sigma: Any
    last_ndf: Any


def warp_scale(
    slices: int, normals: tuple[int, int], samples: int, sigma: int, ndf: int, index: int, dtype: npt.DTypeLike
) -> WarpScale:
    """The constants for tables of these sizes; `normals` = (n_y, n_x), `index` the length of theta_index."""
    number: Any = np.dtype(dtype).type
    n_y, n_x = normals
    half_pi = float(number(HALF_PI))
    values = (
        *(0, 0.5, 1, 2, 4),
        *(half_pi, (HALF_PI - half_pi) + 0.5 * PI_LO, np.pi),
        *_PI_PARTS,
        *(1 / (2 * np.pi), 2 / np.pi, HORIZON_COS),
        *(HALF_PI, DELTA_PHI_DIRECT),
        *(index / HALF_PI, index - 1, slices - 1),
        *(n_x - 1, n_y - 1, 1 / (n_x - 1), 1 / (n_y - 1)),
        *(samples - 1, sigma - 1, ndf - 1),
    )
    return WarpScale(*(number(v) for v in values))


def theta_index(theta_nodes: npt.NDArray[np.float32]) -> npt.NDArray[np.int32] | None:
    """Slice at the start of each of G uniform steps of theta_i; one comparison then finds the slice of an angle.

    G is the smallest power of two for which no step, widened by 1 % for the rounding of float32, holds more than
    one node. None if nodes are closer than any G up to 65,536 resolves (2.4e-5 rad).
    """
    nodes = theta_nodes.astype(np.float64)
    last = nodes.size - 2
    for size in (2**k for k in range(6, 17)):
        steps = np.arange(size)
        low, high = (
            np.clip(np.searchsorted(nodes, (steps + edge) * (HALF_PI / size)) - 1, 0, last) for edge in (-0.01, 1.01)
        )
        if (high - low <= 1).all():
            return np.asarray(low, np.int32)
    return None


# ---- one point ------------------------------------------------------------------------------------


@merged
def _locate(a, b, c, theta_nodes, theta_index, sigma, ndf, warp, rows, scale):
    """Sample-square cell and factors of one pair (a, b, c) = (theta_i, theta_o, delta_phi).

    Returns (inside, slice, cell row, cell column, weight of the next slice, fraction along the row, fraction
    across rows, factor ndf / (4 sigma cos theta_o)).
    """
    zero, one, half = scale.zero, scale.one, scale.half
    # a comparison with NaN is false, so NaN is outside
    inside = (
        (a >= zero) & (a <= scale.theta_max) & (b >= zero) & (b <= scale.theta_max) & (abs(c) <= scale.delta_phi_max)
    )
    a = a if inside else zero
    b = b if inside else zero
    c = c if inside else zero

    # Half vector H / H_z in the frame of wi, with d = theta_i - theta_o, e = delta_phi - an odd multiple of pi:
    # x = tan(d/2) + (2 s_o/S) sin^2(e/2), y = -(2 s_o/S) sin(e/2) cos(e/2), S = c_i + c_o. No difference
    # cancels near the mirror direction. Cosines are sines of the complement, which keeps their relative accuracy at
    # the horizon; it ends at the float64 horizon, so that float32's pi/2 is pi/2 and nothing is divided by 0.
    from_horizon_i = (scale.half_pi - a) + scale.half_pi_low
    from_horizon_o = (scale.half_pi - b) + scale.half_pi_low
    from_horizon_i = from_horizon_i if from_horizon_i > scale.horizon_cos else scale.horizon_cos
    from_horizon_o = from_horizon_o if from_horizon_o > scale.horizon_cos else scale.horizon_cos
    cos_o = sin(from_horizon_o)
    sin_d = sin(half * (a - b))
    cos_d = np.sqrt(one - sin_d * sin_d)  # |d/2| <= pi/4
    ratio = sin(b) / (sin(half * (from_horizon_i + from_horizon_o)) * cos_d)
    turns = scale.two * np.floor(c * scale.per_turn) + one
    e = half * (((c - turns * scale.pi_a) - turns * scale.pi_b) - turns * scale.pi_c)
    sin_e = sin(e)
    cos_e = sin(scale.half_pi - abs(e))
    x = sin_d / cos_d + ratio * sin_e * sin_e
    y = -(ratio * sin_e * cos_e)

    # phi_h = atan2(y, x) and theta_h = atan(hypot(x, y)), each with an argument of at most 1. At h = n both x and y
    # are 0, phi_h has no meaning and is 0.
    size_x, size_y = abs(x), abs(y)
    larger = size_x if size_x > size_y else size_y
    smaller = size_y if size_x > size_y else size_x
    quotient = smaller / (larger if larger > zero else one)
    phi = atan(quotient)
    phi = scale.half_pi - phi if size_y > size_x else phi
    phi = scale.pi - phi if x < zero else phi
    phi = -phi if y < zero else phi
    tan_h = larger * np.sqrt(one + quotient * quotient)
    steep = tan_h > one
    theta_h = atan(one / tan_h if steep else tan_h)
    theta_h = scale.half_pi - theta_h if steep else theta_h

    u = np.sqrt(theta_h * scale.two_over_pi)
    d0, d1, t = _linear(ndf, u, scale.last_ndf, scale)
    density = d0 + (d1 - d0) * t
    d0, d1, t = _linear(sigma, np.sqrt(a * scale.two_over_pi), scale.last_sigma, scale)
    area = d0 + (d1 - d0) * t
    factor = density / (scale.four * area * cos_o)

    # Slice below theta_i; beyond the first and last node the weight stays 0 or 1: the nearest slice is continued.
    step = a * scale.index_per_radian
    step = step if step < scale.last_index else scale.last_index
    k = np.int64(load(theta_index, np.int64(step)))
    _, above = load_pair(theta_nodes, k, one)
    last_k = np.int64(scale.last_slice) - 1
    k = k + (np.int64(1) if a > above else np.int64(0))
    k = k if k < last_k else last_k
    below, above = load_pair(theta_nodes, k, one)
    w = (a - below) / (above - below)
    w = w if w < one else one
    w = w if w > zero else zero

    # Cell of the visible-normal density. u and v may pass 1 by rounding, hence the limits.
    u = u * scale.last_x
    u = u if u < scale.last_x else scale.last_x
    v = (half + phi * scale.per_turn) * scale.last_y
    v = v if v < scale.last_y else scale.last_y
    v = v if v > zero else zero
    column = np.floor(u)
    column = column if column < scale.last_x - one else scale.last_x - one
    row = np.floor(v)
    row = row if row < scale.last_y - one else scale.last_y - one
    u = u - column
    v = v - row
    n_x = np.int64(scale.last_x) + 1
    n_y = np.int64(scale.last_y) + 1
    line = k * n_y + np.int64(row)
    p = (line * n_x + np.int64(column)) * 2
    next_row = n_x * 2
    next_slice = n_y * next_row
    left_0, sum_0 = _blend(warp, p, next_slice, w)
    right_0, _ = _blend(warp, p + 2, next_slice, w)
    left_1, sum_1 = _blend(warp, p + next_row, next_slice, w)
    right_1, _ = _blend(warp, p + next_row + 2, next_slice, w)
    row_0, sum_y = _blend(rows, line * 2, n_y * 2, w)
    row_1, _ = _blend(rows, line * 2 + 2, n_y * 2, w)

    # Integrals of the bilinear density up to (u, v): conditional along the row, marginal across the rows. The row
    # integral is 0 only where no normal is visible (theta_i = pi/2, h behind wi); the column is then 0.
    left = left_0 + (left_1 - left_0) * v
    right = right_0 + (right_1 - right_0) * v
    whole = row_0 + (row_1 - row_0) * v
    part = sum_0 + (sum_1 - sum_0) * v + u * (left + (right - left) * (half * u)) * scale.width
    s = part / whole if whole > zero else zero
    t = sum_y + v * (row_0 + (row_1 - row_0) * (half * v)) * scale.height

    s = s * scale.last_sample
    s = s if s < scale.last_sample else scale.last_sample
    t = t * scale.last_sample
    t = t if t < scale.last_sample else scale.last_sample
    column = np.floor(s)
    column = column if column < scale.last_sample - one else scale.last_sample - one
    row = np.floor(t)
    row = row if row < scale.last_sample - one else scale.last_sample - one
    return inside, k, np.int64(row), np.int64(column), w, s - column, t - row, factor


@merged
def _linear(table, u, last, scale):
    """Neighbours of position u in [0, 1] in a table over a uniform axis, and the fraction between them."""
    x = u * last
    x = x if x < last else last
    i = np.floor(x)
    i = i if i < last - scale.one else last - scale.one
    low, high = load_pair(table, np.int64(i), u)
    return low, high, x - i


@merged
def _blend(table, p, next_slice, w):
    """The pair at p, linear between two slices."""
    low_a, low_b = load_pair(table, p, w)
    high_a, high_b = load_pair(table, p + next_slice, w)
    return low_a + (high_a - low_a) * w, low_b + (high_b - low_b) * w


@merged
def _three(spectra, k, row, column, w, s, t, scale):
    """The three channels at one point: six neighbouring numbers a row of the cell."""
    n = np.int64(scale.last_sample) + 1
    p = ((k * n + row) * n + column) * 3
    both = s * t
    weight_10 = s - both
    weight_01 = t - both
    weight_00 = (scale.one - s) - weight_01
    r0, g0, b0 = _cell(spectra, p, p + n * 3, weight_00, weight_10, weight_01, both)
    p = p + n * n * 3
    r1, g1, b1 = _cell(spectra, p, p + n * 3, weight_00, weight_10, weight_01, both)
    return r0 + (r1 - r0) * w, g0 + (g1 - g0) * w, b0 + (b1 - b0) * w


@merged
def _cell(spectra, p, q, weight_00, weight_10, weight_01, weight_11):
    r00, g00 = load_pair(spectra, p, weight_00)
    b00, r10 = load_pair(spectra, p + 2, weight_00)
    g10, b10 = load_pair(spectra, p + 4, weight_00)
    r01, g01 = load_pair(spectra, q, weight_00)
    b01, r11 = load_pair(spectra, q + 2, weight_00)
    g11, b11 = load_pair(spectra, q + 4, weight_00)
    return (
        weight_00 * r00 + weight_10 * r10 + weight_01 * r01 + weight_11 * r11,
        weight_00 * g00 + weight_10 * g10 + weight_01 * g01 + weight_11 * g11,
        weight_00 * b00 + weight_10 * b10 + weight_01 * b01 + weight_11 * b11,
    )


@merged
def _bilinear(spectra, p, channels, next_row, s, t, scale):
    """One channel in one slice; p its place in the first corner of the cell."""
    a0, b0 = scale.one * load(spectra, p), scale.one * load(spectra, p + channels)
    a1, b1 = scale.one * load(spectra, p + next_row), scale.one * load(spectra, p + next_row + channels)
    low = a0 + (b0 - a0) * s
    return low + ((a1 + (b1 - a1) * s) - low) * t


# ---- kernels --------------------------------------------------------------------------------------


@kernel
def warp_rgb(theta_i, theta_o, delta_phi, spectra, theta_nodes, theta_index, sigma, ndf, warp, rows, out, scale):
    """Three channels; out (3 n,)."""
    outside = np.int64(0)
    for p in prange(theta_i.size):
        inside, k, row, column, w, s, t, factor = _locate(
            load(theta_i, p), load(theta_o, p), load(delta_phi, p),
            theta_nodes, theta_index, sigma, ndf, warp, rows, scale,
        )  # fmt: skip
        r, g, b = _three(spectra, k, row, column, w, s, t, scale)
        store(out, p * 3, factor * r)
        store(out, p * 3 + 1, factor * g)
        store(out, p * 3 + 2, factor * b)
        outside += np.int64(0) if inside else np.int64(1)
    return outside


#: Called, not inlined: with the inner loop over channels nothing is vectorised over points, and it compiles once.
_locate_call = inline(_locate.py_func)


@kernel
def warp_many(theta_i, theta_o, delta_phi, spectra, theta_nodes, theta_index, sigma, ndf, warp, rows, out, scale):
    """Any number of channels C; out (n C,). The inner loop runs along the channels, which lie side by side."""
    n = np.int64(scale.last_sample) + 1
    channels = spectra.size // (theta_nodes.size * n * n)
    next_row = n * channels
    next_slice = n * next_row
    outside = np.int64(0)
    for p in prange(theta_i.size):
        inside, k, row, column, w, s, t, factor = _locate_call(
            load(theta_i, p), load(theta_o, p), load(delta_phi, p),
            theta_nodes, theta_index, sigma, ndf, warp, rows, scale,
        )  # fmt: skip
        first = k * next_slice + row * next_row + column * channels
        for c in range(channels):
            low = _bilinear(spectra, first + c, channels, next_row, s, t, scale)
            high = _bilinear(spectra, first + next_slice + c, channels, next_row, s, t, scale)
            store(out, p * channels + c, factor * (low + (high - low) * w))
        outside += np.int64(0) if inside else np.int64(1)
    return outside


def warp_numpy(
    theta_i: FloatArray,
    theta_o: FloatArray,
    delta_phi: FloatArray,
    spectra: npt.NDArray[np.float32],
    theta_nodes: npt.NDArray[np.float32],
    theta_index: npt.NDArray[np.int32],
    sigma: npt.NDArray[np.float32],
    ndf: npt.NDArray[np.float32],
    warp: npt.NDArray[np.float32],
    rows: npt.NDArray[np.float32],
    out: FloatArray,
    scale: WarpScale,
) -> int:
    """The twin of both kernels: the same tables, every step in float64 by library functions.

    Half vector from H = wi + wo, theta_h and phi_h by arctan2, the slice by a binary search (theta_index is not
    read). Agrees with the kernels in float64 to rounding, away from h = n, where its H_x and H_y cancel.
    """
    with np.errstate(invalid="ignore"):
        inside = (theta_i >= 0) & (theta_i <= scale.theta_max) & (theta_o >= 0) & (theta_o <= scale.theta_max)
        inside &= np.abs(delta_phi) <= DELTA_PHI_DIRECT
    a, b, c = (np.where(inside, x, 0).astype(np.float64) for x in (theta_i, theta_o, delta_phi))
    a, b = np.minimum(a, HALF_PI), np.minimum(b, HALF_PI)
    n_x, n_y, samples, slices = (int(n) + 1 for n in (scale.last_x, scale.last_y, scale.last_sample, scale.last_slice))
    x, y = np.sin(a) + np.sin(b) * np.cos(c), np.sin(b) * np.sin(c)
    theta_h, phi_h = np.arctan2(np.hypot(x, y), np.cos(a) + np.cos(b)), np.arctan2(y, x)
    nodes = theta_nodes.astype(np.float64)
    k = np.clip(np.searchsorted(nodes, a) - 1, 0, slices - 2)
    w = np.clip((a - nodes[k]) / (nodes[k + 1] - nodes[k]), 0, 1)

    def cell(position: FloatArray, size: int) -> tuple[npt.NDArray[np.int64], FloatArray]:
        x = np.clip(position, 0, 1) * (size - 1)
        i = np.minimum(x.astype(np.int64), size - 2)
        return i, x - i

    def blend(table: FloatArray, *index: Any) -> FloatArray:
        low, high = (table[(k + step, *index)].astype(np.float64) for step in (0, 1))
        weight = w.reshape(w.shape + (1,) * (low.ndim - 1))
        return np.asarray(low + (high - low) * weight)

    u = np.sqrt(theta_h * 2 / np.pi)
    line: dict[str, FloatArray] = {}
    for name, table, position in (("ndf", ndf, u), ("sigma", sigma, np.sqrt(a * 2 / np.pi))):
        i, t = cell(position, table.size)
        line[name] = table[i] * (1 - t) + table[i + 1] * t
    column, u = cell(u, n_x)
    row, v = cell(0.5 + phi_h / (2 * np.pi), n_y)
    pairs, lines = warp.reshape(slices, n_y, n_x, 2), rows.reshape(slices, n_y, 2)
    left_0, right_0, left_1, right_1 = (blend(pairs, row + j, column + i) for j in (0, 1) for i in (0, 1))
    left, right = (p * (1 - v)[:, None] + q * v[:, None] for p, q in ((left_0, left_1), (right_0, right_1)))
    below, above = blend(lines, row), blend(lines, row + 1)
    whole = below[:, 0] * (1 - v) + above[:, 0] * v
    part = left[:, 1] + u * (left[:, 0] * (1 - u / 2) + right[:, 0] * u / 2) / (n_x - 1)
    s = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)
    t = below[:, 1] + v * (below[:, 0] * (1 - v / 2) + above[:, 0] * v / 2) / (n_y - 1)
    column, s = cell(s, samples)
    row, t = cell(t, samples)
    values = spectra.reshape(slices, samples, samples, -1)
    corners = [blend(values, row + j, column + i) for j in (0, 1) for i in (0, 1)]
    weights = ((1 - t) * (1 - s), (1 - t) * s, t * (1 - s), t * s)
    value = sum(weight[:, None] * corner for weight, corner in zip(weights, corners, strict=True))
    factor = line["ndf"] / (4 * line["sigma"] * np.cos(b))
    out[...] = (factor[:, None] * value).reshape(-1)
    return int((~inside).sum())
