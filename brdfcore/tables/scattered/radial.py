"""Radial basis functions through scattered points: one factorisation for all channels and for what is left out.

s(x) = sum_j c_j phi(|x - x_j|) + q(x), phi(r) = r^2 ln r (thin plate) or -r (linear), q a polynomial of degree 0 or 1:

    (A + diag(smoothing)) c + P b = y,   P' c = 0,   A_jk = phi(|x_j - x_k|), P the polynomial's terms at the points.

With p an orthonormal basis of P's columns, M = (1 - pp')(A + diag)(1 - pp') + s pp' is positive definite,
c = M^-1 (1 - pp') y, and B = M^-1 - pp'/s turns y into c. What the others say of points S follows without another fit:
y_S - s_S = B_SS^-1 c_S, and the others' coefficients are c_R - B_RS B_SS^-1 c_S (for one point: S. Rippa, An algorithm
for selecting a good value for the parameter c in radial basis function interpolation, 1999, DOI
10.1023/A:1018975909870).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
import numpy.typing as npt

from brdfcore.kernels.machine.blocks import threads

Float64Array = npt.NDArray[np.float64]

#: Distances that one thread has in hand at a time: they stay in its cache. Pieces of so many from which threads pay.
_CHUNK, _WORTH_THREADS = 250_000, 8
#: Terms of the polynomial that differ by less than this, relative, don't differ.
_ALIKE = 1e-9


def _thin_plate(square: Float64Array) -> None:
    square *= 0.5 * np.log(square + 1e-300)


def _linear(square: Float64Array) -> None:
    np.negative(np.sqrt(square, out=square), out=square)


#: phi of squared distances, in place.
_KERNELS: dict[str, Callable[[Float64Array], None]] = {"thin_plate_spline": _thin_plate, "linear": _linear}


class Radial:
    """s of `values` y (n, channels) at `points` (n, d).

    kernel     "thin_plate_spline" or "linear".
    smoothing  a number or (n,), on the diagonal: 0 interpolates.
    degree     of q: 0 or 1; the thin plate needs 1.

    Raises `numpy.linalg.LinAlgError` for points that do not determine s.
    """

    def __init__(
        self, points: Float64Array, values: Float64Array, kernel: str, smoothing: Float64Array | float, degree: int
    ) -> None:
        from scipy.linalg import cho_factor, cho_solve, solve_triangular

        self.points, self.values, self._phi, self._degree = points, values, _KERNELS[kernel], degree
        self.smoothing = np.broadcast_to(np.asarray(smoothing, np.float64), len(points))
        low, high = points.min(axis=0), points.max(axis=0)
        self._shift, self._scale = 0.5 * (low + high), np.where(high > low, 0.5 * (high - low), 1.0)
        self._p, triangle = np.linalg.qr(self._terms(points))
        size = np.abs(np.diag(triangle))
        if len(points) <= size.size or size.min() < _ALIKE * size.max():
            raise np.linalg.LinAlgError("the points do not determine the polynomial")
        matrix = np.empty((len(points), len(points)))
        self._over(points, lambda part, phi: matrix.__setitem__(part, phi))
        matrix = 0.5 * (matrix + matrix.T)
        np.fill_diagonal(matrix, self.smoothing)  # phi(0) = 0 in both
        image = matrix @ self._p
        self._level = float(np.abs(matrix).max()) or 1.0
        half = image - 0.5 * self._p @ (self._p.T @ image + self._level * np.eye(size.size))
        matrix -= self._p @ half.T
        matrix -= half @ self._p.T
        self._factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
        found = cho_solve(self._factor, self._across(values), check_finite=False)
        self.coefficients = self._across(found)
        self._polynomial = solve_triangular(triangle, self._p.T @ values - image.T @ self.coefficients)

    def _across(self, values: Float64Array) -> Float64Array:
        """What of `values` no polynomial takes."""
        return np.asarray(values - self._p @ (self._p.T @ values))

    def _terms(self, points: Float64Array) -> Float64Array:
        one = np.ones((len(points), 1))
        return np.concatenate([one, (points - self._shift) / self._scale], axis=1) if self._degree else one

    def _over(self, points: Float64Array, use: Callable[[slice, Float64Array], None]) -> None:
        """Call `use(rows, phi (rows, n))` for all rows of `points`, in any order."""
        mine = self.points - self._shift
        own = (mine**2).sum(axis=1)
        step = max(_CHUNK // len(mine), 1)

        def rows(start: int) -> None:
            at = points[start : start + step] - self._shift
            phi = at @ (-2 * mine.T)
            phi += (at**2).sum(axis=1)[:, None]
            phi += own
            np.maximum(phi, 0, out=phi)
            self._phi(phi)
            use(slice(start, start + step), phi)

        starts = range(0, len(points), step)
        if len(starts) < _WORTH_THREADS or threads() == 1:
            for start in starts:
                rows(start)
            return
        with ThreadPoolExecutor(threads()) as pool:
            list(pool.map(rows, starts))

    def __call__(self, points: Float64Array) -> Float64Array:
        """s at `points` (m, d), (m, channels)."""
        found = self._terms(points) @ self._polynomial

        def add(part: slice, phi: Float64Array) -> None:
            found[part] += phi @ self.coefficients

        self._over(points, add)
        return np.asarray(found)

    @property
    def fitted(self) -> Float64Array:
        """s at the points themselves, (n, channels)."""
        return np.asarray(self.values - self.smoothing[:, None] * self.coefficients)

    @cached_property
    def _inverse(self) -> Float64Array:
        """B, (n, n)."""
        from scipy.linalg import lapack

        lower, info = lapack.dpotri(self._factor[0], lower=True)
        if info:
            raise np.linalg.LinAlgError("the matrix is singular")
        whole = np.tril(lower)
        whole += np.tril(lower, -1).T
        whole -= self._p @ (self._p.T / self._level)
        return np.asarray(whole)

    def without(self, part: npt.NDArray[np.intp], others: npt.NDArray[np.intp]) -> tuple[Float64Array, Float64Array]:
        """What all points but `part` say: (s at `part`, s at the points `others`), as if fitted without `part`."""
        inverse = self._inverse
        missed = np.linalg.solve(inverse[np.ix_(part, part)], self.coefficients[part])
        left = self.coefficients[others] - inverse[np.ix_(others, part)] @ missed
        return self.values[part] - missed, self.values[others] - self.smoothing[others, None] * left
