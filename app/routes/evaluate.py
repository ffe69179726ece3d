"""f_r at given directions: GET with lists in the query, POST with JSON, plain numbers or a .npy file."""

from __future__ import annotations

from functools import partial
from typing import Literal

from anyio.to_thread import run_sync
from brdf_service.evaluate.answer import INLINE_VALUES, Beside, PlainResponse, answer
from brdf_service.evaluate.binary_body import Precision, directions_from_npy, directions_from_octets
from brdf_service.evaluate.directions import (
    Angles,
    Directions,
    Vectors,
    count_points,
    no_angle_options,
)
from brdf_service.evaluate.json_body import Form, directions_from_json
from brdf_service.http.bodies import read_array, read_json_numbers
from brdf_service.http.caching import material_headers, not_modified
from brdf_service.http.negotiation import MEDIA_TYPES, kind_of_answer, kind_of_body
from brdf_service.http.openapi import Content
from brdf_service.http.query import ANGLES, OUTSIDE, Flag, Numbers, Outside, Query, Unit, numbers, parse_query
from brdf_service.routes.address import ADDRESSES, Address, at_both
from brdf_service.schemas.evaluate import EvaluateAnswer, EvaluateRequest, EvaluateVectors
from brdf_service.state import State
from fastapi import APIRouter
from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

#: JSON bodies of up to this many bytes are parsed in the event loop: some 2,000 points, a fraction of a millisecond.
_INLINE_BODY = 128 * 1024
#: Answers of more values than this are made a few at a time.
_LARGE_VALUES = 250_000
_STATUS = Field(
    False,
    description="true: say for each point whether its value is measured, interpolated, extrapolated, filled, outside "
    "or smoothed",
)
_UNCERTAINTY = Field(
    False, description="true: give beside each value the half-width of its 95 % interval, 1/sr; 0 for a formula"
)


class EvaluateQuery(Query):
    """The directions of a GET."""

    theta_i: Numbers = numbers("polar angle(s) of the light, from the normal, at most 90°", example="30,45")
    theta_o: Numbers = numbers("polar angle(s) of the viewer, from the normal, at most 90°", example="30")
    delta_phi: Numbers = numbers("phi_o - phi_i; mirror direction at 180°", example="180")
    angles: Unit = ANGLES
    outside: Outside = OUTSIDE
    status: Flag = _STATUS
    uncertainty: Flag = _UNCERTAINTY


class EvaluateOptions(Query):
    """What a POST says of its body."""

    angles: Unit | None = Field(
        None, description="unit of the angles: degrees or radians; default: what a JSON body says, else degrees"
    )
    dtype: Literal["f4", "f8"] | None = Field(
        None, description="of an octet-stream body, little-endian: f4 (answered in f4) or f8"
    )
    input: Form | None = Field(
        None,
        description="what the body holds: angles theta_i, theta_o, delta_phi, or vectors wi, wo of shape (n, 3), "
        "normal +z; default: what a JSON body's fields say, else angles",
    )
    outside: Outside = OUTSIDE
    status: Flag = _STATUS
    uncertainty: Flag = _UNCERTAINTY


async def evaluate(request: Request, address: Address) -> Response:
    """The answer to a GET or a POST."""
    state: State = request.scope["brdf"]
    text = request.scope["query_string"]
    asked: Directions
    if request.scope["method"] == "GET":
        query = parse_query(text, EvaluateQuery)
        asked = Angles(query.theta_i, query.theta_o, query.delta_phi, query.angles, query.outside)
        beside = Beside(query.status, query.uncertainty)
        kind = kind_of_answer(request.scope["headers"], "json")
        material, lasting = await address.find(request)
        headers = material_headers(request, material.id, material.tag, lasting, MEDIA_TYPES[kind])
        headers["vary"] = "Accept"
        # angles are only checked while they are evaluated; a wrong question still gets no 304, as its ETag was never
        # given out
        unchanged = not_modified(request, headers)
        if unchanged is not None:
            return unchanged
    else:
        options, sent = parse_query(text, EvaluateOptions), kind_of_body(request.scope["headers"])
        kind, lasting = kind_of_answer(request.scope["headers"], sent), False
        beside = Beside(options.status, options.uncertainty)
        material, _ = await address.find(request)
        asked, headers = await _body(request, sent, options, state), {"cache-control": "no-store"}
        if isinstance(asked, Vectors):
            no_angle_options(options.angles, options.outside, beside._asdict())
    channels = len(material.brdf.channels)
    points = count_points(asked, channels, state.settings)
    values = points * channels * (2 if beside.uncertainty else 1)
    # before it is ready a kernel may have to be compiled first
    inline = values <= INLINE_VALUES[material.facts["kind"]] and state.ready
    how = material, asked, points, kind, beside, inline, lasting
    limiter = state.large if values > _LARGE_VALUES else state.working
    made = answer(*how) if inline else await run_sync(answer, *how, limiter=limiter)
    state.metrics.lookups += points
    state.metrics.lookup_seconds += made.seconds
    request.scope["brdf.lookup_seconds"] = made.seconds
    return PlainResponse(made, headers, kind)


async def _body(request: Request, sent: str, options: EvaluateOptions, state: State) -> Directions:
    settings, unit = state.settings, options.angles or "deg"
    form, dtype = options.input or "angles", options.dtype
    if sent == "json":
        text = await read_json_numbers(request, settings)
        reading = partial(directions_from_json, text, options.input, options.angles, options.outside)
        return reading() if len(text) <= _INLINE_BODY else await run_sync(reading, limiter=state.working)
    body = await read_array(request, settings.max_body_bytes, settings.body_seconds)
    if sent == "npy":
        return directions_from_npy(body, form, dtype, unit, options.outside, settings)
    precision: Precision = dtype or "f8"
    return directions_from_octets(body, form, precision, unit, options.outside, settings)


#: Third part of the path -> how it names a material, and the route.
_SHORT_CUTS: dict[str, tuple[Address | None, str]] = {a.label: (a, f"{a.prefix}/evaluate") for a in ADDRESSES}


class EvaluateShortCut:
    """Middleware that answers look-ups in front of the framework, whose layers, matching and parsing would cost more
    than they do, in every spelling. The same function is behind the framework's routes, which document it."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["path"].endswith("/evaluate") and scope["method"] in ("GET", "POST"):
            parts = scope["path"].split("/")
            address, route = _SHORT_CUTS.get(parts[2], (None, "")) if len(parts) == 5 else (None, "")
            if address is not None and parts[1] == "v1" and parts[3]:
                scope["brdf.route"] = route
                scope["path_params"] = {address.variable: parts[3]}
                response = await evaluate(Request(scope, receive), address)
                await response(scope, receive, send)
                return
        await self.app(scope, receive, send)


_ANSWER: tuple[Content, ...] = (EvaluateAnswer, MEDIA_TYPES["octet"], MEDIA_TYPES["npy"])
_BODY: tuple[Content, ...] = ((EvaluateRequest, EvaluateVectors), MEDIA_TYPES["octet"], MEDIA_TYPES["npy"])
_REFUSALS = (404, 406, 409, 413, 503)

router = APIRouter()


at_both(
    router,
    "GET evaluate",
    evaluate,
    "evaluate_get",
    "f_r at the angles of the query",
    "Lists are separated by commas and broadcast as in numpy: equal lengths, or one value for all. The Accept "
    "header picks JSON, plain numbers or .npy.",
    answer=_ANSWER,
    says="values[point][channel]",
    refusals=_REFUSALS,
    cached=True,
    query=EvaluateQuery,
)
at_both(
    router,
    "POST evaluate",
    evaluate,
    "evaluate_post",
    "f_r at the angles of the body",
    "For lists too long for a URL. JSON; or an octet-stream of three C-order rows theta_i, theta_o, delta_phi; or "
    "a .npy file of shape (3, n). Vectors instead of angles: the JSON fields wi and wo, or with input=vectors two "
    "C-order blocks wi and wo of (n, 3) numbers, or a .npy file of shape (2, n, 3). The Accept header picks the "
    "kind of the answer, by default the body's own: JSON; an octet-stream of values[point][channel]; or a .npy "
    "file. With status=true one byte a point follows the values, or a .npy of them; with uncertainty=true the half-"
    "widths "
    "of 95 % intervals follow as the values do, after the status if both are asked for. The headers X-Brdf-Shape, "
    "-Dtype, -Channels, -Angles, -Id, -Error and -Has-Delta say the rest.",
    answer=_ANSWER,
    says="values[point][channel]",
    refusals=(400, 408, 415, *_REFUSALS),
    query=EvaluateOptions,
    body=_BODY,
)
