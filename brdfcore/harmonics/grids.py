"""An expansion where its sums separate: values on a grid of directions, and the albedo in closed form.

On a grid every order needs three small matrix products instead of a sum for each point: at degree 256 that is some ten
thousand times less work than as many single values.

The albedo takes order 0 alone, since int cos(m delta_phi) = 0 for m > 0:

    int f c_o dwo = 2 pi sum_(l,l') rho_ll'0 p_l(c_i)/c_i^j int_0^1 p_l'(x) x^(1-j') dx

with j, j' = 1 where the target holds that cosine. The integrand is a polynomial: Gauss-Legendre of half its degree is
exact.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels
from brdfcore.harmonics.legendre import Parity, legendre
from brdfcore.harmonics.targets import Block

Float64Array = npt.NDArray[np.float64]


class Coefficients(Protocol):
    """What is read of an expansion."""

    lmax: int
    channels: Channels

    @property
    def blocks(self) -> list[Block]: ...

    @property
    def target_parities(self) -> tuple[Parity, Parity]: ...

    def coefficients(self, m: int, *, sines: bool = False) -> Float64Array: ...


def grid_values(
    made: Coefficients, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array
) -> Float64Array:
    """f_r in 1/sr at every combination of n, k, p angles, radians; float64 (n, k, p, channels)."""
    parity_i, parity_o = made.target_parities
    x_i, x_o = np.cos(theta_i), np.cos(theta_o)
    found = np.zeros((len(made.channels), theta_i.size, theta_o.size, delta_phi.size))
    for block in made.blocks:
        p_i, p_o = (_functions(made.lmax, block.m, x, parity) for x, parity in ((x_i, parity_i), (x_o, parity_o)))
        rho = made.coefficients(block.m, sines=block.sine)
        turned = (np.sin if block.sine else np.cos)(block.m * delta_phi)
        found += (block.weight * (p_i.T @ rho @ p_o))[..., None] * turned
    return np.moveaxis(found, 0, -1)


def albedo(made: Coefficients, theta_i: Float64Array) -> Float64Array:
    """int f c_o dwo without the delta part, exact but for rounding; float64 (n, channels) at n angles, radians."""
    parity_i, parity_o = made.target_parities
    nodes, weights = np.polynomial.legendre.leggauss(made.lmax // 2 + 2)
    x, w = 0.5 * (nodes + 1), 0.5 * weights
    p = legendre(made.lmax, x, parity=parity_o, last_order=0)
    integrals = (p if parity_o == "odd" else p * x) @ w
    p_i = _functions(made.lmax, 0, np.cos(theta_i), parity_i)
    return np.asarray(2 * np.pi * (p_i.T @ (made.coefficients(0) @ integrals).T))


def _functions(lmax: int, m: int, x: Float64Array, parity: Parity) -> Float64Array:
    """p_l^m, divided by x where the target holds the cosine; (degrees, n)."""
    return legendre(lmax, x, parity=parity, over_x=parity == "odd", first_order=m, last_order=m)
