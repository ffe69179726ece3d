"""Elementary functions in float32 for loops that become vector instructions, each one source with two executions:
inlined into a compiled loop, or run by numpy on whole arrays, operation by operation and so to the same bits.

Largest errors, each measured against float64 on 10^6 arguments and more (`test_fast_tier.py` holds them):

    sin    1.6e-7 relative, |x| <= 1.5708
    atan   1.3e-7 relative, 0 <= x <= 1
    exp    8.2e-8 relative, -87 <= x <= 0; below, 0
    log1p  2.4e-7 relative, -1 < x <= 1e33
    smith_excess  1.7e-6 of x + the function, x >= 0

Everything is written without branches: `select` takes both sides, so neither may divide by 0 or leave the integers.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, register_jitable

from brdfcore.kernels.machine import vectorised

#: Decorator: a function of numbers that compiled loops call, the compiler inlines, and numpy runs on arrays.
elementwise = register_jitable(error_model="numpy", nogil=True)

ZERO, HALF, ONE, TWO, FOUR = (np.float32(x) for x in (0, 0.5, 1, 2, 4))
#: float32 arguments of `exp` from which on its value is a normal number.
EXP_LOWEST = np.float32(-87.0)

_LOG2_E = np.float32(1.44269504)
# ln 2 in two parts; a whole number up to 2^9 times the first is exact
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_SQRT_HALF_BITS = np.int32(0x3F3504F3)
_ONE_BITS = np.int32(0x3F800000)
_MANTISSA_BITS = np.int32(23)
#: Beyond, `smith_excess` is less than a bit of x; further on it would be subnormal, which processors take slowly.
_EXCESS_ENDS = np.float32(8.0)
_INVERSE_ROOT_PI = np.float32(0.5641895835477563)  # 1/sqrt(pi)


# ---- what numpy and the compiler write differently ---------------------------------------------------


def select(condition, a, b):
    """a where the condition holds, else b."""
    return np.where(condition, a, b)


@overload(select)
def _select(condition, a, b):
    return lambda condition, a, b: a if condition else b


def single(x):
    """x rounded to float32."""
    return x.astype(np.float32)


@overload(single)
def _single(x):
    return lambda x: np.float32(x)


def whole(x):
    """A float32 that is a whole number as int32."""
    return x.astype(np.int32)


@overload(whole)
def _whole(x):
    return lambda x: np.int32(x)


def real(x):
    """An int32 as float32."""
    return x.astype(np.float32)


@overload(real)
def _real(x):
    return lambda x: np.float32(x)


def bits(x):
    """The 32 bits of a float32 as int32."""
    return x.view(np.int32)


def from_bits(x):
    """The float32 of 32 bits."""
    return x.view(np.float32)


@intrinsic
def _bits(typing_context, x):
    def generate(context, builder, signature, args):
        return builder.bitcast(args[0], ir.IntType(32))

    return types.int32(types.float32), generate


@intrinsic
def _from_bits(typing_context, x):
    def generate(context, builder, signature, args):
        return builder.bitcast(args[0], ir.FloatType())

    return types.float32(types.int32), generate


@overload(bits)
def _choose_bits(x):
    return lambda x: _bits(x)


@overload(from_bits)
def _choose_from_bits(x):
    return lambda x: _from_bits(x)


# ---- functions -----------------------------------------------------------------------------------------

#: sin x, |x| <= pi/2, and atan x, 0 <= x <= 1: the polynomials of `vectorised`.
sin = elementwise(vectorised._sin_single)
atan = elementwise(vectorised._atan_single)


@elementwise
def exp(x):
    """e^x, x <= 0; 0 below `EXP_LOWEST`. x = n ln 2 + r, |r| <= .347, polynomial in r (fit error 3e-9)."""
    y = select(x > EXP_LOWEST, x, EXP_LOWEST)
    n = np.floor(y * _LOG2_E + HALF)
    r = (y - n * _LN2_HIGH) - n * _LN2_LOW
    p = np.float32(0.0013814467) * r + np.float32(0.008368781)
    p = p * r + np.float32(0.041668393)
    p = p * r + np.float32(0.1666652)
    p = p * r + np.float32(0.49999994)
    p = (p * r * r + r) + ONE
    power = from_bits((whole(n) << _MANTISSA_BITS) + _ONE_BITS)
    return select(x >= EXP_LOWEST, p * power, ZERO)


@elementwise
def log1p(x):
    """ln(1 + x), x > -1. What 1 + x rounds off is added to the mantissa; series of atanh (fit error 8e-10)."""
    u = x + ONE
    lost = x - (u - ONE)
    exponent = (bits(u) - _SQRT_HALF_BITS) >> _MANTISSA_BITS
    shift = exponent << _MANTISSA_BITS
    mantissa = from_bits(bits(u) - shift)  # in [sqrt(1/2), sqrt(2))
    f = (mantissa - ONE) + lost * from_bits(_ONE_BITS - shift)
    s = f / (TWO + f)
    z = s * s
    p = np.float32(0.14936537) * z + np.float32(0.19988748)
    p = p * z + np.float32(0.33333388)
    n = real(exponent)
    return n * _LN2_HIGH + (n * _LN2_LOW + (s + s) * (p * z + ONE))


@elementwise
def smith_excess(x):
    """exp(-x^2)/sqrt(pi) - x erfc(x), x >= 0, infinity included: p(x)^-16/sqrt(pi), absolute fit error 4e-8 of x + it.

    x erf(x) + exp(-x^2)/sqrt(pi), of Smith's function for Gaussian slopes, is x plus this: no term cancels.
    """
    x = select(x < _EXCESS_ENDS, x, _EXCESS_ENDS)
    p = np.float32(6.639095e-05) * x + np.float32(0.000119273594)
    p = p * x + np.float32(0.0009892383)
    p = p * x + np.float32(0.009397149)
    p = p * x + np.float32(0.04181278)
    p = p * x + np.float32(0.110778235)
    p = p * x + ONE
    p = p * p
    p = p * p
    p = p * p
    return _INVERSE_ROOT_PI / (p * p)
