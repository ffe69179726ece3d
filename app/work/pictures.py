"""The pictures of a material: what each request asks for as JSON, and the drawing itself, in whichever process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import brdfcore as bc

#: Inches that a sphere's figure is wide and high.
_SPHERE_INCHES = (4.6, 5.0)


class Picture(NamedTuple):
    """What to draw.

    kind   a name in `KINDS`.
    title  what the picture calls the material.
    asked  the arguments of that kind, JSON-ready; angles in radians.
    """

    kind: str
    title: str
    asked: dict[str, Any]


def draw(brdf: bc.Brdf, picture: Picture) -> bytes:
    """The picture's file. Raises `InputError` for what was asked for."""
    return KINDS[picture.kind](brdf, picture.title, **picture.asked)


def _slice(
    brdf: bc.Brdf, title: str, *, theta_i: list[float], view: str, scale: str, channel: str | None, format: str
) -> bytes:
    looks: dict[str, Any] = {"scale": scale, "channel": channel, "title": title}
    if view == "polar":
        return bytes(bc.plot.render(bc.plot.polar(brdf, np.array(theta_i), **looks), format))
    return bytes(bc.plot.render(bc.plot.hemisphere(brdf, theta_i[0], **looks), format))


def _coverage(brdf: bc.Brdf, title: str, *, theta_i: list[float] | None, format: str) -> bytes:
    figure = bc.plot.coverage(brdf, None if theta_i is None else np.array(theta_i), title=title)
    return bytes(bc.plot.render(figure, format))


def _sphere(brdf: bc.Brdf, title: str, *, light: str, size: int, channel: str | None) -> bytes:
    dpi = size / _SPHERE_INCHES[0]
    figure = bc.plot.sphere(brdf, light, channel=channel, title=title, size=_SPHERE_INCHES, dpi=dpi)
    return bytes(bc.plot.render(figure, "png"))


KINDS: dict[str, Callable[..., bytes]] = {"slice": _slice, "sphere": _sphere, "coverage": _coverage}
