"""Where measurements lie: which pairs of directions they hold, enclose, or leave open."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.base.status import Status

Float64Array = npt.NDArray[np.float64]

#: A pair of directions this close to a measured one, rad, counts as measured: a twentieth of a degree, below the
#: aperture of any goniometer.
SAME = 1e-3
#: Pairs of directions looked at in one go: the facets' products stay below 100 MB.
_CHUNK = 16_384


def invariants(theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    """(n, 4) angles of pairs of directions that don't change when both turn about the normal, rad.

    theta_i, theta_o, between wi and wo, and between the mirror image of wi and wo. Each changes by no more than the
    directions themselves; unlike delta_phi they are smooth where a direction is the normal.
    """
    theta_i, theta_o = np.minimum(theta_i, HALF_PI), np.minimum(theta_o, HALF_PI)
    between = [_angle(theta_i, theta_o, np.sin(0.5 * turn)) for turn in (delta_phi, delta_phi - np.pi)]
    return np.stack([theta_i, theta_o, *between], axis=1)


def _angle(theta_i: Float64Array, theta_o: Float64Array, sin_half: Float64Array) -> Float64Array:
    """Angle between directions at polar angles theta whose azimuths differ by twice the angle of sin_half."""
    square = np.sin(0.5 * (theta_i - theta_o)) ** 2 + np.sin(theta_i) * np.sin(theta_o) * sin_half**2
    return np.asarray(2 * np.arcsin(np.sqrt(np.clip(square, 0, 1))))


def sideways(theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    """sin theta_i sin theta_o sin delta_phi, (n,): 0 in the plane of incidence, its sign the side of it."""
    return np.asarray(np.sin(theta_i) * np.sin(theta_o) * np.sin(delta_phi))


class Coverage:
    """The region that measurements at `angles` (n, 3) cover; `gap` rad, `bilateral`: both sides count as one."""

    def __init__(self, angles: Float64Array, gap: float, bilateral: bool) -> None:
        self.angles, self.gap, self.bilateral = angles, gap, bilateral
        self.in_plane = bool((np.abs(sideways(*angles.T)) < SAME).all())
        self.most_grazing = float(angles[:, 0].max()), float(angles[:, 1].max())

    def _embedded(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        points = invariants(theta_i, theta_o, delta_phi)
        if self.bilateral:
            return points
        return np.concatenate([points, sideways(theta_i, theta_o, delta_phi)[:, None]], axis=1)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self._embedded(*self.angles.T))

    @cached_property
    def _facets(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """(basis, offset, facets): the affine space of the points in (theta_i, theta_o, theta between), their hull.

        basis (3, k) spans it; facets (m, k + 1) of the hull in it, normal and offset.
        """
        from scipy.spatial import ConvexHull

        points = self._embedded(*self.angles.T)[:, :3]
        centre = points.mean(axis=0)
        _, sizes, axes = np.linalg.svd(points - centre, full_matrices=False)
        basis = axes[sizes > SAME * np.sqrt(len(points))].T
        flat = (points - centre) @ basis
        if basis.shape[1] == 0:
            return basis, centre, np.zeros((0, 1))
        if basis.shape[1] == 1:
            return basis, centre, np.array([[1.0, -flat.max()], [-1.0, flat.min()]])
        return basis, centre, np.asarray(ConvexHull(flat).equations)

    def neighbours(self, angles: Float64Array, count: int) -> tuple[Float64Array, npt.NDArray[np.intp]]:
        """(distances, indices) of the `count` nearest measurements, or of all, of `angles` (n, 3): (n, count) each."""
        count = min(count, len(self.angles))
        distance, index = self._tree.query(self._embedded(*angles.T), k=count, p=np.inf)
        return distance.reshape(len(angles), count), np.asarray(index, np.intp).reshape(len(angles), count)

    def nearest(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> npt.NDArray[np.intp]:
        """Index of the nearest measurement of each pair of directions."""
        return np.asarray(self._tree.query(self._embedded(theta_i, theta_o, delta_phi), p=np.inf)[1])

    def status(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> npt.NDArray[np.uint8]:
        """`Status` of each pair, (n,).

        MEASURED within `SAME` of a measurement. INTERPOLATED inside the convex hull of the measurements with one nearer
        than `gap`; EXTRAPOLATED outside it, with one nearer than `gap`, and all that is out of the plane of incidence
        where only that was measured. FILLED farther than `gap` from all, and where a direction is more grazing than
        any that was measured.
        """
        codes = np.empty(theta_i.size, np.uint8)
        for start in range(0, theta_i.size, _CHUNK):
            part = slice(start, start + _CHUNK)
            codes[part] = self._codes(theta_i[part], theta_o[part], delta_phi[part])
        return codes

    def _codes(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> npt.NDArray[np.uint8]:
        points = self._embedded(theta_i, theta_o, delta_phi)
        distance = self._tree.query(points, p=np.inf)[0]
        basis, centre, facets = self._facets
        centred = points[:, :3] - centre
        flat = centred @ basis
        inside = (flat @ facets[:, :-1].T + facets[:, -1] <= SAME).all(axis=1)
        inside &= np.abs(centred - flat @ basis.T).max(axis=1) <= SAME
        if self.in_plane:
            inside &= np.abs(sideways(theta_i, theta_o, delta_phi)) < SAME
        codes = np.where(inside, np.uint8(Status.INTERPOLATED), np.uint8(Status.EXTRAPOLATED))
        beyond = (theta_i > self.most_grazing[0] + SAME) | (theta_o > self.most_grazing[1] + SAME)
        codes[beyond | (distance > self.gap)] = Status.FILLED
        codes[distance <= SAME] = Status.MEASURED
        return codes
