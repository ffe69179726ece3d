"""f_r of directions as vectors where one of them has no azimuth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.base.geometry import angles_from_vectors

#: Azimuths that light from exactly above is averaged over, a power of two.
_TURNS = 64


def evaluate_by_angles(
    evaluate: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], Any],
    wi: npt.NDArray[np.float64],
    wo: npt.NDArray[np.float64],
    out: FloatArray,
) -> None:
    """`evaluate(theta_i, theta_o, delta_phi, out)` of vectors (n, 3) of any length, into `out` (n, channels).

    Light from exactly above has no azimuth: its value is the mean over delta_phi, which is the value itself for all but
    data that vary with it there.
    """
    theta_i, theta_o, delta_phi = (x.astype(out.dtype, copy=False) for x in angles_from_vectors(wi, wo))
    at_normal = (wi[:, 0] == 0) & (wi[:, 1] == 0)
    # at theta_o = 0 delta_phi has no meaning, and atan2 would make it of the signs of zeros
    delta_phi = np.where(at_normal | ((wo[:, 0] == 0) & (wo[:, 1] == 0)), 0, delta_phi).astype(out.dtype)
    evaluate(theta_i, theta_o, delta_phi, out)
    if at_normal.any():
        turns = np.arange(_TURNS, dtype=out.dtype) * out.dtype.type(2 * np.pi / _TURNS)
        angles = np.repeat(theta_i[at_normal], _TURNS), np.repeat(theta_o[at_normal], _TURNS)
        around = np.empty((angles[0].size, out.shape[1]), out.dtype)
        evaluate(*angles, np.tile(turns, int(at_normal.sum())), around)
        halves = around.reshape(-1, _TURNS, out.shape[1])
        while halves.shape[1] > 1:  # by halves: the mean of equal values is that value to the bit
            halves = out.dtype.type(0.5) * (halves[:, ::2] + halves[:, 1::2])
        out[at_normal] = halves[:, 0]
