"""What a compiled loop needs to become vector instructions: inlined helpers, reads and stores that say they don't
overlap, and elementary functions without calls.

The `load` functions and `store` carry the statement (LLVM alias scopes) that what is stored is never what is read.
Without it the compiler must assume that a store to `out` changes a table and keeps the loop scalar: 11 instead of
52 million look-ups a second and thread in `kernels.tables.warp`. Indices are not checked and not wrapped: >= 0.

`sin` and `atan` are Chebyshev fits (40 digits) in the type of their argument, because a library call would keep
the loop scalar too. Largest relative errors of the fits: 4e-9 and 3e-9 (float32), 2e-19 and 5e-18 (float64).
"""

from __future__ import annotations

import sys

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload


def _tables_scope(builder):
    module = builder.module
    domain = module.add_metadata(["brdfcore.kernels.machine.vectorised"])
    return module.add_metadata([module.add_metadata(["tables", domain])])


def _element(context, builder, array_type, array, index):
    data = context.make_array(array_type)(context, builder, array).data
    return cgutils.gep_inbounds(builder, data, index)


@intrinsic
def load(typing_context, array, index):
    """array[index], index >= 0."""

    def generate(context, builder, signature, args):
        value = builder.load(_element(context, builder, signature.args[0], args[0], args[1]))
        value.set_metadata("alias.scope", _tables_scope(builder))
        return value

    return array.dtype(array, index), generate


@intrinsic
def load_pair(typing_context, array, index, like):
    """(array[index], array[index + 1]) of a float32 array, in the type of `like`, by one 64-bit load."""

    def generate(context, builder, signature, args):
        pointer = _element(context, builder, signature.args[0], args[0], args[1])
        wide = builder.bitcast(pointer, ir.IntType(64).as_pointer())
        pair = builder.load(wide, align=4, typ=ir.IntType(64))  # neighbours need not be 8-byte aligned
        pair.set_metadata("alias.scope", _tables_scope(builder))
        low = builder.trunc(pair, ir.IntType(32))
        high = builder.trunc(builder.lshr(pair, ir.Constant(ir.IntType(64), 32)), ir.IntType(32))
        if sys.byteorder == "big":
            low, high = high, low
        parts = [builder.bitcast(part, ir.FloatType()) for part in (low, high)]
        if signature.args[2] == types.float64:
            parts = [builder.fpext(part, ir.DoubleType()) for part in parts]
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(like, 2)(array, index, like), generate


@intrinsic
def load_halves(typing_context, array, index, like):
    """Two neighbouring float16 of an int16 array, divided by 2^112, in the type of `like`, by one 32-bit load.

    The bits of a float16 moved to where float32 has them are its value times 2^-112, subnormal numbers included:
    the caller multiplies once, by a constant, instead of each value being converted.
    """

    def generate(context, builder, signature, args):
        pointer = _element(context, builder, signature.args[0], args[0], args[1])
        wide = builder.bitcast(pointer, ir.IntType(32).as_pointer())
        pair = builder.load(wide, align=2, typ=ir.IntType(32))
        pair.set_metadata("alias.scope", _tables_scope(builder))
        word = ir.IntType(32)
        low = builder.shl(pair, ir.Constant(word, 16))
        parts = [low, pair] if sys.byteorder == "little" else [pair, low]
        found = []
        for part in parts:
            # arithmetic shift: the sign stays in front; then only sign, exponent and fraction are kept
            moved = builder.and_(builder.ashr(part, ir.Constant(word, 3)), ir.Constant(word, 0x8FFFE000))
            value = builder.bitcast(moved, ir.FloatType())
            found.append(builder.fpext(value, ir.DoubleType()) if signature.args[2] == types.float64 else value)
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(like, 2)(array, index, like), generate


@intrinsic
def load_words(typing_context, array, index, like):
    """(array[index], array[index + 1]) of a uint16 array, in the type of `like`, by one 32-bit load."""

    def generate(context, builder, signature, args):
        word = ir.IntType(32)
        pointer = _element(context, builder, signature.args[0], args[0], args[1])
        pair = builder.load(builder.bitcast(pointer, word.as_pointer()), align=2, typ=word)
        pair.set_metadata("alias.scope", _tables_scope(builder))
        low = builder.and_(pair, ir.Constant(word, 0xFFFF))
        high = builder.lshr(pair, ir.Constant(word, 16))
        parts = [low, high] if sys.byteorder == "little" else [high, low]
        real = ir.DoubleType() if signature.args[2] == types.float64 else ir.FloatType()
        return context.make_tuple(builder, signature.return_type, [builder.sitofp(part, real) for part in parts])

    return types.UniTuple(like, 2)(array, index, like), generate


@intrinsic
def fma(typing_context, a, b, c):
    """a b + c, rounded once: one instruction, and the same bits in every version of a loop."""

    def generate(context, builder, signature, args):
        return builder.fma(*args)

    return a(a, a, a), generate


@intrinsic
def count_unless(typing_context, count, condition):
    """count + 1 if not `condition`, as int32: a 64-bit sum would halve the width of the whole loop's vectors."""

    def generate(context, builder, signature, args):
        word = ir.IntType(32)
        step = builder.select(args[1], ir.Constant(word, 0), ir.Constant(word, 1))
        return builder.add(args[0], step)

    return types.int32(types.int32, types.boolean), generate


@intrinsic
def float_bits(typing_context, x):
    """The bits of a float32 as an int32; for x > 0 they ascend with x, 2^23 to the octave."""

    def generate(context, builder, signature, args):
        return builder.bitcast(args[0], ir.IntType(32))

    return types.int32(types.float32), generate


@intrinsic
def stepped(typing_context, index, step):
    """index + step of two int32 as an int32, which must hold it: numba's own sum is 64-bit, and takes twice the
    instructions to gather by."""

    def generate(context, builder, signature, args):
        return builder.add(*args, flags=("nsw",))

    return types.int32(types.int32, types.int32), generate


@intrinsic
def power_of_two(typing_context, n):
    """2^n as float32 for an int32 n in [-126, 127]."""

    def generate(context, builder, signature, args):
        word = ir.IntType(32)
        biased = builder.shl(builder.add(args[0], ir.Constant(word, 127)), ir.Constant(word, 23))
        return builder.bitcast(biased, ir.FloatType())

    return types.float32(types.int32), generate


@intrinsic
def store(typing_context, array, index, value):
    """array[index] = value, index >= 0; `array` overlaps no array that `load` or `load_pair` reads."""

    def generate(context, builder, signature, args):
        store = builder.store(args[2], _element(context, builder, signature.args[0], args[0], args[1]))
        store.set_metadata("noalias", _tables_scope(builder))
        return context.get_dummy_value()

    return types.void(array, types.intp, array.dtype), generate


def sin(x):
    """sin, |x| <= pi/2; compiled code only."""
    raise NotImplementedError


def fused_sin(x):
    """sin, |x| <= pi/2, by fused multiply-adds: half the instructions; compiled code only."""
    raise NotImplementedError


def atan(x):
    """atan, 0 <= x <= 1; compiled code only."""
    raise NotImplementedError


def _sin_single(x):
    z = x * x
    p = np.float32(2.6051075e-06) * z + np.float32(-1.9809017e-04)
    p = p * z + np.float32(0.00833305)
    p = p * z + np.float32(-0.16666658)
    return x * (p * z + np.float32(1.0))


def _sin_double(x):
    z = x * x
    p = 2.7215749245979445e-15 * z - 7.643026556333697e-13
    p = p * z + 1.6058940878425258e-10
    p = p * z - 2.5052106890568332e-08
    p = p * z + 2.7557319211229593e-06
    p = p * z - 0.00019841269841208676
    p = p * z + 0.008333333333333186
    p = p * z - 0.16666666666666666
    return x * (p * z + 1.0)


def _fused_single(x):
    z = x * x
    p = fma(np.float32(2.6051075e-06), z, np.float32(-1.9809017e-04))
    p = fma(p, z, np.float32(0.00833305))
    p = fma(p, z, np.float32(-0.16666658))
    return fma(x * z, p, x)


def _fused_double(x):
    z = x * x
    p = fma(2.7215749245979445e-15, z, -7.643026556333697e-13)
    p = fma(p, z, 1.6058940878425258e-10)
    p = fma(p, z, -2.5052106890568332e-08)
    p = fma(p, z, 2.7557319211229593e-06)
    p = fma(p, z, -0.00019841269841208676)
    p = fma(p, z, 0.008333333333333186)
    p = fma(p, z, -0.16666666666666666)
    return fma(x * z, p, x)


def _atan_single(x):
    z = x * x
    p = np.float32(-0.0017011701) * z + np.float32(0.01048765)
    p = p * z + np.float32(-0.030351864)
    p = p * z + np.float32(0.057089556)
    p = p * z + np.float32(-0.08349725)
    p = p * z + np.float32(0.10932341)
    p = p * z + np.float32(-0.14260016)
    p = p * z + np.float32(0.19998075)
    p = p * z + np.float32(-0.33333278)
    return x * (p * z + np.float32(1.0))


def _atan_double(x):
    z = x * x
    p = 1.2631178430477426e-05 * z - 0.00014617088163625013
    p = p * z + 0.0008033604181626027
    p = p * z - 0.0028047655531701315
    p = p * z + 0.007038646202989813
    p = p * z - 0.013674139288399478
    p = p * z + 0.021740213830758134
    p = p * z - 0.02970071773623423
    p = p * z + 0.03651081352721035
    p = p * z - 0.042125723963855326
    p = p * z + 0.04719723992321112
    p = p * z - 0.052527255573225747
    p = p * z + 0.05880342002401543
    p = p * z - 0.06666371187721098
    p = p * z + 0.0769227555520563
    p = p * z - 0.09090906605656898
    p = p * z + 0.11111110982087126
    p = p * z - 0.14285714281592693
    p = p * z + 0.19999999999929946
    p = p * z - 0.3333333333333286
    return x * (p * z + 1.0)


@overload(sin, inline="always")
def _choose_sin(x):
    return _sin_single if x == types.float32 else _sin_double


@overload(fused_sin, inline="always")
def _choose_fused_sin(x):
    return _fused_single if x == types.float32 else _fused_double


@overload(atan, inline="always")
def _choose_atan(x):
    return _atan_single if x == types.float32 else _atan_double
