"""The request log: one line of JSON for each request. Lines are made and written a few at a time, as a system call
for each would cost a third of a look-up."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from functools import lru_cache

from brdf_service.http.metrics import METHODS

#: Seconds that a line may wait, and lines that wait at most.
_WAIT, _MOST = 0.05, 200


class RequestLog:
    """Takes requests in the event loop; `flush` writes what waits."""

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._ended: list[tuple[float, str, str, str, int, float, int]] = []

    def request(self, request_id: str, method: str, route: str, status: int, seconds: float, sent: int) -> None:
        """One request ended. Its line holds nothing that the caller wrote, a request id of safe characters aside."""
        self._ended.append((time.time(), request_id, method, route, status, seconds, sent))
        if len(self._ended) == 1:
            asyncio.get_running_loop().call_later(_WAIT, self.flush)
        elif len(self._ended) >= _MOST:
            self.flush()

    def flush(self) -> None:
        """Write the lines that wait."""
        text = "".join(
            f'{{"time":"{_second(int(now))}.{int(now * 1000) % 1000:03d}Z","id":"{request_id}",'
            f'"method":"{method if method in METHODS else "other"}","route":"{route}","status":{status},'
            f'"ms":{1000 * seconds:.3f},"bytes":{sent}}}\n'
            for now, request_id, method, route, status, seconds, sent in self._ended
        )
        self._ended.clear()
        # where nobody reads the log any more, the service goes on without
        with contextlib.suppress(OSError, ValueError):
            if text:
                self._write(text)


@lru_cache(maxsize=4)
def _second(now: int) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now))
