"""One declaration for each thing that a material answers to a GET: it makes the routes by name and by id, their
OpenAPI, the link in the metadata and the one on the page."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

from brdf_service.evaluate.directions import polar_angles
from brdf_service.http.caching import material_headers, not_modified
from brdf_service.http.json import to_json
from brdf_service.http.openapi import Content
from brdf_service.http.query import NoQuery, Query, parse_query
from brdf_service.http.security import NO_REFERRER, SVG_POLICY
from brdf_service.library.materials import Material
from brdf_service.routes.address import Address, Found, at_both
from brdf_service.state import State, state_of
from brdf_service.work.stoppable import check_seconds, run_stoppable
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

Draw = Callable[[Request, State, Found, Any, str], Awaitable[bytes]]
#: Bytes of a material's facts, four times their text, that are told in the event loop.
_FEW_BYTES = 2**18
#: What to do where it is too much work.
_FEWER = "name one channel where the path takes one, or use the library or the shell"


@dataclass(frozen=True)
class Resource:
    """What a material answers to a GET of its path + /name.

    name          last part of the path; "" is the material itself.
    query         its parameters.
    content       schema of a JSON answer, or the media type of another.
    compute       (material, query) -> content: JSON-ready, or bytes. In a thread, `seats` at once.
    draw          (request, state, found, query, etag) -> bytes, instead of `compute`: more than one computation.
    check         (state, query), and (state, query, found) once the material is found: refuses what is too large.
    seconds       (channels, query) -> about how long it takes: what is too much is refused before it begins. 0: it is
                  only told again, in the event loop if it is short.
    lasting       by id the answer never changes; False if it says anything of the file.
    kept          the answer is kept with the material: `compute` takes seconds, and the query changes next to nothing.
    example       query of the link in the metadata; None: no link.
    title         words of the link on the material's page; "": none there.
    """

    name: str
    summary: str
    query: type[Query] = NoQuery
    content: Content = "application/octet-stream"
    description: str = ""
    says: str = "the answer"
    compute: Callable[[Material, Any], Any] | None = None
    draw: Draw | None = None
    check: Callable[[State, Any], None] | None = None
    check_found: Callable[[State, Any, Found], None] | None = None
    seconds: Callable[[int, Any], float] = lambda channels, _: 0.002 * channels
    refusals: tuple[int, ...] = (404, 409, 413, 503)
    lasting: bool = True
    kept: bool = False
    seats: str = "large"
    example: str | None = None
    title: str = ""

    @property
    def media_type(self) -> str:
        """Of the answer."""
        return self.content if isinstance(self.content, str) else "application/json"

    async def answer(self, request: Request, address: Address) -> Response:
        """The answer to a GET."""
        state, asked = state_of(request), parse_query(request.scope["query_string"], self.query)
        if self.check is not None:
            self.check(state, asked)
        found = await address.find(request)
        if self.check_found is not None:
            self.check_found(state, asked, found)
        material = found.material
        channels = len(material.brdf.channels)
        seconds = self.seconds(channels, asked)
        check_seconds(seconds, channels, state.settings.max_work_seconds, _FEWER)
        headers = material_headers(request, material.id, material.tag, found.by_id, lasting=self.lasting)
        if self.media_type == "image/svg+xml":
            headers |= {"content-security-policy": SVG_POLICY, **NO_REFERRER}
        unchanged = not_modified(request, headers)
        if unchanged is not None:
            return unchanged
        try:
            if not seconds and material.held_bytes - material.nbytes <= _FEW_BYTES:
                body = self._computed(material, asked)  # what is told of it, and not much: a thread would cost more
            else:
                body = await self._body(request, state, found, asked, headers["etag"])
        except bc.InputError as error:
            raise explained(error, asked) from error
        return Response(body, 200, headers, media_type=self.media_type)

    async def _body(self, request: Request, state: State, found: Found, asked: Any, etag: str) -> bytes:
        if self.draw is not None:
            return await self.draw(request, state, found, asked, etag)
        held: bytes | None = found.material.parts.get((self.name, asked)) if self.kept else None
        if held is None:
            work = partial(self._computed, found.material, asked)
            held = await run_stoppable(request, work, getattr(state, self.seats))
            if self.kept:
                found.material.parts[self.name, asked] = held
        return held

    def _computed(self, material: Material, asked: Any) -> bytes:
        assert self.compute is not None
        made = self.compute(material, asked)
        return made if isinstance(made, bytes) else to_json(made)


def explained(error: bc.InputError, asked: Any) -> bc.InputError:
    """The library's complaint about an angle of incidence in the unit of the request."""
    theta_i = getattr(asked, "theta_i", None)
    return error if theta_i is None else polar_angles(theta_i, asked.angles).explained(error)


def add_resources(router: APIRouter, resources: Iterable[Resource]) -> None:
    """The routes of `resources` by name and by id."""
    for each in resources:
        about = {"answer": (each.content,), "says": each.says, "refusals": each.refusals, "query": each.query}
        id = (each.name or "metadata").replace(".", "_")
        at_both(router, f"GET {each.name}", each.answer, id, each.summary, each.description, cached=True, **about)
