"""What a material looks like under an environment and directional lights."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from anyio.to_thread import run_sync
from brdf_service.evaluate.angles import check_points, check_values
from brdf_service.evaluate.binary import map_from_npy
from brdf_service.evaluate.json_codec import array_to_json, load, to_json, unknown_field
from brdf_service.http.bodies import read_array, read_bytes
from brdf_service.http.errors import MediaTypeError
from brdf_service.http.negotiation import MEDIA_TYPES, kind_of_body
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import QueryParameter, parse_numbers, parse_query
from brdf_service.library.materials import Material
from brdf_service.routes.addressing import Address
from brdf_service.routes.harmonics import LMAX
from brdf_service.schemas import RelightAnswer, RelightRequest
from brdf_service.settings import Settings
from brdf_service.state import state_of
from brdf_service.work.expansions import Degree, check_lmax
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

_EXAMPLE = '{"normals": [[0, 0, 1]], "views": [[0, 0, 1]], "lights": [{"direction": [1, 0, 1], "irradiance": 3}]}'
_FIELDS, _LIGHT_FIELDS = ("normals", "views", "map", "lights"), ("direction", "irradiance")
#: Normals times this, or times the directional lights, may be as many as points: each costs as much as ten look-ups.
_COST = 10


def _vectors(name: str, text: str) -> npt.NDArray[np.float64]:
    numbers = np.atleast_1d(parse_numbers(name, text))
    if numbers.size % 3:
        raise bc.InputError(
            "not_vectors", f"{name}: expected x,y,z,x,y,z,..., got {numbers.size} numbers", where=name, got=numbers.size
        )
    return numbers.reshape(-1, 3)


QUERY = (
    LMAX,
    QueryParameter(
        "normals", "with a .npy body: x,y,z of one normal after the other", _vectors, default=None, example="0,0,1"
    ),
    QueryParameter("views", "with a .npy body: as normals; one, or as many", _vectors, default=None, example="0,0,1"),
)


@dataclass(frozen=True)
class _Asked:
    """A request as it was sent; arrays are not checked for their meaning yet."""

    lmax: int
    normals: npt.NDArray[Any]
    views: npt.NDArray[Any]
    map: npt.NDArray[Any] | None
    lights: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]]


def relight_routes(address: Address) -> APIRouter:
    """The relight operation under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.post(
        f"{address.prefix}/relight",
        summary="radiance under an environment and directional lights",
        description="An equirectangular map of radiances (row 0 at the zenith +z, azimuth from +x towards +y along "
        "each row), directional lights, or both; the radiance that surfaces with the given normals send towards the "
        "views. The environment is reflected through spherical harmonics to degree lmax, directional lights exactly. "
        "JSON, or the map as a .npy file with normals and views in the query.",
        operation_id=f"relight_{address.label}",
        responses=answers(
            {"application/json": {"schema": ref(RelightAnswer)}},
            "radiance[normal][channel]",
            (400, 404, 408, 409, 413, 415, 503),
            cached=False,
        ),
        openapi_extra={
            **parameters(QUERY, [address.parameter]),
            "requestBody": {
                "required": True,
                "content": {
                    MEDIA_TYPES["json"]: {"schema": ref(RelightRequest)},
                    MEDIA_TYPES["npy"]: {"schema": {"type": "string", "format": "binary"}},
                },
            },
        },
    )
    async def relight(request: Request) -> Response:
        state = state_of(request)
        settings = state.settings
        given = parse_query(request.scope["query_string"], QUERY)
        check_lmax(given["lmax"], settings.max_lmax)
        kind = kind_of_body(request.headers)
        if kind == "octet":
            raise MediaTypeError(
                "unsupported_media_type",
                "bare numbers do not say how wide a map is: send a .npy file, or JSON",
                where="Content-Type",
                got=MEDIA_TYPES[kind],
                expected=f"{MEDIA_TYPES['json']}, {MEDIA_TYPES['npy']}",
            )
        found = await address.find(request)
        limits = settings.max_body_bytes, settings.body_seconds
        if kind == "npy":
            for name in ("normals", "views"):
                if given[name] is None:
                    raise bc.InputError(
                        "parameter_missing",
                        f"{name} is missing, for example {name}=0,0,1",
                        where=name,
                        expected="x,y,z",
                    )
            pixels = map_from_npy(await read_array(request, *limits))
            asked = _Asked(given["lmax"], given["normals"], given["views"], pixels, [])
        else:
            for name in ("normals", "views"):
                if given[name] is not None:
                    raise bc.InputError("given_twice", f"{name} belong into the JSON body", where=name)
            text = await read_bytes(request, *limits)
            asked = await run_sync(_from_json, text, given["lmax"], limiter=state.working)
        _check(asked, len(found.material.brdf.channels), settings)
        made: bc.HarmonicExpansion | None = None
        if asked.map is not None:
            made = await run_sync(state.expansions.get, found.material, Degree(asked.lmax), limiter=state.projecting)
        body = await run_sync(_relit, found.material, asked, made, limiter=state.large)
        return Response(body, 200, {"cache-control": "no-store"}, media_type="application/json")

    return router


def _from_json(text: bytes, lmax: int) -> _Asked:
    content = {k: v for k, v in _object(load(text, _EXAMPLE), "body", _FIELDS).items() if v is not None}
    for name in ("normals", "views"):
        if name not in content:
            raise bc.InputError(
                "field_missing", f"{name} is missing from the body", where=name, expected="a list of [x, y, z]"
            )
    if "map" not in content and not content.get("lights"):
        raise bc.InputError(
            "field_missing", "the body has neither a map nor lights: nothing shines", where="map", expected=_EXAMPLE
        )
    lights = content.get("lights", [])
    if not isinstance(lights, list):
        raise bc.InputError("bad_lights", "lights: expected a list of objects", where="lights", expected=_EXAMPLE)
    listed = []
    for k, light in enumerate(lights):
        fields = _object(light, f"lights[{k}]", _LIGHT_FIELDS)
        if set(fields) != set(_LIGHT_FIELDS):
            raise bc.InputError(
                "field_missing", f"lights[{k}]: expected direction and irradiance", where="lights", index=[k]
            )
        listed.append((_numbers(f"lights[{k}].direction", fields["direction"]),
                       np.atleast_1d(_numbers(f"lights[{k}].irradiance", fields["irradiance"]))))  # fmt: skip
    pixels = _numbers("map", content["map"]) if "map" in content else None
    return _Asked(lmax, _numbers("normals", content["normals"]), _numbers("views", content["views"]), pixels, listed)


def _object(value: Any, where: str, known: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise bc.InputError(
            "bad_body", f"{where}: expected an object with {', '.join(known)}", where=where, expected="an object"
        )
    for key in value:
        if key not in known:
            raise unknown_field(key, known, where)
    return value


def _numbers(name: str, value: Any) -> npt.NDArray[np.float64]:
    """Nested lists of equal lengths as an array; a boolean or a text among the numbers is no number."""
    flat = [value]
    while flat and all(type(v) is list for v in flat):
        flat = list(itertools.chain.from_iterable(flat))
    if not set(map(type, flat)) <= {int, float}:
        raise bc.InputError(
            "not_a_number", f"{name}: expected numbers in lists of equal lengths", where=name, expected="numbers"
        )
    try:
        return np.array(value, dtype=np.float64)
    except (ValueError, OverflowError) as error:
        raise bc.InputError(
            "not_a_number",
            f"{name}: expected numbers that a float holds, in lists of equal lengths",
            where=name,
            expected="numbers",
        ) from error


def _check(asked: _Asked, channels: int, settings: Settings) -> None:
    normals = max(asked.normals.size // 3, asked.views.size // 3)
    check_points(normals * max(_COST, len(asked.lights)), settings)
    check_values(normals * channels, settings)
    if asked.map is not None:
        check_points(int(np.prod(asked.map.shape[:2])), settings)


def _relit(material: Material, asked: _Asked, made: bc.HarmonicExpansion | None) -> bytes:
    brdf = material.brdf
    light: bc.Light | None = None
    told: dict[str, Any] | None = None
    for towards, power in asked.lights:
        one = bc.Light.directional(towards, power, channels=_channels(brdf, power.size))
        light = one if light is None else light + one
    if asked.map is not None:
        last = asked.map.shape[2:]
        environment = bc.Light.from_map(asked.map, asked.lmax, channels=_channels(brdf, last[0] if last else 1))
        light = environment if light is None else environment + light
        errors = environment.error_by_degree()
        told = {"lmax": asked.lmax, "error": float(errors[-1]), "error_by_degree": errors}
    assert light is not None
    radiance = bc.relight(brdf, light, asked.normals, asked.views, expansion=made)
    summary = None if made is None else bc.harmonic_summary(made)
    rest = {
        "channels": brdf.channels.to_json() if len(brdf.channels) >= len(light.channels) else light.channels.to_json(),
        "environment": told,
        "expansion": None
        if summary is None
        else {k: summary[k] for k in ("lmax", "bytes", "truncation", "quadrature")},
        "id": material.id,
        "has_delta": bool(brdf.has_delta),
    }
    return b'{"radiance":%b,%b' % (array_to_json(radiance.reshape(-1, radiance.shape[-1])), to_json(rest)[1:])


def _channels(brdf: bc.Brdf, size: int) -> bc.Channels | None:
    """The material's channels for a light of as many."""
    return brdf.channels if size == len(brdf.channels) else None
