"""The request log: one line of JSON for each request. Lines are written a few at a time, as a system call for each
would cost a third of a look-up."""

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
        self._lines: list[str] = []

    def request(self, request_id: str, method: str, route: str, status: int, seconds: float, sent: int) -> None:
        """One request ended. Its line holds nothing that the caller wrote, a request id of safe characters aside."""
        now = time.time()
        self._lines.append(
            f'{{"time":"{_second(int(now))}.{int(now * 1000) % 1000:03d}Z","id":"{request_id}",'
            f'"method":"{method if method in METHODS else "other"}","route":"{route}","status":{status},'
            f'"ms":{1000 * seconds:.3f},"bytes":{sent}}}\n'
        )
        if len(self._lines) == 1:
            asyncio.get_running_loop().call_later(_WAIT, self.flush)
        elif len(self._lines) >= _MOST:
            self.flush()

    def flush(self) -> None:
        """Write the lines that wait."""
        text = "".join(self._lines)
        self._lines.clear()
        # where nobody reads the log any more, the service goes on without
        with contextlib.suppress(OSError, ValueError):
            if text:
                self._write(text)


@lru_cache(maxsize=4)
def _second(now: int) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now))
