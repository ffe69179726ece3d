"""Whether a material is physical: every check of the library, in albedo units."""

from __future__ import annotations

from anyio.to_thread import run_sync
from brdf_service.evaluate.angles import Unit
from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import ANGLES, parse_query
from brdf_service.library.materials import Material
from brdf_service.routes.addressing import Address
from brdf_service.schemas import ChecksAnswer
from brdf_service.state import state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

QUERY = (ANGLES,)


def check_routes(address: Address) -> APIRouter:
    """The checks under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/checks",
        summary="energy, reciprocity, sign, symmetry, normal and horizon",
        description="Each finding in albedo units (misplaced reflectance), with its error, a verdict, what the "
        "material declares of itself, and the worst directions. Takes a second or more the first time.",
        operation_id=f"checks_{address.label}",
        responses=answers(
            {"application/json": {"schema": ref(ChecksAnswer)}}, "the findings", (404, 409, 503), cached=True
        ),
        openapi_extra=parameters(QUERY, [address.parameter]),
    )
    async def checks(request: Request) -> Response:
        state = state_of(request)
        asked = parse_query(request.scope["query_string"], QUERY)
        found = await address.find(request)
        headers = found.headers(request)
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        body = await run_sync(_checks, found.material, asked["angles"], limiter=state.large)
        return Response(body, 200, headers, media_type="application/json")

    return router


def _checks(material: Material, unit: Unit) -> bytes:
    key = f"checks {unit}"
    # kept with the material: it never changes, and takes the library a second to find out
    if key not in material.parts:
        report = bc.check(material.brdf)
        units: tuple[Unit, Unit] = ("deg", "rad")
        for each in units:
            content = {**report.to_json(each), "id": material.id}
            material.parts[f"checks {each}"] = to_json(content)
    return material.parts[key]
