"""What the lattice of a `scattered` table misses at the measured geometries, given back around each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray

Float64Array = npt.NDArray[np.float64]

#: Residuals reach as far as the third neighbour, so that neighbours of a scan share them, times this.
_NEIGHBOUR, _BEYOND = 3, 1.0
#: No residual reaches farther, rad.
LONGEST_REACH = 0.3
_NAMES = ("kept", "residuals", "reach")


@dataclass(frozen=True, eq=False)
class Residuals:
    """r_k in 1/sr at geometries, and how far each reaches; how they are interpolated: `kernels.tables.residuals`.

    kept       float64 (k, 3)         theta_i, theta_o, delta_phi, rad
    residuals  float64 (k, channels)  f_r measured, minus the lattice there; 0 where only a neighbour's has to end
    reach      float64 (k,)           rad
    """

    kept: Float64Array
    residuals: Float64Array
    reach: Float64Array

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {name: getattr(self, name) for name in _NAMES}

    @cached_property
    def _buckets(self) -> tuple[npt.NDArray[Any], ...]:
        from brdfcore.kernels.tables.residuals import BUCKETS, buckets_of, coordinates_of

        points = np.empty((len(self.kept), 5))
        coordinates_of(self.kept, points)
        starts = np.zeros(BUCKETS**3 + 1, np.int64)
        buckets_of(points, self.reach, starts, np.zeros(1, np.int32), False)
        ends = np.cumsum(starts)
        members = np.empty(int(ends[-1]), np.int32)
        buckets_of(points, self.reach, ends.copy(), members, True)
        return ends, members, points

    def add_to(
        self,
        theta_i: FloatArray,
        theta_o: FloatArray,
        delta_phi: FloatArray,
        out: FloatArray,
        *,
        two_sided: bool,
        lowest: float,
    ) -> None:
        """Give them back to values (n, channels) at n pairs of directions, in place."""
        from brdfcore.kernels.tables.residuals import add_residuals

        shared = (*self._buckets, self.reach, self.residuals, two_sided, lowest)
        add_residuals(theta_i.size, theta_i, theta_o, delta_phi, out, *shared)

    @classmethod
    def of(cls, angles: Float64Array, residuals: Float64Array, wanted: npt.NDArray[np.bool_], gap: float) -> Residuals:
        """Of the geometries `wanted` (n,) of all `angles` (n, 3); the others within their reach hold theirs at 0."""
        from scipy.spatial import cKDTree

        from brdfcore.kernels.tables.residuals import coordinates_of

        points = np.empty((len(angles), 5))
        coordinates_of(np.ascontiguousarray(angles), points)
        tree = cKDTree(points)
        found = np.asarray(tree.query(points, k=min(_NEIGHBOUR + 1, len(points)), p=np.inf)[0]).reshape(len(points), -1)
        reach = np.clip(_BEYOND * found[:, -1], 1e-4, gap)
        near = tree.query_ball_point(points[wanted], reach[wanted], p=np.inf)
        members = np.flatnonzero(wanted)
        held = np.unique(np.concatenate([np.asarray(n, np.intp) for n in near])) if members.size else members
        values = np.where(wanted[held, None], residuals[held], 0.0)
        return cls(np.ascontiguousarray(angles[held]), np.ascontiguousarray(values), np.ascontiguousarray(reach[held]))

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]], channels: int, most: int) -> Residuals | str | None:
        """Those among the arrays of a table; None without, a text for what they can't be."""
        if not any(name in arrays for name in _NAMES):
            return None
        for name, kind, width in (
            ("kept", np.float64, 3),
            ("residuals", np.float64, channels),
            ("reach", np.float64, 0),
        ):
            array = arrays.get(name)
            shape = (len(arrays["kept"]), width) if width else (len(arrays["kept"]),)
            if array is None or array.dtype != kind or array.shape != shape or not np.isfinite(array).all():
                return name
        if not 1 <= len(arrays["kept"]) <= most or not (arrays["reach"] > 0).all():
            return "reach"
        given = {name: np.require(arrays[name], requirements=("C", "A", "W")) for name in _NAMES}
        return cls(**given)
