"""Query parameters as pydantic models: one declaration parses, refuses and documents itself."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar, cast
from urllib.parse import parse_qsl

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, ValidationError, WithJsonSchema
from pydantic_core import PydanticUndefined

import brdfcore as bc

_MOST_PARAMETERS = 64
_LONGEST_OBJECT = 4000
_SHORT = 1000
# ASCII only: float() itself would also take "nan", "1_000" and digits of other scripts
_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_ONE, _LIST = re.compile(_NUMBER), re.compile(rf"{_NUMBER}(?:,{_NUMBER})*")


class Query(BaseModel):
    """The parameters that a path takes, all of them: an unknown one is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class NoQuery(Query):
    """A path that takes no parameter."""


Q = TypeVar("Q", bound=Query)


def parse_query(query: bytes, model: type[Q]) -> Q:
    """The parameters of a query string. A misspelt or repeated one is an error: ignoring it would answer another
    question than the one asked."""
    pairs = _pairs(query)
    given = dict(pairs)
    if len(given) < len(pairs):
        twice = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)[:80]
        once = f"{twice} is given twice; several values are separated by commas"
        raise bc.InputError("parameter_twice", once, where=twice, expected=f"{twice} once")
    try:
        return cast(Q, model.__pydantic_validator__.validate_python(given))
    except ValidationError as error:
        raise _explained(error, model, given) from error


def _pairs(query: bytes) -> list[tuple[str, str]]:
    text = query.decode("latin-1")
    if len(text) < _SHORT and "%" not in text and "+" not in text:  # what parse_qsl gives, in a fifth of its time
        fields = [field.partition("=")[::2] for field in text.split("&") if field]
        if len(fields) <= _MOST_PARAMETERS:
            return fields
    try:
        return parse_qsl(text, keep_blank_values=True, max_num_fields=_MOST_PARAMETERS)
    except ValueError as error:
        most = f"more than {_MOST_PARAMETERS} query parameters"
        raise bc.LimitError("too_many_parameters", most, where="query", limit=_MOST_PARAMETERS) from error


def _explained(error: ValidationError, model: type[Query], given: Mapping[str, Any]) -> bc.BrdfError:
    """The first complaint, in the words of the declaration."""
    found = error.errors(include_url=False)
    # what is not known comes first: it may be a misspelt name of what is missing
    first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
    name = str(first["loc"][0]) if first["loc"] else "query"
    raised = first.get("ctx", {}).get("error")
    if isinstance(raised, bc.InputError):  # from a parser of ours, which does not know the name
        return bc.InputError(raised.code, f"{name}{raised.detail}", where=name, **raised.context)
    if first["type"] == "extra_forbidden":
        known = ", ".join(model.model_fields) or "none"
        said = f"the query has a parameter that this path does not know; it takes: {known}"
        return bc.UnknownNameError("unknown_parameter", said, where="query", got=name[:80], expected=known)
    field = model.model_fields[name]
    if first["type"] == "missing":
        hint = f", for example {name}={field.examples[0]}" if field.examples else ""
        return bc.InputError("parameter_missing", f"{name} is missing{hint}", where=name, expected=field.description)
    code, expected = _expected(openapi_schema(model, name))
    got = str(given[name])[:80]
    return bc.InputError(code, f"{name}: expected {expected}", where=name, got=got, expected=expected)


def _expected(schema: Mapping[str, Any]) -> tuple[str, str]:
    """(code of the refusal, what the field takes) by its JSON schema."""
    if "enum" in schema:
        return "bad_choice", " or ".join(schema["enum"])
    if schema.get("type") == "integer":
        return "bad_number", f"a whole number from {schema['minimum']} to {schema['maximum']}"
    return "bad_text", f"{schema.get('minLength', 0)} to {schema.get('maxLength', 'any number of')} characters"


def openapi_schema(model: type[Query], name: str) -> dict[str, Any]:
    """JSON schema of a field, without what null adds to it: a parameter that is not wanted is left out."""
    schema = dict(model.model_json_schema()["properties"][name])
    for one in schema.pop("anyOf", ()):
        schema |= one if one.get("type") != "null" else {}
    default = schema.pop("default", None)
    if default is not None:
        schema["default"] = str(default).lower() if isinstance(default, bool) else default
    return {k: v for k, v in schema.items() if k not in ("title", "description", "examples")}


def openapi_parameters(model: type[Query]) -> list[dict[str, Any]]:
    """The parameter objects of an OpenAPI operation."""
    return [
        {
            "name": name,
            "in": "query",
            "required": field.is_required(),
            "description": field.description or "",
            "schema": openapi_schema(model, name),
            **({"example": field.examples[0]} if field.examples else {}),
        }
        for name, field in model.model_fields.items()
    ]


def numbers(description: str, *, default: Any = PydanticUndefined, example: str | None = None) -> Any:
    """A field of numbers separated by commas; its type is `Numbers`."""
    return Field(default, description=description, examples=[example] if example else None, validate_default=False)


def _numbers(text: Any) -> Any:
    """ "30" as an array of shape (), "30,45" of shape (2,)."""
    if not isinstance(text, str):
        return text
    parts = text.split(",")
    if not _LIST.fullmatch(text):
        # a "+" that nobody escaped arrives as a space: 1e+2 must not be refused for that
        parts = [re.sub(r"(?<=[eE]) ", "+", part.strip()) for part in parts]
        for index, part in enumerate(parts):
            if not _ONE.fullmatch(part):
                got = "something else" if part else "nothing"
                said = f"expected a decimal number, got {got}; several values are separated by commas"
                raise _no_number(len(parts), index, said, got=part[:80], expected="a decimal number")
    made = [*map(float, parts)]
    if math.inf in made or -math.inf in made:
        index, said = [*map(math.isinf, made)].index(True), "is larger than any float64"
        raise _no_number(len(parts), index, said, expected="a number that a float64 holds")
    return np.array(made) if len(made) > 1 else np.float64(made[0])  # which is of shape () too


def _no_number(count: int, index: int, said: str, **context: str) -> bc.InputError:
    at = [index] if count > 1 else []
    return bc.InputError("not_a_number", f"{at or ''}: {said}", index=at, **context)


def _object(text: Any) -> Any:
    try:
        value = json.loads(text) if len(text) <= _LONGEST_OBJECT else None
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, dict):
        expected = f"a JSON object of at most {_LONGEST_OBJECT} characters"
        raise bc.InputError("bad_object", f": expected {expected}", got=text[:80], expected=expected)
    return value


def _whole(text: Any) -> Any:
    # pydantic would also take " 1_000.0 "
    return text if not isinstance(text, str) or re.fullmatch(r"[0-9]{1,12}", text) else None


def _flag(text: Any) -> Any:
    # pydantic would also take "0", "on" and "yes"
    return {"true": True, "false": False}.get(text) if isinstance(text, str) else text


#: float64 of shape () or (n,).
Numbers = Annotated[npt.NDArray[np.float64], PlainValidator(_numbers), WithJsonSchema({"type": "string"})]
JsonObject = Annotated[dict[str, Any], BeforeValidator(_object), WithJsonSchema({"type": "string"})]
WholeNumber = Annotated[int, BeforeValidator(_whole)]
Flag = Annotated[bool, BeforeValidator(_flag), WithJsonSchema({"type": "string", "enum": ["true", "false"]})]
Unit = bc.names.AngleUnit
Outside = Literal["raise", "nan", "clip"]

ANGLES: Any = Field("deg", description="unit of every angle, in the request and in the answer")
OUTSIDE: Any = Field(
    "raise",
    description="what a direction past the horizon means: raise refuses the request, nan gives no value, clip moves it "
    "to the edge",
)
