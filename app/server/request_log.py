"""The log of requests: lines are written a few at a time, as a system call for each would cost a third of a look-up."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

#: Seconds that a line may wait, and lines that wait at most.
_WAIT, _MOST = 0.05, 200


class AccessLog:
    """Takes lines in the event loop; `flush` writes what waits."""

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._lines: list[str] = []

    def __call__(self, line: str) -> None:
        self._lines.append(line)
        if len(self._lines) == 1:
            asyncio.get_running_loop().call_later(_WAIT, self.flush)
        elif len(self._lines) >= _MOST:
            self.flush()

    def flush(self) -> None:
        """Write the lines that wait."""
        if self._lines:
            text = "".join(self._lines)
            self._lines.clear()
            # where nobody reads the log any more, the service goes on without
            with contextlib.suppress(OSError, ValueError):
                self._write(text)
