"""ETags made before anything is computed, and the caching rules of each kind of answer."""

from __future__ import annotations

import hashlib

from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

#: A name may stand for another table tomorrow: keep it, but ask before using it.
BY_NAME = "no-cache"
#: An id is a digest of all that is evaluated: its answers never change.
BY_ID = "public, max-age=31536000, immutable"


def etag_of(request: Request, *identities: str) -> str:
    """Strong ETag of the answer: its path, its query, what it is made from, and the version that makes it."""
    scope = request.scope
    digest = hashlib.sha256()
    for part in (scope["path"].encode(), scope["query_string"], bc.__version__.encode(), *map(str.encode, identities)):
        digest.update(len(part).to_bytes(8, "little"))  # so that no two different lists of parts look alike
        digest.update(part)
    return f'"{digest.hexdigest()[:32]}"'


def not_modified(request: Request, etag: str, headers: dict[str, str]) -> Response | None:
    """The 304 answer if the caller already holds the representation named by `etag`.

    "*" is passed over: at this point nobody knows whether the question has an answer.
    """
    given = ",".join(request.headers.getlist("if-none-match"))
    held = {tag.strip().removeprefix("W/") for tag in given.split(",")}
    if etag in held:
        return Response(status_code=304, headers=headers)
    return None
