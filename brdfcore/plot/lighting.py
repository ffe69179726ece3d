"""The light around a sphere: its radiance by direction. x to the right, y up, z towards the viewer.

All lights are white, so that the colours of a picture are the material's alone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError

Array = npt.NDArray[np.float64]
#: Radiance of directions (..., 3) -> (...).
Radiance = Callable[[Array], Array]

#: Largest radiance of a perfectly diffuse white sphere: every lighting is scaled to it, one exposure fits all.
WHITE = 0.9

#: Softboxes of the studio: (towards, up, half width, half height, radiance); sizes as tangents.
_BOXES = (
    ((-0.62, 0.66, 0.42), (0.0, 1.0, 0.0), 0.42, 0.42, 9.0),
    ((0.93, 0.18, 0.10), (0.0, 1.0, 0.0), 0.16, 0.75, 3.2),
    ((-0.40, 0.30, -0.87), (0.0, 1.0, 0.0), 0.20, 0.60, 5.0),
)
#: Radiance of the studio's floor, horizon and ceiling, and how soft the edges of a box are (tangent).
_FLOOR, _HORIZON, _CEILING, _EDGE = 0.10, 0.42, 0.20, 0.06


def studio(towards: Array) -> Array:
    """A room with a dark floor, a square key light above left, a strip right and one behind: unscaled radiance."""
    x, y, z = (towards[..., k] for k in range(3))
    up = _step(-0.12, 0.12, y)
    room = _FLOOR + up * (_HORIZON + (_CEILING - _HORIZON) * np.clip(y, 0.0, 1.0) - _FLOOR)
    for place, vertical, wide, high, radiance in _BOXES:
        w = np.array(place) / np.linalg.norm(place)
        u = np.cross(vertical, w)
        u /= np.linalg.norm(u)
        v = np.cross(w, u)
        depth = x * w[0] + y * w[1] + z * w[2]
        ahead = np.maximum(depth, 1e-3)  # behind the plane nothing is seen; 1e-3 only avoids dividing by 0
        across = np.abs(x * u[0] + y * u[1] + z * u[2]) / ahead
        along = np.abs(x * v[0] + y * v[1] + z * v[2]) / ahead
        shape = (1 - _step(wide - _EDGE, wide + _EDGE, across)) * (1 - _step(high - _EDGE, high + _EDGE, along))
        room = room + radiance * shape * (depth > 1e-3)
    return np.asarray(room, np.float64)


def sky(towards: Array) -> Array:
    """An overcast sky (CIE: three times as bright at the zenith as at the horizon) over dark ground, unscaled."""
    y = towards[..., 1]
    ground, bright = 0.12, (1 + 2 * np.clip(y, 0.0, 1.0)) / 3
    return np.asarray(ground + _step(-0.05, 0.05, y) * (bright - ground), np.float64)


SURROUNDINGS: dict[str, Radiance] = {"studio": studio, "sky": sky}


def surroundings(name: str) -> Radiance:
    """The scaled radiance of a named lighting. Raises `InputError`."""
    if name not in SURROUNDINGS:
        listed = ", ".join(SURROUNDINGS)
        raise InputError(
            "bad_option", f"light={str(name)[:40]!r}: expected {listed}, or directions of lamps",
            where="light", got=str(name)[:40], expected=listed,
        )  # fmt: skip
    scale = _scale(name)
    return lambda towards: scale * SURROUNDINGS[name](towards)


@cache
def _scale(name: str) -> float:
    """WHITE over the largest irradiance/pi that any side of a sphere gets."""
    y = 1 - 2 * (np.arange(4000) + 0.5) / 4000  # Fibonacci's spiral: equal areas
    turn = np.pi * (1 + 5**0.5) * np.arange(4000)
    towards = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], axis=1)
    cosines = np.maximum(towards[::4] @ towards.T, 0.0)
    seen = towards[::4, 2] > 0  # what the viewer can see of it
    return WHITE / float((cosines @ SURROUNDINGS[name](towards))[seen].max() * 4 / 4000)


def _step(low: float, high: float, x: Array) -> Array:
    """0 below `low`, 1 above `high`, smooth in between."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))
