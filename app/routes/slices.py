"""Slices of a material: as a picture (svg, png) and as the numbers behind it (json, csv)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Literal

import numpy as np
from anyio.to_thread import run_sync
from brdf_service.evaluate.angles import AngleRequest, Array, Unit, check_values, in_radians, in_request_units
from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import ANGLES, QueryParameter, choice, parse_numbers, parse_query, text
from brdf_service.http.security import NO_REFERRER, SVG_POLICY
from brdf_service.library.materials import Material
from brdf_service.routes.addressing import Address
from brdf_service.schemas import SliceAnswer
from brdf_service.settings import Settings
from brdf_service.state import state_of
from brdf_service.work.picture_queue import draw_with, picture
from brdf_service.work.pictures import Picture
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

Format = Literal["svg", "png", "json", "csv"]

MEDIA_TYPES: dict[Format, str] = {
    "svg": "image/svg+xml",
    "png": "image/png",
    "json": "application/json",
    "csv": "text/csv; charset=utf-8",
}

#: Lists of up to this many values are made in the event loop: a few milliseconds. A thread waits for the interpreter's
#: lock at each of its many small steps, a second in all when the service is busy.
INLINE_LISTED = 2500

THETA_I = QueryParameter(
    "theta_i", "polar angle(s) of the light; exactly one for the hemisphere", parse_numbers, example="30,60"
)
VIEW = QueryParameter(
    "view",
    "polar: the plane of incidence, theta_o positive on the mirror side; hemisphere: all directions of the viewer",
    choice("polar", "hemisphere"),
    {"type": "string", "enum": ["polar", "hemisphere"]},
    default="polar",
)
SCALE = QueryParameter(
    "scale",
    "scale of the values; pictures only",
    choice("linear", "log"),
    {"type": "string", "enum": ["linear", "log"]},
    default="linear",
)
CHANNEL = QueryParameter(
    "channel",
    "name, wavelength in nm or position of one channel; default: the picture's choice, or all of them as numbers",
    text(40),
    {"type": "string", "minLength": 1, "maxLength": 40},
    default=None,
)
#: A picture needs a scale, numbers have none.
QUERIES: dict[Format, tuple[QueryParameter, ...]] = {
    "svg": (THETA_I, VIEW, SCALE, CHANNEL, ANGLES),
    "png": (THETA_I, VIEW, SCALE, CHANNEL, ANGLES),
    "json": (THETA_I, VIEW, CHANNEL, ANGLES),
    "csv": (THETA_I, VIEW, CHANNEL, ANGLES),
}


@dataclass(frozen=True)
class SliceRequest:
    """What to draw or list."""

    theta_i: Array
    view: Literal["polar", "hemisphere"]
    scale: Literal["linear", "log"]
    channel: str | None
    angles: Unit


def slice_routes(address: Address) -> APIRouter:
    """The four slice operations under one way of naming a material."""
    router = APIRouter(tags=[address.label])
    for format in MEDIA_TYPES:
        _add(router, address, format)
    return router


def _add(router: APIRouter, address: Address, format: Format) -> None:
    query = QUERIES[format]
    media_type = MEDIA_TYPES[format]
    schema: dict[str, Any] = ref(SliceAnswer) if format == "json" else {"type": "string"}
    content = {media_type.partition(";")[0]: {"schema": schema}}

    @router.get(
        f"{address.prefix}/slice.{format}",
        summary=f"a slice as {format.upper()}",
        operation_id=f"slice_{format}_{address.label}",
        responses=answers(content, "the slice", (404, 409, 413, 503), cached=True),
        openapi_extra=parameters(query, [address.parameter]),
    )
    async def slice_get(request: Request) -> Response:
        state = state_of(request)
        asked = SliceRequest(**{"scale": "linear", **parse_query(request.scope["query_string"], query)})
        check_theta_i(asked.theta_i, state.settings)
        _check_view(asked)
        found = await address.find(request)
        values = 0
        if format in ("json", "csv"):
            channels = 1 if asked.channel is not None else len(found.material.brdf.channels)
            values = _directions(asked.view) * asked.theta_i.size * channels
            check_values(values, state.settings)
        headers = found.headers(request)
        if format == "svg":
            headers |= {"content-security-policy": SVG_POLICY, **NO_REFERRER}
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        if format in ("json", "csv"):
            if values <= INLINE_LISTED and state.ready:
                return Response(_list(found.material, asked, format), 200, headers, media_type=media_type)
            body = await run_sync(_list, found.material, asked, format, limiter=state.listing)
            return Response(body, 200, headers, media_type=media_type)
        wanted = _picture(found.title, asked, format)
        try:
            drawn = await picture(state, headers["etag"], partial(draw_with, state.artist, found.material, wanted))
        except bc.InputError as error:
            raise _explained(error, asked) from error
        return Response(drawn, 200, headers, media_type=media_type)


def check_theta_i(theta_i: Array, settings: Settings) -> None:
    """`LimitError` if there are more angles of incidence than the service takes in one request."""
    if theta_i.size > settings.max_theta_i:
        raise bc.LimitError(
            "too_many_slices",
            f"{theta_i.size} angles of incidence; the limit is {settings.max_theta_i}",
            where="theta_i",
            got=theta_i.size,
            limit=settings.max_theta_i,
        )


def _check_view(asked: SliceRequest) -> None:
    if asked.view == "hemisphere" and asked.theta_i.size != 1:
        raise bc.InputError(
            "wrong_number",
            f"theta_i: the hemisphere view takes one angle, got {asked.theta_i.size}",
            where="theta_i",
            got=asked.theta_i.size,
            expected="one angle",
        )


@cache
def _directions(view: Literal["polar", "hemisphere"]) -> int:
    """Directions of the viewer in one slice; the library picks as many for every material and angle."""
    values: Array = bc.slice(bc.model("lambert"), 0.5, view=view).values
    return int(values.size)


def _picture(title: str, asked: SliceRequest, format: Format) -> Picture:
    theta_i = np.atleast_1d(in_radians(asked.theta_i, asked.angles)).tolist()
    looks = {"view": asked.view, "scale": asked.scale, "channel": asked.channel, "format": format}
    return Picture("slice", title, {"theta_i": theta_i, **looks})


def _list(material: Material, asked: SliceRequest, format: Format) -> bytes:
    theta_i = in_radians(asked.theta_i, asked.angles)
    try:
        data = bc.slice(material.brdf, theta_i, view=asked.view, channel=asked.channel)
    except bc.InputError as error:
        raise _explained(error, asked) from error
    if format == "csv":
        return str(data.to_csv(asked.angles)).encode()
    return to_json(data.to_json(asked.angles))


def _explained(error: bc.InputError, asked: SliceRequest) -> bc.InputError:
    zero = np.zeros(())
    return in_request_units(error, AngleRequest(asked.theta_i, zero, zero, asked.angles))
