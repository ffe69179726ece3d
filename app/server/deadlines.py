"""Deadlines of the server's HTTP protocol: one for receiving a request, one for taking an answer; and bounds on what
a client sends without waiting and on a request's head.

Each connection looks at itself a few times within its shortest deadline: what it awaits, since when, and whether its
client takes what is sent. No request has a timer of its own.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import struct
from collections import deque
from collections.abc import Collection
from http import HTTPStatus
from typing import Any

from brdf_service.settings import Settings

# Private parts of uvicorn that are used here: pipeline, cycle (message_event, disconnected, response_*), flow, parser,
# on_response_complete, send_400_response, _unset_keepalive_if_required; its version has bounds therefore.
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

try:
    import fcntl
    import termios
except ImportError:  # Windows, where the system's own queue can't be seen
    fcntl = termios = None  # type: ignore[assignment]

log = logging.getLogger("brdf.service")

#: Bytes of a request's line and headers, and of what is no body after them (one packet more at most). A URL of evaluate
#: holds a few thousand angles.
MOST_HEAD = 64 * 1024


def protocol(settings: Settings) -> type[HttpToolsProtocol]:
    """The protocol for a server with these settings."""
    seconds = {"head": settings.head_seconds, "rest": settings.body_seconds, "answer": settings.send_seconds}
    return type("Protocol", (_Protocol,), {"seconds": seconds, "period": min(1.0, min(seconds.values()) / 4)})


class _Flow(FlowControl):
    """Reads nothing more while requests wait for their turn. The server's own reads on after each answer, and one
    client that sends without waiting would fill the memory."""

    def __init__(self, transport: asyncio.Transport, waiting: Collection[object]) -> None:
        super().__init__(transport)
        self._waiting = waiting

    def resume_reading(self) -> None:
        if not self._waiting:
            super().resume_reading()


class _Protocol(HttpToolsProtocol):
    seconds: dict[str, float]
    period: float
    #: A head is awaited, or comes; a request has begun and not ended; how many have begun.
    _in_head, _open, _begun = True, False, 0
    _idle_bytes = 0  #: since a head began or a piece of a body came
    _refused = 0  #: status to be said after the answers that are owed
    _unsent = 0
    _awaited: tuple[str, int] | None = None  #: what of which request the client has to send

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)  # type: ignore[arg-type]
        self.flow = _Flow(self.transport, self.pipeline)
        self.unanswered: deque[RequestResponseCycle] = deque()  #: read, and their answers are not out
        self._awaited_since = self._taken_at = self.loop.time()
        self._timer = self.loop.call_later(self.period, self._look)

    def _look(self) -> None:
        self._timer = self.loop.call_later(self.period, self._look)
        now, before, self._unsent = self.loop.time(), self._unsent, _unsent(self.transport)
        if not before or self._unsent < before:
            self._taken_at = now  # slow, perhaps, but there
        if now - self._taken_at >= self.seconds["answer"]:
            log.info("connection closed: nothing of an answer was taken for %g s", self.seconds["answer"])
            self.transport.abort()
            return
        if self.unanswered:
            awaited = None  # what is missing of the next request may lie there unread
        elif self._begun and not self._open:
            awaited = "next", self._begun
        else:
            awaited = "head" if self._in_head else "rest", self._begun
        if awaited != self._awaited:
            self._awaited, self._awaited_since = awaited, now
        elif awaited and now - self._awaited_since >= self.seconds.get(awaited[0], self.timeout_keep_alive):
            self._refuse(408)

    def data_received(self, data: bytes) -> None:
        self._idle_bytes += len(data)  # first, as a head that begins in it sets it to 0: where, nobody tells
        super().data_received(data)
        if self._open and self._idle_bytes > MOST_HEAD:
            self._refuse(431)

    def on_message_begin(self) -> None:
        self._in_head = self._open = True
        self._begun += 1
        self._idle_bytes = 0
        super().on_message_begin()

    def on_header(self, name: bytes, value: bytes) -> None:
        if self._in_head:  # a trailer is of no use to anybody
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        super().on_headers_complete()
        self._in_head = False
        self.unanswered.append(self.cycle)

    def on_body(self, body: bytes) -> None:
        self._idle_bytes = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._open = False
        super().on_message_complete()

    def on_response_complete(self) -> None:
        while self.unanswered and self.unanswered[0].response_complete:
            self.unanswered.popleft()
        super().on_response_complete()
        self._unset_keepalive_if_required()  # ours knows of heads that have begun
        if self._refused:
            self._refuse(self._refused)
        elif not self.transport.is_closing():
            self.flow.resume_reading()  # which has to wait until the last of those that waited has begun

    def send_400_response(self, msg: str) -> None:
        self._refuse(400)

    def _refuse(self, status: int) -> None:
        """Hang up, and say why unless an answer to that request is out; after the answers to those before it."""
        if self.transport.is_closing():
            return
        in_body = self._open and not self._in_head
        first = in_body and len(self.unanswered) == 1 and not self.cycle.response_started
        if self.unanswered and not first:
            self._refused = status
            self.flow.pause_reading()
            return
        phrase = HTTPStatus(status).phrase
        if self._open and status != 400:  # of which the server has told
            log.info("connection closed: %s of a request: %s", "rest" if in_body else "head", phrase)
        if first or (self._open and self._in_head):  # nobody listens who never sent a byte
            head = f"HTTP/1.1 {status} {phrase}\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
            self.transport.write(head.encode())
        self.transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        self._timer.cancel()
        # the server's own tells only the last request that was read
        for cycle in self.unanswered:
            cycle.disconnected = True
            cycle.message_event.set()
        super().connection_lost(exc)
        # requests that still waited lead back here: nothing of a connection may wait for the collector of cycles
        self.unanswered.clear()
        self.pipeline.clear()
        self.cycle = self._timer = None  # type: ignore[assignment]


def _unsent(transport: asyncio.Transport) -> int:
    """Bytes that the client has not taken yet: those that wait here, and those in the system's queue, which may hold
    megabytes and takes more only when a third of it is free."""
    waiting = transport.get_write_buffer_size()
    socket: Any = transport.get_extra_info("socket") if waiting else None
    if socket is not None and fcntl is not None:
        with contextlib.suppress(OSError, ValueError):  # closed, or a system that does not tell
            waiting += struct.unpack("i", fcntl.ioctl(socket.fileno(), termios.TIOCOUTQ, bytes(4)))[0]
    return waiting
