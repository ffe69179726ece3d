"""Angles out of requests, values into answers. What Python's json lets pass (NaN, true, 10**400) is refused here."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

import brdfcore as bc
from app.errors import MalformedBodyError
from app.library import Material
from app.settings import Settings

Unit = Literal["deg", "rad"]
Array = npt.NDArray[np.float64]

ANGLE_NAMES = ("theta_i", "theta_o", "delta_phi")
VALUE_UNIT = "1/sr"
#: What each angle may be, in words, by unit.
_RANGES = {
    "deg": {"theta_i": "[0, 90] degrees", "theta_o": "[0, 90] degrees", "delta_phi": "a finite number of degrees"},
    "rad": {"theta_i": "[0, pi/2] radians", "theta_o": "[0, pi/2] radians", "delta_phi": "a finite number of radians"},
}
#: Rows encoded at a time: json holds the interpreter's lock, and other requests must get a turn between two pieces.
_ROWS = 4096


@dataclass(frozen=True)
class AngleRequest:
    """Angles as the request gave them, each of shape () or (n,), and their unit."""

    theta_i: Array
    theta_o: Array
    delta_phi: Array
    unit: Unit

    @property
    def points(self) -> int:
        """Length of the broadcast lists, or of the longest where they do not broadcast (`evaluate` says so)."""
        sizes = [a.size for a in (self.theta_i, self.theta_o, self.delta_phi)]
        return 0 if 0 in sizes else max(sizes)

    def radians(self) -> tuple[Array, Array, Array]:
        """What `Brdf.evaluate` takes, converted by the library's one conversion."""
        return (
            in_radians(self.theta_i, self.unit),
            in_radians(self.theta_o, self.unit),
            in_radians(self.delta_phi, self.unit),
        )


def in_radians(angle: Array, unit: Unit) -> Array:
    """`angle` itself, or converted from degrees by the library's one conversion."""
    return angle if unit == "rad" else cast(Array, bc.to_radians(angle))


def angles_from_json(body: bytes, settings: Settings) -> AngleRequest:
    """The angles of an evaluate request's JSON body.

    Raises `MalformedBodyError` for what is no JSON, `InputError` naming field and index for what is no number,
    `LimitError` for too many points.
    """
    content = _load(body)
    known = (*ANGLE_NAMES, "angles")
    if not isinstance(content, dict):
        raise bc.InputError(
            "bad_body",
            f"the body must be a JSON object with {', '.join(ANGLE_NAMES)}; got {_kind(content)}",
            where="body",
            got=_kind(content),
            expected="an object",
        )
    for key in content:
        if key not in known:
            raise bc.UnknownNameError(
                "unknown_field",
                f"the body has a field that this path does not know; it takes: {', '.join(known)}",
                where="body",
                got=key[:80],
                expected=", ".join(known),
            )
    unit = content.get("angles", "deg")
    if unit not in ("deg", "rad"):
        raise bc.InputError(
            "bad_choice",
            "angles: expected 'deg' or 'rad'",
            where="angles",
            got=unit if isinstance(unit, str) else _kind(unit),
            expected="deg or rad",
        )
    found = []
    for name in ANGLE_NAMES:
        if name not in content:
            raise bc.InputError(
                "field_missing",
                f"{name} is missing from the body",
                where=name,
                expected="a number or a list of numbers",
            )
        found.append(_numbers(name, content[name]))
    return checked(AngleRequest(found[0], found[1], found[2], unit), settings)


def checked(angles: AngleRequest, settings: Settings) -> AngleRequest:
    """`angles`, unless there are more than the service takes."""
    if angles.points > settings.max_points:
        raise bc.LimitError(
            "too_many_points",
            f"{angles.points} points in one request; the limit is {settings.max_points}; send them in several",
            where="points",
            got=angles.points,
            limit=settings.max_points,
        )
    return angles


def check_size(count: int, settings: Settings) -> None:
    """`LimitError` if an answer of `count` values is more than the service writes as text."""
    if count > settings.max_values:
        raise bc.LimitError(
            "too_many_values",
            f"the answer would have {count} values (points x channels); the limit is {settings.max_values}; "
            "ask for fewer points, or for one channel where the path takes one",
            where="values",
            got=count,
            limit=settings.max_values,
        )


def evaluate_to_json(material: Material, angles: AngleRequest) -> bytes:
    """f_r at the angles as the JSON answer; floats are written by repr, so that they read back to the same bits."""
    brdf = material.brdf
    try:
        values = brdf.evaluate(*angles.radians())
    except bc.InputError as error:
        raise in_request_units(error, angles) from error
    head = {
        "channels": brdf.channels.to_json(),
        "unit": VALUE_UNIT,
        "angles": angles.unit,
        "id": material.id,
        "error": error_in_short(material.facts["error"]),
        "has_delta": bool(brdf.has_delta),
    }
    rows = values.reshape(-1, values.shape[-1])
    return b'{"values":[%b],%b' % (_rows_to_json(rows), to_json(head)[1:])


def error_in_short(error: dict[str, Any]) -> dict[str, Any]:
    """What an answer says of a table's measured error; the material's metadata has all of it."""
    return {k: error[k] for k in ("l1", "l1_stderr", "warnings") if k in error}


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


def to_json(value: Any) -> bytes:
    """`value` as compact JSON. Metadata may hold what JSON has no word for: not finite becomes null, numpy becomes
    plain, the rest its text."""
    try:
        text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    except (TypeError, ValueError):
        text = json.dumps(_plain(value), allow_nan=False, separators=(",", ":"))
    return text.encode()


def _rows_to_json(rows: npt.NDArray[np.floating[Any]]) -> bytes:
    pieces = [to_json(rows[k : k + _ROWS].tolist())[1:-1] for k in range(0, len(rows), _ROWS)]
    return b",".join(pieces)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, (str, bool, int)) else str(value)


def _load(body: bytes) -> Any:
    try:
        return json.loads(body.decode("utf-8"), object_pairs_hook=_once)
    except bc.InputError:
        raise
    except json.JSONDecodeError as error:
        raise MalformedBodyError(
            "bad_json",
            f"the body is not JSON: {error.msg} at line {error.lineno}, column {error.colno}",
            where="body",
            offset=error.pos,
            expected='{"theta_i": 30, "theta_o": [0, 30], "delta_phi": 180}',
        ) from error
    except UnicodeDecodeError as error:
        raise MalformedBodyError(
            "bad_json", f"the body is not UTF-8 at byte {error.start}", where="body", offset=error.start
        ) from error
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits; thousands of brackets
        raise MalformedBodyError(
            "bad_json", "the body is JSON that cannot be read: nested too deeply, or a number too long", where="body"
        ) from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose keys are all different; json alone would keep the last and drop the others in silence."""
    made = dict(pairs)
    if len(made) != len(pairs):
        keys = [k for k, _ in pairs]
        twice = next(k for k in keys if keys.count(k) > 1)
        raise bc.InputError("field_twice", "the body has a field twice", where="body", got=twice[:80])
    return made


def _numbers(name: str, value: Any) -> Array:
    """A JSON number or flat list of numbers as an array of shape () or (n,)."""
    listed = value if type(value) is list else [value]
    # in C over the whole list; only an offender is looked for one by one. bool is an int to isinstance, not here
    if not set(map(type, listed)) <= {int, float}:
        index, bad = next((k, v) for k, v in enumerate(listed) if type(v) not in (int, float))
        raise _not_a_number(name, value, index, bad)
    try:
        array = np.array(listed, dtype=np.float64)
    except OverflowError as error:
        index, bad = next((k, v) for k, v in enumerate(listed) if type(v) is int and abs(v) > 10**308)
        raise _not_a_number(name, value, index, bad) from error
    return array if type(value) is list else array[0].reshape(())


def _not_a_number(name: str, value: Any, index: int, bad: Any) -> bc.InputError:
    inside = type(value) is list
    place = f"{name}[{index}]" if inside else name
    kind = "an integer too large for a float" if type(bad) is int else _kind(bad)
    what = "lists must be flat: " if type(bad) is list else ""
    return bc.InputError(
        "not_a_number",
        f"{place}: expected a number, got {kind}" + (f"; {what}one number a point" if what else ""),
        where=name,
        index=[index] if inside else [],
        got=bad if isinstance(bad, (str, bool)) or bad is None else kind,
        expected="a number",
    )


def _kind(value: Any) -> str:
    names = {dict: "an object", list: "a list", str: "text", bool: "a boolean", type(None): "null"}
    return names.get(type(value), "a number")
