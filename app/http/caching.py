"""ETags from the request alone, before anything is computed, and what caches may do with each answer."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import lru_cache

from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

#: By name: ask again each time, the material may be another one by now.
BY_NAME = "no-cache"
#: By id: the id is a digest of all that is evaluated: its answers never change.
BY_ID = "public, max-age=31536000, immutable"
_VERSION = bc.__version__.encode()


def etag_of(request: Request, *identities: str) -> str:
    """Strong ETag of the answer: its path, its query, what it is made from, and the version that makes it."""
    digest = _digest_of(request.scope["path"], identities).copy()
    digest.update(request.scope["query_string"])
    return f'"{digest.hexdigest()[:32]}"'


def etag_of_material(name: str, tag: str) -> str:
    """The ETag of /v1/materials/NAME, which is what If-Match names when a material is replaced or deleted."""
    return f'"{_digest_of(f"/v1/materials/{name}", (tag,)).hexdigest()[:32]}"'


@lru_cache(maxsize=512)
def _digest_of(path: str, identities: tuple[str, ...]) -> hashlib._Hash:
    """The digest of an ETag up to the query. It is shared: copy it before adding to it."""
    parts = (_VERSION, path.encode(), *map(str.encode, identities))
    # with their lengths, so that no two different lists of parts look alike; the query comes last and needs none
    lengths = ",".join([str(len(part)) for part in parts]).encode()
    return hashlib.sha256(b"|".join((lengths, *parts, b"")))


def material_headers(
    request: Request, id: str, tag: str, by_id: bool, *kind: str, lasting: bool = True
) -> dict[str, str]:
    """ETag and caching headers of a GET answer about a material; a name's also says where it stays for ever.

    kind     what tells this answer from others at the same address: the media type that was asked for.
    lasting  by id, the answer holds nothing but what the id is a digest of.
    """
    if by_id and lasting:
        return {"etag": etag_of(request, id, *kind), "cache-control": BY_ID}
    headers = {"etag": etag_of(request, tag, *kind), "cache-control": BY_NAME}
    if not by_id:
        rest = request.scope["path"].split("/", 4)[4:]  # after /v1/materials/NAME
        query = request.scope["query_string"].decode("latin-1")
        place = "/".join([f"/v1/tables/{id}", *rest])
        headers["content-location"] = f"{place}?{query}" if query else place
    return headers


def held_tags(values: Iterable[str]) -> set[str]:
    """The entity tags of If-Match or If-None-Match fields; a weak one counts as the strong one."""
    return {tag.strip().removeprefix("W/") for tag in ",".join(values).split(",")} - {""}


def not_modified(request: Request, headers: dict[str, str]) -> Response | None:
    """The 304 answer if the caller already holds the representation named by the ETag in `headers`.

    "*" is passed over: at this point nobody knows whether the question has an answer.
    """
    for name, _ in request.scope["headers"]:
        if name == b"if-none-match":
            if headers["etag"] in held_tags(request.headers.getlist("if-none-match")):
                return Response(status_code=304, headers=headers)
            return None
    return None
