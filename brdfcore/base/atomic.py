"""Write a file whole or not at all: bytes that are complete are written beside it, flushed, read back, then renamed."""

from __future__ import annotations

import contextlib
import math
import os
import secrets
import shutil
import socket
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, overload

from brdfcore.base.errors import FileFormatError, LimitError, StorageError

T = TypeVar("T")
Content = bytes | bytearray | memoryview

#: Bytes handed to the system at a time.
_PIECE = 2**24


@overload
def write_file(path: Path, content: Content, check: None = None) -> None: ...
@overload
def write_file(path: Path, content: Content, check: Callable[[Path], T]) -> T: ...
def write_file(path: Path, content: Content, check: Callable[[Path], T] | None = None) -> T | None:
    """Replace `path` by `content`, durably, and return what `check` made of the file before it took its place.

    check  reads the finished file, which has the final name in a hidden folder beside `path`; what it raises leaves
           the old file as it was.

    A process killed at any moment leaves the old file or the new one, and perhaps that folder, which the next call for
    the same name on this machine removes. A write, flush or rename that fails leaves the old file. If the last step
    fails, the flush of the folder, the new file stands there whole, and the error says that it may not last.

    Raises `StorageError`; `LimitError` or `FileFormatError` where the reader refuses what was written.
    """
    refuse_special(path)
    temporary = path.with_name(f".{path.name}.{host()}.{os.getpid()}.{secrets.token_hex(4)}.tmp")
    try:
        remove_leftovers(path.parent, f".{path.name}.")
        os.mkdir(temporary)
        try:
            write_plain(temporary / path.name, content)
            made = None if check is None else _checked(path, temporary / path.name, check)
            os.replace(temporary / path.name, path)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        if isinstance(error, StorageError):
            raise
        raise cannot_write(path, error) from error
    try:
        flush_folder(path.parent)
    except OSError as error:
        reason = error.strerror or str(error)
        said = f"{path}: is written whole, but may not outlast a failure of power, as its folder can't be flushed: "
        raise StorageError("not_flushed", said + reason, where=str(path), got=reason) from error
    return made


def write_plain(path: Path, content: Content) -> None:
    """A new file that holds `content` and has reached the disk. Raises `OSError`."""
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0), 0o666)
    try:
        rest = memoryview(content).cast("B")
        while rest:
            rest = rest[os.write(number, rest[:_PIECE]) :]
        os.fsync(number)
    finally:
        os.close(number)


def flush_folder(folder: Path) -> None:
    """See to it that renames and removals in a folder have reached the disk. Raises `OSError`."""
    if os.name == "posix":
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def refuse_special(path: Path) -> None:
    """`StorageError` for a folder, and for a device or FIFO, which a rename would turn into a regular file."""
    try:
        mode = path.stat().st_mode
    except OSError:  # there is none, or the write will say what is wrong with it
        return
    if not stat.S_ISREG(mode):
        what = "is a folder; name a file in it" if stat.S_ISDIR(mode) else "is no regular file; name another"
        raise StorageError("cannot_write", f"{path}: {what}", where=str(path))


def cannot_write(path: Path, error: OSError) -> StorageError:
    """The error for a file that can't be written."""
    reason = error.strerror or str(error)
    return StorageError("cannot_write", f"{path}: cannot be written: {reason}", where=str(path), got=reason)


def remove_leftovers(folder: Path, prefix: str, *, own: bool = False, seconds: float = math.inf) -> None:
    """Remove unfinished files, named PREFIX*HOST.PID.*.tmp, of processes of this machine that are gone.

    own      those of this process's number too: it has none yet, an earlier process of that number had them.
    seconds  those of any machine that are older.
    """
    with os.scandir(folder) as entries:
        found = [e.name for e in entries if e.name.startswith(prefix) and e.name.endswith(".tmp")]
    for name in found:
        path = folder / name
        where, number, _ = ["", "", *name.removesuffix(".tmp").split(".")][-3:]
        gone = where == host() and number.isdigit() and ((own and int(number) == os.getpid()) or not alive(int(number)))
        if gone or (seconds < math.inf and path.lstat().st_mtime < time.time() - seconds):
            shutil.rmtree(path, ignore_errors=True)
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


def alive(pid: int) -> bool:
    """Whether a process of this machine is there."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _checked(path: Path, temporary: Path, check: Callable[[Path], T]) -> T:
    try:
        return check(temporary)
    except (FileFormatError, LimitError) as error:
        said = f"{path}: not written, as it could not be read again: {error.detail}"
        raise type(error)(error.code, said, **{**error.context, "where": str(path)}) from error
    except StorageError as error:
        raise StorageError(error.code, error.detail.replace(str(temporary), str(path)), **error.context) from error


def host() -> str:
    """This machine, in letters, digits and hyphens."""
    return "".join(c for c in socket.gethostname() if c.isalnum() or c == "-")[:32] or "host"
