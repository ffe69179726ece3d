"""Orthonormal associated Legendre functions p_l^m and spherical harmonics, stable at any degree and order.

    p_l^m(x) = sqrt((2l+1)/(4 pi) (l-m)!/(l+m)!) P_l^m(x) without the phase (-1)^m,   int_-1^1 (p_l^m)^2 dx = 1/(2 pi)

Every value is within 1e-12 of the exact one for the float64 x given, relative to itself, also beside zeros of p (the
largest of 3e5 found to l = 1024 is 2.3e-13, to 4096 5.4e-13); that zero itself moves by l dx when x does, so digits of
p there say something only if x is exact. 0 is returned where x is a zero, and where |p| < 2^-1074. Recursion and
exponents: `kernels.harmonics.legendre`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError, LimitError
from brdfcore.base.parameters import shown

Float64Array = npt.NDArray[np.float64]
Parity = Literal["odd", "even"]

#: Largest degree: its recursion coefficients take 200 MB.
MAX_DEGREE = 4_096
#: Largest array of values, bytes.
MAX_BYTES = 4_000_000_000


def order_size(lmax: int, m: int, parity: Parity | None = None) -> int:
    """How many degrees l = m ... lmax of order m there are: all, or those with l - m odd or even."""
    return max(_degrees_left(lmax, m, parity), 0)


def order_offset(lmax: int, m: int, parity: Parity | None = None) -> int:
    """Row of the first degree of order m among the rows of `legendre`: one order after the other, degrees ascending."""
    return int(_rows_before(lmax, min(m, lmax + 1), parity))


def degrees(lmax: int, m: int, parity: Parity | None = None) -> npt.NDArray[np.int64]:
    """The degrees of order m, in the order of the rows."""
    skip, stride = _walk(parity)
    return np.arange(m + skip, lmax + 1, stride)


def entries(lmax: int, parity: Parity | None = None) -> int:
    """Rows of `legendre(lmax, ...)`: (lmax+1)(lmax+2)/2 without parity."""
    return order_offset(lmax, lmax + 1, parity)


def legendre(
    lmax: int,
    x: npt.ArrayLike,
    *,
    parity: Parity | None = None,
    over_x: bool = False,
    first_order: int = 0,
    last_order: int | None = None,
) -> Float64Array:
    """p_l^m(x) for all m <= l <= lmax; float64 (entries, *x.shape), rows as `order_offset` counts them.

    Parameters
    ----------
    lmax : int
        Largest degree, 0 to `MAX_DEGREE`.
    x : array_like
        Nodes in [-1, 1], cos theta.
    parity : {"odd", "even"}, optional
        Only degrees with l - m odd (p odd in x), or even.
    over_x : bool
        p/x instead, for parity="odd": finite, with its limit at x = 0.
    first_order, last_order : int
        Only these orders m, both included: blocks of what would not fit into memory at once.

    Raises `InputError` for nodes outside [-1, 1] or NaN, `LimitError` for a degree or a size too large.
    """
    lmax = checked_degree(lmax)
    last = lmax if last_order is None else last_order
    if not 0 <= first_order <= last <= lmax:
        raise InputError(
            "bad_order", f"orders {first_order} to {last}: expected 0 <= first <= last <= lmax = {lmax}", where="m"
        )
    if over_x and parity != "odd":
        raise InputError("bad_parity", "over_x: p/x is finite at 0 for parity='odd' only", where="parity")
    nodes = _checked_nodes(x)
    rows = order_offset(lmax, last + 1, parity) - order_offset(lmax, first_order, parity)
    size = rows * max(nodes.size, 1) * 8
    if size > MAX_BYTES:
        raise LimitError(
            "legendre_too_large",
            f"p_l^m to degree {lmax} at {nodes.size} nodes take {size} bytes; the limit is {MAX_BYTES}: "
            "ask for fewer orders at a time",
            where="x",
            got=size,
            limit=MAX_BYTES,
        )
    flat = nodes.reshape(-1)
    if over_x:
        # p is odd: below 1e-150 p(x)/x is its limit to all digits, and 1e-150 divides without losing any
        flat = np.where(np.abs(flat) < 1e-150, 1e-150, flat)
    out = _values(lmax, flat, first_order, last, parity, rows)
    if over_x:
        out /= flat
    return out.reshape(rows, *nodes.shape)


def _values(lmax: int, x: Float64Array, first: int, last: int, parity: Parity | None, rows: int) -> Float64Array:
    from brdfcore.kernels.harmonics.legendre import legendre_orders, seeds

    skip, stride = _walk(parity)
    orders = np.arange(first, last + 1)
    starts = _rows_before(lmax, orders, parity) - _rows_before(lmax, first, parity)
    mantissa, exponent = np.empty((2, orders.size, x.size))
    seeds(x.size * last, x, _factors(lmax)[: last + 1], first, mantissa, exponent)
    values = _aligned(rows, x.size)
    legendre_orders(values.size, x, mantissa, exponent, _coefficients(lmax), lmax, first, starts, skip, stride, values)
    return values


def _aligned(rows: int, columns: int) -> Float64Array:
    """Empty, from a multiple of 64 bytes on: vectors that straddle two lines of the cache take a fifth more time."""
    room = np.empty(rows * columns + 7)
    skipped = -room.ctypes.data // 8 % 8
    return room[skipped : skipped + rows * columns].reshape(rows, columns)


@lru_cache(maxsize=4)
def _factors(lmax: int) -> Float64Array:
    """c_0 and c_m/c_(m-1): 4 pi c_m^2 = prod_k (2k+1)/(2k)."""
    m = np.arange(1, lmax + 1)
    out = np.concatenate([[1 / np.sqrt(4 * np.pi)], np.sqrt((2 * m + 1) / (2 * m))])
    out.flags.writeable = False
    return out


@lru_cache(maxsize=4)
def _coefficients(lmax: int) -> Float64Array:
    from brdfcore.kernels.harmonics.legendre import recursion_coefficients
    from brdfcore.kernels.harmonics.legendre_steps import STEPS

    out = np.empty((entries(lmax) + STEPS - 1, 3))
    recursion_coefficients(entries(lmax), lmax, out)
    out.flags.writeable = False
    return out


def _walk(parity: Parity | None) -> tuple[int, int]:
    """(first l - m, step of l)."""
    if parity not in (None, "odd", "even"):
        raise InputError("bad_parity", f"parity = {shown(parity)}: expected 'odd', 'even' or None", where="parity")
    return (0, 1) if parity is None else (1 if parity == "odd" else 0, 2)


def _rows_before(lmax: int, m: Any, parity: Parity | None) -> Any:
    """Rows of the orders below m <= lmax + 1, a number or an array: the sum of n, or of floor(n/2), n descending."""
    skip, stride = _walk(parity)
    longest = lmax + 1 - skip + (stride - 1)
    if stride == 1:
        return m * longest - m * (m - 1) // 2
    return longest * longest // 4 - (longest - m) ** 2 // 4


def _degrees_left(lmax: int, m: int, parity: Parity | None) -> int:
    skip, stride = _walk(parity)
    return (lmax - m - skip) // stride + 1


def checked_degree(lmax: Any, limit: int = MAX_DEGREE) -> int:
    """`lmax` as a whole number in [0, limit]; `InputError`, or `LimitError` above it."""
    if isinstance(lmax, (bool, np.bool_)) or not isinstance(lmax, (int, np.integer)) or lmax < 0:
        raise InputError(
            "bad_lmax", f"lmax = {shown(lmax)}: expected a whole number >= 0", where="lmax", got=shown(lmax)
        )
    if lmax > limit:
        raise LimitError(
            "lmax_too_large", f"lmax = {int(lmax)}: the limit is {limit}", where="lmax", got=int(lmax), limit=limit
        )
    return int(lmax)


def _checked_nodes(x: npt.ArrayLike) -> Float64Array:
    try:
        nodes = np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("bad_nodes", f"x: expected numbers in [-1, 1], got {shown(x)}", where="x") from error
    bad = ~(np.abs(nodes) <= 1)  # true for NaN
    if bad.any():
        index = [int(k) for k in np.argwhere(bad)[0]]
        got = float(nodes[tuple(index)])
        raise InputError(
            "bad_nodes", f"x{index} = {got}: expected a number in [-1, 1]", where="x", index=index, got=str(got)
        )
    return nodes


# ---- spherical harmonics ------------------------------------------------------------------------------


@dataclass(frozen=True)
class SphericalHarmonics:
    """Y_l^m(theta, phi) for l <= lmax, with what else a reader has to know about them.

    lmax           largest degree.
    kind           "real": sqrt(2) p cos(m phi), p, sqrt(2) p sin(|m| phi) for m > 0, = 0, < 0; "complex":
                   p_l^|m| exp(i m phi).
    normalisation  "orthonormal": int |Y|^2 dw = 1; "4pi": 4 pi (geodesy); "schmidt": 4 pi/(2l+1).
    phase          True: with the Condon-Shortley phase (-1)^m for m > 0 (both signs of m for the real kind).
    """

    lmax: int
    kind: Literal["real", "complex"] = "real"
    normalisation: Literal["orthonormal", "4pi", "schmidt"] = "orthonormal"
    phase: bool = False

    def __post_init__(self) -> None:
        checked_degree(self.lmax)
        for name, allowed in (("kind", ("real", "complex")), ("normalisation", ("orthonormal", "4pi", "schmidt"))):
            if getattr(self, name) not in allowed:
                got = shown(getattr(self, name))
                raise InputError("bad_option", f"{name} = {got}: expected one of {', '.join(allowed)}", where=name)

    @staticmethod
    def index(l: int, m: int) -> int:  # noqa: E741
        """Row of Y_l^m: l^2 + l + m."""
        return l * l + l + m

    def evaluate(self, theta: npt.ArrayLike, phi: npt.ArrayLike) -> npt.NDArray[Any]:
        """Y at polar angle theta in [0, pi] and azimuth phi, radians; ((lmax+1)^2, *broadcast shape)."""
        theta, phi = np.broadcast_arrays(np.asarray(theta, np.float64), np.asarray(phi, np.float64))
        p = legendre(self.lmax, np.cos(theta))
        found = np.empty(((self.lmax + 1) ** 2, *theta.shape), np.complex128 if self.kind == "complex" else np.float64)
        for m in range(self.lmax + 1):
            rows = degrees(self.lmax, m)
            first = order_offset(self.lmax, m)
            block = p[first : first + rows.size] * self._scale(rows).reshape(-1, *([1] * theta.ndim))
            sign = -1.0 if self.phase and m % 2 else 1.0
            at = rows * rows + rows
            if self.kind == "complex":
                turned = block * np.exp(1j * m * phi)
                found[at + m] = sign * turned
                # Y_l^-m = (-1)^m conj(Y_l^m) with the phase, its conjugate without
                found[at - m] = turned.conj()
            elif m == 0:
                found[at] = block
            else:
                found[at + m] = sign * np.sqrt(2) * block * np.cos(m * phi)
                found[at - m] = sign * np.sqrt(2) * block * np.sin(m * phi)
        return found

    def _scale(self, l: npt.NDArray[np.int64]) -> Float64Array:  # noqa: E741
        if self.normalisation == "orthonormal":
            return np.ones(l.size)
        whole = np.full(l.size, 4 * np.pi)
        return np.sqrt(whole if self.normalisation == "4pi" else whole / (2 * l + 1))
