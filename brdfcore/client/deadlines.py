"""A deadline for every read of a blocking client.

httpx2 gives each read its own time: a head that comes byte by byte would never end. Its streams are wrapped, as it has
no place of its own for that; where a version of it keeps them elsewhere, its own times hold alone.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator
from time import monotonic
from typing import Any

import httpx2

_now = threading.local()


@contextlib.contextmanager
def within(seconds: float) -> Iterator[None]:
    """All reads of this thread in the block end, with `httpx2.ReadTimeout`, so many seconds from now."""
    _now.deadline = monotonic() + seconds
    try:
        yield
    finally:
        _now.deadline = math.inf


def watch(client: httpx2.Client) -> None:
    """Hold the reads of a client to `within`."""
    for transport in (client._transport, *client._mounts.values()):
        pool: Any = getattr(transport, "_pool", None)
        if hasattr(pool, "_network_backend"):
            pool._network_backend = _Backend(pool._network_backend)


class _Wrapped:
    def __init__(self, inner: Any) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


class _Backend(_Wrapped):
    def connect_tcp(self, *args: Any, **options: Any) -> Any:
        return _Stream(self._inner.connect_tcp(*args, **options))


class _Stream(_Wrapped):
    def read(self, max_bytes: int, timeout: float | None = None) -> Any:
        left = getattr(_now, "deadline", math.inf) - monotonic()
        seconds = min(math.inf if timeout is None else timeout, max(left, 0.001))
        return self._inner.read(max_bytes, timeout=None if seconds == math.inf else seconds)

    def start_tls(self, *args: Any, **options: Any) -> Any:
        return _Stream(self._inner.start_tls(*args, **options))
