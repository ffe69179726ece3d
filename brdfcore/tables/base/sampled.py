"""What tables on a lattice share: interpolation by name, a delta part beside the nodes, status."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.parameters import Parameter, shown
from brdfcore.base.status import Status
from brdfcore.names import Interpolation, choices
from brdfcore.tables.base.table import Table, interpolated_delta

#: nearest: the node's value. linear: never outside the nodes of the cell. monotone_cubic: nor is it, third order where
#: the nodes are monotone, and smooth along their lines (`kernels.tables.interpolation`); some ten times the work.
INTERPOLATIONS = choices(Interpolation)

INTERPOLATION = Parameter(
    "interpolation", "", "between the nodes; none passes the largest node around, or 0 if no node does",
    "linear", kind="choice", choices=INTERPOLATIONS,
)  # fmt: skip

#: Powers of the distance of the nodes that the error may fall with: half an order above the theoretical one, since a
#: lobe that a coarse grid hardly sees comes out a little faster.
_ORDERS = {"nearest": 1.5, "linear": 2.5, "monotone_cubic": 4.5}


#: Float32 node values below this, 1/sr, are stored as 0: far below any light, and a look-up that multiplies one by an
#: interpolation weight (down to 2^-24) would meet subnormal numbers, which cost the processor a hundred times as long.
SMALLEST_NODE = 2.0**-100


def without_subnormals(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """`values` with what is smaller than `SMALLEST_NODE` set to 0, in place."""
    values[np.abs(values) < SMALLEST_NODE] = 0
    return values


class SampledTable(Table):
    """A table of nodes, interpolated by one of `INTERPOLATIONS`, with an optional delta part.

    delta : float64 (n, channels), optional: reflectance of the mirror part at n uniform theta_i of [0, pi/2], linear.
    """

    interpolation: str
    delta: npt.NDArray[np.float64] | None

    def __init__(
        self,
        channels: Channels,
        flags: Mapping[str, bool],
        interpolation: str,
        delta: npt.NDArray[np.float64] | None,
    ) -> None:
        super().__init__(channels, flags)
        self.interpolation, self.delta = interpolation, delta
        self.has_delta = delta is not None

    @classmethod
    def largest_gain(cls, interpolation: str, ratio: float) -> float:
        return float(ratio ** (_ORDERS[interpolation] / 3))

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return np.full(theta_i.shape, Status.INTERPOLATED, np.uint8)

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if self.delta is None:
            return super()._delta_reflectance(theta_i)
        return interpolated_delta(self.delta, theta_i)

    def _with_delta(self, arrays: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        return arrays if self.delta is None else {**arrays, "delta": self.delta}


def check_interpolation(name: str, interpolation: Any) -> None:
    """`InputError` unless representation `name`, which offers all of `INTERPOLATIONS`, has this one."""
    if interpolation not in INTERPOLATIONS:
        got, offered = shown(interpolation), INTERPOLATION.range_text()
        raise InputError(
            "bad_option",
            f"interpolation = {got}: {name} offers {offered}",
            where="interpolation",
            got=got,
            expected=offered,
        )


def stored_interpolation(name: str, attributes: Mapping[str, Any]) -> str:
    """`attributes["interpolation"]`, "linear" if there is none; else `FileFormatError`."""
    found = attributes.get("interpolation", "linear")
    if not isinstance(found, str) or found not in INTERPOLATIONS:
        raise bad_field(name, "interpolation", shown(found), INTERPOLATION.range_text())
    return found


def bad_field(name: str, field: str, got: str, expected: str) -> FileFormatError:
    """The error for an array or attribute that no table of representation `name` can have."""
    return FileFormatError(
        "bad_field", f"{name}: {field} is {got}; expected {expected}", where=field, got=got, expected=expected
    )
