"""The list of materials, and everything about one of them by its name."""

from __future__ import annotations

from typing import Any

from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.caching import BY_NAME, etag_of, not_modified
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import QueryParameter, parse_query, whole_number
from brdf_service.routes.addressing import BY_NAME_ADDRESS, Address, page_of
from brdf_service.routes.parts import PARTS
from brdf_service.schemas import MaterialLine, MaterialList
from brdf_service.state import state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

LARGEST_PAGE = 1000
_MOST = 10**9

PAGING = (
    QueryParameter(
        "limit",
        "most materials in the answer",
        whole_number(1, LARGEST_PAGE),
        {"type": "integer", "minimum": 1, "maximum": LARGEST_PAGE},
        default=100,
    ),
    QueryParameter(
        "offset",
        "materials to pass over, in order of their names",
        whole_number(0, _MOST),
        {"type": "integer", "minimum": 0, "maximum": _MOST},
        default=0,
    ),
)


def links(name: str, facts: dict[str, Any]) -> dict[str, str]:
    """Paths of a material's answers; one that cannot be used has only itself."""
    by_name = f"/v1/materials/{name}"
    if "problem" in facts:
        return {"self": by_name}
    by_id = f"/v1/tables/{facts['id']}"
    return {
        "self": by_name,
        "page": f"/materials/{name}",
        "evaluate": f"{by_name}/evaluate",
        "slice": f"{by_name}/slice.svg?theta_i=30,60",
        "sphere": f"{by_name}/sphere.png",
        "albedo": f"{by_name}/albedo?theta_i=0,30,60",
        "checks": f"{by_name}/checks",
        "gloss": f"{by_name}/gloss",
        "harmonics": f"{by_name}/harmonics?lmax=16",
        "report": f"{by_name}/report",
        "coverage": f"{by_name}/coverage.svg",
        "permanent": by_id,
        "permanent_slice": f"{by_id}/slice.svg?theta_i=30,60",
    }


def with_links(name: str, facts: dict[str, Any]) -> dict[str, Any]:
    """One line of the list."""
    return {**facts, "links": links(name, facts)}


def metadata_route(address: Address) -> APIRouter:
    """The metadata operation under one way of naming a material."""
    router = APIRouter(tags=[address.label])

    @router.get(
        address.prefix,
        summary="what is known of a material",
        operation_id=f"metadata_{address.label}",
        responses=answers(
            {"application/json": {"schema": ref(MaterialLine)}},
            "channels, bytes, flags, measured error, source",
            (404, 409, 503),
            cached=True,
        ),
        openapi_extra=parameters((), [address.parameter]),
    )
    async def metadata(request: Request) -> Response:
        parse_query(request.scope["query_string"], ())
        found = await address.find(request)
        # a file's name, its source and its measured error may be others tomorrow for the same id
        headers = found.headers(request, lasting=False)
        body = to_json(with_links(found.material.name, found.material.facts))
        return found.unchanged(request, headers) or Response(body, 200, headers, media_type="application/json")

    return router


def _list_route() -> APIRouter:
    router = APIRouter(tags=["materials"])

    @router.get(
        "/v1/materials",
        summary="the materials, in order of their names",
        operation_id="materials",
        responses=answers(
            {"application/json": {"schema": ref(MaterialList)}}, "a page of the list", (503,), cached=True
        ),
        openapi_extra=parameters(PAGING),
    )
    async def materials(request: Request) -> Response:
        library = state_of(request).library
        asked = parse_query(request.scope["query_string"], PAGING)
        offset, limit = asked["offset"], asked["limit"]
        page = await page_of(library, offset, limit)
        end = offset + len(page.lines)
        body = to_json(
            {
                "materials": [with_links(line.name, line.facts) for line in page.lines],
                "total": page.total,
                "offset": offset,
                "limit": limit,
                "next": f"/v1/materials?limit={limit}&offset={end}" if end < page.total and page.lines else None,
                "skipped": page.skipped,
            }
        )
        etag = etag_of(request, body.decode())
        headers = {"etag": etag, "cache-control": BY_NAME}
        return not_modified(request, etag, headers) or Response(body, 200, headers, media_type="application/json")

    return router


router = APIRouter()
router.include_router(_list_route())
for _part in (metadata_route, *PARTS):
    router.include_router(_part(BY_NAME_ADDRESS))
