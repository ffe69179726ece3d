"""An order's coefficients as a small core between two bases: rho ~ left^T core right.

Left and right are orthonormal bases of the largest principal directions of rho, of all its channels and of cosines and
sines together (Tucker decomposition in two of three directions; L. De Lathauwer et al. 2000,
DOI 10.1137/S0895479896305696). What is dropped is known: |rho|^2 - |core|^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.harmonics.targets import Block

Float64Array = npt.NDArray[np.float64]


@dataclass
class Order:
    """One order: bases (rank, degrees), or None for the identity; cores (channels, rank_i, rank_o), sines or None."""

    left: Float64Array | None
    right: Float64Array | None
    cosines: Float64Array
    sines: Float64Array | None

    def coefficients(self, core: Float64Array) -> Float64Array:
        """rho (channels, k, k') of one of the cores."""
        rho = core if self.left is None else self.left.T @ core
        return rho if self.right is None else rho @ self.right


def factored(blocks: list[Block], rho: list[Float64Array], budget: float, symmetric: bool) -> list[Order]:
    """The orders, with bases wherever they save room and the energy dropped in all is at most `budget`.

    budget: in units of sum (2-d_m0) rho^2, channels together; 0 keeps everything as it is. symmetric: every block is,
    and left and right bases are one.
    """
    orders = sum(not b.sine for b in blocks)
    sides = 1 if symmetric else 2
    directions: list[list[tuple[Float64Array, Float64Array]]] = []
    for k in range(orders):
        parts = [r for b, r in zip(blocks, rho) if b.m == blocks[k].m]
        grams = [sum(np.einsum("cij,ckj->ik", r, r) for r in parts), sum(np.einsum("cij,cik->jk", r, r) for r in parts)]
        directions.append([np.linalg.eigh(g) for g in grams[:sides]])
    ranks = _ranks([[blocks[k].weight * values for values, _ in d] for k, d in enumerate(directions)], budget, sides)
    found = []
    for k in range(orders):
        cosines = rho[k]
        sines = next((r for b, r in zip(blocks, rho) if b.sine and b.m == blocks[k].m), None)
        kept = [min(n, size) for n, size in zip(ranks[k] * (3 - sides), (blocks[k].rows, blocks[k].columns))]
        if budget <= 0 or not _saves(blocks[k], kept, len(cosines), sines is not None, symmetric):
            found.append(Order(None, None, cosines, sines))
            continue
        bases = [np.ascontiguousarray(vectors[:, ::-1][:, : kept[0]].T) for _, vectors in directions[k][:1]]
        bases.append(bases[0] if symmetric else np.ascontiguousarray(directions[k][1][1][:, ::-1][:, : kept[1]].T))
        # as many as there are degrees: the identity does
        left, right = (None if len(u) == u.shape[1] else u for u in bases)
        cores = [None if rho_m is None else _core(rho_m, left, right) for rho_m in (cosines, sines)]
        assert cores[0] is not None
        found.append(Order(left, right, cores[0], cores[1]))
    return found


def _core(rho: Float64Array, left: Float64Array | None, right: Float64Array | None) -> Float64Array:
    core = rho if left is None else left @ rho
    return core if right is None else core @ right.T


def _ranks(values: list[list[Float64Array]], budget: float, sides: int) -> list[list[int]]:
    """Directions to keep of each order and side: all but the smallest, together at most budget/sides a side."""
    found: list[list[int]] = [[] for _ in values]
    for side in range(sides):
        flat = np.sort(np.concatenate([np.maximum(v[side], 0) for v in values]))
        dropped = int(np.searchsorted(np.cumsum(flat), budget / sides, side="right"))
        threshold = flat[dropped - 1] if dropped else -1.0
        for k, v in enumerate(values):
            found[k].append(max(int((v[side] > threshold).sum()), 1))
    return found


def _saves(block: Block, kept: list[int], channels: int, sines: bool, symmetric: bool) -> bool:
    """Whether bases and cores take less room than the coefficients."""
    copies = channels * (2 if sines else 1)
    if symmetric:
        n, k = kept[0], block.rows
        return n * k * (n < k) + copies * n * (n + 1) // 2 < copies * k * (k + 1) // 2
    bases = sum(n * k for n, k in zip(kept, (block.rows, block.columns)) if n < k)
    return bases + copies * kept[0] * kept[1] < copies * block.rows * block.columns
