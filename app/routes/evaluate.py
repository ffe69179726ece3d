"""f_r at given angles: GET with lists in the query, POST with JSON, plain numbers or a .npy file."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

from anyio.to_thread import run_sync
from brdf_service.evaluate.angles import AngleRequest, Unit, check_points, check_values
from brdf_service.evaluate.binary import angles_from_npy, angles_from_octets, vectors_from_npy, vectors_from_octets
from brdf_service.evaluate.encoding import Asked, Evaluated, answer
from brdf_service.evaluate.json_codec import directions_from_json
from brdf_service.evaluate.vectors import VectorRequest, no_angle_options
from brdf_service.http.bodies import read_array, read_json_numbers
from brdf_service.http.lean import Lean
from brdf_service.http.negotiation import INLINE_VALUES, MEDIA_TYPES, Kind, kind_of_answer, kind_of_body
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import ANGLES, OUTSIDE, QueryParameter, choice, flag, parse_numbers, parse_query
from brdf_service.routes.addressing import Address, Addressed
from brdf_service.schemas import EvaluateAnswer, EvaluateRequest, EvaluateVectors
from brdf_service.state import State, state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

#: JSON bodies of up to this many bytes are parsed in the event loop: some 2,000 points, a fraction of a millisecond.
INLINE_BODY = 128 * 1024
#: Answers of more values than this are made a few at a time.
LARGE_VALUES = 250_000

STATUS = QueryParameter(
    "status",
    "true: say for each point whether its value is measured, interpolated, extrapolated, filled or outside",
    flag,
    {"type": "string", "enum": ["true", "false"]},
    default=False,
)
QUERY = (
    QueryParameter(
        "theta_i", "polar angle(s) of the light, from the normal, at most 90°", parse_numbers, example="30,45"
    ),
    QueryParameter(
        "theta_o", "polar angle(s) of the viewer, from the normal, at most 90°", parse_numbers, example="30"
    ),
    QueryParameter("delta_phi", "phi_o - phi_i; mirror direction at 180°", parse_numbers, example="180"),
    ANGLES,
    OUTSIDE,
    STATUS,
)
POST_QUERY = (
    QueryParameter(
        "angles",
        "unit of the angles: degrees or radians; default: what a JSON body says, else degrees",
        choice("deg", "rad"),
        {"type": "string", "enum": ["deg", "rad"]},
        default=None,
    ),
    QueryParameter(
        "dtype",
        "of an octet-stream body, little-endian: f4 (answered in f4) or f8",
        choice("f4", "f8"),
        {"type": "string", "enum": ["f4", "f8"]},
        default=None,
    ),
    QueryParameter(
        "input",
        "what the body holds: angles theta_i, theta_o, delta_phi, or vectors wi, wo of shape (n, 3), normal +z; "
        "default: what a JSON body's fields say, else angles",
        choice("angles", "vectors"),
        {"type": "string", "enum": ["angles", "vectors"]},
        default=None,
    ),
    OUTSIDE,
    STATUS,
)
_BYTES: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}
_ANSWER = {
    MEDIA_TYPES["json"]: {"schema": ref(EvaluateAnswer)},
    MEDIA_TYPES["octet"]: _BYTES,
    MEDIA_TYPES["npy"]: _BYTES,
}
_BODY = {
    MEDIA_TYPES["json"]: {"schema": {"anyOf": [ref(EvaluateRequest), ref(EvaluateVectors)]}},
    MEDIA_TYPES["octet"]: _BYTES,
    MEDIA_TYPES["npy"]: _BYTES,
}
_GET_REFUSALS = (404, 406, 409, 413, 503)
_POST_REFUSALS = (400, 404, 406, 408, 409, 413, 415, 503)


async def evaluate_get(request: Request, address: Address) -> Response:
    """Answer a GET."""
    state = state_of(request)
    given = parse_query(request.scope["query_string"], QUERY)
    angles = AngleRequest(
        given["theta_i"], given["theta_o"], given["delta_phi"], given["angles"], outside=given["outside"]
    )
    kind = kind_of_answer(request.headers, "json")
    found = await address.find(request)
    headers = found.headers(request, MEDIA_TYPES[kind])
    headers["vary"] = "Accept"
    # angles are only checked while they are evaluated; a wrong question still gets no 304, as its ETag was never
    # given out
    return found.unchanged(request, headers) or await _answer(
        request, state, found, angles, kind, given["status"], headers, lasting=found.by_id
    )


async def evaluate_post(request: Request, address: Address) -> Response:
    """Answer a POST."""
    state = state_of(request)
    given = parse_query(request.scope["query_string"], POST_QUERY)
    sent = kind_of_body(request.headers)
    kind = kind_of_answer(request.headers, sent)
    found = await address.find(request)
    asked = await _asked(request, sent, given, state)
    if isinstance(asked, VectorRequest):
        no_angle_options(given["angles"], given["outside"], given["status"])
    headers = {"cache-control": "no-store"}
    return await _answer(request, state, found, asked, kind, given["status"], headers)


HANDLERS: dict[str, Callable[[Request, Address], Awaitable[Response]]] = {"GET": evaluate_get, "POST": evaluate_post}


async def _asked(request: Request, sent: Kind, given: dict[str, Any], state: State) -> Asked:
    settings, vectors = state.settings, given["input"] == "vectors"
    limit, seconds = settings.max_body_bytes, settings.body_seconds
    unit: Unit = given["angles"] or "deg"
    if sent == "octet":
        body = await read_array(request, limit, seconds)
        if vectors:
            return vectors_from_octets(body, given["dtype"] or "f8", settings)
        return angles_from_octets(body, given["dtype"] or "f8", unit, given["outside"], settings)
    if sent == "npy":
        body = await read_array(request, limit, seconds)
        if vectors:
            return vectors_from_npy(body, given["dtype"], settings)
        return angles_from_npy(body, given["dtype"], unit, given["outside"], settings)
    text = await read_json_numbers(request, settings)
    options = (given["input"], given["angles"], given["outside"])
    if len(text) <= INLINE_BODY:
        return directions_from_json(text, *options)
    return await run_sync(directions_from_json, text, *options, limiter=state.working)


async def _answer(
    request: Request,
    state: State,
    found: Addressed,
    asked: Asked,
    kind: Kind,
    status: bool,
    headers: dict[str, str],
    *,
    lasting: bool = False,
) -> Response:
    material, points = found.material, asked.points
    check_points(points, state.settings)
    values = points * len(material.brdf.channels)
    check_values(values, state.settings)
    made: Evaluated
    if (
        values <= INLINE_VALUES[material.facts["kind"]] and state.ready
    ):  # before that a kernel may have to be compiled first
        made = answer(material, asked, kind, status, lasting=lasting)
    else:
        limiter = state.large if values > LARGE_VALUES else state.working
        made = await run_sync(partial(answer, material, asked, kind, status, lasting=lasting), limiter=limiter)
    state.metrics.lookups += points
    state.metrics.lookup_seconds += made.seconds
    request.scope["brdf.lookup_seconds"] = made.seconds
    headers.update(made.headers)
    return Lean(made.body, headers, MEDIA_TYPES[kind])


def evaluate_routes(address: Address) -> APIRouter:
    """The two evaluate operations under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/evaluate",
        summary="f_r at the angles of the query",
        description="Lists are separated by commas and broadcast as in numpy: equal lengths, or one value for all. "
        "The Accept header picks JSON, plain numbers or .npy.",
        operation_id=f"evaluate_get_{address.label}",
        responses=answers(_ANSWER, "values[point][channel]", _GET_REFUSALS, cached=True),
        openapi_extra=parameters(QUERY, [address.parameter]),
    )
    async def get(request: Request) -> Response:
        return await evaluate_get(request, address)

    @router.post(
        f"{address.prefix}/evaluate",
        summary="f_r at the angles of the body",
        description="For lists too long for a URL. JSON; or an octet-stream of three C-order rows theta_i, theta_o, "
        "delta_phi; or a .npy file of shape (3, n). Vectors instead of angles: the JSON fields wi and wo, or with "
        "input=vectors two C-order blocks wi and wo of (n, 3) numbers, or a .npy file of shape (2, n, 3). The Accept "
        "header picks the kind of the answer, by default the body's own: JSON; an octet-stream of "
        "values[point][channel]; or a .npy file. With status=true one byte a point follows the values, or a second "
        ".npy. The headers X-Brdf-Shape, -Dtype, -Channels, -Angles, -Id, -Error and -Has-Delta say the rest.",
        operation_id=f"evaluate_post_{address.label}",
        responses=answers(_ANSWER, "values[point][channel]", _POST_REFUSALS, cached=False),
        openapi_extra={
            **parameters(POST_QUERY, [address.parameter]),
            "requestBody": {"required": True, "content": _BODY},
        },
    )
    async def post(request: Request) -> Response:
        return await evaluate_post(request, address)

    return router
