"""The list of materials, and everything about one of them by its name and by its id."""

from __future__ import annotations

from typing import Any

from anyio.to_thread import run_sync
from brdf_service.http.caching import BY_NAME, etag_of, not_modified
from brdf_service.http.json import to_json
from brdf_service.http.openapi import route
from brdf_service.http.query import Query, WholeNumber
from brdf_service.library.materials import Library, Material, Page
from brdf_service.routes.analyses import ANALYSES
from brdf_service.routes.harmonics import HARMONICS
from brdf_service.routes.pictures import PICTURES
from brdf_service.routes.resource import Resource, add_resources
from brdf_service.schemas.materials import MaterialLine, MaterialList
from brdf_service.state import state_of
from fastapi import APIRouter
from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

#: What a material answers to a GET.
RESOURCES = (*PICTURES, *ANALYSES, *HARMONICS)


class Paging(Query):
    """Which materials of the list."""

    limit: WholeNumber = Field(100, ge=1, le=1000, description="most materials in the answer")
    offset: WholeNumber = Field(0, ge=0, le=10**9, description="materials to pass over, in order of their names")


def with_links(name: str, facts: dict[str, Any]) -> dict[str, Any]:
    """One line of the list: facts, and paths of the material's answers; one that cannot be used has only itself."""
    by_name = f"/v1/materials/{name}"
    links = {"self": by_name}
    if "problem" not in facts:
        by_id = f"/v1/tables/{facts['id']}"
        links |= {"page": f"/materials/{name}", "evaluate": f"{by_name}/evaluate", "relight": f"{by_name}/relight"}
        links["sample"] = f"{by_name}/sample"
        for resource in RESOURCES:
            if resource.example is not None:
                query = f"?{resource.example}" if resource.example else ""
                links[resource.name.partition(".")[0]] = f"{by_name}/{resource.name}{query}"
        links |= {"permanent": by_id, "permanent_slice": f"{by_id}/slice.svg?theta_i=30,60"}
    return {**facts, "links": links}


def _metadata(material: Material, _: Query) -> dict[str, Any]:
    return with_links(material.name, material.facts)


METADATA = Resource(
    "",
    "what is known of a material",
    content=MaterialLine,
    says="channels, bytes, flags, measured error, source",
    compute=_metadata,
    seconds=lambda *_: 0.0,
    # a file's name, its source and its measured error may be others tomorrow for the same id
    lasting=False,
)
router = APIRouter()
add_resources(router, (METADATA, *RESOURCES))


async def page_of(library: Library, offset: int, limit: int) -> Page:
    """A page of the list of materials; off the event loop if files have to be read, or many looked at."""
    return await run_sync(library.page, offset, limit)


@route(
    router,
    "GET /v1/materials",
    "materials",
    "the materials, in order of their names",
    answer=(MaterialList,),
    says="a page of the list",
    refusals=(503,),
    cached=True,
    tags=["materials"],
    query=Paging,
)
async def materials(request: Request, asked: Paging) -> Response:
    page = await page_of(state_of(request).library, asked.offset, asked.limit)
    end = asked.offset + len(page.lines)
    more = end < page.total and page.lines
    body = to_json(
        {
            "materials": [with_links(line.name, line.facts) for line in page.lines],
            "total": page.total,
            "offset": asked.offset,
            "limit": asked.limit,
            "next": f"/v1/materials?limit={asked.limit}&offset={end}" if more else None,
            "skipped": page.skipped,
        }
    )
    headers = {"etag": etag_of(request, body.decode()), "cache-control": BY_NAME}
    return not_modified(request, headers) or Response(body, 200, headers, media_type="application/json")
