"""The two ways to name a material in a path."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from anyio.to_thread import run_sync
from brdf_service.http.openapi import operation
from brdf_service.library.materials import Library, Material
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc


class Found(NamedTuple):
    """A material as one request named it."""

    material: Material
    by_id: bool

    @property
    def title(self) -> str:
        """What a picture calls it: by id nothing that may change while the id stays."""
        return self.material.id[:12] if self.by_id else self.material.name


async def by_name(request: Request) -> Found:
    """The material of /v1/materials/{name}; off the event loop if its file has to be read."""
    library: Library = request.scope["brdf"].library
    name = request.path_params["name"]
    material = library.peek(name)
    if material is None:
        library.find(name)  # who asks for what there is not waits for no thread
        material = await run_sync(library.get, name)
    return Found(material, False)


async def by_id(request: Request) -> Found:
    """The material of /v1/tables/{id}; off the event loop if files have to be read."""
    library: Library = request.scope["brdf"].library
    id = request.path_params["id"]
    material = library.peek_id(id)
    return Found(material if material is not None else await run_sync(library.get_id, id), True)


@dataclass(frozen=True)
class Address:
    """One way to name a material: where its routes are, how they find it, and how the OpenAPI describes it."""

    label: str
    variable: str
    find: Callable[[Request], Awaitable[Found]]
    pattern: str
    about: str

    @property
    def prefix(self) -> str:
        """Path of the material, as FastAPI writes it."""
        return f"/v1/{self.label}/{{{self.variable}}}"

    @property
    def parameter(self) -> dict[str, object]:
        """The path parameter in the OpenAPI."""
        schema = {"type": "string", "pattern": self.pattern}
        return {"name": self.variable, "in": "path", "required": True, "description": self.about, "schema": schema}


BY_NAME = Address(
    "materials",
    "name",
    by_name,
    f"^{bc.names.MATERIAL_NAME}$",
    "name of the material: its file's name without .h5 or .json",
)
BY_ID = Address(
    "tables",
    "id",
    by_id,
    "^[0-9a-f]{64}$",
    "id of the material: a digest of everything its values depend on, so that answers never change",
)
ADDRESSES = (BY_NAME, BY_ID)
Handler = Callable[[Request, Address], Awaitable[Response]]


def at_both(router: APIRouter, what: str, handler: Handler, id: str, *about: str, **declared: Any) -> None:
    """Let `handler` answer `what`, "METHOD name", of a material by name and by id; the rest as `operation` takes it."""
    method, _, name = what.partition(" ")
    for address in ADDRESSES:
        found_by, tags = [address.parameter], [address.label]
        made = operation(f"{id}_{address.label}", *about, parameters=found_by, tags=tags, **declared)
        path = f"{address.prefix}/{name}" if name else address.prefix
        router.add_api_route(path, _bound(handler, address), methods=[method], response_class=Response, **made)


def _bound(handler: Handler, address: Address) -> Any:
    async def endpoint(request: Request) -> Response:
        return await handler(request, address)

    return endpoint
