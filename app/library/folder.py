"""A folder as the store: NAME.h5 tables and NAME.json models. Nothing else of the service looks at its files.

A leading dot marks what no list shows: files that are not finished, the lock, and the records of jobs.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from brdf_service.http.errors import MaterialDamagedError
from brdf_service.library.index import Index
from brdf_service.library.store import NAME, SUFFIXES, ChangedError, File, Kind, Names, Store

import brdfcore as bc

try:
    import fcntl
except ImportError:  # not POSIX: one process a data folder then
    fcntl = None  # type: ignore[assignment]

#: Seconds for which records of jobs are kept, and for which an unfinished file may belong to another machine's process.
RECORDS_KEPT, UNFINISHED_KEPT = 3600.0, 86400.0
_NEW = ".new-"


class Folder(Store):
    """`StorageError` where the folder itself cannot be read or written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._prefix = f"{path}{os.sep}"  # every request comes here: pathlib would cost more than stat
        self._writing = threading.Lock()
        self._index = Index(path)
        self._records = path / ".jobs"

    # ---- reading --------------------------------------------------------------------------------------

    def names(self) -> Names:
        try:
            return self._index.names()
        except OSError as error:
            raise _cannot("read", error) from error

    def close_to(self, name: str) -> list[str]:
        return self._index.close_to(name)

    def version(self, name: str) -> list[File] | None:
        found = [f for suffix, kind in SUFFIXES.items() if (f := _file(f"{self._prefix}{name}{suffix}", kind))]
        return found or None

    def find(self, name: str) -> File | None:
        if not NAME.fullmatch(name):
            return None
        found = self.version(name)
        if not found or len(found) == 1:
            return found[0] if found else None
        # a change of kind may have been cut off after the new file was in place
        with contextlib.suppress(OSError, StopIteration):
            chosen = f"{self._prefix}{name}{self._choice(name).read_text(encoding='ascii')}"
            return next(file for file in found if file.path == chosen)
        text = f"{name}: both {name}.h5 and {name}.json are in the data folder; remove or rename one"
        raise MaterialDamagedError("material_ambiguous", text, where="name", got=name)

    def stamp(self, file: str) -> tuple[int, ...]:
        with contextlib.suppress(OSError):
            return _stamp(os.stat(self._prefix + file))
        return ()

    def same(self, file: File) -> bool:
        try:
            return _stamp(os.stat(file.path)) == file.stamp
        except (OSError, ValueError):
            return False

    def fetch(self, name: str, into: Path) -> Path | None:
        file = self.find(name)
        path = file.path if file is not None else self._prefix + self.names().measured.get(name, "")
        if path == self._prefix:
            return None
        try:
            if not stat.S_ISREG(os.stat(path).st_mode):
                raise bc.StorageError("cannot_open", f"{os.path.basename(path)}: is no regular file")
            return Path(shutil.copy(path, into))
        except FileNotFoundError:
            return None
        except OSError as error:
            if isinstance(error, bc.StorageError):
                raise
            raise _cannot("written" if os.access(path, os.R_OK) else "read", error) from error

    # ---- changing -------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _changing(self, name: str, expected: list[File] | None) -> Iterator[None]:
        """One change at a time: among threads by a lock, among services that share the folder by one on a file."""
        try:
            with self._writing, (self.path / ".lock").open("a") as lock:
                if fcntl is not None:
                    fcntl.flock(lock, fcntl.LOCK_EX)  # let go when the file is closed
                before = os.stat(self.path).st_mtime_ns
                if self.version(name) != expected:
                    raise ChangedError
                try:
                    yield
                finally:
                    self._index.note(name, self.version(name) is not None, before)
        except OSError as error:
            raise _cannot("written", error) from error

    def put(self, name: str, source: Path, suffix: str, expected: list[File] | None) -> File:
        with self._changing(name, expected):
            path, choice = self.path / f"{name}{suffix}", self._choice(name)
            others = [Path(file.path) for file in expected or () if file.path != str(path)]
            if others:  # killed between the next two steps, `find` still knows which of the two files is meant
                bc.atomic.write_plain(choice, suffix.encode())
            try:
                os.replace(source, path)
            except OSError:
                choice.unlink(missing_ok=True)
                raise
            bc.atomic.flush_folder(self.path)
            for other in (*others, choice):
                other.unlink(missing_ok=True)
            placed = _file(str(path), SUFFIXES[suffix])
        if placed is None:  # somebody beside the service has removed it
            raise _cannot("written", FileNotFoundError(2, "the new file was removed at once"))
        return placed

    def delete(self, name: str, expected: list[File] | None) -> None:
        with self._changing(name, expected):
            for path in (*(Path(file.path) for file in expected or ()), self._choice(name)):
                path.unlink(missing_ok=True)
            bc.atomic.flush_folder(self.path)

    @contextlib.contextmanager
    def scratch(self) -> Iterator[Path]:
        # on the same disk, so that what is finished can be moved
        path = self.path / f"{_NEW}{secrets.token_hex(4)}.{bc.atomic.host()}.{os.getpid()}.00.tmp"
        try:
            path.mkdir()
        except OSError as error:
            raise _cannot("written", error) from error
        try:
            yield path
        except OSError as error:
            raise error if isinstance(error, bc.BrdfError) else _cannot("written", error) from error
        finally:
            shutil.rmtree(path, ignore_errors=True)

    def failed(self, error: OSError) -> bc.StorageError:
        return _cannot("written", error)

    # ---- records --------------------------------------------------------------------------------------

    def put_record(self, key: str, content: bytes) -> None:
        new = self._records / f".{key}.{secrets.token_hex(4)}"
        try:
            self._records.mkdir(exist_ok=True)
            new.write_bytes(content)  # what is lost with the power is news of an hour
            os.replace(new, self._records / f"{key}.json")
        except OSError as error:
            with contextlib.suppress(OSError):
                new.unlink(missing_ok=True)
            raise _cannot("written", error) from error

    def record(self, key: str) -> bytes | None:
        try:
            return (self._records / f"{key}.json").read_bytes() if key.isalnum() else None
        except OSError:
            return None

    def records(self, most: int) -> Iterator[bytes]:
        found: list[tuple[float, str]] = []
        with contextlib.suppress(OSError), os.scandir(self._records) as entries:
            found = [(entry.stat().st_mtime, entry.path) for entry in entries if not entry.name.startswith(".")]
        for changed, path in sorted(found, reverse=True):
            with contextlib.suppress(OSError):
                if changed < time.time() - RECORDS_KEPT:
                    os.unlink(path)
                elif most > 0:
                    most -= 1
                    yield Path(path).read_bytes()

    def clean(self) -> None:
        with contextlib.suppress(OSError):
            bc.atomic.remove_leftovers(self.path, _NEW, own=True, seconds=UNFINISHED_KEPT)
            for path in self._records.glob(".*"):
                path.unlink(missing_ok=True)
            for path in self.path.glob(".job-*"):  # of earlier versions
                shutil.rmtree(path, ignore_errors=True)

    def _choice(self, name: str) -> Path:
        """The file that says which of two files of one name is meant, while one replaces the other."""
        return self.path / f".{name}.choice"


def _file(path: str, kind: Kind) -> File | None:
    try:
        info = os.stat(path)
    except (OSError, ValueError):
        return None
    if not stat.S_ISREG(info.st_mode):  # opening a FIFO would wait for ever
        return None
    return File(path, kind, _stamp(info))


def _stamp(info: os.stat_result) -> tuple[int, ...]:
    return info.st_ino, info.st_mtime_ns, info.st_ctime_ns, info.st_size


def _cannot(what: Literal["read", "written"], error: OSError) -> bc.StorageError:
    reason = error.context.get("got") if isinstance(error, bc.BrdfError) else error.strerror
    return bc.StorageError("data_folder", f"the data folder cannot be {what} ({reason})", where="data")
