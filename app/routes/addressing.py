"""The two ways to name a material in a path, and what follows from each for caches."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from brdf_service.http.caching import BY_ID, BY_NAME, etag_of, not_modified
from brdf_service.library.materials import Library, Material, Page
from brdf_service.state import state_of
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response


@dataclass(frozen=True)
class Addressed:
    """A material as one request named it."""

    material: Material
    by_id: bool

    @property
    def title(self) -> str:
        """What a picture calls it: by id nothing that may change while the id stays."""
        return self.material.id[:12] if self.by_id else self.material.name

    def headers(self, request: Request, *kind: str, lasting: bool = True) -> dict[str, str]:
        """ETag and caching headers of a GET answer; a name's answer also says where it stays for ever.

        kind     what tells this answer from others at the same address: the media type that was asked for.
        lasting  by id, the answer holds nothing but what the id is a digest of.
        """
        if self.by_id and lasting:
            return {"etag": etag_of(request, self.material.id, *kind), "cache-control": BY_ID}
        etag = etag_of(request, self.material.tag, *kind)
        if self.by_id:
            return {"etag": etag, "cache-control": BY_NAME}
        rest = "".join(f"/{part}" for part in request.scope["path"].split("/")[4:])  # after /v1/materials/NAME
        query = f"?{given.decode('latin-1')}" if (given := request.scope["query_string"]) else ""
        return {
            "etag": etag,
            "cache-control": BY_NAME,
            "content-location": f"/v1/tables/{self.material.id}{rest}{query}",
        }

    def unchanged(self, request: Request, headers: dict[str, str]) -> Response | None:
        """The 304 answer, if the caller's copy is good."""
        return not_modified(request, headers["etag"], headers)


Find = Callable[[Request], Awaitable[Addressed]]


async def by_name(request: Request) -> Addressed:
    """The material of /v1/materials/{name}; off the event loop if its file has to be read."""
    library, name = state_of(request).library, request.path_params["name"]
    material = library.peek(name)
    return Addressed(material if material is not None else await run_in_threadpool(library.get, name), by_id=False)


async def by_id(request: Request) -> Addressed:
    """The material of /v1/tables/{id}; off the event loop if files have to be read."""
    library, id = state_of(request).library, request.path_params["id"]
    material = library.peek_id(id)
    return Addressed(material if material is not None else await run_in_threadpool(library.get_id, id), by_id=True)


async def page_of(library: Library, offset: int, limit: int) -> Page:
    """A page of the list of materials; off the event loop if files have to be read, or many looked at."""
    page = library.peek_page(offset, limit)
    return page if page is not None else await run_in_threadpool(library.page, offset, limit)


@dataclass(frozen=True)
class Address:
    """One way to name a material: where its routes are, how they find it, and how the OpenAPI describes it."""

    prefix: str
    find: Find
    label: str
    parameter: dict[str, Any]


BY_NAME_ADDRESS = Address(
    "/v1/materials/{name}",
    by_name,
    "materials",
    {
        "name": "name",
        "in": "path",
        "required": True,
        "description": "name of the material: its file's name without .h5 or .json",
        "schema": {"type": "string", "pattern": "^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"},
    },
)
BY_ID_ADDRESS = Address(
    "/v1/tables/{id}",
    by_id,
    "tables",
    {
        "name": "id",
        "in": "path",
        "required": True,
        "description": "id of the material: a digest of everything its values depend on, so that answers never change",
        "schema": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
    },
)
