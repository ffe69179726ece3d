"""The directions of a request, as angles or as vectors: their number, their limits, and complaints about them in the
request's own unit and index."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from brdf_service.http.query import Outside, Unit
from brdf_service.settings import Settings

import brdfcore as bc

Array = npt.NDArray[np.floating[Any]]

ANGLE_NAMES = ("theta_i", "theta_o", "delta_phi")
VECTOR_NAMES = ("wi", "wo")
A_DIRECTION = "a direction [x, y, z], or a list of them"
#: What each angle may be, in words, by unit.
_POLAR = {"deg": "[0, 90] degrees", "rad": "[0, pi/2] radians"}
_AZIMUTH = {"deg": "a finite number of degrees", "rad": "a finite number of radians"}


class Angles(NamedTuple):
    """Angles as the request gave them, each of shape () or (n,), their unit, and what to do with those outside."""

    theta_i: Array
    theta_o: Array
    delta_phi: Array
    unit: Unit = "deg"
    outside: Outside = "raise"

    @property
    def lists(self) -> tuple[Array, ...]:
        """What broadcasts."""
        return self[:3]

    def evaluate(self, brdf: bc.Brdf, out: Array | None = None) -> Array:
        """f_r at the angles."""
        return brdf.evaluate(*self.radians(), out=out, outside=self.outside)

    def status(self, brdf: bc.Brdf) -> npt.NDArray[np.uint8]:
        """Where each value comes from."""
        return brdf.status(*self.radians())

    def uncertainty(self, brdf: bc.Brdf) -> Array:
        """Half-widths of 95 % intervals."""
        return brdf.uncertainty(*self.radians(), outside=self.outside)

    def part(self, start: int, stop: int) -> Angles:
        """Points start to stop of lists that have one value or as many as there are points."""
        a, b, c = (x[start:stop] if x.size > 1 else x for x in self[:3])
        return Angles(a, b, c, self.unit, self.outside)

    def radians(self) -> tuple[Array, Array, Array]:
        """What `Brdf.evaluate` takes, converted by the library's one conversion."""
        a, b, c = self.lists
        if self.unit == "deg":
            if a.ndim == b.ndim == c.ndim == 0:  # one conversion instead of three
                a, b, c = bc.to_radians(np.array((a, b, c))).tolist()
            else:
                a, b, c = map(bc.to_radians, (a, b, c))
        return a, b, c

    def explained(self, error: bc.InputError) -> bc.InputError:
        """The library's complaint about an angle, in the unit, the number and the index that the request gave."""
        name = error.context.get("where")
        if error.code != "angle_outside" or name not in ANGLE_NAMES:
            return error
        given: Array = getattr(self, name)
        index = list(error.context.get("index", []))
        if given.size == 1:  # it was broadcast: the request gave it once
            index = [0] if given.ndim else []
        got = float(given[index[0]] if index else given)
        expected = (_AZIMUTH if name == "delta_phi" else _POLAR)[self.unit]
        past = " (a direction past the horizon has no value)" if name != "delta_phi" and np.isfinite(got) else ""
        said = f"{name}{index if index else ''} = {got!r} is outside {expected}{past}"
        return bc.InputError(error.code, said, where=name, index=index, got=got, expected=expected)


class Vectors(NamedTuple):
    """Directions as the request gave them, each of shape (3,) or (n, 3): nobody has normalised them."""

    wi: Array
    wo: Array

    @property
    def unit(self) -> None:
        """Vectors have no unit of angle."""

    @property
    def lists(self) -> tuple[Array, ...]:
        """What broadcasts: the first component of each direction."""
        return self.wi[..., 0], self.wo[..., 0]

    def evaluate(self, brdf: bc.Brdf, out: Array | None = None) -> Array:
        """f_r, exactly 0 below the horizon."""
        return brdf.evaluate_vectors(self.wi, self.wo, out=out)

    def status(self, brdf: bc.Brdf) -> npt.NDArray[np.uint8]:
        """Refused by `no_angle_options`."""
        raise NotImplementedError

    def uncertainty(self, brdf: bc.Brdf) -> Array:
        """Refused by `no_angle_options`."""
        raise NotImplementedError

    def part(self, start: int, stop: int) -> Vectors:
        """Points start to stop of lists that have one direction or as many as there are points."""
        a, b = (x[start:stop] if x.size > 3 else x for x in self)
        return Vectors(a, b)

    def explained(self, error: bc.InputError) -> bc.InputError:
        """The library names wi, wo and the index already."""
        return error


Directions = Angles | Vectors


def polar_angles(theta_i: Array, unit: Unit) -> Angles:
    """Angles of incidence alone, to convert and to explain."""
    zero = np.zeros(())
    return Angles(theta_i, zero, zero, unit)


def count_points(asked: Directions, channels: int, settings: Settings) -> int:
    """Length of the broadcast lists, or of the longest where they do not broadcast (`evaluate` says so).

    Raises `LimitError` if there are more points, or values in an answer of so many channels, than the service takes.
    """
    sizes = [x.size for x in asked.lists]
    points = 0 if 0 in sizes else max(sizes)
    check_points(points, settings)
    check_values(points * channels, settings)
    return points


def no_angle_options(unit: Unit | None, outside: Outside, beside: Mapping[str, bool]) -> None:
    """`InputError` for an option that vectors have no use for: it would be ignored in silence."""
    asked = {"angles": unit is not None, "outside": outside != "raise", **beside}
    given = next((name for name, is_asked in asked.items() if is_asked), None)
    if given is not None:
        why = {
            "angles": "vectors have no unit of angle",
            "outside": "a vector below the horizon has the value 0",
        }.get(given, f"{given} is given for angles only")
        said = f"{given} goes with angles, not with wi and wo: {why}; leave it out"
        raise bc.InputError("options_exclude", said, where=given, expected=f"no {given}")


def check_points(count: int, settings: Settings) -> None:
    """`LimitError` if there are more points than the service takes in one request."""
    if count > settings.max_points:
        raise _too_many("points", "points", count, settings.max_points, "points in one request", "send them in several")


def check_values(count: int, settings: Settings) -> None:
    """`LimitError` if an answer would hold more values than the service gives in one."""
    if count > settings.max_values:
        hint, what = "ask for fewer points, or for one channel where the path takes one", "values (points x channels)"
        raise _too_many("values", "values", count, settings.max_values, f"{what} in the answer", hint)


def check_incidences(theta_i: Array, settings: Settings) -> None:
    """`LimitError` if there are more angles of incidence than the service takes in one request."""
    if theta_i.size > settings.max_theta_i:
        hint = "ask for the others in another request"
        raise _too_many("slices", "theta_i", theta_i.size, settings.max_theta_i, "angles of incidence", hint)


def _too_many(code: str, where: str, got: int, limit: int, what: str, hint: str) -> bc.LimitError:
    text = f"{got} {what}; the limit is {limit}; {hint}"
    return bc.LimitError(f"too_many_{code}", text, where=where, got=got, limit=limit)
