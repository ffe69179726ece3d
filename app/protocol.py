"""The server's HTTP protocol with what it leaves out: limits of time and size for a request's head."""

from __future__ import annotations

import asyncio
import logging

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

log = logging.getLogger("brdf.service")

#: Bytes of a request's line and headers. A URL of evaluate holds a few thousand angles.
MOST_HEAD = 64 * 1024
_REFUSALS = {
    408: b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
    431: b"HTTP/1.1 431 Request Header Fields Too Large\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
}


def protocol(head_seconds: float) -> type[HttpToolsProtocol]:
    """The protocol for a server that gives a request's head so many seconds to arrive."""
    return type("Protocol", (_Protocol,), {"head_seconds": head_seconds})


class _Protocol(HttpToolsProtocol):
    head_seconds: float
    #: Runs while a head is awaited: from the connection's begin for the first, from its first byte for each other.
    _clock: asyncio.TimerHandle | None = None
    _in_head = True
    _head_bytes = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)  # type: ignore[arg-type]
        self._start_clock()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self._in_head:
            self._head_bytes += len(data)
            if self._head_bytes > MOST_HEAD:
                self._refuse(431)
            elif self._clock is None and not self.transport.is_closing():
                self._start_clock()
        elif self._clock is not None:
            self._stop_clock()

    def on_message_begin(self) -> None:
        self._in_head, self._head_bytes = True, 0
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        self._in_head = False
        super().on_headers_complete()
        # for `direct.writer`
        self.scope["brdf.cycle"] = self.cycle  # type: ignore[typeddict-unknown-key]

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
        log.info("connection closed: the head of a request was too %s", "slow" if status == 408 else "long")
        # nobody listens who never sent a byte; and into an answer that is under way no other one is written
        if self._head_bytes and (self.cycle is None or self.cycle.response_complete):
            self.transport.write(_REFUSALS[status])
        self.transport.close()
