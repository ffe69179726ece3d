"""What a person sees in a browser: the materials, one material, and the list of operations. No script is needed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from brdf_service.http.caching import BY_NAME, not_modified
from brdf_service.http.errors import NotFoundError
from brdf_service.http.query import NoQuery, Query, WholeNumber, parse_query
from brdf_service.http.security import NO_REFERRER, PAGE_POLICY
from brdf_service.routes.address import by_name
from brdf_service.routes.materials import RESOURCES, page_of
from brdf_service.schemas.materials import MeasuredError
from brdf_service.state import state_of
from fastapi import APIRouter
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

_WEB = Path(__file__).parents[1] / "web"
_TEMPLATES = Environment(
    loader=FileSystemLoader(_WEB), autoescape=True, undefined=StrictUndefined, auto_reload=False, trim_blocks=True
)
#: Materials on the start page; each shows a picture.
PER_PAGE = 24
_STATIC = {
    "style.css": "text/css; charset=utf-8",
    "app.js": "text/javascript; charset=utf-8",
    "icon.svg": "image/svg+xml",
}
_FLAGS = ("bilateral", "reciprocal", "energy_conserving", "non_negative")

router = APIRouter(include_in_schema=False)


class StartQuery(Query):
    """Which materials the start page shows."""

    offset: WholeNumber = Field(0, ge=0, le=10**9, description="materials to pass over")


class MaterialPageQuery(Query):
    """The picture on a material's page; what is typed into the form goes to its address, which says what is wrong."""

    theta_i: str = Field("0,30,60", max_length=200, description="angles of the light, degrees")
    view: bc.names.View = Field("polar", description="view")
    scale: bc.names.Scale = Field("log", description="scale")
    channel: str = Field("", description="channel")


@router.get("/")
async def start(request: Request) -> Response:
    offset = parse_query(request.scope["query_string"], StartQuery).offset
    state = state_of(request)
    page = await page_of(state.library, offset, PER_PAGE)
    shown = {"materials": [_shown(line.facts) for line in page.lines], "total": page.total, "skipped": page.skipped}
    return _page(request, "index.html", offset=offset, per_page=PER_PAGE, folder=state.settings.data, **shown)


@router.get("/materials/{name}")
async def material(request: Request) -> Response:
    asked = parse_query(request.scope["query_string"], MaterialPageQuery)
    found = (await by_name(request)).material
    channels, report = found.brdf.channels, found.brdf.report
    named = {str(c): label for c, label in zip(channels, channels.labels(), strict=True)}
    picked = asked.channel if asked.channel in named else ""
    shown = {**asked.model_dump(exclude={"channel"}), **({"channel": picked} if picked else {})}
    return _page(
        request,
        "material.html",
        m=_shown(found.facts),
        asked=asked,
        picture=urlencode(shown, safe=","),
        channel=picked,
        channels={"": "default"} | named,
        labels=channels.labels(),
        errors=_errors(found.facts["error"]),
        # the measured angles only where there are some
        resources=[r for r in RESOURCES if r.title and (not r.name.startswith("coverage") or "coverage" in report)],
    )


@router.get("/docs")
async def docs(request: Request) -> Response:
    parse_query(request.scope["query_string"], NoQuery)
    return _page(request, "docs.html", document=request.app.openapi())


@router.get("/static/{file}")
async def static(request: Request) -> Response:
    file = request.path_params["file"]
    if file not in _STATIC:
        raise NotFoundError("unknown_path", "no such file; / lists the materials and /docs every path", where="path")
    return _cached(request, _static(file), _STATIC[file], {})


@cache
def _static(file: str) -> bytes:
    return (_WEB / file).read_bytes()


def _page(request: Request, template: str, **values: Any) -> Response:
    base = str(request.base_url).rstrip("/")
    text = _TEMPLATES.get_template(template).render(version=bc.__version__, base=base, **values)
    headers = {"content-security-policy": PAGE_POLICY, **NO_REFERRER}
    return _cached(request, text.encode(), "text/html; charset=utf-8", headers)


def _cached(request: Request, body: bytes, media_type: str, headers: Mapping[str, str]) -> Response:
    sent = {"etag": f'"{hashlib.sha256(body).hexdigest()[:32]}"', "cache-control": BY_NAME, **headers}
    return not_modified(request, sent) or Response(body, 200, sent, media_type=media_type)


def _shown(facts: Mapping[str, Any]) -> dict[str, Any]:
    """What the pages say of a material, in words."""
    if "problem" in facts:
        return {"name": facts["name"], "problem": facts["problem"]["detail"]}
    exact, l1 = facts["kind"] == "model", facts["error"].get("l1")
    error = "not measured" if l1 is None else f"L1 {float(l1):.2g}"
    size = "none: a formula" if exact else _bytes(float(facts["nbytes"]))
    shown = {
        "channels": _channels(facts),
        "size": size,
        "error": "none: evaluated exactly" if exact else error,
        "id": facts["id"],
    }
    table = {
        "kind": facts["kind"],
        "representation": facts.get("representation", "formula"),
        "channels": shown["channels"],
        "bytes": size,
        "measured error": shown["error"],
        "properties": ", ".join(f"{'' if facts.get(f) else 'not '}{f.replace('_', ' ')}" for f in _FLAGS),
        "mirror part": "yes: a delta, left out of values and pictures" if facts.get("has_delta") else "none",
        "id": facts["id"],
    }
    return {
        **shown,
        "name": facts["name"],
        "problem": "",
        "kind": facts["kind"],
        "path": f"/v1/materials/{facts['name']}",
        "has_delta": bool(facts.get("has_delta")),
        "warnings": [*facts["error"].get("warnings", ()), *facts["warnings"]],
        "about": _about(facts),
        "facts": table,
    }


def _errors(error: Mapping[str, Any]) -> list[dict[str, str]]:
    """A table's measured error at each angle of incidence, the stated ones and those between them, in words."""
    measured = MeasuredError.model_validate(error)
    rows = sorted((*measured.by_theta_i, *measured.between), key=lambda row: row.theta_i)

    def percent(share: float | None, stderr: float | None = None) -> str:
        if share is None:
            return "unknown"
        return f"{100 * share:.2g} %" if stderr is None else f"{100 * share:.2g} ± {100 * stderr:.1g} %"

    return [
        {
            "theta_i": f"{math.degrees(row.theta_i):.3g}",
            "l1": percent(row.l1, row.l1_stderr),
            "albedo_error": percent(row.albedo_error),
        }
        for row in rows
    ]


def _about(facts: Mapping[str, Any]) -> str:
    metadata = facts.get("metadata", {})
    if isinstance(metadata.get("about"), str):
        return str(metadata["about"])
    if facts["kind"] == "model":
        terms = metadata.get("sum", [metadata])
        return " + ".join(f"{term.get('model', 'sum')} {json.dumps(term.get('parameters'))}" for term in terms)
    source = facts.get("source") or {}
    return f"from {source['name']}" if isinstance(source, dict) and source.get("name") else ""


def _channels(facts: Mapping[str, Any]) -> str:
    channels, wavelengths = facts["channels"], facts["channel_kind"] == "wavelength"
    shown = [f"{c:g}" if wavelengths else str(c) for c in channels]
    listed = ", ".join(shown) if len(shown) <= 8 else f"{shown[0]} … {shown[-1]} ({len(shown)})"
    return f"{listed} nm" if wavelengths else listed


def _bytes(size: float) -> str:
    for unit in ("bytes", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"
