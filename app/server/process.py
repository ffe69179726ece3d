"""The server process: its socket, its one line on the terminal, its logs, and how it ends."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from importlib.util import find_spec
from types import FrameType
from typing import Any

import uvicorn
from brdf_service.settings import Settings
from brdf_service.state import State
from starlette.types import ASGIApp

import brdfcore as bc

#: Seconds after the drain in which everything has to end.
_LAST_SECONDS = 1.0
#: Number of the parameter in glibc's malloc.h.
_M_ARENA_MAX = -8
_HINTS = {
    errno.EADDRINUSE: "the port is in use; stop the other program, or choose another with --port (0: any free one)",
    errno.EACCES: "not allowed; ports below 1024 belong to the administrator, choose another with --port",
    errno.EADDRNOTAVAIL: "no address of this machine; choose another with --host",
}


class ListenError(bc.StorageError):
    """The address cannot be listened on; the message says which and what to do."""


def bind(settings: Settings) -> socket.socket:
    """A bound socket, not listening yet: a port in use is noticed before any work is done.

    Raises `ListenError`.
    """
    try:
        found = socket.getaddrinfo(settings.host.strip("[]"), settings.port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise _refused(settings, "no such host; --host takes an address of this machine") from error
    # localhost may mean ::1 first; what is printed must work in every client, so IPv4 goes before
    family, _, _, _, address = min(found, key=lambda f: f[0] != socket.AF_INET)
    # with its protocol spelt out: asyncio turns Nagle's delay (40 ms an answer) off only where it reads TCP there
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if sys.platform != "win32":  # there it would let two processes share a port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
    except OSError as error:
        listener.close()
        raise _refused(settings, error) from error
    return listener


def _refused(settings: Settings, why: str | OSError) -> ListenError:
    if isinstance(why, OSError):
        why = _HINTS.get(why.errno or 0, why.strerror or str(why))
    place = f"{settings.host}:{settings.port}"
    return ListenError("cannot_listen", f"cannot listen on {place}: {why}", where=place)


def address_of(listener: socket.socket) -> str:
    """URL of a bound socket, with the port that port 0 became."""
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def start_logging(level: str) -> None:
    """Logs go to stderr, one line each; stdout keeps the one line that says where the service listens."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    for name in ("brdf", "uvicorn"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(level.upper())
    # what the server says of its own start and end is said better by our line
    logging.getLogger("uvicorn.error").setLevel("DEBUG" if level == "debug" else "WARNING")


def _leave(state: State) -> None:
    """End the process now, and its children before it."""
    logging.getLogger("brdf.service").warning("ended while work was running: the drain is over")
    for end in (state.jobs.kill, state.drawing.kill):
        end()
    logging.shutdown()
    sys.stdout.flush()
    os._exit(0)


class _Server(uvicorn.Server):
    """Says where it listens once it does, and returns after SIGTERM instead of dying of it."""

    def __init__(self, config: uvicorn.Config, state: State, listening: str) -> None:
        super().__init__(config)
        self._state, self._listening = state, listening

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self._state.draining = True
        super().handle_exit(sig, frame)
        # what cannot be stopped, a kernel or a reader, does not keep the process: every file is whole at any moment
        last = threading.Timer(self._state.settings.drain_seconds + _LAST_SECONDS, _leave, (self._state,))
        last.daemon = True
        last.start()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            print(self._listening, flush=True)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        # as the base class, which afterwards raises the signal again: a drained service has ended well
        before = {s: signal.signal(s, self.handle_exit) for s in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def server_options(settings: Settings) -> dict[str, Any]:
    """Options of the server that change how it speaks: our protocol, where its parser is installed. The application
    reads a proxy's headers itself, where it needs them."""
    options: dict[str, Any] = {"ws": "none", "proxy_headers": False}
    if find_spec("httptools") is not None:
        from brdf_service.server.deadlines import protocol

        options["http"] = protocol(settings)
    return options


def run(app: ASGIApp, state: State, listener: socket.socket) -> None:
    """Serve until SIGINT or SIGTERM; running requests get `drain_seconds` to finish. Raises `ListenError`."""
    settings = state.settings
    config = uvicorn.Config(
        app,
        **server_options(settings),
        log_config=None,
        log_level=None,
        access_log=False,  # the middleware writes a line for each request
        server_header=False,
        lifespan="on",
        timeout_graceful_shutdown=settings.drain_seconds,
    )
    # two heaps of glibc's instead of eight a core: what one thread frees in its own no other can use, and the process
    # grows by tens of megabytes that nothing holds
    with contextlib.suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 2)
    # a thread that computes gives way to the event loop after a millisecond, not after five
    sys.setswitchinterval(0.001)
    how = "writing takes the key" if settings.writable else "read-only"
    reach = "only this machine can reach it" if settings.loopback else f"reachable from other machines, {how}"
    listening = f"listening on {address_of(listener)} ({reach}); data: {settings.data}; stop with Ctrl-C"
    try:
        _Server(config, state, listening).run(sockets=[listener])
    except OSError as error:  # another process began to listen between our bind and our listen
        raise _refused(settings, error) from error
