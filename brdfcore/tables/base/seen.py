"""The angles that a table was made for: what it is right about, and where it continues what it holds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.directions import mixture
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.parameters import shown
from brdfcore.base.status import Status
from brdfcore.metrics import WHOLE, Range

_NAMES = ("light", "view")
#: Most draws made to have enough of them within a narrow range.
MOST_DRAWS = 2_000_000
#: Fewer draws within the ranges than this make no table.
_LEAST_DRAWS = 100


@dataclass(frozen=True, slots=True)
class Seen:
    """Ranges (from, to) of theta_i and theta_o, radians, both ends included. Beyond them a table answers all the same,
    as it extrapolates: `status` says so, and nobody measured its error there."""

    light: Range = WHOLE
    view: Range = WHOLE

    @classmethod
    def of(cls, light: Any, view: Any) -> Self:
        """The ranges that a caller gives, None for all of one; `InputError` for what can't be one."""
        found: list[Range] = []
        for name, given in zip(_NAMES, (light, view)):
            if given is None:
                found.append(WHOLE)
                continue
            try:
                low, high = (float(x) for x in given)
            except (TypeError, ValueError, OverflowError):
                low = high = math.nan
            # float32's pi/2 is past pi/2
            if not 0 <= low < high <= float(np.float32(HALF_PI)):
                got, expected = shown(given), "(from, to), radians, 0 <= from < to <= pi/2"
                raise InputError(
                    "bad_option", f"{name} = {got}: expected {expected}", where=name, got=got, expected=expected
                )
            found.append((low, WHOLE[1] if high >= HALF_PI else high))
        return cls(found[0], found[1])

    def draws(self, wanted: int, most: int = MOST_DRAWS) -> int:
        """Of how many draws of `directions.mixture` about `wanted` fall within, `most` at most."""
        if self.whole:
            return wanted
        drawn = mixture(20_000, 1)
        share = float(np.mean((drawn.weight > 0) & self.holds(drawn.theta_i, drawn.theta_o)))
        return min(int(wanted / max(share, wanted / most)), most)

    def check_enough(self, count: int) -> None:
        """`InputError` if so few draws within the ranges say nothing of where a table is wanted."""
        if count < _LEAST_DRAWS:
            raise InputError(
                "range_too_narrow",
                f"light {list(self.light)} and view {list(self.view)}, radians: {count} of all directions drawn are "
                f"within, too few to make a table for; expected at least {_LEAST_DRAWS}: give wider ranges",
                where="light, view",
                got=count,
                expected=_LEAST_DRAWS,
            )

    @property
    def whole(self) -> bool:
        """Whether every direction is within."""
        return all(low <= 0 and high >= HALF_PI for low, high in (self.light, self.view))

    def holds(self, theta_i: FloatArray, theta_o: FloatArray, *, swapped: bool = False) -> npt.NDArray[np.bool_]:
        """Which pairs are within; `swapped`: also those that are so with light and viewer exchanged."""
        (a, b), (c, d) = self.light, self.view
        inside: npt.NDArray[np.bool_] = (theta_i >= a) & (theta_i <= b) & (theta_o >= c) & (theta_o <= d)
        return inside | self.holds(theta_o, theta_i) if swapped else inside

    def status(self, theta_i: FloatArray, theta_o: FloatArray) -> npt.NDArray[np.uint8]:
        """INTERPOLATED within, EXTRAPOLATED beyond."""
        if self.whole:
            return np.full(theta_i.shape, Status.INTERPOLATED, np.uint8)
        # an end that is a float64 is meant, whatever it was rounded to on the way
        angles = theta_i.astype(np.float64), theta_o.astype(np.float64)
        slack = float(np.finfo(theta_i.dtype).eps)
        (a, b), (c, d) = self.light, self.view
        wide = Seen((a - slack, b + slack), (c - slack, d + slack))
        return np.where(wide.holds(*angles), np.uint8(Status.INTERPOLATED), np.uint8(Status.EXTRAPOLATED))

    def attributes(self) -> dict[str, Any]:
        """For `Table.attributes`; none without a limit, so that such tables keep their id."""
        if self.whole:
            return {}
        return {name: [low, high] for name, (low, high) in zip(_NAMES, (self.light, self.view))}

    @classmethod
    def from_attributes(cls, table: str, attributes: Mapping[str, Any]) -> Self:
        """The inverse of `attributes`; `FileFormatError` for what no range can be."""
        found: list[Range] = []
        for name in _NAMES:
            given = attributes.get(name, list(WHOLE))
            numbers = isinstance(given, list) and len(given) == 2
            numbers = numbers and all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in given)
            if not numbers or not 0 <= given[0] < given[1] <= WHOLE[1] or not math.isfinite(given[1]):
                got, expected = shown(given), f"[from, to], radians, 0 <= from < to <= {WHOLE[1]:g}"
                raise FileFormatError(
                    "bad_field",
                    f"{table}: {name} is {got}; expected {expected}",
                    where=name,
                    got=got,
                    expected=expected,
                )
            found.append((float(given[0]), float(given[1])))
        return cls(found[0], found[1])


#: No limit.
EVERYWHERE = Seen()
