"""The OpenAPI document: operations say here what they take and answer, in the same objects that parse and refuse."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from brdf_service.http.errors import PROBLEM_TYPE
from brdf_service.http.query import QueryParameter
from brdf_service.schemas import SCHEMAS
from brdf_service.settings import Settings
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

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


def ref(schema: type[BaseModel]) -> dict[str, str]:
    """Reference to a schema of the document."""
    return {"$ref": f"#/components/schemas/{schema.__name__}"}


def answers(
    content: dict[str, Any], description: str, refusals: Iterable[int], *, cached: bool
) -> dict[int | str, Any]:
    """The `responses` of an operation: its answer, 304 where an ETag is given, and each refusal as a problem."""
    made: dict[int | str, Any] = {200: {"description": description, "content": content}}
    if cached:
        made[200]["headers"] = {"ETag": {"schema": {"type": "string"}}}
        made[304] = {"description": "unchanged: If-None-Match names the ETag of the answer"}
    for status in sorted({*refusals, 421, 422}):
        made[status] = {
            "description": _REFUSALS[status],
            "content": {PROBLEM_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
        }
    return made


#: Headers of answers, by the kind of answer.
HEADERS: dict[str, dict[str, Any]] = {
    "stored": {
        "ETag": {"schema": {"type": "string"}},
        "Location": {"schema": {"type": "string"}},
    }
}
_CONDITIONS = (
    ("If-Match", "the material's ETag as its metadata gave it, or *: what may be replaced or deleted"),
    ("If-None-Match", "*: only if there is none of this name"),
)


def parameters(
    query: Iterable[QueryParameter] = (), path: Iterable[dict[str, Any]] = (), *, conditions: bool = False
) -> dict[str, Any]:
    """The `openapi_extra` of an operation that parses its own parameters; `conditions`: it takes If-Match."""
    headers = [
        {"name": name, "in": "header", "required": False, "description": about, "schema": {"type": "string"}}
        for name, about in _CONDITIONS
        if conditions
    ]
    return {"parameters": [*path, *(q.openapi() for q in query), *headers]}


def allowed_methods(document: dict[str, Any], path: str) -> list[str]:
    """Methods that a path takes; the router itself names those of the first operation it finds there only."""
    for template, operations in document["paths"].items():
        if re.fullmatch(re.sub(r"\\{\w+\\}", "[^/]+", re.escape(template)), path):
            methods = {method.upper() for method in operations}
            return sorted(methods | ({"HEAD"} if "GET" in methods else set()))
    return ["GET", "HEAD"]  # a page: the document does not list them


_SCHEMES = {
    "key": {"type": "apiKey", "in": "header", "name": "X-API-Key"},
    "bearer": {"type": "http", "scheme": "bearer"},
}


def _secure(document: dict[str, Any]) -> None:
    """Say of the operations that write that they take the key."""
    for path in document["paths"].values():
        for operation in path.values():
            if "401" in operation["responses"]:
                operation["security"] = [{"key": []}, {"bearer": []}]


def install(app: FastAPI, settings: Settings) -> None:
    """Make `app.openapi()` give the complete document."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = get_openapi(
                title="BRDF tables", version=bc.__version__, description=DESCRIPTION, routes=app.routes
            )
            _, definitions = models_json_schema(
                [(s, "validation") for s in SCHEMAS], ref_template="#/components/schemas/{model}"
            )
            components = document.setdefault("components", {})
            components.setdefault("schemas", {}).update(definitions["$defs"])
            if settings.api_key is not None:
                components["securitySchemes"] = _SCHEMES
                _secure(document)
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
