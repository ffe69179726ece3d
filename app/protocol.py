"""The server's HTTP protocol with what it leaves out: limits of time and size for a request's head, and answers that
need no task of their own."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from app.outbox import Outbox

log = logging.getLogger("brdf.service")

#: Bytes of a request's line and headers. A URL of evaluate holds a few thousand angles.
MOST_HEAD = 64 * 1024
_REFUSALS = {
    408: b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
    431: b"HTTP/1.1 431 Request Header Fields Too Large\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
}


#: URL, headers and the server's own header lines of a GET -> the whole answer, or None.
Quick = Callable[[bytes, list[tuple[bytes, bytes]], bytes], bytes | None]


def protocol(head_seconds: float, quick: Quick) -> type[HttpToolsProtocol]:
    """The protocol for a server that gives a request's head so many seconds to arrive, and asks `quick` before it
    starts the application for a GET."""
    own = {"head_seconds": head_seconds, "quick": staticmethod(quick), "outbox": Outbox()}
    return type("Protocol", (_Protocol,), own)


class _Protocol(HttpToolsProtocol):
    head_seconds: float
    quick: Quick
    outbox: Outbox
    #: Runs while a head is awaited: from the connection's begin for the first, from its first byte for each other.
    _clock: asyncio.TimerHandle | None = None
    _in_head = True
    _head_bytes = 0
    #: True if that head began in the packet that is being read, after others perhaps.
    _new_head = False
    #: True from the end of a head that was answered at once to the end of its request.
    _answered = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)  # type: ignore[arg-type]
        self._start_clock()

    def data_received(self, data: bytes) -> None:
        self._new_head = False
        super().data_received(data)
        if self._in_head:
            # where in its first packet a head begins, the parser does not tell: it is one packet too long at most
            self._head_bytes += 1 if self._new_head else len(data)
            if self._head_bytes > MOST_HEAD:
                self._refuse(431)
            elif self._clock is None and not self.transport.is_closing():
                self._start_clock()
        elif self._clock is not None:
            self._stop_clock()

    def on_message_begin(self) -> None:
        self._in_head = self._new_head = True
        self._head_bytes = 0
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        self._in_head = False
        self._answered = self._answer_at_once()
        if not self._answered:
            self._unset_keepalive_if_required()  # which an answer before it in the same packet has begun to count
            super().on_headers_complete()

    def on_message_complete(self) -> None:
        if self._answered:
            self._answered = False
        else:
            super().on_message_complete()

    def _answer_at_once(self) -> bool:
        """Answer the request whose head is complete, if that needs no application: the answers before it are out, the
        client reads what is sent, and wants the connection kept."""
        parser = self.parser
        if (
            (self.cycle is not None and not self.cycle.response_complete)
            or self.flow.write_paused
            or self.transport.is_closing()
            or parser.get_method() != b"GET"
            or parser.get_http_version() != "1.1"
            or not parser.should_keep_alive()
            or self.outbox.holds(self.transport)  # one that does not wait for answers takes its turn with the others
        ):
            return False
        answer = self.quick(self.url, self.headers, _lines(self.server_state.default_headers))
        if answer is None:
            return False
        self.outbox.put(self.loop, self.transport, answer)
        self.on_response_complete()  # counts it, and lets the connection wait for the next
        return True

    # what is sent or closed without the application comes after the answers that wait

    def send_400_response(self, msg: str) -> None:
        self.outbox.send()
        super().send_400_response(msg)

    def eof_received(self) -> None:
        self.outbox.send()
        super().eof_received()

    def shutdown(self) -> None:
        self.outbox.send()
        super().shutdown()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_clock()
        super().connection_lost(exc)

    def _start_clock(self) -> None:
        self._clock = self.loop.call_later(self.head_seconds, self._refuse, 408)

    def _stop_clock(self) -> None:
        if self._clock is not None:
            self._clock.cancel()
            self._clock = None

    def _refuse(self, status: int) -> None:
        self._stop_clock()
        if self.transport.is_closing():
            return
        if status == 408 and self.flow.read_paused:  # what is missing may lie there since, unread until others are done
            self._start_clock()
            return
        self.outbox.send()
        log.info("connection closed: the head of a request was too %s", "slow" if status == 408 else "long")
        # nobody listens who never sent a byte; and into an answer that is under way no other one is written
        if self._head_bytes and (self.cycle is None or self.cycle.response_complete):
            self.transport.write(_REFUSALS[status])
        self.transport.close()


class _Lines:
    """The server's own headers as lines of HTTP. The list is another one every second, when its Date changes."""

    def __init__(self) -> None:
        self._made_from: list[tuple[bytes, bytes]] = []
        self._lines = b""

    def __call__(self, headers: list[tuple[bytes, bytes]]) -> bytes:
        if headers is not self._made_from:
            self._made_from, self._lines = headers, b"".join([b"%b: %b\r\n" % header for header in headers])
        return self._lines


_lines = _Lines()
