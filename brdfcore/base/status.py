"""Where a value comes from: one uint8 per point, the answer of `Brdf.status`."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import numpy.typing as npt


class Status(IntEnum):
    """Provenance of one value.

    MEASURED      the value is the source's own: a measured sample to 2 %, or a model's formula.
    INTERPOLATED  between samples of the source.
    EXTRAPOLATED  beyond the source's samples, continued from them.
    FILLED        set by a named policy, not by the source.
    OUTSIDE       outside the domain (below the horizon, not finite): no value.
    SMOOTHED      at a measured sample, and a fit through it and its neighbours: farther from it than `MEASURED` may be.

    >>> bc.Status(1), bc.Status.MEASURED < bc.Status.FILLED
    (<Status.INTERPOLATED: 1>, True)
    """

    MEASURED = 0
    INTERPOLATED = 1
    EXTRAPOLATED = 2
    FILLED = 3
    OUTSIDE = 4
    SMOOTHED = 5


#: From the strongest to the weakest, by code.
_RANKS = np.array([0, 2, 3, 4, 5, 1], np.uint8)


def weaker(*codes: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Of several statuses of each point the weakest: what may be said of a value made of all of them."""
    stacked = np.stack(codes)
    pick = _RANKS[stacked].argmax(axis=0)
    return np.asarray(np.take_along_axis(stacked, pick[None], axis=0)[0])
