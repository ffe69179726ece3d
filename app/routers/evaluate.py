"""f_r at given angles: GET with lists in the query, POST with JSON."""

from __future__ import annotations

from fastapi import APIRouter
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from app.addressing import Address
from app.bodies import read_json_body
from app.codecs import AngleRequest, angles_from_json, check_size, checked, evaluate_to_json
from app.library import Material
from app.openapi import answers, parameters, ref
from app.query import ANGLES, QueryParameter, parse_numbers, parse_query
from app.schemas import EvaluateAnswer, EvaluateRequest
from app.settings import Settings
from app.state import state_of

#: Answers of up to this many values are made in the event loop: a thread would cost more than they do.
INLINE_VALUES = 1024
#: Bodies of up to this many bytes are parsed in the event loop.
INLINE_BODY = 32 * 1024

QUERY = (
    QueryParameter(
        "theta_i", "polar angle(s) of the light, from the normal, at most 90°", parse_numbers, example="30,45"
    ),
    QueryParameter(
        "theta_o", "polar angle(s) of the viewer, from the normal, at most 90°", parse_numbers, example="30"
    ),
    QueryParameter("delta_phi", "phi_o - phi_i; mirror direction at 180°", parse_numbers, example="180"),
    ANGLES,
)
_ANSWER = {"application/json": {"schema": ref(EvaluateAnswer)}}


def evaluate_routes(address: Address) -> APIRouter:
    """The two evaluate operations under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/evaluate",
        summary="f_r at the angles of the query",
        description="Lists are separated by commas and broadcast as in numpy: equal lengths, or one value for all.",
        operation_id=f"evaluate_get_{address.label}",
        responses=answers(_ANSWER, "values[point][channel]", (404, 409, 413, 503), cached=True),
        openapi_extra=parameters(QUERY, [address.parameter]),
    )
    async def evaluate_get(request: Request) -> Response:
        settings = state_of(request).settings
        given = parse_query(request.scope["query_string"], QUERY)
        angles = AngleRequest(given["theta_i"], given["theta_o"], given["delta_phi"], given["angles"])
        checked(angles, settings)
        found = await address.find(request)
        headers = found.headers(request)
        # angles are only checked while they are evaluated; a wrong question still gets no 304, as its ETag was
        # never given out
        return found.unchanged(request, headers) or await _answer(found.material, angles, settings, headers)

    @router.post(
        f"{address.prefix}/evaluate",
        summary="f_r at the angles of a JSON body",
        description="For lists too long for a URL.",
        operation_id=f"evaluate_post_{address.label}",
        responses=answers(_ANSWER, "values[point][channel]", (400, 404, 409, 413, 415, 503), cached=False),
        openapi_extra={
            **parameters((), [address.parameter]),
            "requestBody": {"required": True, "content": {"application/json": {"schema": ref(EvaluateRequest)}}},
        },
    )
    async def evaluate_post(request: Request) -> Response:
        settings = state_of(request).settings
        parse_query(request.scope["query_string"], ())
        found = await address.find(request)
        body = await read_json_body(request, settings.max_body_bytes)
        if len(body) <= INLINE_BODY:
            angles = angles_from_json(body, settings)
        else:
            angles = await run_in_threadpool(angles_from_json, body, settings)
        return await _answer(found.material, angles, settings, {"cache-control": "no-store"})

    return router


async def _answer(material: Material, angles: AngleRequest, settings: Settings, headers: dict[str, str]) -> Response:
    values = angles.points * len(material.brdf.channels)
    check_size(values, settings)
    if values <= INLINE_VALUES:
        body = evaluate_to_json(material, angles)
    else:
        body = await run_in_threadpool(evaluate_to_json, material, angles)
    return Response(body, 200, headers, media_type="application/json")
