"""ETags made before anything is computed, and the caching rules of each kind of answer."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

#: A name may stand for another table tomorrow: keep it, but ask before using it.
BY_NAME = "no-cache"
#: An id is a digest of all that is evaluated: its answers never change.
BY_ID = "public, max-age=31536000, immutable"
_VERSION = bc.__version__.encode()


def etag_of(request: Request, *identities: str) -> str:
    """Strong ETag of the answer: its path, its query, what it is made from, and the version that makes it."""
    scope = request.scope
    return _etag(scope["path"].encode(), scope["query_string"], identities)


def etag_of_material(name: str, tag: str) -> str:
    """The ETag of /v1/materials/NAME, which is what If-Match names when a material is replaced or deleted."""
    return _etag(f"/v1/materials/{name}".encode(), b"", (tag,))


def held_tags(values: Iterable[str]) -> set[str]:
    """The entity tags of If-Match or If-None-Match fields; a weak one counts as the strong one."""
    return {tag.strip().removeprefix("W/") for tag in ",".join(values).split(",")} - {""}


def _etag(path: bytes, query: bytes, identities: Iterable[str]) -> str:
    parts = (path, query, _VERSION, *map(str.encode, identities))
    # with their lengths, so that no two different lists of parts look alike
    lengths = ",".join([str(len(part)) for part in parts]).encode()
    digest = hashlib.sha256(b"|".join((lengths, *parts))).hexdigest()
    return f'"{digest[:32]}"'


def not_modified(request: Request, etag: str, headers: dict[str, str]) -> Response | None:
    """The 304 answer if the caller already holds the representation named by `etag`.

    "*" is passed over: at this point nobody knows whether the question has an answer.
    """
    given = [value.decode("latin-1") for name, value in request.scope["headers"] if name == b"if-none-match"]
    if given and etag in held_tags(given):
        return Response(status_code=304, headers=headers)
    return None
