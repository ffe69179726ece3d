"""Models, representations and formats by name, with their parameters."""

from __future__ import annotations

from typing import Any

from brdfcore.base.brdf import Brdf
from brdfcore.base.parameters import Parameter
from brdfcore.base.registry import FORMATS, MODELS, REPRESENTATIONS, Registry


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
