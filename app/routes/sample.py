"""Directions drawn for a material: what a path tracer elsewhere continues with."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from anyio.to_thread import run_sync
from brdf_service.evaluate.answer import array_to_json
from brdf_service.evaluate.directions import check_points, check_values
from brdf_service.http.bodies import read_bytes
from brdf_service.http.errors import MediaTypeError
from brdf_service.http.json import model_from_json, to_json
from brdf_service.http.negotiation import MEDIA_TYPES, kind_of_body
from brdf_service.http.query import NoQuery, parse_query
from brdf_service.library.materials import Material
from brdf_service.routes.address import Address, at_both
from brdf_service.schemas.sample import SampleAnswer, SampleRequest
from brdf_service.state import state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

_EXAMPLE = '{"wi": [0, 0, 1], "u": [[0.25, 0.5]]}'


async def sample(request: Request, address: Address) -> Response:
    """One direction for each wi and pair of numbers."""
    state, settings = state_of(request), state_of(request).settings
    parse_query(request.scope["query_string"], NoQuery)
    kind = kind_of_body(request.scope["headers"])
    if kind != "json":
        said = f"directions to draw are asked for in JSON, got {MEDIA_TYPES[kind]}"
        expected = MEDIA_TYPES["json"]
        raise MediaTypeError(
            "unsupported_media_type", said, where="Content-Type", got=MEDIA_TYPES[kind], expected=expected
        )
    material, _ = await address.find(request)
    text = await read_bytes(request, settings.max_body_bytes, settings.body_seconds)
    asked = await run_sync(model_from_json, text, SampleRequest, _EXAMPLE, limiter=state.working)
    wi, u = np.array(asked.wi, np.float64), np.array(asked.u, np.float64)
    points = max(wi.size // 3, u.size // 2)
    check_points(points, settings)
    check_values(points * (len(material.brdf.channels) + 4), settings)
    body = await run_sync(_drawn, material, wi, u, limiter=state.large)
    return Response(body, 200, {"cache-control": "no-store"}, media_type="application/json")


def _drawn(material: Material, wi: npt.NDArray[Any], u: npt.NDArray[Any]) -> bytes:
    brdf = material.brdf
    found: bc.Sample = brdf.sample(wi, u)
    rest = {
        "delta": found.delta.reshape(-1).tolist(),
        "channels": brdf.channels.to_json(),
        "id": material.id,
        "has_delta": bool(brdf.has_delta),
    }
    parts = [
        b'"%b":%b' % (name.encode(), array_to_json(array))
        for name, array in (
            ("wo", found.wo.reshape(-1, 3)),
            ("weight", found.weight.reshape(-1, len(brdf.channels))),
            ("pdf", found.pdf.reshape(-1)),
        )
    ]
    return b"{%b,%b" % (b",".join(parts), to_json(rest)[1:])


router = APIRouter()


at_both(
    router,
    "POST sample",
    sample,
    "sample",
    "directions drawn in proportion to f_r cos theta_o",
    "For each wi (towards the light, held) and pair u of numbers in [0, 1) one direction wo, its weight "
    "f_r cos theta_o / pdf for each channel, and the density pdf over solid angle, 1/sr. Where the mirror part was "
    "drawn, delta is true and pdf null. The first call for a material prepares its tables.",
    answer=(SampleAnswer,),
    says="wo[point], weight[point][channel], pdf[point]",
    refusals=(400, 404, 408, 409, 413, 415, 503),
    query=NoQuery,
    body=(SampleRequest,),
)
