"""Steps of the recursion of `kernels.harmonics.legendre`, several degrees and nodes at a time, in vector instructions.

Written as LLVM vectors because numba's vectoriser sees only one degree at a time: the four numbers that a node carries
would go to memory and back every degree. Here they stay in registers for `STEPS` degrees, and the high parts of a
degree, on which the next one waits, are begun before the low parts of the one before. Wider vectors than a processor
has are split by LLVM.
"""

from __future__ import annotations

from functools import reduce

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

#: Degrees a call; nodes worked on together, in vectors of WIDTH.
STEPS = 8
LANES = 16
WIDTH = 8
#: Rows of the state, each LANES long: q high and low of the last degree and of the one before it, x, 2^(256 exponent),
#: and the exponent.
HIGH, LOW, HIGH_BEFORE, LOW_BEFORE, NODE, POWER, EXPONENT = (row * LANES for row in range(7))

_WORD = ir.IntType(64)
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_BITS = ir.IntType(WIDTH)
_BYTES = ir.IntType(8).as_pointer()
_FOR_WRITING = [ir.IntType(32)(k) for k in (1, 3, 1)]  # to write, keep near, data
_PARTS = range(0, LANES, WIDTH)


@intrinsic
def address(typing_context, array, index):
    """Where array[index] of the flat array lies in memory."""

    def generate(context, builder, signature, args):
        return builder.ptrtoint(_element(context, builder, signature, args, 0, args[1]), _WORD)

    return types.int64(array, types.int64), generate


@intrinsic
def advance(typing_context, state, coefficients, row, even, odd, even_by, odd_by, large):
    """`STEPS` degrees of `LANES` nodes: the state is replaced, (q high + q low) scale 2^(256 exponent) is stored.

    state (7 LANES,); coefficients (rows, 3), the first used is `row`. Values go to addresses that overlap neither
    of the two, LANES to each: of steps 0, 2, ... to even, even + even_by, ..., of 1, 3, ... to odd, odd + odd_by, ...
    Returns whether any high part of the last two degrees is beyond +-large.

    The pairs of the last two degrees are then made to sum to their high parts, so that low parts don't grow with l.

    With t = alpha x and u = t high_(l-1), each a float64 and what its rounding left, exact by fma: high_l is
    u - high_(l-2) rounded, and low_l = t low_(l-1) - low_(l-2) + all that was left. The remainder of the difference is
    that of D. E. Knuth, "The Art of Computer Programming" 2, 4.2.2, theorem B. What is left of t meets high parts only:
    its product with a low part is of the order of that part's own rounding.
    """

    def generate(context, builder, signature, args):
        add, sub, mul, load = _each(builder.fadd), _each(builder.fsub), _each(builder.fmul), builder.load
        fma, negative = _each(_function(builder, "fma", 3)), _each(builder.fneg)

        def element(argument, index):
            return _element(context, builder, signature, args, argument, index)

        def pointers(of_row):
            return [builder.bitcast(element(0, _WORD(of_row + part)), _VECTOR.as_pointer()) for part in _PARTS]

        def read(of_row):
            return [load(pointer, align=8) for pointer in pointers(of_row)]

        first = builder.mul(args[2], _WORD(3))

        def coefficient(k, column):
            return [_spread(builder, load(element(1, builder.add(first, _WORD(3 * k + column)))))] * len(_PARTS)

        def begun(k, high, high_before):
            alpha, alpha_low = coefficient(k, 0), coefficient(k, 1)
            t = mul(alpha, x)
            u = mul(t, high)
            q = sub(u, high_before)
            t_left = fma(alpha_low, x, fma(alpha, x, negative(t)))
            return t, t_left, u, q

        def low_part(step, high, low, high_before, low_before):
            t, t_left, u, q = step
            u_left = fma(t_left, high, fma(t, high, negative(u)))
            part = sub(q, u)
            q_left = sub(sub(u, sub(q, part)), add(high_before, part))
            return fma(t, low, add(q_left, sub(u_left, low_before)))

        def together(high, low):
            whole = add(high, low)
            return whole, sub(low, sub(whole, high))

        prefetch = _prefetch(builder)
        x, power = read(NODE), read(POWER)
        high, low, high_before, low_before = (read(of) for of in (HIGH, LOW, HIGH_BEFORE, LOW_BEFORE))
        to, by = [args[3], args[4]], [args[5], args[6]]
        step = begun(0, high, high_before)
        for k in range(STEPS):
            following = begun(k + 1, step[3], high) if k + 1 < STEPS else None
            new = low_part(step, high, low, high_before, low_before)
            # not scale 2^(256 exponent) first: 2^-1024 keeps no more than its own bit
            values = mul(mul(add(step[3], new), coefficient(k, 2)), power)
            for part, value in zip(_PARTS, values, strict=True):
                place = builder.inttoptr(builder.add(to[k % 2], _WORD(8 * part)), _VECTOR.as_pointer())
                builder.store(value, place, align=8)
                # to write a line of the cache it is read from memory first: asked for one call ahead
                ahead = builder.add(builder.ptrtoint(place, _WORD), builder.mul(by[k % 2], _WORD(STEPS // 2)))
                builder.call(prefetch, [builder.inttoptr(ahead, _BYTES), *_FOR_WRITING])
            to[k % 2] = builder.add(to[k % 2], by[k % 2])
            high, low, high_before, low_before, step = step[3], new, high, low, following
        (high, low), (high_before, low_before) = together(high, low), together(high_before, low_before)
        for of, values in ((HIGH, high), (LOW, low), (HIGH_BEFORE, high_before), (LOW_BEFORE, low_before)):
            for pointer, value in zip(pointers(of), values, strict=True):
                builder.store(value, pointer, align=8)
        absolute = _function(builder, "fabs", 1)
        limit = _spread(builder, args[7])
        beyond = [builder.fcmp_ordered(">", absolute(value), limit) for value in high + high_before]
        return builder.icmp_unsigned("!=", builder.bitcast(reduce(builder.or_, beyond), _BITS), _BITS(0))

    return types.boolean(state, coefficients, *[types.int64] * 5, types.float64), generate


def _element(context, builder, signature, args, argument, index):
    data = context.make_array(signature.args[argument])(context, builder, args[argument]).data
    return cgutils.gep_inbounds(builder, data, index)


def _each(operation):
    """`operation` on lists of vectors, one after the other."""
    return lambda *lists: [operation(*vectors) for vectors in zip(*lists, strict=True)]


def _function(builder, name, arguments):
    signature = ir.FunctionType(_VECTOR, [_VECTOR] * arguments)
    function = cgutils.get_or_insert_function(builder.module, signature, f"llvm.{name}.v{WIDTH}f64")
    return lambda *vectors: builder.call(function, vectors)


def _prefetch(builder):
    signature = ir.FunctionType(ir.VoidType(), [_BYTES] + [ir.IntType(32)] * 3)
    return cgutils.get_or_insert_function(builder.module, signature, "llvm.prefetch.p0i8")


def _spread(builder, value):
    """A number in every place of a vector."""
    word = ir.IntType(32)
    alone = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, word(0))
    return builder.shuffle_vector(alone, alone, ir.Constant(ir.VectorType(word, WIDTH), None))
