"""Associated Legendre functions by the fixed-order upward recursion, in double-double numbers with a carried exponent.

    p_l = a_l x p_(l-1) - b_l p_(l-2),  a_l^2 = (4l^2-1)/(l^2-m^2),  b_l = a_l/a_(l-1),  p_m = c_m (1-x^2)^(m/2)

Near a zero of p the two terms cancel: in float64 the error is 1e-16 l of the envelope there, and unbounded relative to
p. So the recursion runs on pairs of float64 (T. J. Dekker, "A floating-point technique for extending the available
precision", 1971, DOI 10.1007/BF01397083), the coefficients, square roots of ratios of whole numbers below 2^53,
included; the seed, a factor of all of them, needs float64 only. A value is mantissa 2^(256 e): the seed may lie below
float64's range although the functions that grow out of it do not (T. Fukushima, 2012, DOI 10.1007/s00190-011-0519-2).

Nodes are worked on in groups of `LANES`, one vector instruction for several of them.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt
from numba import float64
from numba.extending import intrinsic

from brdfcore.kernels.jit import inline, kernel, prange

Float64Array = npt.NDArray[np.float64]

#: Nodes worked on together.
LANES = 32
#: A mantissa above 2^128 moves to the next exponent, 256 binary places up. Looked at every 8 steps: each multiplies
#: by at most a_(m+1) = sqrt(2m+3) < 2^8 (m < 2^14), and 2^(128 + 64) is far from 2^1023.
_BIG = 2.0**128
_STEP = 2.0**-256
_EVERY = 8


@intrinsic
def fma(typing_context, a, b, c):
    """a b + c, rounded once."""

    def generate(context, builder, signature, args):
        return builder.fma(*args)

    return float64(float64, float64, float64), generate


@inline
def _root(numerator, denominator):
    """sqrt(numerator/denominator) of whole numbers below 2^53 as high + low."""
    high = np.sqrt(numerator / denominator)
    square = high * high
    rest = fma(high, high, -square)
    product = denominator * square
    left = ((numerator - product) - fma(denominator, square, -product)) - denominator * rest
    return high, left / (2.0 * high * denominator)


@kernel
def recursion_coefficients(lmax, out):
    """out (entries, 4): a high, a low, b high, b low of every l > m, entries ordered as `first_entry`."""
    for m in prange(lmax + 1):
        first = m * (lmax + 1) - (m * (m - 1)) // 2
        for l in range(m, lmax + 1):  # noqa: E741
            row = first + l - m
            for column in range(4):
                out[row, column] = 0.0
            if l > m:
                n1 = 4.0 * l * l - 1.0
                d1 = float(l - m) * float(l + m)
                out[row, 0], out[row, 1] = _root(n1, d1)
                if l > m + 1:
                    d0 = float(l - 1 - m) * float(l - 1 + m)
                    out[row, 2], out[row, 3] = _root((2.0 * l + 1.0) * d0, (2.0 * l - 3.0) * d1)
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


@kernel
def legendre_orders(x, seed, exponent, coefficients, lmax, first_order, orders, skip, stride, out):
    """p_l^m of orders first_order ... first_order + orders - 1 at nodes x (n,).

    seed and exponent (orders, n): of `seeds`. out (rows, n): of each order the degrees m + skip, m + skip + stride,
    ... up to lmax, one order after the other.
    """
    groups = (x.size + LANES - 1) // LANES
    for task in prange(groups * orders):
        order = task // groups
        m = first_order + order
        at = (task - order * groups) * LANES
        lanes = min(LANES, x.size - at)
        row = np.int64(0)
        for earlier in range(order):
            count = lmax - (first_order + earlier) - skip
            row += count // stride + 1 if count >= 0 else 0
        first = m * (lmax + 1) - (m * (m - 1)) // 2
        # one flat array with constant offsets: the compiler sees that its parts don't overlap, and makes vectors
        s = np.zeros(7 * LANES)  # p high, p low, q high, q low, exponent, 2^(256 exponent), x
        behind = False
        for j in range(lanes):
            s[j] = seed[order, at + j]
            s[4 * LANES + j] = exponent[order, at + j]
            s[5 * LANES + j] = _power(s[4 * LANES + j])
            s[6 * LANES + j] = x[at + j]
            behind |= s[4 * LANES + j] < 0.0
        for l in range(m, lmax + 1):  # noqa: E741
            if l > m:
                ah = coefficients[first + l - m, 0]
                al = coefficients[first + l - m, 1]
                bh = coefficients[first + l - m, 2]
                bl = coefficients[first + l - m, 3]
                for j in range(LANES):
                    node = s[6 * LANES + j]
                    ph = s[j]
                    pl = s[LANES + j]
                    qh = s[2 * LANES + j]
                    ql = s[3 * LANES + j]
                    # a x, a x p, - b q: each high + low
                    th = ah * node
                    tl = fma(al, node, fma(ah, node, -th))
                    uh = th * ph
                    ul = fma(tl, ph, fma(th, pl, fma(th, ph, -uh)))
                    vh = -(bh * qh)
                    vl = -fma(bl, qh, fma(bh, ql, fma(bh, qh, vh)))
                    sh = uh + vh
                    part = sh - uh
                    sl = ((uh - (sh - part)) + (vh - part)) + (ul + vl)
                    high = sh + sl
                    s[j] = high
                    s[LANES + j] = sl - (high - sh)
                    s[2 * LANES + j] = ph
                    s[3 * LANES + j] = pl
                if behind and (l - m) % _EVERY == 0:
                    behind = False
                    for j in range(LANES):
                        e = s[4 * LANES + j]
                        big = (e < 0.0) & ((abs(s[j]) > _BIG) | (abs(s[2 * LANES + j]) > _BIG))
                        factor = _STEP if big else 1.0
                        for part_of in range(4):
                            s[part_of * LANES + j] *= factor
                        e += 1.0 if big else 0.0
                        s[4 * LANES + j] = e
                        s[5 * LANES + j] = _power(e)
                        behind |= e < 0.0
            step = l - m - skip
            if step >= 0 and step % stride == 0:
                if lanes == LANES:
                    for j in range(LANES):
                        out[row, at + j] = s[j] * s[5 * LANES + j]
                else:
                    for j in range(lanes):
                        out[row, at + j] = s[j] * s[5 * LANES + j]
                row += 1
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
