"""Directions of a JSON body. What a reader of JSON lets pass (NaN, true, 10**400, a key twice) is refused with its
place.

simdjson puts a list of numbers straight into memory, in half the time that orjson takes to make Python objects; where
it is not installed, or the body is not three flat lists, orjson reads it, and what orjson refuses the standard library,
which can say where and why. All three round to the nearest: the same bits.
"""

from __future__ import annotations

import array
import contextlib
import threading
from itertools import chain
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import orjson

try:
    import simdjson
except ModuleNotFoundError:
    simdjson = None  # type: ignore[assignment]

from brdf_service.evaluate.directions import A_DIRECTION, ANGLE_NAMES, VECTOR_NAMES, Angles, Directions, Vectors
from brdf_service.http.json import from_json
from brdf_service.http.query import Outside, Unit

import brdfcore as bc

Floats = npt.NDArray[np.float64]
#: What a body may hold.
Form = Literal["angles", "vectors"]
_EXAMPLE = '{"theta_i": 30, "theta_o": [0, 30], "delta_phi": 180}'
_SORTED = sorted(ANGLE_NAMES)
_held = threading.local()


def directions_from_json(body: bytes, form: Form | None, unit: Unit | None, outside: Outside) -> Directions:
    """The angles or the vectors of a body; which, its fields say. `form`, `unit` and `outside` are what the query says.

    Raises `MalformedBodyError` for what is no JSON, `InputError` naming field and index for what is no number.
    """
    if form != "vectors":
        found = _flat_lists(body)
        if found is not None:
            return Angles(*found, unit or "deg", outside)
    content = _load(body)
    if not isinstance(content, dict):
        known = " and ".join(VECTOR_NAMES) if form == "vectors" else ", ".join(ANGLE_NAMES)
        said = f"the body must be a JSON object with {known}; got {_kind(content)}"
        raise bc.InputError("bad_body", said, where="body", got=_kind(content), expected="an object")
    if form == "vectors" or (form is None and not content.keys().isdisjoint(VECTOR_NAMES)):
        _check_fields(content, VECTOR_NAMES, VECTOR_NAMES, A_DIRECTION)
        return Vectors(*(_vectors(name, content[name]) for name in VECTOR_NAMES))
    _check_fields(content, (*ANGLE_NAMES, "angles"), ANGLE_NAMES, "a number or a list of numbers")
    plain = b"u" not in body and b"f" not in body  # neither true nor false: no other word here has these letters
    a, b, c = (_numbers(name, content[name], plain) for name in ANGLE_NAMES)
    return Angles(a, b, c, _unit(content, unit), outside)


def _check_fields(content: dict[str, Any], known: tuple[str, ...], needed: tuple[str, ...], expected: str) -> None:
    for key in content:
        if key not in known:
            listed = ", ".join(known)
            said = f"body has a field that is not known; it takes: {listed}"
            raise bc.UnknownNameError("unknown_field", said, where="body", got=key[:80], expected=listed)
    for name in needed:
        if name not in content:
            raise bc.InputError("field_missing", f"{name} is missing from the body", where=name, expected=expected)


def _flat_lists(body: bytes) -> tuple[Floats, Floats, Floats] | None:
    """The three angles of a body that holds just them, each a flat list of numbers, and nothing else. None: read it in
    another way, which also says what is wrong with it."""
    # a nested list would be flattened in silence: there must be three brackets
    if simdjson is None or body.count(b"[") != 3:
        return None
    try:
        # one parser a thread: it keeps its memory, and must not be used while a document of it is
        if not hasattr(_held, "parser"):
            _held.parser = simdjson.Parser()
        content: Any = _held.parser.parse(body)
        if sorted(content) != _SORTED:  # a key twice is there twice
            return None
        a, b, c = (np.frombuffer(content[name].as_buffer(of_type="d"), np.float64) for name in ANGLE_NAMES)
    except (ValueError, TypeError, RuntimeError, AttributeError, KeyError):  # no JSON, no list, no number
        return None
    return a, b, c


def _load(body: bytes) -> Any:
    with contextlib.suppress(orjson.JSONDecodeError):
        content = orjson.loads(body)
        if isinstance(content, dict):
            # a key that is there twice passes unseen, but its quotation marks are there
            texts = len(content) + sum(type(value) is str for value in content.values())
            if body.count(b'"') == 2 * texts:
                return content
    return from_json(body, _EXAMPLE)


def _unit(content: dict[str, Any], asked: Unit | None) -> Unit:
    unit = content.get("angles", asked or "deg")
    if unit not in ("deg", "rad"):
        got = unit if isinstance(unit, str) else _kind(unit)
        said = "angles: expected 'deg' or 'rad'"
        raise bc.InputError("bad_choice", said, where="angles", got=got, expected="deg or rad")
    if asked is not None and unit != asked:
        said = f"angles: the query says {asked}, the body {unit}"
        raise bc.InputError("given_twice", said, where="angles", got=unit, expected=asked)
    made: Unit = unit
    return made


def _numbers(name: str, value: Any, plain: bool) -> Floats:
    """A JSON number or flat list of numbers as an array of shape () or (n,); `plain`: no boolean can be among them."""
    if plain and type(value) is list:
        with contextlib.suppress(TypeError, OverflowError):  # takes no text, as numpy would
            return np.frombuffer(array.array("d", value), np.float64)
    listed = value if type(value) is list else [value]
    for index, each in enumerate(listed):
        if type(each) not in (int, float):
            raise _not_a_number(name, value, index, _kind(each))
        if type(each) is int and abs(each) > 10**308:
            raise _not_a_number(name, value, index, "an integer too large for a float")
    made = np.array(listed, np.float64)
    return made if type(value) is list else made[0].reshape(())


def _not_a_number(name: str, value: Any, index: int, kind: str) -> bc.InputError:
    inside = type(value) is list
    bad = value[index] if inside else value
    place = f"{name}[{index}]" if inside else name
    said = f"{place}: expected a number, got {kind}"
    said += "; lists must be flat: one number a point" if type(bad) is list else ""
    got = bad if isinstance(bad, (str, bool)) or bad is None else kind
    where = {"where": name, "index": [index] if inside else []}
    return bc.InputError("not_a_number", said, **where, got=got, expected="a number")


def _vectors(name: str, value: Any) -> Floats:
    """[x, y, z] as an array (3,), a list of them as (n, 3)."""
    if type(value) is not list:
        raise _no_direction(name, value, [])
    one = bool(value) and type(value[0]) is not list
    rows = [value] if one else value
    for index, row in enumerate(rows):
        if type(row) is not list or len(row) != 3:
            raise _no_direction(name, row, [] if one else [index])
    flat = list(chain.from_iterable(rows))
    for place, each in enumerate(flat):
        if type(each) not in (int, float):
            raise _no_direction(name, each, [place] if one else [place // 3, place % 3], "a number")
    try:
        made = np.array(flat, np.float64)
    except OverflowError as error:
        raise _no_direction(name, value, [], "numbers that fit a float") from error
    return made if one else made.reshape(-1, 3)


def _no_direction(name: str, bad: Any, index: list[int], expected: str = A_DIRECTION) -> bc.InputError:
    place = name + "".join(f"[{k}]" for k in index)
    got = _kind(bad) + (f" of {len(bad)}" if type(bad) is list else "")
    said = f"{place}: expected {expected}, got {got}"
    return bc.InputError("not_a_direction", said, where=name, index=index, got=got, expected=expected)


def _kind(value: Any) -> str:
    names = {dict: "an object", list: "a list", str: "text", bool: "a boolean", type(None): "null"}
    return names.get(type(value), "a number")
