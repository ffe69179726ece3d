"""Expansions in spherical harmonics: their errors as JSON, and as a picture."""

from __future__ import annotations

from functools import partial
from typing import Any

from anyio.to_thread import run_sync
from brdf_service.evaluate.angles import AngleRequest, in_radians, in_request_units
from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import ANGLES, QueryParameter, choice, flag, parse_numbers, parse_query, whole_number
from brdf_service.http.security import NO_REFERRER, SVG_POLICY
from brdf_service.library.materials import Material
from brdf_service.routes.addressing import Address, Addressed
from brdf_service.routes.slices import CHANNEL
from brdf_service.schemas import HarmonicsAnswer
from brdf_service.state import State, state_of
from brdf_service.work.expansions import Degree, Expansions, check_lmax
from brdf_service.work.picture_queue import picture
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

_TARGETS, _WINDOWS = ("f_cos_cos", "f", "f_cos_o"), ("none", "lanczos", "hann", "lanczos2")

LMAX = QueryParameter(
    "lmax",
    "largest degree of the expansion",
    whole_number(1, 10**6),
    {"type": "integer", "minimum": 1, "maximum": 10**6},
    default=32,
)
TARGET = QueryParameter(
    "target",
    "what is expanded: f_r times the cosines of both directions, f_r, or f_r times that of the viewer",
    choice(*_TARGETS),
    {"type": "string", "enum": list(_TARGETS)},
    default="f_cos_cos",
)
WINDOW = QueryParameter(
    "window",
    "factors of the coefficients against ringing",
    choice(*_WINDOWS),
    {"type": "string", "enum": list(_WINDOWS)},
    default="none",
)
SYMMETRISE = QueryParameter(
    "symmetrise",
    "true: only the reciprocal part of a source that is not reciprocal",
    flag,
    {"type": "string", "enum": ["true", "false"]},
    default=False,
)
SLICES = QueryParameter(
    "theta_i", "polar angles of the light of the slices, one to four", parse_numbers, default="0,30,60"
)
QUERY = (LMAX, TARGET, WINDOW, SYMMETRISE)
PICTURE_QUERY = (*QUERY, SLICES, CHANNEL, ANGLES)


def harmonics_routes(address: Address) -> APIRouter:
    """The expansion's numbers and its picture under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/harmonics",
        summary="errors of an expansion in spherical harmonics",
        description="Relative L2 error of what is left out at each degree (Parseval), at the last one also that of f_r "
        "itself; the spectrum; the smallest value; the bytes of the coefficients.",
        operation_id=f"harmonics_{address.label}",
        responses=answers(
            {"application/json": {"schema": ref(HarmonicsAnswer)}}, "the expansion", (404, 409, 413, 503), cached=True
        ),
        openapi_extra=parameters(QUERY, [address.parameter]),
    )
    async def harmonics(request: Request) -> Response:
        state = state_of(request)
        asked = _asked(parse_query(request.scope["query_string"], QUERY), state)
        found = await address.find(request)
        headers = found.headers(request)
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        body = await run_sync(_told, state.expansions, found.material, asked, limiter=state.projecting)
        return Response(body, 200, headers, media_type="application/json")

    for format in ("png", "svg"):
        _add_picture(router, address, format)
    return router


def _add_picture(router: APIRouter, address: Address, format: str) -> None:
    media_type = {"png": "image/png", "svg": "image/svg+xml"}[format]

    @router.get(
        f"{address.prefix}/harmonics.{format}",
        summary=f"an expansion in spherical harmonics as {format.upper()}",
        description="Error by degree, spectrum, and slices over the original, where it rings.",
        operation_id=f"harmonics_{format}_{address.label}",
        responses=answers(
            {media_type: {"schema": {"type": "string"}}}, "the picture", (404, 409, 413, 503), cached=True
        ),
        openapi_extra=parameters(PICTURE_QUERY, [address.parameter]),
    )
    async def harmonics_picture(request: Request) -> Response:
        state = state_of(request)
        given = parse_query(request.scope["query_string"], PICTURE_QUERY)
        asked = _asked(given, state)
        if isinstance(given["theta_i"], str):  # the default, in degrees
            given |= {"theta_i": parse_numbers("theta_i", given["theta_i"]), "angles": "deg"}
        found = await address.find(request)
        headers = found.headers(request)
        if format == "svg":
            headers |= {"content-security-policy": SVG_POLICY, **NO_REFERRER}
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        if state.pictures.get(headers["etag"]) is None:
            # not among those who draw: they would wait for a projection
            await run_sync(state.expansions.get, found.material, asked, limiter=state.projecting)
        drawn = await picture(state, headers["etag"], partial(_drawn, state.expansions, found, asked, given, format))
        return Response(drawn, 200, headers, media_type=media_type)


def _asked(given: dict[str, Any], state: State) -> Degree:
    check_lmax(given["lmax"], state.settings.max_lmax)
    return Degree(given["lmax"], given["target"], given["window"], given["symmetrise"])


def _told(expansions: Expansions, material: Material, asked: Degree) -> bytes:
    return to_json({**bc.harmonic_summary(expansions.get(material, asked)), "id": material.id})


def _drawn(expansions: Expansions, found: Addressed, asked: Degree, given: dict[str, Any], format: str) -> bytes:
    brdf, theta_i, unit = found.material.brdf, given["theta_i"], given["angles"]
    made = expansions.get(found.material, asked)
    try:
        figure = bc.plot.expansion(brdf, made, in_radians(theta_i, unit), channel=given["channel"], title=found.title)
    except bc.InputError as error:
        raise in_request_units(error, AngleRequest(theta_i, theta_i, theta_i, unit)) from error
    drawn: bytes = bc.plot.render(figure, format)
    return drawn
