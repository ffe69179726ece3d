"""One value by GET, the question that is asked most: the answer of `routers.evaluate`, byte for byte, without the parts
of it that this question has no use for. What is not exactly this question gets None and goes the long way."""

from __future__ import annotations

import re
import time
from typing import NamedTuple

import numpy as np
import orjson

import brdfcore as bc
from app.addressing import BY_ID_ADDRESS, Address
from app.answers import tail
from app.caching import BY_ID, BY_NAME, etag
from app.errors import MaterialDamagedError, NotFoundError
from app.library import Material
from app.negotiation import INLINE_VALUES, MEDIA_TYPES
from app.state import State

_NUMBER = rb"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
#: As the OpenAPI lists the parameters and as most write them.
_QUESTION = re.compile(b"theta_i=%b&theta_o=%b&delta_phi=%b(?:&angles=(deg|rad))?" % (_NUMBER, _NUMBER, _NUMBER))
_LONGEST = 300
_JSON = MEDIA_TYPES["json"]
#: What an Accept header may be for JSON to be the answer.
ACCEPT = frozenset((b"", b"*/*", _JSON.encode()))


_KEEP_BY_ID, _KEEP_BY_NAME = BY_ID.encode(), BY_NAME.encode()
_TYPE = _JSON.encode()
_LINES = b"etag: %%b\r\ncache-control: %%b\r\n%%bvary: Accept\r\ncontent-type: %b\r\ncontent-length: %%d\r\n" % _TYPE


class Value(NamedTuple):
    """The parts of an answer that differ, and the seconds of looking up; `location` is None by id."""

    etag: bytes
    keep: bytes
    location: bytes | None
    body: bytes
    seconds: float

    def headers(self) -> list[tuple[bytes, bytes]]:
        """As the framework takes them."""
        location = [] if self.location is None else [(b"content-location", self.location)]
        length = b"%d" % len(self.body)
        first = [(b"etag", self.etag), (b"cache-control", self.keep), *location]
        return [*first, (b"vary", b"Accept"), (b"content-type", _TYPE), (b"content-length", length)]

    def lines(self) -> bytes:
        """The same as they go over the wire."""
        location = b"" if self.location is None else b"content-location: %b\r\n" % self.location
        return _LINES % (self.etag, self.keep, location, len(self.body))


def one_value(state: State, address: Address, key: str, path: str, query: bytes) -> Value | None:
    """The answer; `key` is the name or the id of the material."""
    if len(query) > _LONGEST or not state.ready:
        return None
    asked = _QUESTION.fullmatch(query)
    if asked is None:
        return None
    by_id = address is BY_ID_ADDRESS
    try:
        material = state.library.peek_id(key) if by_id else state.library.peek(key)
    except (NotFoundError, MaterialDamagedError):
        return None
    if material is None or not _small(material, state):
        return None
    theta_i, theta_o, delta_phi, unit = asked.groups()
    angles = np.array((float(theta_i), float(theta_o), float(delta_phi)))
    if unit != b"rad":
        angles = bc.to_radians(angles)
    begun = time.perf_counter()
    try:
        values = material.brdf.evaluate(*angles.tolist())
    except bc.InputError:
        return None
    seconds = time.perf_counter() - begun
    rest = tail(material, "rad" if unit == b"rad" else "deg", by_id)
    body = b'{"values":%b,%b' % (orjson.dumps([values.tolist()]), rest)
    tag = etag(path, query, material.id if by_id else material.tag, _JSON).encode()
    if by_id:
        return Value(tag, _KEEP_BY_ID, None, body, seconds)
    return Value(tag, _KEEP_BY_NAME, b"/v1/tables/%b/evaluate?%b" % (material.id.encode(), query), body, seconds)


def _small(material: Material, state: State) -> bool:
    count = len(material.brdf.channels)
    return count <= INLINE_VALUES[material.facts["kind"]] and count <= state.settings.max_values
