"""A bar on a terminal, and nothing anywhere else: a log is no place for bars."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

#: Called as progress(done, total, stage), like that of `tabulate`.
Progress = Callable[[int, int, str], None]

_WIDTH = 30
_REDRAW_SECONDS = 0.1


@contextmanager
def reporting(wanted: Progress | bool, stream: TextIO | None = None) -> Iterator[Progress]:
    """What to call as work goes on: the caller's own function; for True a bar on stderr if that is a terminal; for
    False, or without a terminal, nothing. The bar is wiped at the end."""
    stream = sys.stderr if stream is None else stream
    if callable(wanted):
        yield wanted
    elif wanted and stream is not None and stream.isatty():
        drawn = 0.0

        def draw(done: int, total: int, stage: str) -> None:
            nonlocal drawn
            now = time.monotonic()
            if now - drawn < _REDRAW_SECONDS and done < total:
                return
            drawn = now
            filled = _WIDTH * done // total if total else 0
            bar = "#" * filled + "-" * (_WIDTH - filled)
            # a stage may be a service's words: no control sequence of a stranger's reaches the terminal
            shown = "".join(c for c in stage[:40] if c.isprintable())
            stream.write(f"\r\x1b[K{shown} [{bar}] {done}/{total}")
            stream.flush()

        try:
            yield draw
        finally:
            stream.write("\r\x1b[K")
            stream.flush()
    else:
        yield lambda done, total, stage: None
