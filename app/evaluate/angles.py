"""The angles of a request: their unit, their number, and complaints about them in the request's own terms."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from brdf_service.settings import Settings

import brdfcore as bc

Unit = Literal["deg", "rad"]
Outside = Literal["raise", "nan", "clip"]
Array = npt.NDArray[np.floating[Any]]

ANGLE_NAMES = ("theta_i", "theta_o", "delta_phi")
#: What each angle may be, in words, by unit.
_RANGES = {
    "deg": {"theta_i": "[0, 90] degrees", "theta_o": "[0, 90] degrees", "delta_phi": "a finite number of degrees"},
    "rad": {"theta_i": "[0, pi/2] radians", "theta_o": "[0, pi/2] radians", "delta_phi": "a finite number of radians"},
}


class AngleRequest(NamedTuple):
    """Angles as the request gave them, each of shape () or (n,), their unit, and what to do with those outside."""

    theta_i: Array
    theta_o: Array
    delta_phi: Array
    unit: Unit = "deg"
    outside: Outside = "raise"

    @property
    def points(self) -> int:
        """Length of the broadcast lists, or of the longest where they do not broadcast (`evaluate` says so)."""
        sizes = (self.theta_i.size, self.theta_o.size, self.delta_phi.size)
        return 0 if 0 in sizes else max(sizes)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the values."""
        return np.result_type(*self[:3])

    @property
    def single(self) -> bool:
        """True if the values have no axis of points."""
        return self.theta_i.ndim == self.theta_o.ndim == self.delta_phi.ndim == 0

    def evaluate(self, brdf: bc.Brdf, out: Array | None = None) -> Array:
        """f_r at the angles."""
        return brdf.evaluate(*self.radians(), out=out, outside=self.outside)

    @property
    def uniform(self) -> bool:
        """True if each list has one value or as many as there are points: then parts of it broadcast as the whole."""
        return all(x.size in (1, self.points) for x in self[:3])

    def part(self, start: int, stop: int) -> AngleRequest:
        """Points start to stop of a uniform request."""
        a, b, c = (x[start:stop] if x.size > 1 else x for x in self[:3])
        return self._replace(theta_i=a, theta_o=b, delta_phi=c)

    def status(self, brdf: bc.Brdf) -> npt.NDArray[np.uint8]:
        """Where each value comes from."""
        return brdf.status(*self.radians())

    def explained(self, error: bc.InputError) -> bc.InputError:
        """The library's complaint in the request's own unit and index."""
        return in_request_units(error, self)

    def radians(self) -> tuple[Array, Array, Array]:
        """What `Brdf.evaluate` takes, converted by the library's one conversion."""
        if self.unit == "rad":
            return self.theta_i, self.theta_o, self.delta_phi
        if self.single:  # one conversion instead of three
            all_three = bc.to_radians(np.array([self.theta_i, self.theta_o, self.delta_phi]))
            return all_three[0], all_three[1], all_three[2]
        return bc.to_radians(self.theta_i), bc.to_radians(self.theta_o), bc.to_radians(self.delta_phi)


def in_radians(angle: Array, unit: Unit) -> Array:
    """`angle` itself, or converted from degrees by the library's one conversion."""
    return angle if unit == "rad" else bc.to_radians(angle)


def check_points(count: int, settings: Settings) -> None:
    """`LimitError` if there are more points than the service takes in one request."""
    if count > settings.max_points:
        raise bc.LimitError(
            "too_many_points",
            f"{count} points in one request; the limit is {settings.max_points}; send them in several",
            where="points",
            got=count,
            limit=settings.max_points,
        )


def check_values(count: int, settings: Settings) -> None:
    """`LimitError` if an answer would hold more values than the service gives in one."""
    if count > settings.max_values:
        raise bc.LimitError(
            "too_many_values",
            f"the answer would have {count} values (points x channels); the limit is {settings.max_values}; "
            "ask for fewer points, or for one channel where the path takes one",
            where="values",
            got=count,
            limit=settings.max_values,
        )


def in_request_units(error: bc.InputError, angles: AngleRequest) -> bc.InputError:
    """The library's complaint about an angle, in the unit, the number and the index that the request gave."""
    name = error.context.get("where")
    if error.code != "angle_outside" or name not in ANGLE_NAMES:
        return error
    given: Array = getattr(angles, name)
    index = list(error.context.get("index", []))
    if given.size == 1:  # it was broadcast: the request gave it once
        index = [0] if given.ndim else []
    got = float(given[index[0]] if index else given)
    expected = _RANGES[angles.unit][name]
    past = " (a direction past the horizon has no value)" if name != "delta_phi" and np.isfinite(got) else ""
    return bc.InputError(
        error.code,
        f"{name}{index if index else ''} = {got!r} is outside {expected}{past}",
        where=name,
        index=index,
        got=got,
        expected=expected,
    )
