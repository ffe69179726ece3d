"""One value by GET, the question that is asked most: answered inside the server's protocol, without a task, a scope, or
messages between layers, which together cost three times as much as the answer.

The answer is that of `routers.evaluate`, byte for byte, with the headers, the log line and the counters of `boundary`.
What is not exactly this question gets None and goes the long way.
"""

from __future__ import annotations

import hashlib
import logging
import math
import re
import time
from typing import NamedTuple

import orjson
from brdf_service.evaluate.angles import Unit
from brdf_service.evaluate.encoding import tail
from brdf_service.http.caching import BY_ID, BY_NAME, digest_of
from brdf_service.http.errors import MaterialDamagedError, NotFoundError
from brdf_service.http.negotiation import INLINE_VALUES, MEDIA_TYPES
from brdf_service.http.security import ALWAYS
from brdf_service.library.materials import Material
from brdf_service.routes.addressing import BY_ID_ADDRESS, BY_NAME_ADDRESS
from brdf_service.server.request import REQUEST_ID, log_line, new_id, timing
from brdf_service.state import State

import brdfcore as bc

_NUMBER = rb"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
#: As the OpenAPI lists the parameters and as most write them.
_QUESTION = re.compile(
    rb"/v1/(?:(materials)|tables)/([A-Za-z0-9._-]+)/evaluate"
    rb"\?(theta_i=%b&theta_o=%b&delta_phi=%b(?:&angles=(deg|rad))?)" % (_NUMBER, _NUMBER, _NUMBER)
)
_LONGEST = 400
_JSON = MEDIA_TYPES["json"]
#: What an Accept header may be for JSON to be the answer.
_ACCEPT = frozenset((b"", b"*/*", _JSON.encode()))
#: Of a request whose answer is not the plain one: a copy to compare, a body to read, another protocol to speak.
_LONG_WAY = frozenset((b"if-none-match", b"content-length", b"transfer-encoding", b"expect", b"upgrade"))
_ROUTES = {by_id: f"{a.prefix}/evaluate" for by_id, a in ((False, BY_NAME_ADDRESS), (True, BY_ID_ADDRESS))}
_ANSWER = (
    b"HTTP/1.1 200 OK\r\netag: %%b\r\ncache-control: %%b\r\n%%bvary: Accept\r\ncontent-type: %b\r\n"
    b"content-length: %%d\r\n%%b%bx-request-id: %%b\r\nserver-timing: %%b\r\n\r\n%%b"
) % (_JSON.encode(), b"".join(b"%b: %b\r\n" % (name.encode(), value.encode()) for name, value in ALWAYS.items()))

log = logging.getLogger("brdf.service")


class _Fixed(NamedTuple):
    """What is the same in all answers of a material by one kind of address, in one unit."""

    digest: hashlib._Hash  # of the ETag, up to the query
    keep: bytes
    location: bytes  # up to the query; empty by id
    tail: bytes


class Quick:
    """Answers requests as the parser hands them over; one for a service, used in its event loop only."""

    def __init__(self, state: State) -> None:
        self._state = state

    def __call__(self, url: bytes, headers: list[tuple[bytes, bytes]], server_lines: bytes) -> bytes | None:
        """The whole answer to a GET over HTTP/1.1, status line and all, or None.

        headers       names in lower case.
        server_lines  the server's own headers, each with its end of line.
        """
        try:
            return self._answer(url, headers, server_lines)
        except Exception:
            log.exception("a value could not be answered at once")
            return None  # the long way meets the same error, and tells the caller

    def _answer(self, url: bytes, headers: list[tuple[bytes, bytes]], server_lines: bytes) -> bytes | None:
        begun = time.perf_counter()
        asked = _QUESTION.fullmatch(url) if len(url) <= _LONGEST else None
        state = self._state
        if asked is None or not state.ready:
            return None
        given, hosts = b"", []
        for name, value in headers:
            if name == b"host":
                hosts.append(value)
            elif name == b"x-request-id":
                given = value
            elif name in _LONG_WAY or (name == b"accept" and value not in _ACCEPT):
                return None
        if not state.hosts.known(hosts):
            return None
        named, key, query, theta_i, theta_o, delta_phi, unit = asked.groups()
        by_id = named is None
        material = _held(state, key.decode(), by_id)
        if material is None:
            return None
        angles = float(theta_i), float(theta_o), float(delta_phi)
        if unit != b"rad":
            # the bits of `bc.to_radians`, which takes arrays
            angles = math.radians(angles[0]), math.radians(angles[1]), math.radians(angles[2])
        started = time.perf_counter()
        try:
            values = material.brdf.evaluate(*angles)
        except bc.InputError:
            return None
        spent = time.perf_counter() - started
        fixed = _fixed(material, by_id, "rad" if unit == b"rad" else "deg")
        digest = fixed.digest.copy()
        digest.update(query)
        location = b"content-location: %b%b\r\n" % (fixed.location, query) if fixed.location else b""
        body = b'{"values":%b,%b' % (orjson.dumps([values.tolist()]), fixed.tail)
        tag = b'"%b"' % digest.hexdigest()[:32].encode()
        id = given.decode() if REQUEST_ID.fullmatch(given) else new_id()
        seconds = time.perf_counter() - begun
        answer = _ANSWER % (
            tag, fixed.keep, location, len(body), server_lines, id.encode(), timing(seconds, spent), body,
        )  # fmt: skip
        metrics, route = state.metrics, _ROUTES[by_id]
        metrics.lookups += 1
        metrics.lookup_seconds += spent
        metrics.request(route, "GET", 200, seconds, len(body))
        if state.access_log is not None:
            state.access_log(log_line(id, "GET", route, 200, seconds, len(body)))
        return answer


def _held(state: State, key: str, by_id: bool) -> Material | None:
    """The material if it is loaded, and so small that it is evaluated in the event loop."""
    try:
        material = state.library.peek_id(key) if by_id else state.library.peek(key)
    except (NotFoundError, MaterialDamagedError):
        return None
    if material is None:
        return None
    count = len(material.brdf.channels)
    if count > INLINE_VALUES[material.facts["kind"]] or count > state.settings.max_values:
        return None
    return material


def _fixed(material: Material, by_id: bool, unit: Unit) -> _Fixed:
    held, key = material.fixed, (by_id, unit)
    if key not in held:
        path = f"/v1/tables/{material.id}/evaluate" if by_id else f"/v1/materials/{material.name}/evaluate"
        digest = digest_of(path, (material.id if by_id else material.tag, _JSON))
        location = b"" if by_id else b"/v1/tables/%b/evaluate?" % material.id.encode()
        held[key] = _Fixed(digest, (BY_ID if by_id else BY_NAME).encode(), location, tail(material, unit, by_id))
    fixed: _Fixed = held[key]
    return fixed
