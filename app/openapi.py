"""The OpenAPI document: operations say here what they take and answer, in the same objects that parse and refuse."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

import brdfcore as bc
from app.errors import PROBLEM_TYPE
from app.query import QueryParameter
from app.schemas import SCHEMAS

_REFUSALS = {
    400: "the body cannot be read as JSON",
    404: "no such material",
    409: "the material's file cannot be used",
    413: "more than a limit; the problem says which",
    415: "a body of another media type",
    421: "the Host header names another machine",
    422: "a parameter or value that is not taken; the problem says which, where and why",
    503: "not ready, or the data folder cannot be read",
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


def parameters(query: Iterable[QueryParameter] = (), path: Iterable[dict[str, Any]] = ()) -> dict[str, Any]:
    """The `openapi_extra` of an operation that parses its own parameters."""
    return {"parameters": [*path, *(q.openapi() for q in query)]}


def install(app: FastAPI) -> None:
    """Make `app.openapi()` give the complete document."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = get_openapi(
                title="BRDF tables", version=bc.__version__, description=DESCRIPTION, routes=app.routes
            )
            _, definitions = models_json_schema(
                [(s, "validation") for s in SCHEMAS], ref_template="#/components/schemas/{model}"
            )
            document.setdefault("components", {}).setdefault("schemas", {}).update(definitions["$defs"])
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
