"""Faults of a file system: the n-th call of the system that changes a file fails, as where a disk is full or broken."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

#: Calls that change files, by their names in `os`, and how each may fail.
CALLS = ("open", "write", "fsync", "replace", "mkdir")
ERRORS = (errno.ENOSPC, errno.EIO)


class Faults:
    """Counts the calls, and lets the one with number `at` fail with `error`."""

    def __init__(self, at: int = -1, error: int = errno.EIO) -> None:
        self.at, self.error, self.calls = at, error, list[str]()

    def wrapped(self, name: str, real: Callable[..., Any], under: Path) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            if name == "open" and not (args[1] & os.O_CREAT and Path(args[0]).is_relative_to(under)):
                return real(*args, **options)
            self.calls.append(name)
            if len(self.calls) - 1 == self.at:
                if name == "write":  # a disk that fills up takes a part first
                    real(args[0], args[1][: len(args[1]) // 2])
                raise OSError(self.error, os.strerror(self.error))
            return real(*args, **options)

        return call


@contextmanager
def faults(under: Path, at: int = -1, error: int = errno.EIO) -> Iterator[Faults]:
    """Within the block the `at`-th call fails; of `open` only those that make files in `under` count."""
    made = Faults(at, error)
    real = {name: getattr(os, name) for name in CALLS}
    try:
        for name, call in real.items():
            setattr(os, name, made.wrapped(name, call, under))
        yield made
    finally:
        for name, call in real.items():
            setattr(os, name, call)
