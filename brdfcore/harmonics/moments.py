"""Project samples of a BRDF: orders by sums over delta_phi, degrees by sums over both cosines.

h_l = sqrt(4 pi) p_l^m is orthonormal on [0, 1] among the degrees of one parity. With g the target,
G_m = mean over delta_phi of g cos(m delta_phi):

    R_ll' = int int G_m h_l(c_i) h_l'(c_o) dc_i dc_o,   rho = 4 pi R,   mean of g^2 = sum_m (2-d_m0) |R|^2

Sums over delta_phi are matrix products with cos(m delta_phi): at these lengths a product with all cores is as fast as
FFTs, and takes graded nodes too.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.quadrature import gauss_legendre
from brdfcore.harmonics.legendre import legendre, order_offset
from brdfcore.harmonics.rules import Rule
from brdfcore.harmonics.targets import Block, Target, blocks
from brdfcore.kernels.machine.blas import one_blas_thread
from brdfcore.kernels.machine.blocks import threads

Float64Array = npt.NDArray[np.float64]
Progress = Callable[[int, int, str], None]

#: Values that a thread samples at a time: with their angles 100 MB.
_VALUES = 3_000_000


@dataclass
class Moments:
    """What a rule found, a list entry a block of `targets.blocks`.

    rho     (channels, k, k') coefficients.
    cross   (channels, k, k') the same sums of f over h/x^2 instead of g over h, in units of rho: the scalar product of
            f with the reconstruction, for the error of f itself; the same list as rho where nothing is divided.
    energy, energy_f   (channels,) ||g||^2 and ||f||^2 over both hemispheres, one azimuth, over 2 pi, in units of rho^2:
            sum (2-d_m0) |rho|^2 -> energy.
    """

    lmax: int
    target: Target
    bilateral: bool
    blocks: list[Block]
    rho: list[Float64Array]
    cross: list[Float64Array]
    energy: Float64Array
    energy_f: Float64Array
    evaluations: int


def moments(b: Brdf, target: Target, rule: Rule, progress: Progress | None = None) -> Moments:
    """Sample `b` on `rule` and project; `InputError` where a value is not finite."""
    work = _Work(b, target, rule)
    slabs = work.slabs()
    # several slabs beside each other, each with the plain product
    with one_blas_thread(), ThreadPoolExecutor(threads()) as pool:
        for done, _ in enumerate(pool.map(work.sum_over_theta_o, slabs), 1):
            if progress is not None:
                progress(done, len(slabs), "projecting")
        rho = list(pool.map(partial(work.sum_over_theta_i, work.inner), range(len(work.blocks))))
        cross = rho
        if work.divided:
            cross = list(pool.map(partial(work.sum_over_theta_i, work.inner_f), range(len(work.blocks))))
    units = (4 * np.pi) ** 2 * work.w_i
    return Moments(
        rule.lmax, target, rule.bilateral, work.blocks, rho, cross, units @ work.squares[0], units @ work.squares[1],
        rule.evaluations,
    )  # fmt: skip


class _Work:
    """The arrays of one projection; its methods write to separate parts of them and run beside each other."""

    def __init__(self, b: Brdf, target: Target, rule: Rule) -> None:
        self.source, self.target, self.rule, self.channels = b, target, rule, len(b.channels)
        self.blocks = blocks(rule.lmax, target, rule.bilateral)
        self.divided = bool(target.cos_i or target.cos_o)
        self.x_i, self.w_i = rule.outer()
        self.x_o, self.w_o = gauss_legendre(rule.lmax + 2) if rule.graded else rule.outer()
        self.theta_i = _angles(self.x_i)
        scale = np.sqrt(4 * np.pi)
        self.left = legendre(rule.lmax, self.x_i, parity=target.parity_i) * scale
        shared = target.symmetric and not rule.graded
        self.right = self.left if shared else legendre(rule.lmax, self.x_o, parity=target.parity_o) * scale
        self.phi, self.w_phi = rule.azimuth()
        self.waves = np.stack([(np.sin if k.sine else np.cos)(k.m * self.phi) * self.w_phi for k in self.blocks])
        self.odd = np.array([k.m % 2 == 1 for k in self.blocks])
        self.inner = [np.empty((k.columns, self.x_i.size, self.channels)) for k in self.blocks]
        self.inner_f = [np.empty_like(a) for a in self.inner] if self.divided else self.inner
        # int (mean of g^2) dc_o, and of f^2, at each theta_i
        self.squares = np.empty((2, self.x_i.size, self.channels))
        #: First row of the cosine block m among `legendre`'s; sine blocks use the same rows.
        self.rows, self.columns = (
            {k.m: order_offset(rule.lmax, k.m, parity) for k in self.blocks}
            for parity in (target.parity_i, target.parity_o)
        )

    def slabs(self) -> list[slice]:
        across = self.rule.inner(0.8)[0].size if self.rule.graded else self.x_o.size
        step = max(min(_VALUES // (self.phi.size * across * self.channels), 16), 1)
        return [slice(k, min(k + step, self.x_i.size)) for k in range(0, self.x_i.size, step)]

    def sum_over_theta_o(self, part: slice) -> None:
        pieces = [slice(i, i + 1) for i in range(part.start, part.stop)] if self.rule.graded else [part]
        sums = [self._sampled(piece) for piece in pieces]
        for which, found in ((0, self.inner), (1, self.inner_f))[: 1 + self.divided]:
            summed = np.concatenate([s[which] for s in sums]) if len(sums) > 1 else sums[0][which]
            for k, block in enumerate(self.blocks):
                first = self.columns[block.m]
                order = summed[:, k].transpose(1, 0, 2).reshape(self.x_o.size, -1)
                product = self.right[first : first + block.columns] @ order
                found[k][:, part] = product.reshape(block.columns, -1, self.channels)

    def sum_over_theta_i(self, source: list[Float64Array], k: int) -> Float64Array:
        block, first = self.blocks[k], self.rows[self.blocks[k].m]
        p = self.left[first : first + block.rows] * self.w_i
        summed = p @ source[k].transpose(1, 0, 2).reshape(self.x_i.size, -1)
        return np.asarray(4 * np.pi * np.moveaxis(summed.reshape(block.rows, block.columns, self.channels), -1, 0))

    def _sampled(self, part: slice) -> tuple[Float64Array, Float64Array]:
        """Orders of g and of f over the cosines, (nodes, blocks, x_o, channels), with the weights of theta_o's
        quadrature: to be summed against functions at x_o."""
        if self.rule.graded:
            theta_o, w = self.rule.inner(float(self.theta_i[part.start]))
            x = np.cos(theta_o)
        else:
            x, w, theta_o = self.x_o, self.w_o, _angles(self.x_o)
        f = _finite(self.source, self.theta_i[part, None, None], theta_o[None, None, :], self.phi[None, :, None])
        flat = f.reshape(f.shape[0], self.phi.size, -1)
        means = (self.waves @ flat).reshape(f.shape[0], len(self.blocks), x.size, self.channels)
        flat *= flat
        squares = (self.w_phi @ flat).reshape(f.shape[0], x.size, self.channels)
        power_i = self.x_i[part, None, None, None] ** self.target.cos_i
        power_o = x[:, None] ** self.target.cos_o
        self.squares[0, part] = np.einsum("ioc,o->ic", squares, w * power_o[:, 0] ** 2) * power_i[:, 0, 0] ** 2
        self.squares[1, part] = np.einsum("ioc,o->ic", squares, w)
        found = [means * (power_i * (w[:, None] * power_o))]
        if self.divided:
            found.append(means * ((w[:, None] / power_o) / power_i))
        if self.rule.graded:
            spread = [_spread(x, self.x_o, odd) for odd in (False, True)]
            found = [self._gathered(sums, spread) for sums in found]
        return found[0], found[-1]

    def _gathered(self, sums: Float64Array, spread: list[Float64Array]) -> Float64Array:
        """(1, blocks, x, channels) -> (1, blocks, x_o, channels): the same sums against functions given at x_o."""
        _, orders, size, channels = sums.shape
        found = np.empty((1, orders, self.x_o.size, channels))
        for which in (False, True):
            some = np.ascontiguousarray(sums[0, self.odd == which].transpose(1, 0, 2)).reshape(size, -1)
            found[0, self.odd == which] = (spread[which] @ some).reshape(self.x_o.size, -1, channels).transpose(1, 0, 2)
        return found


def _angles(x: Float64Array) -> Float64Array:
    return np.minimum(np.arctan2(np.sqrt((1 - x) * (1 + x)), x), np.pi / 2)


def _finite(b: Brdf, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    f = b.evaluate(theta_i, theta_o, delta_phi).astype(np.float64, copy=False)
    # one pass without a temporary: an infinite or NaN value makes the sum so
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(np.abs(f.sum()))
    if not np.isfinite(total):
        bad = np.argwhere(~np.isfinite(f))
        at = tuple(bad[0][:3]) if len(bad) else (0, 0, 0)
        angles = np.broadcast_arrays(theta_i, theta_o, delta_phi)
        degrees = [round(float(np.degrees(a[at])), 6) for a in angles]
        raise InputError(
            "source_not_finite",
            f"the source is not finite, or too large to sum, at theta_i, theta_o, delta_phi = {degrees} degrees",
            where="source",
            got=degrees,
            expected="finite values",
        )
    return f


def _spread(x: Float64Array, nodes: Float64Array, odd: bool) -> Float64Array:
    """(nodes, x): functions of one order at `nodes`, times this, are their values at x.

    p_l^m is a polynomial of degree below the number of nodes, times sin(theta) where m is `odd`: barycentric
    interpolation is exact. Weights of Gauss-Legendre nodes: (-1)^j sqrt((1-t^2) w) (H. Wang and S. Xiang 2012,
    DOI 10.1090/S0025-5718-2011-02549-4).
    """
    _, w = gauss_legendre(nodes.size)
    weights = np.sqrt(nodes * (1 - nodes) * w)
    weights[1::2] *= -1
    difference = x[None, :] - nodes[:, None]
    hit = difference == 0
    difference[hit] = 1.0
    matrix = weights[:, None] / difference
    matrix /= matrix.sum(axis=0)
    for column in np.flatnonzero(hit.any(axis=0)):
        matrix[:, column] = hit[:, column]
    if odd:
        sine_x, sine = (np.sqrt((1 - t) * (1 + t)) for t in (x, nodes))
        matrix *= sine_x[None, :] / sine[:, None]
    return matrix
