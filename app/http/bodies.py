"""Request bodies, counted and timed while they arrive: a limit that is checked at the end is no limit."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
from collections.abc import AsyncIterator, Awaitable
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from brdf_service.http.errors import BusyError, MediaTypeError, SlowBodyError
from brdf_service.http.negotiation import media_type_of
from brdf_service.settings import Settings
from starlette.requests import ClientDisconnect, Request
from starlette.types import Scope

import brdfcore as bc

#: Bytes of bodies held together after which memory is given back, and seconds until then.
_MUCH, _AFTER = 32 * 2**20, 1.0
Bytes = npt.NDArray[np.uint8]
T = TypeVar("T")


class Room:
    """Bytes of bodies that are held at the moment, all requests together. It belongs to the event loop."""

    def __init__(self, most: int) -> None:
        self.most, self.held = most, 0
        self._peak = 0  # since memory was last given back
        self._giving_back: asyncio.TimerHandle | None = None

    def take(self, scope: Scope, count: int) -> None:
        """Hold so many bytes more for a request; `BusyError` if there is no room for them."""
        if self.held + count > self.most:
            said = f"bodies of {self.held} bytes are held already; the limit is {self.most}; try again later"
            raise BusyError("bodies_full", said, where="body", limit=self.most, retry_after=2, rest_unread=True)
        self.held += count
        self._peak = max(self._peak, self.held)
        scope["brdf.held"] = scope.get("brdf.held", 0) + count

    def release(self, scope: Scope) -> None:
        """A request has ended. What many bodies took goes back to the system a moment after the last of them: the C
        library would keep it."""
        self.held -= scope.pop("brdf.held", 0)
        if self._peak >= _MUCH and not self.held:
            if self._giving_back is not None:
                self._giving_back.cancel()
            self._giving_back = asyncio.get_running_loop().call_later(_AFTER, self._give_back)

    def _give_back(self) -> None:
        self._peak, self._giving_back = 0, None
        asyncio.get_running_loop().run_in_executor(None, _give_back)


def _give_back() -> None:
    with contextlib.suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


async def read_json_body(request: Request, limit: int, seconds: float) -> bytes:
    """The body of a JSON request. Raises `MediaTypeError` for another type, and what `pieces` raises."""
    media_type = media_type_of(request.scope["headers"])
    if media_type != "application/json":
        raise MediaTypeError(
            "unsupported_media_type",
            "the body must be JSON; send it with the header 'Content-Type: application/json'",
            where="Content-Type",
            got=media_type[:80],
            expected="application/json",
        )
    return await read_bytes(request, limit, seconds)


async def read_json_numbers(request: Request, settings: Settings) -> bytes:
    """The body of a JSON request full of numbers.

    Parsing holds the interpreter's lock, and nobody else is answered meanwhile: some 5 ms a megabyte. Plain numbers
    are not parsed.
    """
    try:
        return await read_bytes(request, min(settings.max_body_bytes, settings.max_json_bytes), settings.body_seconds)
    except bc.LimitError as error:
        if error.code != "body_too_large" or error.context["limit"] == settings.max_body_bytes:
            raise
        raise bc.LimitError(
            error.code,
            f"{error.detail} for JSON; send more numbers as application/octet-stream (limit "
            f"{settings.max_body_bytes} bytes), or in several requests",
            **error.context,
        ) from error


async def read_bytes(request: Request, limit: int, seconds: float) -> bytes:
    """The whole body as bytes; a small one, which comes in one piece, is not copied."""

    async def receive() -> list[bytes]:
        return [piece async for piece in pieces(request, limit)]

    received = await in_time(receive(), seconds)
    return received[0] if len(received) == 1 else b"".join(received)


async def read_array(request: Request, limit: int, seconds: float) -> Bytes:
    """The whole body as an array of bytes: received into one buffer if its length was announced."""
    announced = _announced(request)
    if announced is None:
        return np.frombuffer(bytearray(await read_bytes(request, limit, seconds)), np.uint8)
    _check(announced, limit)
    buffer = np.empty(announced, np.uint8)
    view = memoryview(buffer)  # type: ignore[arg-type]  # an array is a buffer; numpy's stubs say so from 3.12

    async def receive() -> int:
        end = 0
        async for piece in pieces(request, limit):
            view[end : end + len(piece)] = piece  # the server sees to it that no more comes than was announced
            end += len(piece)
        return end

    return buffer[: await in_time(receive(), seconds)]


async def in_time(receiving: Awaitable[T], seconds: float) -> T:
    """What `receiving` a body gives, by one timer for all of it; `SlowBodyError` if it takes more than `seconds`."""
    try:
        async with asyncio.timeout(seconds) as deadline:
            return await receiving
    except TimeoutError:
        if not deadline.expired():
            raise
        said = f"the body has not arrived within {seconds:g} seconds"
        raise SlowBodyError("body_too_slow", said, where="body", limit=int(seconds), rest_unread=True) from None


async def pieces(request: Request, limit: int, *, held: bool = True) -> AsyncIterator[bytes]:
    """The body piece by piece.

    held  the caller keeps them: they count among those that the service holds, until the request ends.

    Raises `LimitError` beyond `limit` bytes, `BusyError` if the service holds too many bytes, `MediaTypeError` for a
    body that is compressed.
    """
    encoding = request.headers.get("content-encoding", "identity").strip().lower()
    if encoding not in ("", "identity"):
        said = "the body must not be compressed; send it without Content-Encoding"
        got, where = encoding[:80], "Content-Encoding"
        raise MediaTypeError("encoding_refused", said, where=where, got=got, expected="identity", rest_unread=True)
    _check(_announced(request) or 0, limit)
    room: Room | None = request.scope["brdf"].bodies if held else None
    receive, count, more = request.receive, 0, True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientDisconnect
        piece, more = message.get("body", b""), message.get("more_body", False)
        count += len(piece)
        _check(count, limit)
        if piece:
            if room is not None:
                room.take(request.scope, len(piece))
            yield piece


def _announced(request: Request) -> int | None:
    """Content-Length, if there is one that can be read."""
    text = request.headers.get("content-length", "")
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 20 else None


def _check(got: int, limit: int) -> None:
    if got > limit:
        raise bc.LimitError(
            "body_too_large",
            f"the body has {got} bytes or more; the limit is {limit}",
            where="body",
            got=got,
            limit=limit,
            rest_unread=True,
        )
