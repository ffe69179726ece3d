"""The server's HTTP protocol with what it leaves out: limits of time and size for those who send slowly or take
nothing, and answers that need no task of their own."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Collection

from brdf_service.server.outbox import Outbox
from brdf_service.server.send_clock import SendClock
from brdf_service.settings import Settings
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

log = logging.getLogger("brdf.service")

#: Bytes of a request's line and headers, and of what is no body after them. A URL of evaluate holds a few thousand
#: angles.
MOST_HEAD = 64 * 1024
_REFUSALS = {
    408: b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
    431: b"HTTP/1.1 431 Request Header Fields Too Large\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
}


#: URL, headers and the server's own header lines of a GET -> the whole answer, or None.
Quick = Callable[[bytes, list[tuple[bytes, bytes]], bytes], bytes | None]


def protocol(settings: Settings, quick: Quick) -> type[HttpToolsProtocol]:
    """The protocol for a server with these settings, which asks `quick` before it starts the application for a GET."""
    own = {
        "head_seconds": settings.head_seconds,
        "body_seconds": settings.body_seconds,
        "send_seconds": settings.send_seconds,
        "quick": staticmethod(quick),
        "outbox": Outbox(),
    }
    return type("Protocol", (_Protocol,), own)


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
    head_seconds: float
    body_seconds: float
    send_seconds: float
    quick: Quick
    outbox: Outbox
    send_clock: SendClock
    #: Runs while a head is awaited: from the connection's begin for the first, from its first packet for each. And
    #: while the rest of a body comes whose answer is out.
    _clock: asyncio.TimerHandle | None = None
    _in_head = True
    #: True from a request's end, however it was answered, to the begin of the next.
    _ended = True
    #: True if the packet that is being read begins a head, or holds some of a body.
    _new_head = _new_body = False
    #: Bytes since then: of a head, of trailers, of what a client may write beside the pieces of a body.
    _idle_bytes = 0
    #: True from the end of a head that was answered at once to the end of its request.
    _answered = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)  # type: ignore[arg-type]
        self.flow = _Flow(self.transport, self.pipeline)
        self.send_clock = SendClock(self.loop, self.transport, self.send_seconds)
        #: Requests read whose answers are not out, but for those answered at once.
        self._unanswered: deque[RequestResponseCycle] = deque()
        self._start_clock(self.head_seconds)

    def data_received(self, data: bytes) -> None:
        self._new_head = self._new_body = False
        super().data_received(data)
        if self._ended and self._clock is None and self.timeout_keep_alive_task is not None:
            return  # all is answered already
        if not (self._ended or self._new_head or self._new_body):
            # where in its first packet a head begins, the parser does not tell: it is one packet too long at most
            self._idle_bytes += len(data)
            if self._idle_bytes > MOST_HEAD:
                self._refuse(431)
        self._wait()

    def _wait(self) -> None:
        """Let the clock run that belongs to what is awaited now."""
        if self.transport.is_closing():
            self._stop_clock()
        elif self._in_head:
            self._unset_keepalive_if_required()
            if self._new_head or self._clock is None:
                self._start_clock(self.head_seconds)
        elif self._owes():
            self._stop_clock()
        elif not self._ended:
            self._unset_keepalive_if_required()
            if self._clock is None:
                self._start_clock(self.body_seconds)
        else:
            self._stop_clock()
            if self.timeout_keep_alive_task is None:  # nothing but an empty line came
                self.timeout_keep_alive_task = self.loop.call_later(
                    self.timeout_keep_alive, self.timeout_keep_alive_handler
                )

    def _owes(self) -> bool:
        """True if a request was read whose answer is not out."""
        return bool(self._unanswered)

    def on_message_begin(self) -> None:
        self._in_head = self._new_head = True
        self._ended = False
        self._idle_bytes = 0
        self._unset_keepalive_if_required()  # from here on the head's own clock runs
        super().on_message_begin()

    def on_header(self, name: bytes, value: bytes) -> None:
        if self._in_head:  # a trailer is of no use to anybody
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        self._in_head = False
        self._answered = self._answer_at_once()
        if not self._answered:
            before = self.cycle
            super().on_headers_complete()
            if self.cycle is not before:
                self._unanswered.append(self.cycle)

    def on_body(self, body: bytes) -> None:
        self._new_body = True
        self._idle_bytes = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._ended = True
        if self._answered:
            self._answered = False
        else:
            super().on_message_complete()

    def _answer_at_once(self) -> bool:
        """Answer the request whose head is complete, if that needs no application: the answers before it are out, the
        client reads what is sent, and wants the connection kept."""
        parser = self.parser
        if (
            self._owes()
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
        super().on_response_complete()  # counts it, and lets the connection wait for the next
        return True

    def on_response_complete(self) -> None:
        while self._unanswered and self._unanswered[0].response_complete:
            self._unanswered.popleft()
        super().on_response_complete()
        self.send_clock.watch()
        if not self.transport.is_closing():
            self.flow.resume_reading()  # which has to wait until the last of those that waited has begun
            self._new_head = False
            self._wait()

    def timeout_keep_alive_handler(self) -> None:
        super().timeout_keep_alive_handler()
        self.send_clock.watch()  # a transport that is closed waits for ever for what is left

    # what is sent or closed without the application comes after the answers that wait

    def send_400_response(self, msg: str) -> None:
        self.outbox.send()
        in_body = self._owes() and not self.pipeline and self.cycle.more_body and not self.cycle.response_started
        if self._owes() and not in_body:
            self.transport.close()  # the client would take this answer for that of another request
        else:
            super().send_400_response(msg)
        self.send_clock.watch()

    def eof_received(self) -> None:
        self.outbox.send()
        super().eof_received()

    def shutdown(self) -> None:
        self.outbox.send()
        super().shutdown()
        self.send_clock.watch()

    def pause_writing(self) -> None:
        super().pause_writing()
        self.send_clock.watch()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_clock()
        self.send_clock.stop()
        # the server's own tells only the last request that was read
        for cycle in self._unanswered:
            cycle.disconnected = True
            cycle.message_event.set()
        self._unanswered.clear()
        super().connection_lost(exc)
        self._unset_keepalive_if_required()
        # requests that still waited lead back here: nothing of a connection may wait for the collector of cycles
        self.pipeline.clear()
        self.cycle = None  # type: ignore[assignment]

    def _start_clock(self, seconds: float) -> None:
        self._stop_clock()
        self._clock = self.loop.call_later(seconds, self._refuse, 408)

    def _stop_clock(self) -> None:
        if self._clock is not None:
            self._clock.cancel()
            self._clock = None

    def _refuse(self, status: int) -> None:
        self._stop_clock()
        if self.transport.is_closing():
            return
        if status == 408 and self._owes():
            # those before it come first, and what is missing may lie there, unread until then
            self._start_clock(self.head_seconds)
            return
        self.outbox.send()
        what = "head" if self._in_head else "rest"
        log.info("connection closed: the %s of a request was too %s", what, "slow" if status == 408 else "long")
        # nobody listens who never sent a byte; and into an answer that is under way, or after it, no other is written
        if self._in_head and not self._ended and not self._owes():
            self.transport.write(_REFUSALS[status])
        self.transport.close()
        self.send_clock.watch()


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
