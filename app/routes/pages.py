"""What a person sees in a browser: the materials, one material, and the list of operations. No script is needed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlencode

from brdf_service.http.caching import BY_NAME, not_modified
from brdf_service.http.errors import NotFoundError
from brdf_service.http.query import NoQuery, Query, WholeNumber, parse_query
from brdf_service.http.security import NO_REFERRER, PAGE_POLICY
from brdf_service.http.templates import Html, fill, join, web_file
from brdf_service.routes.address import by_name
from brdf_service.routes.materials import RESOURCES, page_of
from brdf_service.routes.pictures import Scale, View
from brdf_service.state import state_of
from fastapi import APIRouter
from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

router = APIRouter(include_in_schema=False)

#: Materials on the start page; each shows a picture.
PER_PAGE = 24
_STATIC = {
    "style.css": "text/css; charset=utf-8",
    "app.js": "text/javascript; charset=utf-8",
    "icon.svg": "image/svg+xml",
}
#: What a picture of the start page shows: three angles tell a lobe's growth, the logarithm shows all of it.
_OVERVIEW = {"theta_i": "0,30,60", "scale": "log"}


class StartQuery(Query):
    """Which materials the start page shows."""

    offset: WholeNumber = Field(0, ge=0, le=10**9, description="materials to pass over")


class MaterialPageQuery(Query):
    """The picture on a material's page; what is typed into the form goes to its address, which says what is wrong."""

    theta_i: str = Field(_OVERVIEW["theta_i"], max_length=200, description="angles of the light, degrees")
    view: View = Field("polar", description="view")
    scale: Scale = Field("log", description="scale")
    channel: str = Field("", description="channel")


@router.get("/")
async def start(request: Request) -> Response:
    offset = parse_query(request.scope["query_string"], StartQuery).offset
    library = state_of(request).library
    listed = await page_of(library, offset, PER_PAGE)
    lines, total = listed.lines, listed.total
    base = str(request.base_url).rstrip("/")
    cards = [_card(line.facts, base) if line.usable else _damaged_card(line.facts) for line in lines]
    page = fill(
        "index.html",
        version=bc.__version__,
        count=f"{total} material{'' if total == 1 else 's'}",
        folder=state_of(request).settings.data,
        cards=join(cards) if cards else fill("empty.html", folder=state_of(request).settings.data),
        skipped=fill("skipped.html", files=", ".join(listed.skipped)) if listed.skipped else Html(""),
        pager=_pager(offset, len(lines), total),
        base=base,
        first=next((line.name for line in lines if line.usable), "NAME"),
    )
    return _page(request, page)


@router.get("/materials/{name}")
async def material(request: Request) -> Response:
    asked = parse_query(request.scope["query_string"], MaterialPageQuery)
    found = (await by_name(request)).material
    facts, base = found.facts, str(request.base_url).rstrip("/")
    channels = found.brdf.channels
    picked = asked.channel if asked.channel in map(str, channels) else ""
    shown = asked.model_dump(include={"theta_i", "view", "scale"}) | ({"channel": picked} if picked else {})
    path = f"/v1/materials/{found.name}"
    page = fill(
        "material.html",
        version=bc.__version__,
        name=found.name,
        about=_about(facts),
        badges=_badges(facts),
        warnings=_warnings(facts),
        picture=f"{path}/slice.svg?{_query(shown)}",
        path=path,
        permanent=f"/v1/tables/{found.id}",
        theta_i=asked.theta_i,
        views=_options({"polar": "plane of incidence", "hemisphere": "all directions"}, asked.view),
        scales=_options({"linear": "linear", "log": "logarithmic"}, asked.scale),
        channels=_options(
            {"": "default"} | {str(c): label for c, label in zip(channels, channels.labels(), strict=True)}, picked
        ),
        labels=json.dumps(channels.labels()),
        facts=_facts_table(facts),
        analyses=_analyses(path, found.brdf.report),
        curl=_curl(found.name, base),
    )
    return _page(request, page)


@router.get("/docs")
async def docs(request: Request) -> Response:
    parse_query(request.scope["query_string"], NoQuery)
    document = request.app.openapi()
    schemas = document["components"]["schemas"]
    operations = [
        _operation(method, path, operation, schemas)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    return _page(request, fill("docs.html", version=bc.__version__, operations=join(operations)))


@router.get("/static/{file}")
async def static(request: Request) -> Response:
    file = request.path_params["file"]
    if file not in _STATIC:
        raise NotFoundError("unknown_path", "no such file; / lists the materials and /docs every path", where="path")
    return _cached(request, web_file(file), _STATIC[file], {})


def _page(request: Request, page: Html) -> Response:
    return _cached(
        request, page.encode(), "text/html; charset=utf-8", {"content-security-policy": PAGE_POLICY, **NO_REFERRER}
    )


def _cached(request: Request, body: bytes, media_type: str, headers: Mapping[str, str]) -> Response:
    etag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    sent = {"etag": etag, "cache-control": BY_NAME, **headers}
    return not_modified(request, sent) or Response(body, 200, sent, media_type=media_type)


def _card(facts: Mapping[str, Any], base: str) -> Html:
    name = facts["name"]
    return fill(
        "card.html",
        name=name,
        about=_about(facts),
        badges=_badges(facts),
        warnings=_warnings(facts),
        channels=_channels(facts),
        size=_bytes(facts),
        error=_error(facts),
        id=facts["id"],
        short_id=facts["id"][:12],
        path=f"/v1/materials/{name}",
        overview=_query(_OVERVIEW),
        curl=_curl(name, base),
    )


def _damaged_card(facts: Mapping[str, Any]) -> Html:
    return fill("card_damaged.html", name=facts["name"], detail=facts["problem"]["detail"])


def _badges(facts: Mapping[str, Any]) -> Html:
    badges = [Html(f'<span class="badge">{"model, exact" if facts["kind"] == "model" else "table"}</span>')]
    if facts.get("has_delta"):
        badges.append(Html('<span class="badge">mirror part</span>'))
    if _said(facts):
        badges.append(Html('<span class="badge warn">⚠ warning</span>'))
    return join(badges)


def _said(facts: Mapping[str, Any]) -> list[str]:
    """The warnings that came with the table's measured error."""
    said = facts["error"].get("warnings", []) if isinstance(facts["error"], dict) else []
    return [str(w) for w in said] if isinstance(said, list) else []


def _warnings(facts: Mapping[str, Any]) -> Html:
    return join(fill("warning.html", text=w) for w in _said(facts))


def _about(facts: Mapping[str, Any]) -> str:
    metadata = facts.get("metadata", {})
    if isinstance(metadata.get("about"), str):
        return str(metadata["about"])
    if facts["kind"] == "model":
        return f"{metadata.get('model')} {json.dumps(metadata.get('parameters'))}"
    source = facts.get("source") or {}
    return f"from {source['name']}" if isinstance(source, dict) and source.get("name") else ""


def _channels(facts: Mapping[str, Any]) -> str:
    channels, wavelengths = facts["channels"], facts["channel_kind"] == "wavelength"
    shown = [f"{c:g}" if wavelengths else str(c) for c in channels]
    listed = ", ".join(shown) if len(shown) <= 8 else f"{shown[0]} … {shown[-1]} ({len(shown)})"
    return f"{listed} nm" if wavelengths else listed


def _bytes(facts: Mapping[str, Any]) -> str:
    if facts["kind"] == "model":
        return "none: a formula"
    size = float(facts["nbytes"])
    for unit in ("bytes", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"


def _error(facts: Mapping[str, Any]) -> str:
    if facts["kind"] == "model":
        return "none: evaluated exactly"
    l1 = facts["error"].get("l1")
    return f"L1 {l1:.2g}" if isinstance(l1, (int, float)) else "not measured"


def _facts_table(facts: Mapping[str, Any]) -> Html:
    flags = ("bilateral", "reciprocal", "energy_conserving", "non_negative")
    rows = {
        "kind": facts["kind"],
        "representation": facts.get("representation", "formula"),
        "channels": _channels(facts),
        "bytes": _bytes(facts),
        "measured error": _error(facts),
        "properties": ", ".join(f"{'' if facts.get(f) else 'not '}{f.replace('_', ' ')}" for f in flags),
        "mirror part": "yes: a delta, left out of values and pictures" if facts.get("has_delta") else "none",
        "id": facts["id"],
    }
    return join(fill("fact.html", term=k, value=v) for k, v in rows.items())


def _analyses(path: str, report: Mapping[str, Any]) -> Html:
    """Links to what the service can say of a material; the measured angles only where there are some."""
    offered = (r for r in RESOURCES if r.title and (not r.name.startswith("coverage") or "coverage" in report))
    return join(
        Html(f'<a href="{path}/{r.name}{"?" + r.example if r.example else ""}">{r.title}</a> ') for r in offered
    )


def _curl(name: str, base: str) -> Html:
    path = f"{base}/v1/materials/{name}"
    body = json.dumps({"theta_i": 30, "theta_o": [0, 30, 60], "delta_phi": 180})
    lines = (
        f'curl "{path}/evaluate?theta_i=30&theta_o=0,30,60&delta_phi=180"',
        f"curl -H 'Content-Type: application/json' -d '{body}' {path}/evaluate",
        f'curl -o {name}.png "{path}/slice.png?theta_i=30,60"',
    )
    return join(fill("command.html", command=line) for line in lines)


def _options(choices: Mapping[str, str], picked: str) -> Html:
    return join(
        fill("option.html", value=value, label=label, selected=Html(" selected" if value == picked else ""))
        for value, label in choices.items()
    )


def _pager(offset: int, shown: int, total: int) -> Html:
    if shown == total:
        return Html("")
    before = f"/?offset={max(0, offset - PER_PAGE)}" if offset else ""
    after = f"/?offset={offset + shown}" if offset + shown < total else ""
    return fill(
        "pager.html",
        range=f"{offset + 1}–{offset + shown} of {total}" if shown else f"none of {total} from here",
        before=Html(f'<a href="{before}">previous</a>' if before else ""),
        after=Html(f'<a href="{after}">next</a>' if after else ""),
    )


def _query(values: Mapping[str, Any]) -> str:
    return urlencode(values, safe=",")


def _operation(method: str, path: str, operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> Html:
    parameters = [
        fill(
            "docs_parameter.html",
            name=p["name"],
            where=p["in"],
            need="required" if p["required"] else f"default: {p['schema'].get('default', 'none')}",
            description=p.get("description", ""),
        )
        for p in operation.get("parameters", [])
    ]
    for media_type, body in operation.get("requestBody", {}).get("content", {}).items():
        if "$ref" not in body["schema"]:
            parameters.append(
                fill("docs_parameter.html", name="body", where=media_type, need="", description="see the description")
            )
            continue
        schema = schemas[body["schema"]["$ref"].rpartition("/")[2]]
        parameters += [
            fill(
                "docs_parameter.html",
                name=name,
                where="body, JSON",
                need="required" if name in schema.get("required", ()) else f"default: {field.get('default')}",
                description=field.get("description", ""),
            )
            for name, field in schema["properties"].items()
        ]
    responses = [
        fill(
            "docs_response.html",
            status=status,
            description=r["description"],
            types=", ".join(r.get("content", {})) or "no body",
        )
        for status, r in operation["responses"].items()
    ]
    return fill(
        "docs_operation.html",
        id=operation["operationId"],
        method=method.upper(),
        path=path,
        summary=operation.get("summary", ""),
        description=operation.get("description", ""),
        parameters=join(parameters) if parameters else Html("<tr><td>none</td></tr>"),
        responses=join(responses),
    )
