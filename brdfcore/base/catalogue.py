"""Models, representations and formats by name, with their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError, UnknownNameError
from brdfcore.base.parameters import Parameter
from brdfcore.base.registry import FORMATS, MODELS, REPRESENTATIONS, Registry

#: Models of one sum.
MOST_TERMS = 8


def model(name: str, /, **parameters: Any) -> Brdf:
    """An analytic model: `model("cook_torrance", roughness=0.1, ior="gold")`.

    Raises `UnknownNameError` for an unknown model or parameter, `InputError` for a value out of bounds.

    >>> bc.model("lambert", reflectance=0.5).evaluate(0.3, 0.2, 3.0)  # 0.5/pi
    array([0.15915494])
    >>> bc.model("mirror", ior=1.567).delta_reflectance(np.radians([20, 60, 85]))[:, 0].round(6)  # Fresnel's formulas
    array([0.049078, 0.100056, 0.619148])
    >>> bc.model("cook_torrance", roughness=0.1, fresnel="none").albedo(0.0).round(3)
    array([1.])
    """
    made: Brdf = MODELS.load(name)(**parameters)
    return made


def model_from_json(content: Mapping[str, Any]) -> Brdf:
    """The model of `{"model": NAME, "parameters": {...}}`, or the sum of those in `{"sum": [{...}, ...]}`.

    A term may have a "factor", a number >= 0 or one a channel, that its values are multiplied by.

    Raises `InputError` for another form and for more than `MOST_TERMS` terms, and what `model` raises.

    >>> b = bc.model_from_json({"sum": [{"model": "lambert", "parameters": {"reflectance": 0.5}}, {"model": "mirror"}]})
    >>> b.evaluate(0.3, 0.2, 3.0)  # 0.5/pi
    array([0.15915494])
    """
    terms = content.get("sum", [content])
    if not isinstance(terms, (list, tuple)) or not 1 <= len(terms) <= MOST_TERMS:
        said = f"sum: expected a list of 1 to {MOST_TERMS} models"
        raise InputError("bad_model", said, where="sum", expected="a list of models")
    made: Brdf | None = None
    for term in terms:
        name, parameters = (term.get("model"), term.get("parameters", {})) if isinstance(term, Mapping) else (None, {})
        if not isinstance(name, str) or not isinstance(parameters, Mapping):
            said = 'expected an object {"model": NAME, "parameters": {...}}'
            raise InputError("bad_model", said, where="model", expected='{"model": NAME, "parameters": {...}}')
        for clash in ("name", "self"):  # would collide with arguments of `model` and of the class
            if clash in parameters:
                said = f"no model has a parameter {clash!r}"
                raise UnknownNameError("unknown_parameter", said, where=clash)
        one = model(name, **parameters)
        if isinstance(term, Mapping) and "factor" in term:
            one = term["factor"] * one
        made = one if made is None else made + one
    assert made is not None
    return made


def models() -> dict[str, tuple[Parameter, ...]]:
    """Every analytic model with its parameters."""
    return _parameters(MODELS)


def representations() -> dict[str, tuple[Parameter, ...]]:
    """Every table representation with what `tabulate` may be asked for.

    >>> "angle_grid" in bc.representations()
    True
    """
    return _parameters(REPRESENTATIONS)


def formats() -> dict[str, tuple[Parameter, ...]]:
    """Every file format with the options of its reader."""
    return _parameters(FORMATS)


def extensions() -> dict[str, tuple[str, ...]]:
    """Every file format with the usual ends of its files' names; a file is told by its content, not by them.

    >>> bc.extensions()["merl"]
    ('.binary',)
    """
    return {name: FORMATS.load(name).EXTENSIONS for name in FORMATS}


def _parameters(registry: Registry) -> dict[str, tuple[Parameter, ...]]:
    return {name: registry.load(name).PARAMETERS for name in registry}
