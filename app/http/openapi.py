"""The OpenAPI document: operations say here what they take and answer, in the same objects that parse and refuse."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import Any

from brdf_service.http.errors import PROBLEM_TYPE
from brdf_service.http.query import NoQuery, Query, openapi_parameters, parse_query
from brdf_service.schemas.service import Problem
from fastapi import APIRouter, FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

_REFUSALS = {
    400: "the body cannot be read",
    401: "writing takes a key",
    403: "the service is read-only, or a page from another origin asks",
    404: "there is nothing of this name or id",
    406: "the Accept header takes none of the types that are offered",
    408: "the body did not arrive in time",
    409: "the material's file cannot be used; or it exists, and the request does not say that it may be replaced",
    412: "If-Match or If-None-Match speaks of another state than the present one",
    413: "more than a limit; the problem says which",
    415: "a body of another media type",
    421: "the Host header names another machine",
    422: "a parameter or value that is not taken; the problem says which, where and why",
    503: "not ready, or too many jobs wait, or the data folder cannot be read or written",
}
DESCRIPTION = """\
Look-ups of bidirectional reflectance distribution functions (BRDF): f_r in 1/sr, **without** the cosine.

Angles are in degrees unless `angles=rad`, and every answer repeats the unit. `theta_i` and `theta_o` are measured
from the normal; `delta_phi` = phi_o - phi_i, so the mirror direction is theta_o = theta_i, delta_phi = 180 degrees.

A failure is `application/problem+json` with `code`, `detail`, `errors` and `request_id`. Every GET may also be a
HEAD, and answers with an ETag; a path by id never changes its answer.
"""
_CONDITIONS = {
    "If-Match": "the material's ETag as its metadata gave it, or *: what may be replaced or deleted",
    "If-None-Match": "*: only if there is none of this name",
}
_TEXT: dict[str, Any] = {"schema": {"type": "string"}}
_BYTES: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}
_ETAG: dict[str, Any] = {"ETag": _TEXT}
_SCHEMES = {
    "key": {"type": "apiKey", "in": "header", "name": "X-API-Key"},
    "bearer": {"type": "http", "scheme": "bearer"},
}
#: Schemas that some operation refers to.
_referred: dict[str, type[BaseModel]] = {"Problem": Problem}

#: What a body holds: a schema of JSON, several of them, or a media type of plain bytes or text.
Content = type[BaseModel] | tuple[type[BaseModel], ...] | str | Mapping[str, Any]


def content_of(*bodies: Content) -> dict[str, Any]:
    """The `content` of a request or an answer that may be any of `bodies`."""
    made: dict[str, Any] = {}
    for body in bodies:
        if isinstance(body, str):
            media_type = body.partition(";")[0]
            made[media_type] = _TEXT if media_type.startswith(("text/", "image/svg")) else _BYTES
        elif isinstance(body, Mapping):
            made |= body
        else:
            schemas = body if isinstance(body, tuple) else (body,)
            _referred.update({s.__name__: s for s in schemas})
            refs = [{"$ref": f"#/components/schemas/{s.__name__}"} for s in schemas]
            made["application/json"] = {"schema": refs[0] if len(refs) == 1 else {"anyOf": refs}}
    return made


def operation(
    id: str,
    summary: str,
    description: str = "",
    *,
    answer: tuple[Content, ...] = (),
    says: str = "",
    status: int = 200,
    headers: Iterable[str] = (),
    refusals: Iterable[int] = (),
    cached: bool = False,
    parameters: Iterable[Mapping[str, Any]] = (),
    query: type[Query] = NoQuery,
    body: tuple[Content, ...] = (),
    conditions: bool = False,
    more: Mapping[int | str, Any] = {},
    tags: list[str] | None = None,
) -> dict[str, Any]:
    """Arguments of `APIRouter.add_api_route` for an operation that parses its own parameters.

    answer, says, status, headers  of the good answer; `more`: others, by status.
    refusals    statuses of problems beside 421 and 422.
    cached      it has an ETag, and may be a 304.
    parameters, query, body  what it takes, parameters of the path first; `conditions`: If-Match, If-None-Match too.
    """
    good: dict[str, Any] = {"description": says or "done"}
    if answer:
        good["content"] = content_of(*answer)
    if cached or headers:
        good["headers"] = {**(_ETAG if cached else {}), **dict.fromkeys(headers, _TEXT)}
    responses: dict[int | str, Any] = {status: good, **more}
    if cached:
        responses[304] = {"description": "unchanged: If-None-Match names the ETag of the answer"}
    problem = {PROBLEM_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    for number in sorted({*refusals, 421, 422}):
        responses[number] = {"description": _REFUSALS[number], "content": problem}
    told = [
        {"name": name, "in": "header", "required": False, "description": about, **_TEXT}
        for name, about in _CONDITIONS.items()
        if conditions
    ]
    extra: dict[str, Any] = {"parameters": [*parameters, *openapi_parameters(query), *told]}
    if body:
        extra["requestBody"] = {"required": True, "content": content_of(*body)}
    made = {"operation_id": id, "summary": summary, "description": description, "status_code": status, "tags": tags}
    return {**made, "responses": responses, "openapi_extra": extra}


Handler = Callable[[Request, Any], Awaitable[Response]]


def route(
    router: APIRouter, what: str, *about: str, query: type[Query] = NoQuery, **declared: Any
) -> Callable[[Handler], Handler]:
    """Decorator: `handler(request, asked)` answers `what`, "METHOD /path"; `asked` is its query as `query`. The rest as
    `operation` takes it."""
    method, _, path = what.partition(" ")

    def add(handler: Handler) -> Handler:
        async def endpoint(request: Request) -> Response:
            return await handler(request, parse_query(request.scope["query_string"], query))

        made = operation(*about, query=query, **declared)
        router.add_api_route(path, endpoint, methods=[method], response_class=Response, **made)
        return handler

    return add


def allowed_methods(document: Mapping[str, Any], path: str) -> list[str]:
    """Methods that a path takes; the router itself names those of the first operation it finds there only."""
    for template, operations in document["paths"].items():
        if re.fullmatch(re.sub(r"\\{\w+\\}", "[^/]+", re.escape(template)), path):
            methods = {method.upper() for method in operations}
            return sorted(methods | ({"HEAD"} if "GET" in methods else set()))
    return ["GET", "HEAD"]  # a page: the document does not list them


def install(app: FastAPI, *, keyed: bool) -> None:
    """Make `app.openapi()` give the complete document; `keyed`: writing takes a key."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = get_openapi(
                title="BRDF tables", version=bc.__version__, description=DESCRIPTION, routes=app.routes
            )
            _, definitions = models_json_schema(
                [(s, "validation") for s in _referred.values()], ref_template="#/components/schemas/{model}"
            )
            components = document.setdefault("components", {})
            components.setdefault("schemas", {}).update(definitions["$defs"])
            if keyed:
                components["securitySchemes"] = _SCHEMES
                for path in document["paths"].values():
                    for each in path.values():
                        if "401" in each["responses"]:
                            each["security"] = [{"key": []}, {"bearer": []}]
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
