"""Self-describing parameters: one declaration feeds validation, documentation, `--help` and forms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from brdfcore.base.errors import InputError, UnknownNameError

Kind = Literal["number", "choice", "ior", "wavelengths", "flag", "integer", "text"]


def shown(value: Any) -> str:
    """`value` as an error message shows it: its repr, at most 80 characters; its type where it has none."""
    try:
        text = repr(value)
    except Exception:  # whole numbers of more than 4,300 digits, and whatever a caller's own class does
        return f"a value of type {type(value).__name__}"
    return text if len(text) <= 80 else text[:77] + "..."


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a registry entry.

    name      keyword argument.
    symbol    as in the literature, e.g. "m" or "alpha".
    meaning   one sentence.
    default   value when not given; None means "not given" and has to be legal for the entry.
    kind      "number" takes a float, or one per channel unless `per_channel` is False.
    bounds    (lowest, highest) allowed, both included unless listed in `open_bounds` ("low", "high").
    unit      "" for a pure number, else "rad", "nm", ...
    choices   legal values of kind "choice".
    aliases   other keyword names that mean the same.

    >>> exponent = next(p for p in bc.models()["phong"] if p.name == "exponent")
    >>> exponent.symbol, exponent.default, exponent.range_text()
    ('n', 100.0, '[0, 2e+16]')
    """

    name: str
    symbol: str
    meaning: str
    default: Any
    kind: Kind = "number"
    bounds: tuple[float, float] = (-math.inf, math.inf)
    open_bounds: tuple[str, ...] = ()
    unit: str = ""
    choices: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()
    per_channel: bool = True

    def to_json(self) -> dict[str, Any]:
        """JSON-ready description; infinite bounds become null."""
        low, high = (x if math.isfinite(x) else None for x in self.bounds)
        return {
            "name": self.name,
            "symbol": self.symbol,
            "meaning": self.meaning,
            "kind": self.kind,
            "default": self.default,
            "bounds": [low, high] if self.kind in ("number", "integer") else None,
            "unit": self.unit,
            "choices": list(self.choices),
            "aliases": list(self.aliases),
            "per_channel": self.per_channel and self.kind == "number",
        }

    def range_text(self) -> str:
        """The legal range as mathematics writes it, e.g. "(0, 1]" or "one of 'a', 'b'"."""
        if self.kind == "choice":
            return "one of " + ", ".join(repr(c) for c in self.choices)
        low, high = self.bounds
        left = "(" if "low" in self.open_bounds or low == -math.inf else "["
        right = ")" if "high" in self.open_bounds or high == math.inf else "]"
        return f"{left}{low:g}, {high:g}{right}"

    def validate(self, owner: str, value: Any) -> Any:
        """`value` in its canonical type (float, 1-D float64 array, str, bool, int), or `InputError`."""
        if value is None and self.default is None:
            return None
        if self.kind == "choice":
            if not isinstance(value, str) or value not in self.choices:
                raise self._error(owner, value, self.range_text())
            return value
        if self.kind == "flag":
            if not isinstance(value, (bool, np.bool_)):
                raise self._error(owner, value, "true or false")
            return bool(value)
        if self.kind == "text":
            if not isinstance(value, str):
                raise self._error(owner, value, "text")
            return value
        if self.kind == "ior":  # its own grammar: names, n, (n, k), {"n", "k"}; the entry interprets it
            return value
        return self._validate_number(owner, value)

    def _validate_number(self, owner: str, value: Any) -> Any:
        if value is None or isinstance(value, (bool, np.bool_, str, bytes, Mapping)):
            raise self._error(owner, value, "a number")
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:  # overflow: a whole number beyond float64
            raise self._error(owner, value, "a number") from error
        many = self.kind == "wavelengths" or (self.kind == "number" and self.per_channel)
        if array.ndim > 1 or (array.ndim == 1 and (not many or array.size == 0)):
            raise self._error(owner, value, "one number" + (" or one per channel" if many else ""))
        low, high = self.bounds
        bad = ~(np.isfinite(array) & (array >= low) & (array <= high))
        if "low" in self.open_bounds:
            bad |= array == low
        if "high" in self.open_bounds:
            bad |= array == high
        if bad.any():
            raise self._error(owner, value, self.range_text())
        if self.kind == "integer":
            if array != np.rint(array):
                raise self._error(owner, value, "a whole number")
            return int(array)
        if array.ndim == 0:
            return float(array)
        array = array.copy()
        array.flags.writeable = False
        return array

    def _error(self, owner: str, value: Any, expected: str) -> InputError:
        unit = f" {self.unit}" if self.unit else ""
        got = shown(value)
        return InputError(
            "bad_parameter",
            f"{owner}: {self.name} = {got} is not allowed; expected {expected}{unit} ({self.meaning})",
            where=self.name,
            got=got,
            expected=expected + unit,
        )


def resolve(owner: str, parameters: Iterable[Parameter], given: Mapping[str, Any]) -> dict[str, Any]:
    """Canonical value of every parameter: given or default, validated, aliases resolved.

    Raises `UnknownNameError` for a keyword no parameter has, `InputError` for a value outside its range
    or a parameter given twice (by name and alias).
    """
    parameters = tuple(parameters)
    by_key = {key: p for p in parameters for key in (p.name, *p.aliases)}
    values: dict[str, Any] = {}
    for key, value in given.items():
        if key not in by_key:
            names = ", ".join(p.name for p in parameters) or "none"
            raise UnknownNameError(
                "unknown_parameter",
                f"{owner} has no parameter {key!r}; it takes: {names}",
                where=key,
                got=key,
                expected=names,
            )
        parameter = by_key[key]
        if parameter.name in values:
            raise InputError(
                "parameter_twice",
                f"{owner}: {parameter.name} is given twice (also as {key!r}); give it once",
                where=parameter.name,
            )
        values[parameter.name] = parameter.validate(owner, value)
    for parameter in parameters:
        if parameter.name not in values:
            values[parameter.name] = parameter.validate(owner, parameter.default)
    return values
