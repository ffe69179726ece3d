"""Write a file whole or not at all: a temporary file in the same folder, flushed, then renamed."""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
from collections.abc import Iterator
from pathlib import Path

from brdfcore.base.errors import StorageError


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that replaces it, durably, when the block ends without an error.

    A process killed at any moment leaves the old file or the new one, and perhaps a hidden temporary file that
    the next call for the same name removes. `OSError` becomes `StorageError`.
    """
    try:
        _remove_leftovers(path)
        temporary = path.with_name(f".{path.name}.{_host()}.{os.getpid()}.{secrets.token_hex(4)}.tmp")
        try:
            yield temporary
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
        if os.name == "posix":  # the rename itself has to reach the disk
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except OSError as error:
        if isinstance(error, StorageError):
            raise
        reason = error.strerror or str(error)
        raise StorageError(
            "cannot_write", f"{path}: cannot be written: {reason}", where=str(path), got=reason
        ) from error


def _host() -> str:
    return "".join(c for c in socket.gethostname() if c.isalnum() or c == "-")[:32] or "host"


def _remove_leftovers(path: Path) -> None:
    """Remove temporary files for `path` of processes of this host that are gone."""
    for leftover in path.parent.glob(f".{path.name}.{_host()}.*.tmp"):
        number = leftover.name.removeprefix(f".{path.name}.{_host()}.").split(".")[0]
        if number.isdigit() and not _alive(int(number)):
            leftover.unlink(missing_ok=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
