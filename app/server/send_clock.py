"""Cuts off clients that take nothing of what is sent to them: they would keep memory, a connection, and a service that
is told to end."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import struct

try:
    import fcntl
    import termios
except ImportError:  # Windows, where the system's own queue can't be seen
    fcntl = termios = None  # type: ignore[assignment]

log = logging.getLogger("brdf.service")


class SendClock:
    """Of one connection. Once told to watch it runs until all is sent, or nothing was taken for `seconds`."""

    def __init__(self, loop: asyncio.AbstractEventLoop, transport: asyncio.Transport, seconds: float) -> None:
        self._loop, self._transport, self._seconds = loop, transport, seconds
        self._timer: asyncio.TimerHandle | None = None
        self._left = 0

    def watch(self) -> None:
        """Begin, if something waits to be sent."""
        if self._timer is None and self._transport.get_write_buffer_size():
            self._left = left(self._transport)
            self._timer = self._loop.call_later(self._seconds, self._look)

    def stop(self) -> None:
        """The connection is gone."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        self._timer = None
        if not self._transport.get_write_buffer_size():
            return
        if left(self._transport) < self._left:
            self.watch()  # slow, but there
        else:
            log.info("connection closed: nothing of an answer was taken for %g s", self._seconds)
            self._transport.abort()


def left(transport: asyncio.Transport) -> int:
    """Bytes that the client has not taken yet: those that wait here, and those in the system's queue, which may hold
    megabytes and takes more only when a third of it is free."""
    waiting = transport.get_write_buffer_size()
    socket = transport.get_extra_info("socket")
    if socket is not None and fcntl is not None:
        with contextlib.suppress(OSError, ValueError):  # closed, or a system that does not tell
            waiting += struct.unpack("i", fcntl.ioctl(socket.fileno(), termios.TIOCOUTQ, bytes(4)))[0]
    return waiting
