"""A whole small answer in one piece: the server's `send` looks at each header of each answer with two regular
expressions, which costs as much as a look-up. For answers whose headers are made here, of digits and our own words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def writer(scope: Any) -> Callable[[bytes], None] | None:
    """A function that sends a whole answer, status line and all, in one piece; None where the server is another one, or
    the usual way is needed: for HEAD, and while the client reads slowly."""
    cycle = scope.get("brdf.cycle")
    if cycle is None or cycle.scope is not scope or cycle.response_started or cycle.disconnected:
        return None
    if cycle.flow.write_paused or not cycle.keep_alive:
        return None

    def write(answer: bytes) -> None:
        # what the server's own `send` does for the two messages
        cycle.response_started = cycle.response_complete = True
        cycle.waiting_for_100_continue = False
        cycle.transport.write(answer)
        cycle.message_event.set()
        cycle.on_response()

    return write


def date_line(scope: Any) -> bytes:
    """The server's own headers, as lines."""
    return b"".join([b"%b: %b\r\n" % header for header in scope["brdf.cycle"].default_headers])
