"""ETags made before anything is computed, and the caching rules of each kind of answer."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import lru_cache

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
    return etag(request.scope["path"], request.scope["query_string"], *identities)


def etag_of_material(name: str, tag: str) -> str:
    """The ETag of /v1/materials/NAME, which is what If-Match names when a material is replaced or deleted."""
    return etag(f"/v1/materials/{name}", b"", tag)


def held_tags(values: Iterable[str]) -> set[str]:
    """The entity tags of If-Match or If-None-Match fields; a weak one counts as the strong one."""
    return {tag.strip().removeprefix("W/") for tag in ",".join(values).split(",")} - {""}


def etag(path: str, query: bytes, *identities: str) -> str:
    """Strong ETag of what `identities` say at this path and query."""
    digest = digest_of(path, identities).copy()
    digest.update(query)
    return f'"{digest.hexdigest()[:32]}"'


@lru_cache(maxsize=512)
def digest_of(path: str, identities: tuple[str, ...]) -> hashlib._Hash:
    """The digest behind `etag`, up to the query. It is shared: copy it before adding to it."""
    parts = (_VERSION, path.encode(), *map(str.encode, identities))
    # with their lengths, so that no two different lists of parts look alike; the query comes last and needs none
    lengths = ",".join([str(len(part)) for part in parts]).encode()
    return hashlib.sha256(b"|".join((lengths, *parts, b"")))


def not_modified(request: Request, etag: str, headers: dict[str, str]) -> Response | None:
    """The 304 answer if the caller already holds the representation named by `etag`.

    "*" is passed over: at this point nobody knows whether the question has an answer.
    """
    given = [value.decode("latin-1") for name, value in request.scope["headers"] if name == b"if-none-match"]
    if given and etag in held_tags(given):
        return Response(status_code=304, headers=headers)
    return None
