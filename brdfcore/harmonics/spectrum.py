"""Errors of an expansion from its coefficients: Parseval's, in the target's norm and in that of f.

Relative L2 over pairs of directions, dc_i dc_o d(delta_phi). ||g - g'||^2 = ||g||^2 - |rho|^2 + |rho' - rho|^2 where
rho are the projection's coefficients and rho' those kept. For f = g/(c_i c_o) functions p/x are not orthogonal: their
Gram matrix K enters, ||f'||^2 = sum (2-d_m0) tr(rho' K rho'^T K), and <f, f'> needs the sums `Moments.cross`.
Differences of squares: an error below 1e-8 of the whole is rounding.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from brdfcore.base.quadrature import gauss_legendre
from brdfcore.harmonics.legendre import Parity, legendre
from brdfcore.harmonics.moments import Moments
from brdfcore.harmonics.targets import degrees_of

Float64Array = npt.NDArray[np.float64]


def energy_by_degree(found: Moments, rho: list[Float64Array] | None = None) -> Float64Array:
    """(channels, lmax + 1): sum of (2-d_m0) rho^2 over the coefficients whose larger degree is l."""
    total = np.zeros((found.energy.size, found.lmax + 1))
    for block, r in zip(found.blocks, found.rho if rho is None else rho):
        rows, columns = degrees_of(block, found.lmax, found.target)
        larger = np.maximum(rows[:, None], columns[None, :]).reshape(-1)
        for channel, values in enumerate(r):
            square = (values * values).reshape(-1)
            total[channel] += block.weight * np.bincount(larger, square, found.lmax + 1)
    return total


def error_by_degree(found: Moments) -> Float64Array:
    """Truncation error, relative L2 of the target, channels together, if the expansion ended at degree 0 ... lmax."""
    left = found.energy.sum() - np.cumsum(energy_by_degree(found).sum(axis=0))
    return np.asarray(np.sqrt(np.maximum(left, 0) / _positive(found.energy.sum())))


def target_error(found: Moments, kept: list[Float64Array] | None = None) -> Float64Array:
    """(channels,): squared L2 of target minus expansion with the coefficients `kept` (None: all found)."""
    square = found.energy.copy()
    for k, (block, r) in enumerate(zip(found.blocks, found.rho)):
        square -= block.weight * (r * r).sum(axis=(1, 2))
        if kept is not None:
            square += block.weight * ((kept[k] - r) ** 2).sum(axis=(1, 2))
    return np.maximum(square, 0)


def value_error(found: Moments, kept: list[Float64Array] | None = None) -> Float64Array:
    """(channels,): squared L2 of f minus what `kept` says of f."""
    if not (found.target.cos_i or found.target.cos_o):
        return target_error(found, kept)
    kept = found.rho if kept is None else kept
    square = found.energy_f - 2 * sum(
        block.weight * (r * t).sum(axis=(1, 2)) for block, r, t in zip(found.blocks, kept, found.cross)
    )
    return np.asarray(np.maximum(square + value_norm(found, kept), 0))


def value_norm(found: Moments, rho: list[Float64Array]) -> Float64Array:
    """(channels,): squared L2 of the f that coefficients `rho` stand for."""
    total = np.zeros(found.energy.size)
    for block, r in zip(found.blocks, rho):
        left, right = (_gram(found.lmax, block.m, parity) for parity in (found.target.parity_i, found.target.parity_o))
        total += block.weight * ((left @ r @ right) * r).sum(axis=(1, 2))
    return total


@lru_cache(maxsize=2_048)
def _gram(lmax: int, m: int, parity: Parity) -> Float64Array:
    """4 pi int_0^1 (p_l/x)(p_l'/x) dx of one order's odd functions; the identity for even ones, where nothing is
    divided."""
    x, w = gauss_legendre(lmax + 2)
    odd = parity == "odd"
    p = legendre(lmax, x, parity=parity, over_x=odd, first_order=m, last_order=m)
    return np.asarray(4 * np.pi * (p * w) @ p.T)


def distance(a: Moments, rho: list[Float64Array], other: list[Float64Array]) -> tuple[float, float]:
    """L2 distance of two lists of coefficients relative to `a`'s target, and to its f; channels together."""
    difference = [r - s for r, s in zip(rho, other)]
    square = sum(block.weight * float((d * d).sum()) for block, d in zip(a.blocks, difference))
    in_target = float(np.sqrt(square / _positive(a.energy.sum())))
    return in_target, float(np.sqrt(value_norm(a, difference).sum() / _positive(a.energy_f.sum())))


def _positive(total: float) -> float:
    """A norm to divide by: nothing has no relative error."""
    return float(total) if total > 0 else 1.0
