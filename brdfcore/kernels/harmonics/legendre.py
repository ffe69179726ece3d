"""Associated Legendre functions by the fixed-order upward recursion, compensated, with a carried exponent.

    p_l = a_l x p_(l-1) - b_l p_(l-2),  a_l^2 = (4l^2-1)/(l^2-m^2),  b_l = a_l/a_(l-1),  p_m = c_m (1-x^2)^(m/2)

With p_l = s_l q_l, s_m = s_(m+1) = 1 and s_l = b_l s_(l-2), the second coefficient is 1:

    q_l = alpha_l x q_(l-1) - q_(l-2),  alpha_(m+1) = a_(m+1),  alpha_l alpha_(l-1) = a_(l-1)^2,  .1 < s_l < 1.2

Near a zero of p the two terms cancel: in float64 the error is 1e-16 l of the envelope there, and unbounded relative to
p. So q is a pair of float64: the high part is the recursion in float64, the low part the same linear recursion driven
by what each rounding of the first left, known exactly (T. J. Dekker, "A floating-point technique for extending the
available precision", 1971, DOI 10.1007/BF01397083). Unlike Dekker's sums, a pair is made to sum to its high part only
every 8 degrees: in between the low part may be some units in the last place of the high one, its own rounding is 2^-53
of that. alpha is a pair too; what alpha_l inherits of the error of alpha_(l-1), the reciprocal, only scales odd l - m
against even ones. The seed, a factor of all of them, needs float64 only; its error, 2.3e-13 at most to l = 1024, is the
largest there. A value is mantissa 2^(256 e): the seed may lie below float64's range although the functions that grow
out of it do not (T. Fukushima, 2012, DOI 10.1007/s00190-011-0519-2).
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from brdfcore.kernels.harmonics.legendre_steps import (
    EXPONENT,
    HIGH,
    HIGH_BEFORE,
    LANES,
    LOW,
    LOW_BEFORE,
    NODE,
    POWER,
    STEPS,
    address,
    advance,
)
from brdfcore.kernels.machine.jit import inline, kernel, prange
from brdfcore.kernels.machine.vectorised import fma, load, store

Float64Array = npt.NDArray[np.float64]

#: A mantissa above 2^128 moves to the next exponent, 256 binary places up. Looked at every 8 steps (`STEPS`): each
#: multiplies by at most a_(m+1) = sqrt(2m+3) < 2^8 (m < 2^14), and 2^(128 + 64) is far from 2^1023.
_BIG = 2.0**128
_STEP = 2.0**-256


@inline
def _root(numerator, denominator):
    """sqrt(numerator/denominator) of whole numbers below 2^53 as high + low."""
    high = np.sqrt(numerator / denominator)
    square = high * high
    rest = fma(high, high, -square)
    product = denominator * square
    left = ((numerator - product) - fma(denominator, square, -product)) - denominator * rest
    return high, left / (2.0 * high * denominator)


@inline
def _quotient(n, d, high, low):
    """n/(d (high + low)) as high + low, n and d whole numbers."""
    whole = d * high
    rest = fma(d, high, -whole) + d * low
    found = n / whole
    left = (fma(-found, whole, n) - found * rest) / whole
    # made to sum to its high part: as the next quotient's divisor the square of low/high is neglected
    quotient = found + left
    return quotient, left - (quotient - found)


@kernel
def recursion_coefficients(lmax, out):
    """out (entries + STEPS - 1, 3): alpha high, alpha low, s of every l >= m, entries ordered as `first_entry`.

    The last rows, which `advance` reads without need, and alpha_m are 0.
    """
    for m in prange(lmax + 1):
        first = m * (lmax + 1) - (m * (m - 1)) // 2
        high = low = 0.0
        s, s_low, before, before_low = 1.0, 0.0, 1.0, 0.0  # s_l, s_(l-1)
        for l in range(m, lmax + 1):  # noqa: E741
            if l == m + 1:
                high, low = _root(2.0 * m + 3.0, 1.0)
            elif l > m + 1:
                n0 = 4.0 * (l - 1) * (l - 1) - 1.0
                d0 = float(l - 1 - m) * float(l - 1 + m)
                high, low = _quotient(n0, d0, high, low)
                b, b_low = _root((2.0 * l + 1.0) * d0, (2.0 * l - 3.0) * float(l - m) * float(l + m))
                product = b * before
                rest = fma(b, before, -product) + (b * before_low + b_low * before)
                before, before_low = s, s_low
                s = product + rest
                s_low = rest - (s - product)
            row = first + l - m
            out[row, 0] = high
            out[row, 1] = low
            out[row, 2] = s
    for row in range(out.shape[0] - STEPS + 1, out.shape[0]):
        for column in range(3):
            out[row, column] = 0.0
    return 0


@inline
def _power(e):
    """2^(256 e); below e = -4 a mantissa's value is below 2^-1074, float64's range: 0."""
    p = 1.0 if e > -1.0 else 2.0**-256
    p = p if e > -2.0 else 2.0**-512
    p = p if e > -3.0 else 2.0**-768
    p = p if e > -4.0 else 2.0**-1024
    return p if e > -5.0 else 0.0


@kernel
def seeds(x, factors, first_order, mantissa, exponent):
    """p_m = mantissa 2^(256 exponent) of orders first_order ... at nodes x (n,), each (orders, n), exponent <= 0.

    factors (last order + 1,): p_m/p_(m-1) = factors[m] sqrt(1-x^2), and p_0 = factors[0].
    """
    for k in prange(x.size):
        sine = np.sqrt((1.0 - x[k]) * (1.0 + x[k]))
        value = factors[0]
        power = 0.0
        for m in range(factors.size):
            if m > 0:
                value *= factors[m] * sine
                # sine >= 1e-8 or 0: one step divides by 2^27 at most
                if (value < 2.0**-128) & (value > 0.0):
                    value *= 2.0**256
                    power -= 1.0
            if m >= first_order:
                mantissa[m - first_order, k] = value
                exponent[m - first_order, k] = power if value > 0.0 else 0.0
    return 0


@inline
def _moved(state):
    """Where a mantissa is too large, it goes down and the exponent up; whether an exponent is left below 0."""
    left = 0.0
    for j in range(LANES):
        e = state[EXPONENT + j]
        big = (e < 0.0) & ((abs(state[HIGH + j]) > _BIG) | (abs(state[HIGH_BEFORE + j]) > _BIG))
        factor = _STEP if big else 1.0
        state[HIGH + j] *= factor
        state[LOW + j] *= factor
        state[HIGH_BEFORE + j] *= factor
        state[LOW_BEFORE + j] *= factor
        e += 1.0 if big else 0.0
        state[EXPONENT + j] = e
        state[POWER + j] = _power(e)
    for j in range(LANES):
        left = min(left, state[EXPONENT + j])
    return left < 0.0


@kernel
def legendre_orders(x, seed, exponent, coefficients, lmax, first_order, starts, skip, stride, out):
    """p_l^m of orders first_order ... first_order + starts.size - 1 at nodes x (n,).

    seed and exponent (orders, n): of `seeds`. out (rows, n): of each order the degrees m + skip, m + skip + stride,
    ... up to lmax, from row `starts` (orders,) on.
    """
    nodes = x.size
    orders = starts.size
    groups = (nodes + LANES - 1) // LANES
    for task in prange(groups * orders):
        # an order has lmax + 1 - m degrees, and threads take neighbouring tasks: one from the front, one from the back
        turn = task // groups
        order = turn // 2 if turn % 2 == 0 else orders - 1 - turn // 2
        m = first_order + order
        at = (task - turn * groups) * LANES
        lanes = min(LANES, nodes - at)
        state = np.zeros(7 * LANES)
        tile = np.empty(STEPS * LANES)
        behind = False
        for j in range(lanes):
            state[HIGH + j] = seed[order, at + j]
            state[NODE + j] = x[at + j]
            state[EXPONENT + j] = exponent[order, at + j]
            state[POWER + j] = _power(state[EXPONENT + j])
            behind |= state[EXPONENT + j] < 0.0
        row = starts[order]
        if skip == 0:
            for j in range(lanes):
                out[row, at + j] = state[HIGH + j] * state[POWER + j]
            row += 1
        first = m * (lmax + 1) - (m * (m - 1)) // 2 - m
        for l in range(m + 1, lmax + 1, STEPS):  # noqa: E741
            whole = lanes == LANES and l + STEPS <= lmax + 1
            spare = address(tile, 0)
            here, line = spare, 8 * LANES
            if whole:
                here, line = address(out, row * nodes + at), 8 * nodes
                row += STEPS // stride
            even, even_by = here, line
            odd, odd_by = here, line
            if stride == 1 or not whole:
                odd += line
                even_by, odd_by = 2 * line, 2 * line
            elif skip == 1:
                odd, odd_by = spare, 0
            else:
                even, even_by = spare, 0
            grown = advance(state, coefficients, first + l, even, odd, even_by, odd_by, _BIG)
            if not whole:
                for k in range(min(STEPS, lmax + 1 - l)):
                    step = l + k - m - skip
                    if step >= 0 and step % stride == 0:
                        for j in range(lanes):
                            store(out, row * nodes + at + j, load(tile, k * LANES + j))
                        row += 1
            if grown and behind:
                behind = _moved(state)
    return 0


def legendre_numpy(lmax: int, m: int, x: Float64Array) -> Float64Array:
    """p_l^m(x), l = m ... lmax, (lmax - m + 1, n): the twin, in whole numbers and fractions, rounded once at the end.

    Slow and exact but for the last rounding of the square roots: with p_l = N_l P_l, P_l the unnormalised function
    without (1-x^2)^(m/2), P_l is a polynomial with rational coefficients and float64 nodes are fractions.
    """
    found = np.empty((lmax - m + 1, x.size))
    for k, node in enumerate(x.tolist()):
        t = Fraction(node)
        previous, current = Fraction(0), Fraction(1)  # P_m = (2m-1)!! s^m; the double factorial goes to the norm
        for l in range(m, lmax + 1):  # noqa: E741
            if l > m:
                previous, current = current, ((2 * l - 1) * t * current - (l + m - 1) * previous) / (l - m)
            # N^2 (2m-1)!!^2 (1-x^2)^m P^2, all rational: logarithms of whole numbers have any range
            square = Fraction(2 * l + 1) * math.factorial(l - m) / math.factorial(l + m) * (1 - t * t) ** m
            square *= Fraction(math.factorial(2 * m), math.factorial(m) << m) ** 2 * current * current
            found[l - m, k] = math.copysign(_root_of_fraction(square) / math.sqrt(4 * math.pi), current)
    return found


def _root_of_fraction(square: Fraction) -> float:
    """sqrt of a fraction of any size, 60 bits before the rounding."""
    if square == 0:
        return 0.0
    shift = 124 - (square.numerator.bit_length() - square.denominator.bit_length())
    shift += shift % 2
    scaled = square * (Fraction(2) ** shift)
    return math.ldexp(math.isqrt(scaled.numerator // scaled.denominator), -shift // 2)
