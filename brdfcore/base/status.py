"""Where a value comes from: one uint8 per point, the answer of `Brdf.status`."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Provenance of one value.

    MEASURED      the value is the source's own: a measured sample, or a model's formula.
    INTERPOLATED  between samples of the source.
    EXTRAPOLATED  beyond the source's samples, continued from them.
    FILLED        set by a named policy, not by the source.
    OUTSIDE       outside the domain (below the horizon, not finite): no value.

    >>> bc.Status(1), bc.Status.MEASURED < bc.Status.FILLED
    (<Status.INTERPOLATED: 1>, True)
    """

    MEASURED = 0
    INTERPOLATED = 1
    EXTRAPOLATED = 2
    FILLED = 3
    OUTSIDE = 4
