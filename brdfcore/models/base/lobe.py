"""What models of the form f = diffuse/pi + specular lobe share: the two factors and the light they may reflect."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter

Float64Array = npt.NDArray[np.float64]

DIFFUSE = Parameter("diffuse", "k_d", "reflectance of the diffuse part", 0.0, bounds=(0.0, np.inf))
#: Degrees of theta_i at which the albedo of a model whose factors pass 1 is looked at.
ANGLES = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 65.0, 70.0, 75.0, 80.0, 83.0, 85.0, 87.0, 88.0, 89.0)
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


def check_albedo(b: Brdf) -> None:
    """Hold the albedo of a model with a Fresnel term to 1: a lobe that reflects 4 % leaves room for a diffuse part.

    `InputError` where it passes 1 at normal incidence; where it does so at a larger angle only, the model does not
    conserve energy, and says from which of `ANGLES` on.
    """
    p = b.metadata["parameters"]
    total = float(np.max(per_channel(p["diffuse"]) + per_channel(p["specular"])))
    if total <= 1 + 4 * np.finfo(np.float64).eps:
        return
    name, slack = b.metadata["model"], 1e-5
    first = float(b.albedo(0.0).max())
    if first > 1 + slack:
        said = f"{name}: diffuse and specular reflect {first:.4g} of the light at normal incidence; expected at most 1"
        raise InputError("bad_parameter", said, where="specular", got=first, expected="an albedo of at most 1")
    past = (b.albedo(np.radians(ANGLES)) > 1 + slack).any(axis=1)
    if past.any():
        b.energy_conserving = False
        angle = float(np.array(ANGLES)[past].min())
        b.metadata["energy"] = f"reflects more light than arrives from theta_i = {angle:g} degrees on"
