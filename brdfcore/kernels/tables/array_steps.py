"""What look-ups written over the array-API standard share: limits of a type, angles, cells, nodes around a point.

`xp` is the namespace of the arrays (numpy, torch, jax.numpy, cupy, ... as array-api-compat gives it). No bit views, no
number type but float32, float64 and one integer type, and every cell is clamped here, since libraries wrap, clamp or
raise each in its own way. Derivatives are finite: where a formula has none, its argument is replaced before it is
taken. Selecting the result alone is not enough, as 0 times an infinite derivative is NaN in both torch and jax.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from brdfcore.base.conventions import HALF_PI, PI_LO, THETA_MAX
from brdfcore.kernels.tables.half_coordinates import HORIZON_COS, LEAST_NORM2, MOST_NORM2

_TURN_32 = 2 * float(np.float32(np.pi))


class Limits(NamedTuple):
    """2 pi as a number of the type, and what is left of it; the smallest divisor whose square has an inverse; the
    largest theta."""

    turn: float
    turn_low: float
    least: float
    theta_max: float


#: Of x^2, highest first: (sin(x)/x - 1)/x^2, |x| <= pi/2, as the kernels have it.
SIN_SINGLE = (2.6051075e-06, -1.9809017e-04, 0.00833305, -0.16666658)
SIN_DOUBLE = (
    2.7215749245979445e-15, -7.643026556333697e-13, 1.6058940878425258e-10, -2.5052106890568332e-08,
    2.7557319211229593e-06, -0.00019841269841208676, 0.008333333333333186, -0.16666666666666666,
)  # fmt: skip
_SINGLE = Limits(_TURN_32, 2 * np.pi - _TURN_32, 2.0**-62, THETA_MAX)
_DOUBLE = Limits(2 * np.pi, 2 * PI_LO, 2.0**-500, HALF_PI)


class Pair(NamedTuple):
    """Sines and cosines of theta_i, theta_o, (theta_i - theta_o)/2 and delta_phi/2 (in [0, pi/2]); whether
    sin(delta_phi) < 0."""

    cos_i: Any
    cos_o: Any
    sin_i: Any
    sin_o: Any
    sin_b: Any
    cos_b: Any
    sin_half: Any
    cos_half: Any
    backward: Any


def limits(xp: Any, x: Any) -> Limits:
    """Those of the type of x, float32 or float64."""
    return _SINGLE if float(xp.finfo(x.dtype).eps) > 1e-10 else _DOUBLE


def in_domain(xp: Any, theta_i: Any, theta_o: Any, delta_phi: Any) -> tuple[Any, Any, Any, Any]:
    """Where all three are in their domain, and the three with 0 elsewhere; delta_phi in [-pi, pi]."""
    lim = limits(xp, theta_i)
    inside = (theta_i >= 0) & (theta_i <= lim.theta_max) & (theta_o >= 0) & (theta_o <= lim.theta_max)
    inside = inside & xp.isfinite(delta_phi)
    a, b, c = (xp.where(inside, x, xp.zeros_like(x)) for x in (theta_i, theta_o, delta_phi))
    # pi itself stays: it is no exact half of a turn, and at the horizon the mirror direction is as narrow as that
    turns = xp.where(xp.abs(c) > 0.5 * lim.turn, xp.floor(c / lim.turn + 0.5), xp.zeros_like(c))
    return inside, a, b, (c - turns * lim.turn) - turns * lim.turn_low


def at_least(xp: Any, x: Any, least: Any) -> Any:
    """max(x, least) with no derivative where `least` is it."""
    return xp.where(x > least, x, least * xp.ones_like(x))


def at_most(xp: Any, x: Any, most: Any) -> Any:
    """min(x, most) with no derivative where `most` is it."""
    return xp.where(x < most, x, most * xp.ones_like(x))


def root(xp: Any, x: Any) -> Any:
    """sqrt(x), x >= 0; at 0 its derivative is 0."""
    least = limits(xp, x).least ** 2
    some = x > least
    return xp.where(some, xp.sqrt(xp.where(some, x, xp.ones_like(x))), xp.zeros_like(x))


def taken(xp: Any, table: Any, at: Any) -> Any:
    """Rows of `table` at indices within it."""
    if _is_jax(xp):  # its take looks whether they are, and writes NaN: three times as long
        return table.at[at].get(mode="promise_in_bounds")
    return xp.take(table, at, axis=0)


def sin(xp: Any, x: Any) -> Any:
    """sin(x), |x| <= pi/2."""
    return _polynomial(xp, x) if _is_jax(xp) else xp.sin(x)


def cos(xp: Any, x: Any) -> Any:
    """cos(x), |x| <= pi/2, relative accuracy kept at the ends."""
    if not _is_jax(xp):
        return xp.cos(x)
    # the low part of pi/2 last: beside the high one jax, compiling, makes one constant of both
    lim = limits(xp, x)
    return _polynomial(xp, 0.25 * lim.turn - xp.abs(x)) + 0.25 * lim.turn_low


def _polynomial(xp: Any, x: Any) -> Any:
    """sin(x), |x| <= pi/2, in jax, which on a processor calls its own a number at a time: forty times as long."""
    z = x * x
    p = xp.zeros_like(x)
    for coefficient in SIN_SINGLE if limits(xp, x) is _SINGLE else SIN_DOUBLE:
        p = p * z + coefficient
    return x * (p * z + 1)


def _is_jax(xp: Any) -> bool:
    return getattr(xp, "__name__", "") == "jax.numpy"


def cosine(xp: Any, theta: Any) -> Any:
    """cos(theta), which at the horizon ends at that of the float64 nearest pi/2."""
    return at_least(xp, cos(xp, theta), HORIZON_COS)


def pair_of_angles(xp: Any, a: Any, b: Any, c: Any) -> Pair:
    """Of theta_i, theta_o and delta_phi as `in_domain` leaves them."""
    apart, half_turn = 0.5 * (a - b), 0.5 * xp.abs(c)
    return Pair(
        cosine(xp, a), cosine(xp, b), sin(xp, a), sin(xp, b), sin(xp, apart), cos(xp, apart),
        sin(xp, half_turn), cos(xp, half_turn), c < 0,
    )  # fmt: skip


class Vectors(NamedTuple):
    """Where both are usable, and above the horizon; wi and wo as unit vectors, their sum and wo - wi, by components."""

    usable: Any
    above: Any
    wi: tuple[Any, Any, Any]
    wo: tuple[Any, Any, Any]
    sum: tuple[Any, Any, Any]
    difference: tuple[Any, Any, Any]


def unit_vectors(xp: Any, wi: Any, wo: Any) -> Vectors:
    """Of vectors (N, 3); the normal where either is not above the horizon.

    Usable: finite, and of a squared length within [1e-12, 1e12]. Sum and difference are those of the vectors given,
    corrected for their lengths: near the mirror direction, and the light, no digit is lost.
    """
    given = [tuple(v[..., k] for k in range(3)) for v in (wi, wo)]
    norms = [x * x + y * y + z * z for x, y, z in given]
    usable = (norms[0] >= LEAST_NORM2) & (norms[0] <= MOST_NORM2) & (norms[1] >= LEAST_NORM2) & (norms[1] <= MOST_NORM2)
    above = usable & (given[0][2] > 0) & (given[1][2] > 0)
    zero, one = xp.zeros_like(norms[0]), xp.ones_like(norms[0])
    i, o = ([xp.where(above, v, other) for v, other in zip(each, (zero, zero, one))] for each in given)
    length_i, length_o = (xp.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) for v in (i, o))
    both, apart = [p + q for p, q in zip(i, o)], [q - p for p, q in zip(i, o)]
    unlike = sum((p * q for p, q in zip(both, apart)), zero)
    longer, unit = -unlike / (length_o * (length_o + length_i)), 1 / length_i
    sums, differences = (tuple((p + q * longer) * unit for p, q in zip(each, o)) for each in (both, apart))
    found = []
    for (x, y, z), per in ((i, unit), (o, 1 / length_o)):
        found.append((x * per, y * per, at_least(xp, z * per, HORIZON_COS)))
    return Vectors(usable, above, found[0], found[1], sums, differences)


def beside(xp: Any, x: Any) -> dict[str, Any]:
    """Type and place of x, for an array made beside it; jax places it by itself."""
    return {"dtype": x.dtype} if _is_jax(xp) else {"dtype": x.dtype, "device": x.device}


def index_type(xp: Any) -> Any:
    """The integers that the library counts in."""
    return xp.__array_namespace_info__().default_dtypes()["integral"]


def cell(xp: Any, position: Any, nodes: int) -> tuple[Any, Any]:
    """Node at or below a position among `nodes` >= 2 nodes, never the last, and how far beyond it."""
    first = xp.clip(xp.floor(position), 0.0, float(nodes - 2))
    return xp.astype(first, index_type(xp)), position - first


def along(xp: Any, table: Any, at: Any, part: Any) -> Any:
    """Linear in a table (n,) between `at` and the next."""
    low = taken(xp, table, at)
    return low + part * (taken(xp, table, at + 1) - low)


def trilinear(xp: Any, values: Any, at: Any, parts: Any) -> Any:
    """values (n_0, n_1, n_2, C) within the cells `at`, three arrays (N,), at `parts`; (N, C)."""
    _, n_1, n_2, channels = values.shape
    flat = xp.reshape(values, (-1, channels))
    u, v, w = (part[:, None] for part in parts)
    first = (at[0] * n_1 + at[1]) * n_2 + at[2]

    def edge(node: Any) -> Any:
        low = taken(xp, flat, node)
        return low + w * (taken(xp, flat, node + 1) - low)

    def face(node: Any) -> Any:
        low = edge(node)
        return low + v * (edge(node + n_2) - low)

    low = face(first)
    return low + u * (face(first + n_1 * n_2) - low)
