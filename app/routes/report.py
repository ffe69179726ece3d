"""What an import found and did: as JSON, and the covered angles as a picture."""

from __future__ import annotations

from functools import partial
from typing import Literal

import numpy as np
from brdf_service.evaluate.angles import AngleRequest, in_request_units
from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.openapi import answers, parameters
from brdf_service.http.query import ANGLES, QueryParameter, parse_numbers, parse_query
from brdf_service.http.security import NO_REFERRER, SVG_POLICY
from brdf_service.routes.addressing import Address
from brdf_service.routes.slices import check_theta_i
from brdf_service.state import state_of
from brdf_service.work.picture_queue import draw_with, picture
from brdf_service.work.pictures import Picture
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

_THETA_I = QueryParameter(
    "theta_i",
    "polar angle(s) of the light, one disc each; default: those of the measurements",
    parse_numbers,
    default=None,
    example="0,30,60",
)
_QUERY = (_THETA_I, ANGLES)


def report_routes(address: Address) -> APIRouter:
    """The report and the picture of the covered angles under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        f"{address.prefix}/report",
        summary="what reading the source found and did",
        description="Counts of negative, zero and invalid values, conventions, policies, coverage, symmetries, albedo "
        "before and after, noise. Empty for a model.",
        operation_id=f"report_{address.label}",
        responses=answers(
            {"application/json": {"schema": {"type": "object"}}}, "the import report", (404, 409, 503), cached=True
        ),
        openapi_extra=parameters((), [address.parameter]),
    )
    async def report(request: Request) -> Response:
        parse_query(request.scope["query_string"], ())
        found = await address.find(request)
        # a name belongs to the file, not to what the id is a digest of
        headers = found.headers(request, lasting=False)
        material = found.material
        body = to_json({"name": material.name, "id": material.id, "report": material.brdf.report})
        return found.unchanged(request, headers) or Response(body, 200, headers, media_type="application/json")

    for format, media_type in (("png", "image/png"), ("svg", "image/svg+xml")):
        _add(router, address, "png" if format == "png" else "svg", media_type)
    return router


def _add(router: APIRouter, address: Address, format: Literal["png", "svg"], media_type: str) -> None:
    @router.get(
        f"{address.prefix}/coverage.{format}",
        summary=f"which angles were measured, as {format.upper()}",
        operation_id=f"coverage_{format}_{address.label}",
        responses=answers(
            {media_type: {"schema": {"type": "string"}}}, "the picture", (404, 409, 413, 503), cached=True
        ),
        openapi_extra=parameters(_QUERY, [address.parameter]),
    )
    async def coverage(request: Request) -> Response:
        state = state_of(request)
        asked = parse_query(request.scope["query_string"], _QUERY)
        if asked["theta_i"] is not None:
            check_theta_i(asked["theta_i"], state.settings)
        found = await address.find(request)
        headers = found.headers(request)
        if format == "svg":
            headers |= {"content-security-policy": SVG_POLICY, **NO_REFERRER}
        unchanged = found.unchanged(request, headers)
        if unchanged is not None:
            return unchanged
        given, theta_i = None, None
        if asked["theta_i"] is not None:
            given = AngleRequest(asked["theta_i"], np.zeros(()), np.zeros(()), asked["angles"])
            theta_i = np.atleast_1d(given.radians()[0]).tolist()
        wanted = Picture("coverage", found.title, {"theta_i": theta_i, "format": format})
        try:
            drawn = await picture(state, headers["etag"], partial(draw_with, state.artist, found.material, wanted))
        except bc.InputError as error:
            raise (error if given is None else in_request_units(error, given)) from error
        return Response(drawn, 200, headers, media_type=media_type)
