"""How sure the values of a slice are, as pictures show it: intervals, what is extrapolated, what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.status import Status
from brdfcore.tables.scattered.coverage import SAME, sideways
from brdfcore.tables.scattered.table import Scattered

Array = npt.NDArray[np.float64]

#: Dashes of what is extrapolated or filled.
WEAK_DASHES: Any = (0, (3, 2))
#: Measurements whose theta_i is within this of a curve's, rad, are on it.
_NEAR = np.radians(0.5)
#: Intervals narrower than this part of the largest value are not drawn: less than a line's width.
_VISIBLE = 2e-3


@dataclass(frozen=True)
class Sure:
    """Of one curve: half-widths (m,), None if they could not be seen; where values are weak (m,); signed theta_o and
    values of what was measured, None if nothing was; whether it has no uncertainty at all."""

    widths: Array | None
    weak: npt.NDArray[np.bool_]
    measured: tuple[Array, Array] | None
    unknown: bool = False


def sure_of(b: Brdf, theta_i: float, theta_o: Array, channel: int) -> Sure:
    """Of the channel at position `channel` of `b`, in the plane of incidence over signed theta_o."""
    angles = theta_i, np.abs(theta_o), np.where(theta_o >= 0, np.pi, 0.0)
    widths, unknown = None, False
    try:
        found = np.asarray(b.uncertainty(*angles)[:, channel], np.float64)
        largest = float(np.abs(b.evaluate(*angles)[:, channel]).max())
        # relative to each value too: a log scale shows the small ones
        if (found > _VISIBLE * np.minimum(largest, 10 * np.abs(b.evaluate(*angles)[:, channel]))).any():
            widths = found
    except InputError as error:
        if error.code != "missing_uncertainty":
            raise
        unknown = True
    weak = np.isin(b.status(*angles), (Status.EXTRAPOLATED, Status.FILLED))
    return Sure(widths, weak, _measured(b, theta_i, channel), unknown)


def _measured(b: Brdf, theta_i: float, channel: int) -> tuple[Array, Array] | None:
    if not isinstance(b, Scattered):
        return None
    on = (np.abs(b.angles[:, 0] - theta_i) <= _NEAR) & (np.abs(sideways(*b.angles.T)) <= SAME)
    if not on.any():
        return None
    side = np.where(np.cos(b.angles[on, 2]) < 0, 1.0, -1.0)
    return side * b.angles[on, 1], b.measured[on, channel]


def sure_notes(all_of_them: Sequence[Sure]) -> list[str]:
    """One sentence about what the curves show beside values."""
    said = []
    if any(s.widths is not None for s in all_of_them):
        said.append("bands: 95 % intervals")
    if any(s.weak.any() for s in all_of_them):
        said.append("dashed: extrapolated or filled")
    if any(s.measured is not None for s in all_of_them):
        said.append("circles: measured")
    if any(s.unknown for s in all_of_them):
        said.append("no uncertainty is stored: tabulate again")
    return ["; ".join(said)] if said else []
