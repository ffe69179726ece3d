"""A lit sphere of a material, as a picture."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial

from brdf_service.http.openapi import answers, parameters
from brdf_service.http.query import QueryParameter, choice, parse_query, text, whole_number
from brdf_service.routes.addressing import Address
from brdf_service.state import state_of
from brdf_service.work.picture_queue import draw_with, picture
from brdf_service.work.pictures import Picture
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

NARROWEST, WIDEST = 128, 1024

QUERY = (
    QueryParameter(
        "light",
        "studio: soft boxes in a room; sky: an overcast sky over dark ground",
        choice("studio", "sky"),
        {"type": "string", "enum": ["studio", "sky"]},
        default="studio",
    ),
    QueryParameter(
        "size",
        "width of the picture in pixels",
        whole_number(NARROWEST, WIDEST),
        {"type": "integer", "minimum": NARROWEST, "maximum": WIDEST},
        default=460,
    ),
    QueryParameter(
        "channel",
        "name, wavelength in nm or position of one channel, in grey; default: all of them as a colour",
        text(40),
        {"type": "string", "minLength": 1, "maxLength": 40},
        default=None,
    ),
)


@dataclass(frozen=True)
class _Asked:
    light: str
    size: int
    channel: str | None


def sphere_routes(address: Address) -> APIRouter:
    """The sphere under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/sphere.png",
        summary="a lit sphere as PNG",
        description="Under white light scaled so that a white Lambertian sphere reaches a linear 0.9, as sRGB; what is "
        "clipped is said in the picture.",
        operation_id=f"sphere_{address.label}",
        responses=answers({"image/png": {"schema": {"type": "string"}}}, "the sphere", (404, 409, 503), cached=True),
        openapi_extra=parameters(QUERY, [address.parameter]),
    )
    async def sphere(request: Request) -> Response:
        asked = _Asked(**parse_query(request.scope["query_string"], QUERY))
        found = await address.find(request)
        if asked.channel is not None:
            found.material.brdf.channels.find(asked.channel)
        headers = found.headers(request)
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        state, wanted = state_of(request), Picture("sphere", found.title, asdict(asked))
        drawn = await picture(state, headers["etag"], partial(draw_with, state.artist, found.material, wanted))
        return Response(drawn, 200, headers, media_type="image/png")

    return router
