"""JSON out, and small JSON bodies in: the same bits both ways, and nothing that JSON has no word for."""

from __future__ import annotations

import json
from typing import Any, TypeVar

import numpy as np
import orjson
from brdf_service.http.errors import MalformedBodyError
from pydantic import BaseModel, ValidationError

import brdfcore as bc

M = TypeVar("M", bound=BaseModel)


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


def from_json(body: bytes, example: str) -> Any:
    """What a JSON body says, no key twice. Raises `MalformedBodyError` with line and column."""
    where: dict[str, Any] = {"where": "body", "expected": example}
    try:
        return json.loads(body.decode("utf-8"), object_pairs_hook=_once)
    except bc.InputError:
        raise
    except json.JSONDecodeError as error:
        said = f"the body is not JSON: {error.msg} at line {error.lineno}, column {error.colno}"
        raise MalformedBodyError("bad_json", said, offset=error.pos, **where) from error
    except UnicodeDecodeError as error:
        said = f"the body is not UTF-8 at byte {error.start}"
        raise MalformedBodyError("bad_json", said, offset=error.start, **where) from error
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits; thousands of brackets
        said = "the body is JSON that cannot be read: nested too deeply, or a number too long"
        raise MalformedBodyError("bad_json", said, **where) from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose keys are all different; json alone would keep the last and drop the others in silence."""
    made: dict[str, Any] = {}
    for key, value in pairs:
        if key in made:
            raise bc.InputError("field_twice", "the body has a field twice", where="body", got=key[:80])
        made[key] = value
    return made


def model_from_json(body: bytes, model: type[M], example: str) -> M:
    """A JSON body as `model`. Raises `MalformedBodyError` for what is no JSON, and what `validated` raises."""
    return validated(from_json(body, example), model)


def validated(content: Any, model: type[M], where: str = "") -> M:
    """`content` as `model`, strictly: a number in quotes is none. `where` goes before the names of its fields."""
    try:
        return model.model_validate(content, strict=True)
    except ValidationError as error:
        raise _explained(error, where) from error


def _explained(error: ValidationError, where: str) -> bc.BrdfError:
    """The first complaint about a body."""
    first = error.errors(include_url=False, include_context=False)[0]
    kind, path = first["type"], [str(part)[:40] for part in first["loc"]]
    place = (where + ".".join(path) or "body")[:100]
    got, said = first["input"], first["msg"].removeprefix("Value error, ")  # the prefix of our own validators' words
    shown = got if isinstance(got, (str, bool, int, float)) else type(got).__name__
    if kind == "extra_forbidden":
        return bc.UnknownNameError("unknown_field", f"{place}: no such field; /docs lists them", where=place, got=shown)
    code = {"missing": "field_missing", "model_type": "bad_body"}.get(kind, "bad_field")
    return bc.InputError(code, f"{place}: {said}", where=place, got=shown, expected=said)
