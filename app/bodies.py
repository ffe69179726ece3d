"""Request bodies, counted while they arrive: a limit that is checked at the end is no limit."""

from __future__ import annotations

from starlette.requests import Request

import brdfcore as bc
from app.errors import MediaTypeError


async def read_json_body(request: Request, limit: int) -> bytes:
    """The body of a JSON request. Raises `MediaTypeError` for another type, `LimitError` beyond `limit` bytes."""
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if media_type != "application/json":
        raise MediaTypeError(
            "unsupported_media_type",
            "the body must be JSON; send it with the header 'Content-Type: application/json'",
            where="Content-Type",
            got=media_type[:80],
            expected="application/json",
        )
    announced = request.headers.get("content-length", "")
    if announced.isascii() and announced.isdigit() and int(announced[:20]) > limit:
        raise _too_large(int(announced[:20]), limit)
    received = bytearray()
    async for chunk in request.stream():
        received += chunk
        if len(received) > limit:
            raise _too_large(len(received), limit)
    return bytes(received)


def _too_large(got: int, limit: int) -> bc.LimitError:
    return bc.LimitError(
        "body_too_large",
        f"the body has {got} bytes or more; the limit is {limit}; send the points in several requests",
        where="body",
        got=got,
        limit=limit,
    )
