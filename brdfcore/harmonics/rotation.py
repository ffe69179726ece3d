"""Rotation of real spherical harmonics by orthogonal matrices that keep their digits at any degree.

About z a rotation turns pairs of cos m phi and sin m phi. Any other is made of such turns and of J, which exchanges y
and z: R_y(beta) = J R_z(-beta) J (D. Pinchon and P. Hoggan 2007, DOI 10.1088/1751-8113/40/7/011). J's entries are
Wigner's d^l_mk(pi/2), by upward recursion in l at fixed m, k from 2^-m binom(2m, m-k)^1/2: it grows until the functions
oscillate, so rounding is not amplified. Three quarters of them are 0 by parity, and J is its own inverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import as_float
from brdfcore.base.errors import InputError
from brdfcore.harmonics.legendre import checked_degree

Float64Array = npt.NDArray[np.float64]

#: Largest degree: J takes 45 MB there.
MAX_ROTATED = 256
#: How far R^T R may be from 1: products of a few matrices given in float32 still pass.
_ORTHONORMAL = 1e-5


@dataclass(frozen=True)
class Swap:
    """J of one degree, what is not 0: rows and columns are orders of l + m even (`e`) or odd (`o`), ascending.

    cosines_e from cosines_e, cosines_o from sines_e (and its transpose back), sines_o from sines_o.
    """

    cosines: Float64Array
    mixed: Float64Array
    sines: Float64Array


def orders_of(l: int, odd: bool, sines: bool) -> npt.NDArray[np.int64]:  # noqa: E741
    """Orders m <= l with l + m odd or even; from 1 on for sines."""
    first = (l + odd) % 2
    return np.arange(first if first or not sines else 2, l + 1, 2)


@lru_cache(maxsize=2)
def swaps(lmax: int) -> tuple[Swap, ...]:
    """J for degrees 0 ... lmax."""
    lmax = checked_degree(lmax, MAX_ROTATED)
    found = []
    for l, d in enumerate(_quarter_turns(lmax)):  # noqa: E741
        ce, co = orders_of(l, False, False), orders_of(l, True, False)
        se, so = orders_of(l, False, True), orders_of(l, True, True)
        found.append(Swap(_signed(d, ce, ce, 1), _signed(d, co, se, 1), _signed(d, so, so, -1)))
    return tuple(found)


def _signed(d: Float64Array, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], sign: int) -> Float64Array:
    """2 d^l_mk with J's sign; 1/sqrt(2) for m = 0 and for k = 0, whose functions have no sqrt(2)."""
    apart = np.abs(rows[:, None] - columns[None, :])
    scale = np.where(rows == 0, np.sqrt(2), 2.0)[:, None] * np.where(columns == 0, np.sqrt(0.5), 1.0)
    return np.ascontiguousarray(sign * np.where(apart // 2 % 2, -1.0, 1.0) * scale * d[np.ix_(rows, columns)])


def _quarter_turns(lmax: int) -> list[Float64Array]:
    """|sign| d^l_mk(pi/2), (l+1, l+1) for 0 <= m, k <= l, each started positive at l = max(m, k)."""
    m = np.arange(lmax + 1.0)
    squares, products = m[:, None] ** 2, m[:, None] * m[None, :]
    last, now = np.zeros((2, lmax + 1, lmax + 1))
    now[0, 0] = 1.0
    found = [now[:1, :1].copy()]
    for q in range(lmax):
        new = np.zeros_like(now)
        n = q + 1
        part = np.s_[:n, :n]
        up = np.sqrt(((n * n - squares) * (n * n - squares.T))[part])
        if q:
            down = np.sqrt(((q * q - squares) * (q * q - squares.T))[part])
            new[part] = -((2 * q + 1) * products[part] * now[part] + n * down * last[part]) / (q * up)
        # q = 0: cos(pi/2) d^0, which is 0
        k = np.arange(n)
        # d^n_nk: 2^-n, then sqrt((n+k)/(n-k+1)) a step of k down
        steps = np.sqrt((n + np.arange(n, 0, -1.0)) / (n - np.arange(n, 0, -1.0) + 1))
        seeds = np.cumprod(np.concatenate([[0.5**n], steps]))
        new[n, n] = seeds[0]
        new[n, k] = new[k, n] = seeds[:0:-1]
        last, now = now, new
        found.append(now[: n + 1, : n + 1].copy())
    return found


def swap(l: int, values: Float64Array) -> Float64Array:  # noqa: E741
    """J times coefficients of one degree, (2l+1, n), rows m = -l ... l."""
    j = swaps(_table(l))[l]
    ce, co = l + orders_of(l, False, False), l + orders_of(l, True, False)
    se, so = l - orders_of(l, False, True), l - orders_of(l, True, True)
    found = np.empty_like(values)
    found[ce] = j.cosines @ values[ce]
    found[co] = j.mixed @ values[se]
    found[se] = j.mixed.T @ values[co]
    found[so] = j.sines @ values[so]
    return found


def _table(l: int) -> int:  # noqa: E741
    """A power of two: few tables for many degrees."""
    return min(max(1 << max(l - 1, 0).bit_length(), 32), MAX_ROTATED)


def turn(l: int, values: Float64Array, angle: float) -> Float64Array:  # noqa: E741
    """The coefficients (2l+1, n) of f turned by `angle` about z: f(theta, phi - angle)."""
    m = np.arange(-l, l + 1)
    # with m < 0 for sines: a cos - b sin at m > 0, a sin + b cos at -m
    return np.asarray(np.cos(m * angle)[:, None] * values - np.sin(m * angle)[:, None] * values[::-1])


def rotated(coefficients: Float64Array, rotation: npt.ArrayLike) -> Float64Array:
    """Coefficients ((lmax+1)^2, channels) of f(R^-1 w), the function carried along by the rotation matrix R (3, 3).

    Raises `InputError` for what is no rotation, `LimitError` above `MAX_ROTATED`.
    """
    alpha, beta, gamma = euler(checked_rotation(rotation))
    lmax = checked_degree(int(np.sqrt(len(coefficients))) - 1, MAX_ROTATED)
    found = np.empty_like(coefficients)
    for l in range(lmax + 1):  # noqa: E741
        part = slice(l * l, (l + 1) ** 2)
        inner = swap(l, turn(l, coefficients[part], gamma))
        found[part] = turn(l, swap(l, turn(l, inner, -beta)), alpha)
    return found


def euler(r: Float64Array) -> tuple[float, float, float]:
    """alpha, beta, gamma with R = R_z(alpha) R_y(beta) R_z(gamma); no angle from an arc cosine, so that small and
    straight beta keep their digits, and there, where only alpha + gamma or their difference counts, that is kept."""
    alpha = float(np.arctan2(r[1, 2], r[0, 2]))
    beta = float(np.arctan2(np.hypot(r[0, 2], r[1, 2]), r[2, 2]))
    first = np.array([np.cos(alpha) * np.cos(beta), np.sin(alpha) * np.cos(beta), -np.sin(beta)])
    second = np.array([-np.sin(alpha), np.cos(alpha), 0.0])
    return alpha, beta, float(np.arctan2(r[:, 0] @ second, r[:, 0] @ first))


def checked_rotation(rotation: npt.ArrayLike) -> Float64Array:
    """`rotation` as float64 (3, 3); `InputError` unless R^T R = 1 and det R = 1."""
    r = as_float("rotation", rotation).astype(np.float64)
    if r.shape != (3, 3) or not np.isfinite(r).all():
        raise InputError(
            "bad_rotation",
            f"rotation: expected a finite matrix of shape (3, 3), got {r.shape}",
            where="rotation",
            got=list(r.shape),
            expected="(3, 3)",
        )
    off, determinant = float(np.abs(r.T @ r - np.eye(3)).max()), float(np.linalg.det(r))
    if off > _ORTHONORMAL or determinant < 0:
        raise InputError(
            "bad_rotation",
            f"rotation: its columns are off orthonormal by {off:.3g} and its determinant is {determinant:.6g}; "
            "expected a rotation matrix (a mirror image is none)",
            where="rotation",
            got=determinant,
            expected="orthonormal columns, determinant 1",
        )
    return r
