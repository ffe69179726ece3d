"""What a material looks like under an environment and directional lights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from anyio.to_thread import run_sync
from brdf_service.evaluate.answer import array_to_json
from brdf_service.evaluate.binary_body import map_from_npy
from brdf_service.evaluate.directions import check_points, check_values
from brdf_service.http.bodies import read_array, read_bytes
from brdf_service.http.errors import MediaTypeError
from brdf_service.http.json import model_from_json, to_json
from brdf_service.http.negotiation import MEDIA_TYPES, kind_of_body
from brdf_service.http.query import Numbers, Query, WholeNumber, numbers, parse_query
from brdf_service.library.materials import Material
from brdf_service.routes.address import Address, at_both
from brdf_service.routes.harmonics import expanded
from brdf_service.schemas.harmonics import RelightAnswer, RelightRequest
from brdf_service.settings import Settings
from brdf_service.state import state_of
from brdf_service.work.expansions import Degree, check_lmax, projection_seconds
from brdf_service.work.stoppable import check_seconds, run_stoppable
from fastapi import APIRouter
from pydantic import AfterValidator, Field, WithJsonSchema
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

Floats = npt.NDArray[Any]

_EXAMPLE = '{"normals": [[0, 0, 1]], "views": [[0, 0, 1]], "lights": [{"direction": [1, 0, 1], "irradiance": 3}]}'
#: Normals times this, or times the directional lights, may be as many as points: each costs as much as ten look-ups.
_COST = 10


def _in_threes(given: Floats) -> Floats:
    if given.size % 3:
        raise bc.InputError("not_vectors", f": expected x,y,z,x,y,z,..., got {given.size} numbers", got=given.size)
    return given.reshape(-1, 3)


VectorList = Annotated[Numbers, AfterValidator(_in_threes), WithJsonSchema({"type": "string"})]


class RelightQuery(Query):
    """The degree, and what a .npy body cannot say."""

    lmax: WholeNumber = Field(32, ge=1, le=10**6, description="largest degree of the expansion")
    normals: VectorList | None = numbers(
        "with a .npy body: x,y,z of one normal after the other", default=None, example="0,0,1"
    )
    views: VectorList | None = numbers("with a .npy body: as normals; one, or as many", default=None, example="0,0,1")


@dataclass(frozen=True)
class _Scene:
    """A request as arrays that are not checked for their meaning yet; lights as (direction, irradiance)."""

    normals: Floats
    views: Floats
    map: Floats | None
    lights: list[tuple[Floats, Floats]]


async def relight(request: Request, address: Address) -> Response:
    """Radiance of each normal towards its view."""
    state, settings = state_of(request), state_of(request).settings
    query = parse_query(request.scope["query_string"], RelightQuery)
    check_lmax(query.lmax, settings.max_lmax)
    kind = kind_of_body(request.scope["headers"])
    if kind == "octet":
        raise MediaTypeError(
            "unsupported_media_type",
            "bare numbers do not say how wide a map is: send a .npy file, or JSON",
            where="Content-Type",
            got=MEDIA_TYPES[kind],
            expected=f"{MEDIA_TYPES['json']}, {MEDIA_TYPES['npy']}",
        )
    material, _ = await address.find(request)
    limits = settings.max_body_bytes, settings.body_seconds
    given = {"normals": query.normals, "views": query.views}
    if kind == "npy":
        for name, value in given.items():
            if value is None:
                said = f"{name} is missing, for example {name}=0,0,1"
                raise bc.InputError("parameter_missing", said, where=name, expected="x,y,z")
        assert query.normals is not None
        assert query.views is not None
        scene = _Scene(query.normals, query.views, map_from_npy(await read_array(request, *limits)), [])
    else:
        for name, value in given.items():
            if value is not None:
                raise bc.InputError("given_twice", f"{name} belong into the JSON body", where=name)
        text = await read_bytes(request, *limits)
        scene = await run_sync(_scene_of, text, limiter=state.working)
    _check(scene, len(material.brdf.channels), settings)
    made: bc.HarmonicExpansion | None = None
    if scene.map is not None:
        channels = len(material.brdf.channels)
        seconds = projection_seconds(channels, query.lmax)
        check_seconds(seconds, channels, settings.max_work_seconds, "ask for a smaller lmax")
        made = await expanded(request, state, material, Degree(query.lmax))
    body = await run_stoppable(request, partial(_relit, material, scene, query.lmax, made), state.large)
    return Response(body, 200, {"cache-control": "no-store"}, media_type="application/json")


def _scene_of(text: bytes) -> _Scene:
    asked = model_from_json(text, RelightRequest, _EXAMPLE)
    if asked.map is None and not asked.lights:
        said = "the body has neither a map nor lights: nothing shines"
        raise bc.InputError("field_missing", said, where="map", expected=_EXAMPLE)
    lights = [(np.array(light.direction), np.atleast_1d(light.irradiance)) for light in asked.lights or ()]
    try:
        pixels = None if asked.map is None else np.array(asked.map, np.float64)
    except ValueError as error:
        said = "map: expected numbers in lists of equal lengths"
        raise bc.InputError("not_a_number", said, where="map", expected="numbers") from error
    return _Scene(np.array(asked.normals), np.array(asked.views), pixels, lights)


def _check(scene: _Scene, channels: int, settings: Settings) -> None:
    normals = max(scene.normals.size // 3, scene.views.size // 3)
    check_points(normals * max(_COST, len(scene.lights)), settings)
    check_values(normals * channels, settings)
    if scene.map is not None:
        if scene.map.ndim not in (2, 3) or not scene.map.size:  # before an expansion is made for it
            said = f"map: expected pixels of shape (h, w) or (h, w, channels), got {scene.map.shape}"
            raise bc.InputError("bad_map", said, where="map", got=str(scene.map.shape))
        check_points(int(np.prod(scene.map.shape[:2])), settings)


def _relit(material: Material, scene: _Scene, lmax: int, made: bc.HarmonicExpansion | None) -> bytes:
    brdf = material.brdf

    def channels(size: int) -> bc.Channels | None:
        """The material's channels for a light of as many."""
        return brdf.channels if size == len(brdf.channels) else None

    light: bc.Light | None = None
    for towards, power in scene.lights:
        one = bc.Light.directional(towards, power, channels=channels(power.size))
        light = one if light is None else light + one
    environment = None
    if scene.map is not None:
        last = scene.map.shape[2:]
        sky = bc.Light.from_map(scene.map, lmax, channels=channels(last[0] if last else 1))
        errors = sky.error_by_degree()
        environment = {"lmax": lmax, "error": float(errors[-1]), "error_by_degree": errors}
        light = sky if light is None else sky + light
    assert light is not None
    radiance = bc.relight(brdf, light, scene.normals, scene.views, expansion=made)
    summary = {} if made is None else bc.harmonic_summary(made)
    told = {k: summary[k] for k in ("lmax", "bytes", "truncation", "quadrature") if summary}
    more = brdf.channels if len(brdf.channels) >= len(light.channels) else light.channels
    rest = {
        "channels": more.to_json(),
        "environment": environment,
        "expansion": told or None,
        "id": material.id,
        "has_delta": bool(brdf.has_delta),
    }
    return b'{"radiance":%b,%b' % (array_to_json(radiance.reshape(-1, radiance.shape[-1])), to_json(rest)[1:])


router = APIRouter()


at_both(
    router,
    "POST relight",
    relight,
    "relight",
    "radiance under an environment and directional lights",
    "An equirectangular map of radiances (row 0 at the zenith +z, azimuth from +x towards +y along each row), "
    "directional lights, or both; the radiance that surfaces with the given normals send towards the views. The "
    "environment is reflected through spherical harmonics to degree lmax, directional lights exactly. JSON, or the "
    "map as a .npy file with normals and views in the query.",
    answer=(RelightAnswer,),
    says="radiance[normal][channel]",
    refusals=(400, 404, 408, 409, 413, 415, 503),
    query=RelightQuery,
    body=(RelightRequest, MEDIA_TYPES["npy"]),
)
