"""JSON in and out. What a reader of JSON lets pass (NaN, true, 10**400, a key twice) is refused here, with its place.

Numbers go through orjson, some ten times faster than the standard library and the same bits both ways; whatever it
refuses is read again by the standard library, which can say where and why.
"""

from __future__ import annotations

import array
import contextlib
import json
import threading
from itertools import chain
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import orjson

try:
    import simdjson
except ModuleNotFoundError:  # faster where it is; orjson does all of it
    simdjson = None  # type: ignore[assignment]

from brdf_service.evaluate.angles import ANGLE_NAMES, AngleRequest, Outside, Unit
from brdf_service.evaluate.vectors import EXPECTED, VECTOR_NAMES, VectorRequest
from brdf_service.http.errors import MalformedBodyError

import brdfcore as bc

#: Values encoded at a time: the interpreter's lock is held meanwhile, and other requests must get a turn in between.
_VALUES = 65_536
Floats = npt.NDArray[np.float64]
_held = threading.local()
#: What a body may hold.
Form = Literal["angles", "vectors"]
_SORTED = sorted(ANGLE_NAMES)
_KNOWN = (*ANGLE_NAMES, "angles")


def directions_from_json(
    body: bytes, form: Form | None, unit: Unit | None, outside: Outside
) -> AngleRequest | VectorRequest:
    """The angles or the vectors of an evaluate request's JSON body; which, its fields say. `form`, `unit` and `outside`
    are what the query says.

    Raises `MalformedBodyError` for what is no JSON, `InputError` naming field and index for what is no number.
    """
    if form != "vectors":
        found = _flat_lists(body)
        if found is not None:
            return AngleRequest(*found, unit or "deg", outside)
    content = _load_numbers(body)
    if not isinstance(content, dict):
        known = " and ".join(VECTOR_NAMES) if form == "vectors" else ", ".join(ANGLE_NAMES)
        raise bc.InputError(
            "bad_body",
            f"the body must be a JSON object with {known}; got {_kind(content)}",
            where="body",
            got=_kind(content),
            expected="an object",
        )
    if form == "vectors" or (form is None and not content.keys().isdisjoint(VECTOR_NAMES)):
        _check_fields(content, VECTOR_NAMES, VECTOR_NAMES, EXPECTED)
        return VectorRequest(*(_directions(name, content[name]) for name in VECTOR_NAMES))
    _check_fields(content, _KNOWN, ANGLE_NAMES, "a number or a list of numbers")
    plain = b"u" not in body and b"f" not in body  # neither true nor false: no other word here has these letters
    a, b, c = (_numbers(name, content[name], plain) for name in ANGLE_NAMES)
    return AngleRequest(a, b, c, _unit(content, unit), outside)


def _check_fields(content: dict[str, Any], known: tuple[str, ...], needed: tuple[str, ...], expected: str) -> None:
    for key in content:
        if key not in known:
            raise unknown_field(key, known)
    for name in needed:
        if name not in content:
            raise bc.InputError("field_missing", f"{name} is missing from the body", where=name, expected=expected)


def _flat_lists(body: bytes) -> tuple[Floats, Floats, Floats] | None:
    """The three angles of a body that holds just them, each a flat list of numbers, and nothing else. None: read it in
    another way, which also says what is wrong with it.

    simdjson puts a list of numbers straight into memory where orjson makes a Python object of each; the bits are the
    same (both round to the nearest).
    """
    # a nested list would be flattened in silence: there must be three brackets
    if simdjson is None or body.count(b"[") != 3:
        return None
    try:
        content: Any = _parser().parse(body)
        if sorted(content) != _SORTED:  # a key twice is there twice
            return None
        a, b, c = (np.frombuffer(content[name].as_buffer(of_type="d"), np.float64) for name in ANGLE_NAMES)
    except (ValueError, TypeError, RuntimeError, AttributeError, KeyError):  # no JSON, no list, no number
        return None
    return a, b, c


def _parser() -> Any:
    """One for each thread: it keeps its memory, and must not be used while a document of it is."""
    if not hasattr(_held, "parser"):
        _held.parser = simdjson.Parser()
    return _held.parser


def _directions(name: str, value: Any) -> npt.NDArray[np.float64]:
    """[x, y, z] as an array (3,), a list of them as (n, 3)."""
    if type(value) is not list:
        raise _no_direction(name, value, [])
    one = bool(value) and type(value[0]) is not list
    rows = [value] if one else value
    for index, row in enumerate(rows):
        if type(row) is not list or len(row) != 3:
            raise _no_direction(name, row, [] if one else [index])
    flat = list(chain.from_iterable(rows))
    if not set(map(type, flat)) <= {int, float}:
        place = next(k for k, x in enumerate(flat) if type(x) not in (int, float))
        raise _no_direction(name, flat[place], [place] if one else [place // 3, place % 3], "a number")
    try:
        numbers = np.array(flat, np.float64)
    except OverflowError as error:
        raise _no_direction(name, value, [], "numbers that fit a float") from error
    return numbers if one else numbers.reshape(-1, 3)


def _no_direction(name: str, got: Any, index: list[int], expected: str = EXPECTED) -> bc.InputError:
    place = name + "".join(f"[{k}]" for k in index)
    length = f" of {len(got)}" if type(got) is list else ""
    return bc.InputError(
        "not_a_direction",
        f"{place}: expected {expected}, got {_kind(got)}{length}",
        where=name,
        index=index,
        got=f"{_kind(got)}{length}",
        expected=expected,
    )


def unknown_field(key: str, known: tuple[str, ...], where: str = "body") -> bc.UnknownNameError:
    """The error for a field that nobody reads: ignoring it would do something else than was asked."""
    return bc.UnknownNameError(
        "unknown_field",
        f"{where} has a field that is not known; it takes: {', '.join(known)}",
        where=where,
        got=key[:80],
        expected=", ".join(known),
    )


def load(body: bytes, example: str) -> Any:
    """What a JSON body says, no key twice. Raises `MalformedBodyError` with line and column."""
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
            expected=example,
        ) from error
    except UnicodeDecodeError as error:
        raise MalformedBodyError(
            "bad_json", f"the body is not UTF-8 at byte {error.start}", where="body", offset=error.start
        ) from error
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits; thousands of brackets
        raise MalformedBodyError(
            "bad_json", "the body is JSON that cannot be read: nested too deeply, or a number too long", where="body"
        ) from error


def to_json(value: Any) -> bytes:
    """`value` as compact JSON. Metadata may hold what JSON has no word for: not finite becomes null, numpy becomes
    plain, the rest its text."""
    try:
        return orjson.dumps(value)
    except TypeError:  # a whole number beyond 64 bits, a key that is no text, an object of numpy
        return json.dumps(_plain(value), allow_nan=False, separators=(",", ":")).encode()


def to_header(value: Any) -> str:
    """`value` as JSON in ASCII: whatever it holds, it cannot break out of a header."""
    return json.dumps(_plain(value), allow_nan=False, separators=(",", ":"))


def array_to_json(values: npt.NDArray[Any]) -> bytes:
    """A contiguous array as nested lists: floats read back to the same bits, not finite ones are null."""
    if values.dtype == np.float32:
        values = values.astype(np.float64)  # its shortest text is that of another float64
    if values.size <= _VALUES or values.ndim == 0:
        return orjson.dumps(values, option=orjson.OPT_SERIALIZE_NUMPY)
    step = max(1, _VALUES * len(values) // values.size)
    parts = [
        orjson.dumps(values[k : k + step], option=orjson.OPT_SERIALIZE_NUMPY)[1:-1] for k in range(0, len(values), step)
    ]
    return b"[%b]" % b",".join(parts)


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


def _load_numbers(body: bytes) -> Any:
    try:
        content = orjson.loads(body)
    except orjson.JSONDecodeError:
        content = None
    if isinstance(content, dict):
        # a key that is there twice passes unseen, but its quotation marks are there
        texts = len(content) + sum(type(value) is str for value in content.values())
        if body.count(b'"') == 2 * texts:
            return content
    return load(body, '{"theta_i": 30, "theta_o": [0, 30], "delta_phi": 180}')


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose keys are all different; json alone would keep the last and drop the others in silence."""
    made = dict(pairs)
    if len(made) != len(pairs):
        keys = [k for k, _ in pairs]
        seen: set[str] = set()
        twice = next(k for k in keys if k in seen or seen.add(k))  # type: ignore[func-returns-value]
        raise bc.InputError("field_twice", "the body has a field twice", where="body", got=twice[:80])
    return made


def _unit(content: dict[str, Any], asked: Unit | None) -> Unit:
    unit = content.get("angles", asked or "deg")
    if unit not in ("deg", "rad"):
        raise bc.InputError(
            "bad_choice",
            "angles: expected 'deg' or 'rad'",
            where="angles",
            got=unit if isinstance(unit, str) else _kind(unit),
            expected="deg or rad",
        )
    if asked is not None and unit != asked:
        raise bc.InputError(
            "given_twice",
            f"angles: the query says {asked}, the body {unit}",
            where="angles",
            got=unit,
            expected=asked,
        )
    made: Unit = unit
    return made


def _numbers(name: str, value: Any, plain: bool) -> npt.NDArray[np.float64]:
    """A JSON number or flat list of numbers as an array of shape () or (n,); `plain`: no boolean can be among them."""
    if plain and type(value) is list:
        with contextlib.suppress(TypeError, OverflowError):  # five times faster than numpy, and takes no text either
            return np.frombuffer(array.array("d", value), np.float64)
    listed = value if type(value) is list else [value]
    # in C over the whole list; only an offender is looked for one by one. bool is an int to isinstance, not here
    if not set(map(type, listed)) <= {int, float}:
        index, bad = next((k, v) for k, v in enumerate(listed) if type(v) not in (int, float))
        raise _not_a_number(name, value, index, bad)
    try:
        numbers = np.array(listed, dtype=np.float64)
    except OverflowError as error:
        index, bad = next((k, v) for k, v in enumerate(listed) if type(v) is int and abs(v) > 10**308)
        raise _not_a_number(name, value, index, bad) from error
    return numbers if type(value) is list else numbers[0].reshape(())


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
