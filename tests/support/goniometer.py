"""Small sets of scattered measurements made from models, as files and as `Measurements`."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

import brdfcore as bc
from brdfcore.base.channels import RGB, Channels
from brdfcore.formats.base.measurements import Measurements

Array = npt.NDArray[np.float64]


def geometries(
    lights: int = 5, viewers: int = 6, turns: int = 7, both_sides: bool = False
) -> tuple[Array, Array, Array]:
    """theta_i to 75, theta_o to 80, delta_phi to 180 degrees (both sides: down to -180), in degrees, (n,) each."""
    turn = np.linspace(0, 180, turns)
    if both_sides:
        turn = np.concatenate([-turn[-2:0:-1], turn])
    grid = np.meshgrid(np.linspace(0, 75, lights), np.linspace(0, 80, viewers), turn, indexing="ij")
    theta_i, theta_o, delta_phi = (g.reshape(-1) for g in grid)
    once = (np.minimum(theta_i, theta_o) > 0) | (delta_phi == 0)
    return theta_i[once], theta_o[once], delta_phi[once]


def measured(b: bc.Brdf, noise: float = 0.0, seed: int = 1, both_sides: bool = False, **options: Any) -> Measurements:
    """`b` at `geometries`, with relative noise."""
    theta_i, theta_o, delta_phi = geometries(both_sides=both_sides, **options)
    values = b.evaluate(*(np.radians(a) for a in (theta_i, theta_o, delta_phi)))
    values = values * (1 + noise * np.random.default_rng(seed).standard_normal(values.shape))
    return Measurements.from_columns(theta_i, 0.0, theta_o, delta_phi, values, b.channels, file="made", format="test")


def paint(channels: Channels = RGB) -> bc.Brdf:
    """A broad lobe over a diffuse part, three channels."""
    assert len(channels) == 3
    return bc.model("cook_torrance", diffuse=[0.5, 0.2, 0.1], specular=0.5, roughness=0.4, ior="glass")
