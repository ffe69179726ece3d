"""How much of the light from a direction is reflected at all."""

from __future__ import annotations

from typing import Any

from anyio.to_thread import run_sync
from brdf_service.evaluate.angles import AngleRequest, check_values, in_request_units
from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import ANGLES, QueryParameter, parse_numbers, parse_query
from brdf_service.library.materials import Material
from brdf_service.routes.addressing import Address
from brdf_service.routes.slices import check_theta_i
from brdf_service.schemas import AlbedoAnswer
from brdf_service.state import state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

QUERY = (
    QueryParameter("theta_i", "polar angle(s) of the light, from the normal", parse_numbers, example="0,30,60"),
    ANGLES,
)


def albedo_routes(address: Address) -> APIRouter:
    """The albedo under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/albedo",
        summary="directional-hemispherical reflectance",
        description="The integral of f_r cos(theta_o) over all directions of the viewer, the mirror part included.",
        operation_id=f"albedo_{address.label}",
        responses=answers(
            {"application/json": {"schema": ref(AlbedoAnswer)}},
            "values[theta_i][channel]",
            (404, 409, 413, 503),
            cached=True,
        ),
        openapi_extra=parameters(QUERY, [address.parameter]),
    )
    async def albedo(request: Request) -> Response:
        state = state_of(request)
        asked = parse_query(request.scope["query_string"], QUERY)
        check_theta_i(asked["theta_i"], state.settings)
        found = await address.find(request)
        check_values(asked["theta_i"].size * len(found.material.brdf.channels), state.settings)
        headers = found.headers(request)
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        body = await run_sync(_albedo, found.material, asked, limiter=state.large)
        return Response(body, 200, headers, media_type="application/json")

    return router


def _albedo(material: Material, asked: dict[str, Any]) -> bytes:
    theta_i, unit = asked["theta_i"], asked["angles"]
    given = AngleRequest(theta_i, theta_i, theta_i, unit)
    try:
        values = material.brdf.albedo(given.radians()[0])
        delta = material.brdf.delta_reflectance(given.radians()[0])
    except bc.InputError as error:
        raise in_request_units(error, given) from error
    return to_json(
        {
            "theta_i": theta_i.reshape(-1).tolist(),
            "angles": unit,
            "values": values.reshape(-1, values.shape[-1]),
            "delta_reflectance": delta.reshape(-1, delta.shape[-1]),
            "channels": material.brdf.channels.to_json(),
            "id": material.id,
            "has_delta": bool(material.brdf.has_delta),
        }
    )
