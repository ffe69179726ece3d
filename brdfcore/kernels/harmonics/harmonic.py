"""Values of an expansion: sum_m (2-d_m0) sum_rs A_rs u_r(theta_i) v_s(theta_o) cos(m delta_phi), and the same of sines.

u_r = sum_l basis_rl p_l^m(x)/x^e, x = cos theta_i, e = 1 for odd functions and 0 for even ones; v_s likewise. A basis
that is the identity is not stored. Points run through in groups of `LANES`, which share the recursion's coefficients;
a point's bits do not depend on the others of its group.

Degrees of one parity by steps of two: with c_l = sqrt((l^2-m^2)/(4l^2-1)),

    c_(l+1) c_(l+2) p_(l+2) = (x^2 - c_(l+1)^2 - c_l^2) p_l - c_l c_(l-1) p_(l-2),

for p/x too. Its error grows as l^2 1e-16: 1e-10 of the largest value at l = 1024. Where p_m^m is below 1e-280 the
order's functions up to that degree are below 1e-100, and count as 0.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI, FloatArray
from brdfcore.kernels.machine.jit import inline, on_one_thread
from brdfcore.kernels.machine.vectorised import load, store

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

#: Points worked on together.
LANES = 32
#: Columns of the layout, one row an order: numbers of degrees and of basis functions of both directions (as many as
#: degrees: the identity), where their bases begin, where the cores of cosines and sines do (-1: none), and where the
#: steps' coefficients do.
DEGREES_I, DEGREES_O, RANK_I, RANK_O, BASIS_I, BASIS_O, COSINES, SINES, STEPS_I, STEPS_O = range(10)
#: A point where p_m^m is smaller has no more of the orders from m on.
_NOTHING = 1e-280


def steps(lmax: int, m: int, odd: bool) -> Float64Array:
    """(degrees, 3): p_(l+2) = (a x^2 - b) p_l - c p_(l-2) in row l; the first row's a is p's first value over p_m^m."""
    first = m + (1 if odd else 0)
    l = np.arange(first, lmax + 1, 2, dtype=np.float64)  # noqa: E741

    def square(k: Float64Array) -> Float64Array:
        return np.maximum((k - m) * (k + m), 0) / (4 * k * k - 1)

    found = np.zeros((l.size + 1, 3))
    scale = np.sqrt(square(l + 1) * square(l + 2))
    # c_l = 0 at l = m
    found[1:, 0] = 1 / scale
    found[1:, 1] = (square(l + 1) + square(l)) / scale
    found[1:, 2] = np.where(l > m + 1, np.sqrt(square(l) * square(l - 1)), 0.0) / scale
    found[0, 0] = np.sqrt(2 * m + 3) if odd else 1.0
    return found[: l.size] if l.size else found[:0]


@inline
def _functions(lanes, x2, seed, coefficients, first, count, p):
    """p (count rows of lanes): the degrees of one order and parity from p_m^m in `seed`."""
    for j in range(lanes):
        store(p, j, load(seed, j) * coefficients[first, 0])
    if count > 1:
        a = coefficients[first + 1, 0]
        b = coefficients[first + 1, 1]
        for j in range(lanes):
            store(p, lanes + j, (a * load(x2, j) - b) * p[j])
    for k in range(2, count):
        a = coefficients[first + k, 0]
        b = coefficients[first + k, 1]
        c = coefficients[first + k, 2]
        now = k * lanes
        for j in range(lanes):
            store(p, now + j, (a * load(x2, j) - b) * p[now - lanes + j] - c * p[now - 2 * lanes + j])


@inline
def _combined(lanes, p, degrees, basis, first, rank, y):
    """y_r = sum_l basis_rl p_l; four rows share the reads of p, the last ones of four may mean nothing."""
    for r in range(0, rank, 4):
        last = rank - 1
        row_0 = first + r * degrees
        row_1 = first + min(r + 1, last) * degrees
        row_2 = first + min(r + 2, last) * degrees
        row_3 = first + min(r + 3, last) * degrees
        at = r * lanes
        for j in range(4 * lanes):
            y[at + j] = 0.0
        even = degrees - degrees % 2
        for k in range(0, even, 2):
            b0 = basis[row_0 + k]
            b1 = basis[row_1 + k]
            b2 = basis[row_2 + k]
            b3 = basis[row_3 + k]
            c0 = basis[row_0 + k + 1]
            c1 = basis[row_1 + k + 1]
            c2 = basis[row_2 + k + 1]
            c3 = basis[row_3 + k + 1]
            for j in range(lanes):
                one = load(p, k * lanes + j)
                two = load(p, (k + 1) * lanes + j)
                store(y, at + j, y[at + j] + (b0 * one + c0 * two))
                store(y, at + lanes + j, y[at + lanes + j] + (b1 * one + c1 * two))
                store(y, at + 2 * lanes + j, y[at + 2 * lanes + j] + (b2 * one + c2 * two))
                store(y, at + 3 * lanes + j, y[at + 3 * lanes + j] + (b3 * one + c3 * two))
        for k in range(even, degrees):
            b0 = basis[row_0 + k]
            b1 = basis[row_1 + k]
            b2 = basis[row_2 + k]
            b3 = basis[row_3 + k]
            for j in range(lanes):
                value = load(p, k * lanes + j)
                store(y, at + j, y[at + j] + b0 * value)
                store(y, at + lanes + j, y[at + lanes + j] + b1 * value)
                store(y, at + 2 * lanes + j, y[at + 2 * lanes + j] + b2 * value)
                store(y, at + 3 * lanes + j, y[at + 3 * lanes + j] + b3 * value)


@inline
def _paired(lanes, y, z, rank_i, rank_o, core, first, symmetric, wave, t, total, at):
    """total += wave sum_rs A_rs y_r z_s; a symmetric core holds r <= s, and swapping y and z gives the same bits."""
    place = first
    for r in range(rank_i):
        row = r * lanes
        if symmetric:
            a = core[place]
            for j in range(lanes):
                store(t, j, a * (load(y, row + j) * load(z, row + j)))
            for s in range(r + 1, rank_o):
                a = core[place + s - r]
                for j in range(lanes):
                    one = load(y, row + j) * load(z, s * lanes + j)
                    store(t, j, t[j] + a * (one + load(y, s * lanes + j) * load(z, row + j)))
            for j in range(lanes):
                store(total, at + j, total[at + j] + load(wave, j) * t[j])
            place += rank_o - r
        else:
            for j in range(lanes):
                t[j] = 0.0
            # four terms at a time: the sums wait for each other
            four = rank_o - rank_o % 4
            for s in range(0, four, 4):
                a0 = core[place + s]
                a1 = core[place + s + 1]
                a2 = core[place + s + 2]
                a3 = core[place + s + 3]
                at_s = s * lanes
                for j in range(lanes):
                    left = a0 * load(z, at_s + j) + a1 * load(z, at_s + lanes + j)
                    right = a2 * load(z, at_s + 2 * lanes + j) + a3 * load(z, at_s + 3 * lanes + j)
                    store(t, j, t[j] + (left + right))
            for s in range(four, rank_o):
                a = core[place + s]
                for j in range(lanes):
                    store(t, j, t[j] + a * load(z, s * lanes + j))
            for j in range(lanes):
                store(total, at + j, total[at + j] + load(wave, j) * (load(y, row + j) * t[j]))
            place += rank_o


@on_one_thread
def harmonic_values(
    theta_i, theta_o, delta_phi, out, layout, ratios, coefficients, bases, cores, channels, symmetric, limit, lanes
):
    """out (n channels,), flat; returns how many points are outside the plain domain (their values mean nothing).

    layout int64 (orders, 10); ratios (orders,): p_0^0, then p_m^m/p_(m-1)^(m-1) without the sine; coefficients (.., 3)
    of `steps`; bases and cores flat; `symmetric`: cores hold their upper triangles, left and right bases are one.
    limit: the angles' own pi/2. lanes: `LANES`, told at run time: loops of a known short length are unrolled before the
    compiler looks for vectors.
    """
    most = 1
    for m in range(layout.shape[0]):
        most = max(most, max(layout[m, DEGREES_I], layout[m, DEGREES_O]))
    size = theta_i.size
    outside = np.int64(0)
    p = np.empty((most + 4) * lanes)
    y = np.empty((most + 4) * lanes)
    z = np.empty((most + 4) * lanes)
    t = np.empty(lanes)
    state = np.empty((12, lanes))
    sine_i, sine_o, x2_i, x2_o = state[0], state[1], state[2], state[3]
    # of delta_phi and of m delta_phi; p_m^m of both directions
    cos_1, sin_1, cos_m, sin_m = state[4], state[5], state[6], state[7]
    seed_i, seed_o, wave_c, wave_s = state[8], state[9], state[10], state[11]
    total = np.empty(channels * lanes)
    for start in range(0, size, lanes):
        for j in range(lanes):
            k = min(start + j, size - 1)
            a = theta_i[k]
            b = theta_o[k]
            d = delta_phi[k]
            # a comparison with NaN is false, so NaN counts as outside
            inside = (a >= 0) & (a <= limit) & (b >= 0) & (b <= limit) & (abs(d) <= DELTA_PHI_DIRECT)
            if (not inside) and start + j < size:
                outside += 1
            ti = min(np.float64(a), HALF_PI) if inside else 0.0
            to = min(np.float64(b), HALF_PI) if inside else 0.0
            turn = np.float64(d) if inside else 0.0
            sine_i[j] = np.sin(ti)
            sine_o[j] = np.sin(to)
            x2_i[j] = np.cos(ti) * np.cos(ti)
            x2_o[j] = np.cos(to) * np.cos(to)
            cos_1[j] = np.cos(turn)
            sin_1[j] = np.sin(turn)
            cos_m[j] = 1.0
            sin_m[j] = 0.0
            seed_i[j] = ratios[0]
            seed_o[j] = ratios[0]
        for k in range(channels * lanes):
            total[k] = 0.0
        for m in range(layout.shape[0]):
            if m > 0:
                alive = False
                for j in range(lanes):
                    c = cos_m[j] * cos_1[j] - sin_m[j] * sin_1[j]
                    sin_m[j] = sin_m[j] * cos_1[j] + cos_m[j] * sin_1[j]
                    cos_m[j] = c
                    left = seed_i[j] * (ratios[m] * sine_i[j])
                    right = seed_o[j] * (ratios[m] * sine_o[j])
                    left = left if left > _NOTHING else 0.0
                    right = right if right > _NOTHING else 0.0
                    seed_i[j] = left
                    seed_o[j] = right
                    alive |= (left > 0.0) & (right > 0.0)
                # from here on every order adds exactly 0
                if not alive:
                    break
            row = layout[m]
            count = row[DEGREES_I]
            rank_i = row[RANK_I]
            rank_o = row[RANK_O]
            identity = rank_i == count
            _functions(lanes, x2_i, seed_i, coefficients, row[STEPS_I], count, y if identity else p)
            if not identity:
                _combined(lanes, p, count, bases, row[BASIS_I], rank_i, y)
            count = row[DEGREES_O]
            identity = rank_o == count
            _functions(lanes, x2_o, seed_o, coefficients, row[STEPS_O], count, z if identity else p)
            if not identity:
                _combined(lanes, p, count, bases, row[BASIS_O], rank_o, z)
            for j in range(lanes):
                wave_c[j] = cos_m[j] * (1.0 if m == 0 else 2.0)
                wave_s[j] = 2.0 * sin_m[j]
            length = rank_i * (rank_i + 1) // 2 if symmetric else rank_i * rank_o
            for channel in range(channels):
                at = channel * lanes
                first = row[COSINES] + channel * length
                _paired(lanes, y, z, rank_i, rank_o, cores, first, symmetric, wave_c, t, total, at)
                if row[SINES] >= 0:
                    first = row[SINES] + channel * length
                    _paired(lanes, y, z, rank_i, rank_o, cores, first, symmetric, wave_s, t, total, at)
        for j in range(min(lanes, size - start)):
            for channel in range(channels):
                out[(start + j) * channels + channel] = total[channel * lanes + j]
    return outside


def harmonic_numpy(
    theta_i: FloatArray,
    theta_o: FloatArray,
    delta_phi: FloatArray,
    out: FloatArray,
    layout: IntArray,
    ratios: Float64Array,
    coefficients: Float64Array,
    bases: npt.NDArray[np.floating],
    cores: npt.NDArray[np.floating],
    channels: int,
    symmetric: bool,
    limit: float,
    lanes: int,
) -> int:
    """The twin, order by order in whole arrays; Legendre functions by the same steps."""
    with np.errstate(invalid="ignore"):
        inside = (theta_i >= 0) & (theta_i <= limit) & (theta_o >= 0) & (theta_o <= limit)
        inside &= np.abs(delta_phi) <= DELTA_PHI_DIRECT
    a, b, d = (np.where(inside, t, 0).astype(np.float64) for t in (theta_i, theta_o, delta_phi))
    a, b = np.minimum(a, HALF_PI), np.minimum(b, HALF_PI)
    total = np.zeros((channels, a.size))
    seeds = [np.full(a.size, ratios[0]) for _ in range(2)]
    for m, row in enumerate(layout):
        if m:
            seeds = [seed * ratios[m] * np.sin(t) for seed, t in zip(seeds, (a, b))]
            seeds = [np.where(seed > _NOTHING, seed, 0.0) for seed in seeds]
        sides = []
        for side, theta in enumerate((a, b)):
            count, rank, at = row[DEGREES_I + side], row[RANK_I + side], row[STEPS_I + side]
            p = np.empty((count, a.size))
            x2 = np.cos(theta) ** 2
            for k, (one, two, three) in enumerate(coefficients[at : at + count]):
                if k == 0:
                    p[0] = seeds[side] * one
                else:
                    p[k] = (one * x2 - two) * p[k - 1] - (three * p[k - 2] if k > 1 else 0.0)
            if rank < count:
                at = row[BASIS_I + side]
                p = bases[at : at + rank * count].reshape(rank, count).astype(np.float64) @ p
            sides.append(p)
        y, z = sides
        length = len(y) * (len(y) + 1) // 2 if symmetric else len(y) * len(z)
        for column, wave in ((COSINES, np.cos(m * d) * (1 if m == 0 else 2)), (SINES, 2 * np.sin(m * d))):
            if row[column] < 0:
                continue
            for channel in range(channels):
                first = row[column] + channel * length
                core = cores[first : first + length].astype(np.float64)
                if symmetric:
                    full = np.zeros((len(y), len(y)))
                    full[np.triu_indices(len(y))] = core
                    core = full + np.triu(full, 1).T
                total[channel] += wave * (y * (core.reshape(len(y), len(z)) @ z)).sum(axis=0)
    out[...] = total.T.reshape(-1)
    return int(np.count_nonzero(~inside))
