"""Query parameters, declared once: the declaration parses, explains its errors and documents itself."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any
from urllib.parse import parse_qsl

import numpy as np
import numpy.typing as npt

import brdfcore as bc

#: Marks a parameter without a default.
REQUIRED: Any = object()

_MOST_PARAMETERS = 64
_LONGEST_OBJECT = 4000
_SHORT = 1000
# ASCII only: float() itself would also take "nan", "1_000" and digits of other scripts
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


@dataclass(frozen=True, eq=False)
class QueryParameter:
    """One query parameter: `parse(name, text)` gives its value or raises `InputError`; `schema` is its OpenAPI."""

    name: str
    description: str
    parse: Callable[[str, str], Any]
    schema: dict[str, Any] = field(default_factory=lambda: {"type": "string"})
    default: Any = REQUIRED
    example: str | None = None

    def openapi(self) -> dict[str, Any]:
        """The parameter object of an OpenAPI operation."""
        schema = dict(self.schema)
        if self.default is not REQUIRED and self.default is not None:
            schema["default"] = str(self.default).lower() if isinstance(self.default, bool) else self.default
        described = {
            "name": self.name,
            "in": "query",
            "required": self.default is REQUIRED,
            "description": self.description,
            "schema": schema,
        }
        return described if self.example is None else {**described, "example": self.example}


def parse_query(query: bytes, parameters: tuple[QueryParameter, ...]) -> dict[str, Any]:
    """Values of the declared parameters. A misspelt or repeated one is an error: ignoring it would answer another
    question than the one asked."""
    declared = _by_name(parameters)
    values: dict[str, Any] = {}
    for name, text in _pairs(query):
        if name not in declared:
            known = ", ".join(declared) or "none"
            raise bc.UnknownNameError(
                "unknown_parameter",
                f"the query has a parameter that this path does not know; it takes: {known}",
                where="query",
                got=name[:80],
                expected=known,
            )
        if name in values:
            raise bc.InputError(
                "parameter_twice",
                f"{name} is given twice; several values are separated by commas",
                where=name,
                expected=f"{name} once",
            )
        values[name] = declared[name].parse(name, text)
    for name, parameter in declared.items():
        if name not in values:
            if parameter.default is REQUIRED:
                hint = f", for example {name}={parameter.example}" if parameter.example else ""
                raise bc.InputError(
                    "parameter_missing", f"{name} is missing{hint}", where=name, expected=parameter.description
                )
            values[name] = parameter.default
    return values


@cache
def _by_name(parameters: tuple[QueryParameter, ...]) -> dict[str, QueryParameter]:
    return {p.name: p for p in parameters}


def _pairs(query: bytes) -> list[tuple[str, str]]:
    if len(query) < _SHORT and b"%" not in query and b"+" not in query:  # what parse_qsl gives, in a fifth of its time
        fields = [field.partition("=") for field in query.decode("latin-1").split("&") if field]
        if len(fields) <= _MOST_PARAMETERS:
            return [(name, text) for name, _, text in fields]
    try:
        return parse_qsl(query.decode("latin-1"), keep_blank_values=True, max_num_fields=_MOST_PARAMETERS)
    except ValueError as error:
        raise bc.LimitError(
            "too_many_parameters",
            f"more than {_MOST_PARAMETERS} query parameters",
            where="query",
            limit=_MOST_PARAMETERS,
        ) from error


def parse_numbers(name: str, text: str) -> npt.NDArray[np.float64]:
    """ "30" as an array of shape (), "30,45" of shape (2,)."""
    if len(text) < _SHORT and _NUMBER.fullmatch(text):
        return np.array(float(text))
    parts = [p.strip() for p in text.split(",")]
    # a "+" that nobody escaped arrives as a space: 1e+2 must not be refused for that
    parts = [re.sub(r"(?<=[eE]) ", "+", p) for p in parts]
    for index, part in enumerate(parts):
        if not _NUMBER.fullmatch(part):
            place = f"{name}[{index}]" if len(parts) > 1 else name
            what = "nothing" if not part else "something else"
            raise bc.InputError(
                "not_a_number",
                f"{place}: expected a decimal number, got {what}; several values are separated by commas",
                where=name,
                index=[index] if len(parts) > 1 else [],
                got=part[:80],
                expected="a decimal number",
            )
    numbers = [float(p) for p in parts]
    return np.array(numbers[0] if len(numbers) == 1 else numbers)


def choice(*choices: str) -> Callable[[str, str], str]:
    """A parser that takes one of `choices`."""

    def parse(name: str, text: str) -> str:
        if text not in choices:
            listed = " or ".join(choices)
            raise bc.InputError("bad_choice", f"{name}: expected {listed}", where=name, got=text[:80], expected=listed)
        return text

    return parse


def whole_number(low: int, high: int) -> Callable[[str, str], int]:
    """A parser of a whole number in [low, high]."""

    def parse(name: str, text: str) -> int:
        if re.fullmatch(r"[0-9]{1,12}", text) and low <= int(text) <= high:
            return int(text)
        expected = f"a whole number from {low} to {high}"
        raise bc.InputError("bad_number", f"{name}: expected {expected}", where=name, got=text[:80], expected=expected)

    return parse


def text(longest: int) -> Callable[[str, str], str]:
    """A parser of text of 1 to `longest` characters."""

    def parse(name: str, given: str) -> str:
        if not 0 < len(given) <= longest:
            expected = f"1 to {longest} characters"
            raise bc.InputError(
                "bad_text", f"{name}: expected {expected}", where=name, got=given[:80], expected=expected
            )
        return given

    return parse


def json_object(name: str, text: str) -> dict[str, Any]:
    """A parser of a JSON object."""
    try:
        value = json.loads(text) if len(text) <= _LONGEST_OBJECT else None
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, dict):
        expected = f"a JSON object of at most {_LONGEST_OBJECT} characters"
        raise bc.InputError("bad_object", f"{name}: expected {expected}", where=name, got=text[:80], expected=expected)
    return value


def flag(name: str, text: str) -> bool:
    """A parser of "true" or "false"."""
    if text not in ("true", "false"):
        raise bc.InputError(
            "bad_choice", f"{name}: expected true or false", where=name, got=text[:80], expected="true or false"
        )
    return text == "true"


ANGLES = QueryParameter(
    "angles",
    "unit of every angle, in the request and in the answer: degrees or radians",
    choice("deg", "rad"),
    {"type": "string", "enum": ["deg", "rad"]},
    default="deg",
)

OUTSIDE = QueryParameter(
    "outside",
    "what a direction past the horizon means: raise refuses the request, nan gives no value, clip moves it to the edge",
    choice("raise", "nan", "clip"),
    {"type": "string", "enum": ["raise", "nan", "clip"]},
    default="raise",
)
