"""Pictures of a material, and slices as the numbers behind them (json, csv)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import numpy as np
from anyio.to_thread import run_sync
from brdf_service.evaluate.directions import check_incidences, check_values, polar_angles
from brdf_service.http.json import to_json
from brdf_service.http.openapi import Content
from brdf_service.http.query import ANGLES, Numbers, Query, Unit, WholeNumber, numbers
from brdf_service.library.materials import Material
from brdf_service.routes.address import Found
from brdf_service.routes.resource import Draw, Resource
from brdf_service.schemas.analysis import SliceAnswer
from brdf_service.state import State
from brdf_service.work.pictures import Picture
from pydantic import Field
from starlette.requests import Request

import brdfcore as bc

SVG, PNG, CSV = "image/svg+xml", "image/png", "text/csv; charset=utf-8"
#: Lists of up to this many values are made in the event loop: a few milliseconds. A thread waits for the interpreter's
#: lock at each of its many small steps, a second in all when the service is busy.
_INLINE_LISTED = 2500

Channel = Annotated[str | None, Field(min_length=1, max_length=40)]


class ListedSliceQuery(Query):
    """A slice as numbers."""

    theta_i: Numbers = numbers("polar angle(s) of the light; exactly one for the hemisphere", example="30,60")
    view: bc.names.View = Field(
        "polar",
        description="polar: the plane of incidence, theta_o positive on the mirror side; hemisphere: all directions of "
        "the viewer",
    )
    channel: Channel = Field(
        None,
        description="name, wavelength in nm or position of one channel; default: the picture's choice, or all of them "
        "as numbers",
    )
    angles: Unit = ANGLES


class SliceQuery(ListedSliceQuery):
    """A slice as a picture."""

    scale: bc.names.Scale = Field("linear", description="scale of the values; pictures only")


class SphereQuery(Query):
    """A lit sphere."""

    light: bc.names.Lighting = Field(
        "studio", description="studio: soft boxes in a room; sky: an overcast sky over dark ground"
    )
    size: WholeNumber = Field(460, ge=128, le=1024, description="width of the picture in pixels")
    channel: Channel = Field(
        None,
        description="name, wavelength in nm or position of one channel, in grey; default: all of them as a colour",
    )


class CoverageQuery(Query):
    """The measured angles."""

    theta_i: Numbers | None = numbers(
        "polar angle(s) of the light, one disc each; default: those of the measurements", default=None, example="0,30"
    )
    angles: Unit = ANGLES


def _check_slice(state: State, asked: ListedSliceQuery) -> None:
    check_incidences(asked.theta_i, state.settings)
    if asked.view == "hemisphere" and asked.theta_i.size != 1:
        said = f"theta_i: the hemisphere view takes one angle, got {asked.theta_i.size}"
        raise bc.InputError("wrong_number", said, where="theta_i", got=asked.theta_i.size, expected="one angle")


def _check_coverage(state: State, asked: CoverageQuery) -> None:
    if asked.theta_i is not None:
        check_incidences(asked.theta_i, state.settings)


def _seconds(channels: int, asked: Any) -> float:
    return 0.02 if asked.channel is not None else 0.02 * channels


def _check_sphere(_: State, asked: SphereQuery, found: Found) -> None:
    if asked.channel is not None:
        found.material.brdf.channels.find(asked.channel)


def _radians(theta_i: Any, unit: Unit) -> list[float]:
    listed: list[float] = np.atleast_1d(polar_angles(theta_i, unit).radians()[0]).tolist()
    return listed


def _slice_of(asked: SliceQuery, format: str) -> dict[str, Any]:
    looks = {"view": asked.view, "scale": asked.scale, "channel": asked.channel, "format": format}
    return {"theta_i": _radians(asked.theta_i, asked.angles), **looks}


def _coverage_of(asked: CoverageQuery, format: str) -> dict[str, Any]:
    return {"theta_i": None if asked.theta_i is None else _radians(asked.theta_i, asked.angles), "format": format}


def _sphere_of(asked: SphereQuery, _: str) -> dict[str, Any]:
    return asked.model_dump()


def drawn(kind: str, arguments: Callable[[Any, str], dict[str, Any]], format: str) -> Draw:
    """Draws a picture of this kind, whose arguments are those of the query in this format."""

    async def draw(_: Request, state: State, found: Found, asked: Any, etag: str) -> bytes:
        wanted = Picture(kind, found.title, arguments(asked, format))
        return await state.drawing.picture(etag, found.material, wanted)

    return draw


@cache
def _directions(view: bc.names.View) -> int:
    """Directions of the viewer in one slice; the library picks as many for every material and angle."""
    return int(bc.slice(bc.model("lambert"), 0.5, view=view).values.size)


def _values(asked: ListedSliceQuery, found: Found) -> int:
    channels = 1 if asked.channel is not None else len(found.material.brdf.channels)
    return _directions(asked.view) * asked.theta_i.size * channels


def _check_listed(state: State, asked: ListedSliceQuery, found: Found) -> None:
    check_values(_values(asked, found), state.settings)


def _listed(format: str) -> Draw:
    def list_all(material: Material, asked: ListedSliceQuery) -> bytes:
        theta_i = polar_angles(asked.theta_i, asked.angles).radians()[0]
        data = bc.slice(material.brdf, theta_i, view=asked.view, channel=asked.channel)
        return str(data.to_csv(asked.angles)).encode() if format == "csv" else to_json(data.to_json(asked.angles))

    async def draw(_: Request, state: State, found: Found, asked: ListedSliceQuery, etag: str) -> bytes:
        if _values(asked, found) <= _INLINE_LISTED and state.ready:
            return list_all(found.material, asked)
        return await run_sync(list_all, found.material, asked, limiter=state.listing)

    return draw


def _slice_resource(format: str, content: Content, **how: Any) -> Resource:
    query = SliceQuery if format in ("svg", "png") else ListedSliceQuery
    return Resource(
        f"slice.{format}", f"a slice as {format.upper()}", query, content, "", "the slice", check=_check_slice, **how
    )


PICTURES = (
    _slice_resource("svg", SVG, draw=drawn("slice", _slice_of, "svg"), seconds=_seconds, example="theta_i=30,60"),
    _slice_resource("png", PNG, draw=drawn("slice", _slice_of, "png"), seconds=_seconds),
    _slice_resource("json", SliceAnswer, draw=_listed("json"), check_found=_check_listed),
    _slice_resource("csv", CSV, draw=_listed("csv"), check_found=_check_listed),
    Resource(
        "sphere.png",
        "a lit sphere as PNG",
        SphereQuery,
        PNG,
        "Under white light scaled so that a white Lambertian sphere reaches a linear 0.9, as sRGB; what is clipped is "
        "said in the picture.",
        "the sphere",
        draw=drawn("sphere", _sphere_of, "png"),
        seconds=_seconds,
        check_found=_check_sphere,
        example="",
    ),
    *(
        Resource(
            f"coverage.{format}",
            f"which angles were measured, as {format.upper()}",
            CoverageQuery,
            media_type,
            says="the picture",
            draw=drawn("coverage", _coverage_of, format),
            check=_check_coverage,
            example="" if format == "svg" else None,
            title="measured angles" if format == "svg" else "",
        )
        for format, media_type in (("svg", SVG), ("png", PNG))
    ),
)
