"""What models of the form f = diffuse/pi + specular lobe share: the two factors and the light they may reflect."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter

Float64Array = npt.NDArray[np.float64]

DIFFUSE = Parameter("diffuse", "k_d", "reflectance of the diffuse part", 0.0, bounds=(0.0, np.inf))
SPECULAR = Parameter("specular", "k_s", "factor of the specular lobe", 1.0, bounds=(0.0, np.inf))


def per_channel(value: Any) -> Float64Array:
    """A number, or a list of one per channel, as float64 (channels,)."""
    return np.atleast_1d(np.asarray(value, dtype=np.float64))


def check_sum(owner: str, parameters: Mapping[str, Any], energy_conserving: bool) -> None:
    """Hold diffuse + specular to 1: `InputError` where the model conserves energy, UserWarning elsewhere."""
    total = float(np.max(per_channel(parameters["diffuse"]) + per_channel(parameters["specular"])))
    if total <= 1 + 4 * np.finfo(np.float64).eps:  # decimals that add to 1 may miss it by their own rounding
        return
    detail = f"{owner}: diffuse + specular = {total:g} reflects more light than arrives; expected at most 1"
    if energy_conserving:
        raise InputError("bad_parameter", detail, where="specular", got=total, expected="diffuse + specular <= 1")
    warnings.warn(detail, stacklevel=4)  # at the caller of bc.model, or of the class
