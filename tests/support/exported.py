"""Tables of every kind that is exported, with each symmetry, and directions to ask them in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import brdfcore as bc
from tests.support.sources import Skewed

HALF_PI = np.pi / 2


def _gold(roughness: float = 0.2) -> bc.Brdf:
    return bc.model("cook_torrance", roughness=roughness, ior="gold", distribution="beckmann")


def _warp() -> bc.Brdf:
    from tests.brdfcore.tables.test_vndf_warp import made
    from tests.support.rgl_synthetic import fields_of

    return made(fields_of(thetas=5, normals=(16, 12), samples=6))


#: By name; those that a shader has come first.
MADE: dict[str, Callable[[], bc.Brdf]] = {
    "half_difference": lambda: bc.tabulate(_gold(), "half_difference", shape=(24, 12, 12)),
    "half_difference, three channels, no symmetry": lambda: bc.tabulate(
        Skewed(), "half_difference", shape=(12, 10, 12)
    ),
    "half_difference about the mirror direction": lambda: bc.tabulate(
        bc.model("phong", exponent=200), "half_difference", shape=(24, 12, 12)
    ),
    "lobe_grid": lambda: bc.tabulate(_gold(), "lobe_grid", shape=(24, 12, 12)),
    "angle_grid": lambda: bc.tabulate(_gold(0.4), "angle_grid", shape=(31, 31, 61)),
    "angle_grid, three channels, no symmetry": lambda: bc.tabulate(Skewed(), "angle_grid", shape=(10, 10, 19)),
    "angle_grid, nearest": lambda: bc.tabulate(_gold(), "angle_grid", shape=(19, 19, 37), interpolation="nearest"),
    "vndf_warp": _warp,
}
SHADERS = tuple(name for name in MADE if name != "vndf_warp")

_held: dict[str, bc.Table] = {}


def table(name: str) -> bc.Table:
    """The table of that name, made when first asked for."""
    if name not in _held:
        made = MADE[name]()
        assert isinstance(made, bc.Table)
        _held[name] = made
    return _held[name]


def angles(n: int, seed: int, dtype: Any = np.float64) -> list[Any]:
    """Half of them near the mirror direction, none within 1e-3 of the horizon."""
    rng = np.random.default_rng(seed)
    theta_i, theta_o = np.arccos(rng.random((2, n)))
    delta_phi = rng.uniform(-np.pi, np.pi, n)
    near = n // 2
    theta_o[:near] = theta_i[:near] + rng.normal(0, 0.05, near)
    delta_phi[:near] = np.pi + rng.normal(0, 0.05, near)
    return [
        x.astype(dtype) for x in (np.minimum(theta_i, HALF_PI - 1e-3), np.clip(theta_o, 0, HALF_PI - 1e-3), delta_phi)
    ]


def vectors(n: int, seed: int, dtype: Any = np.float64) -> list[Any]:
    """Directions of `angles` at any azimuth, as unit vectors; one in eight below the horizon."""
    theta_i, theta_o, delta_phi = angles(n, seed)
    phi = np.random.default_rng(seed + 1).uniform(-np.pi, np.pi, n)
    found = [
        np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
        for t, p in ((theta_i, phi), (theta_o, phi + delta_phi))
    ]
    found[0][::16, 2] *= -1
    found[1][8::16, 2] *= -1
    return [v.astype(dtype) for v in found]
