"""What a glossmeter would read of a material."""

from __future__ import annotations

from anyio.to_thread import run_sync
from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import parse_query
from brdf_service.library.materials import Material
from brdf_service.routes.addressing import Address
from brdf_service.schemas import GlossAnswer
from brdf_service.state import state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc


def gloss_routes(address: Address) -> APIRouter:
    """Gloss and haze under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/gloss",
        summary="gloss at 20, 60 and 85 degrees, and haze",
        description="Gloss units over the apertures of ISO 2813 / ASTM D523, haze after ASTM D4039 and E430, by "
        "channel and as a luminance, with the integration's error. Takes seconds the first time for a sharp material.",
        operation_id=f"gloss_{address.label}",
        responses=answers(
            {"application/json": {"schema": ref(GlossAnswer)}}, "the readings", (404, 409, 503), cached=True
        ),
        openapi_extra=parameters((), [address.parameter]),
    )
    async def gloss(request: Request) -> Response:
        state = state_of(request)
        parse_query(request.scope["query_string"], ())
        found = await address.find(request)
        headers = found.headers(request)
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        body = await run_sync(_gloss, found.material, limiter=state.large)
        return Response(body, 200, headers, media_type="application/json")

    return router


def _gloss(material: Material) -> bytes:
    # kept with the material: it never changes
    if "gloss" not in material.parts:
        material.parts["gloss"] = to_json({**bc.gloss(material.brdf).to_json(), "id": material.id})
    return material.parts["gloss"]
