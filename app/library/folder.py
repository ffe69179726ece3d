"""The data folder: NAME.h5 tables and NAME.json models. Nothing else of the service looks at its files or changes them.

A leading dot marks what no list shows: files that are not finished, the lock, and the folders of jobs.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import socket
import stat
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from brdf_service.http.errors import MaterialDamagedError

import brdfcore as bc

try:
    import fcntl
except ImportError:  # not POSIX: one process a data folder then
    fcntl = None  # type: ignore[assignment]

NAME = re.compile(bc.names.MATERIAL_NAME)

Kind = Literal["table", "model"]
#: Each kind by its file name's end.
SUFFIXES: dict[str, Kind] = {".h5": "table", ".json": "model"}


class File(NamedTuple):
    """The file of a material; `stamp` (inode, mtime and ctime in ns, size) tells its states apart."""

    path: str
    kind: Kind
    stamp: tuple[int, int, int, int]


class Folder:
    """Reading and changing files. `StorageError` where the folder itself cannot be read or written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._prefix = f"{path}{os.sep}"  # every request comes here: pathlib would cost more than stat
        self._writing = threading.Lock()
        host = "".join(c for c in socket.gethostname() if c.isalnum())[:32] or "host"
        self._scratch = f".job-{host}-"

    # ---- reading --------------------------------------------------------------------------------------

    def names(self) -> tuple[list[str], list[str]]:
        """(names of all materials, files that look like materials but cannot be addressed), each sorted."""
        try:
            with os.scandir(self.path) as entries:
                ends = [os.path.splitext(e.name) for e in entries if not e.name.startswith(".") and e.is_file()]
        except OSError as error:
            raise _cannot("read", error) from error
        found = [(stem, suffix) for stem, suffix in ends if suffix in SUFFIXES]
        names = {stem for stem, _ in found if NAME.fullmatch(stem)}
        return sorted(names), sorted(stem + suffix for stem, suffix in found if stem not in names)

    def find(self, name: str) -> File | None:
        """The one file of a material, None if there is none; `MaterialDamagedError` if two files claim the name."""
        if not NAME.fullmatch(name):
            return None
        found = [f for suffix, kind in SUFFIXES.items() if (f := _file(f"{self._prefix}{name}{suffix}", kind))]
        if len(found) < 2:
            return found[0] if found else None
        # a change of kind may have been cut off after the new file was in place
        with contextlib.suppress(OSError, StopIteration):
            chosen = f"{self._prefix}{name}{self._choice(name).read_text(encoding='ascii')}"
            return next(file for file in found if file.path == chosen)
        text = f"{name}: both {name}.h5 and {name}.json are in the data folder; remove or rename one"
        raise MaterialDamagedError("material_ambiguous", text, where="name", got=name)

    def copy(self, name: str, into: Path) -> Path | None:
        """A copy of the material's file as it is now, under its own file name; None if there is none."""
        file = self.find(name)
        try:
            return None if file is None else Path(shutil.copy(file.path, into))
        except FileNotFoundError:
            return None
        except OSError as error:
            raise _cannot("written", error) from error

    # ---- changing -------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def changing(self) -> Iterator[None]:
        """One change at a time: among threads by a lock, among services that share the folder by one on a file."""
        try:
            with self._writing, (self.path / ".lock").open("a") as file:
                if fcntl is not None:
                    fcntl.flock(file, fcntl.LOCK_EX)  # let go when the file is closed
                yield
        except OSError as error:
            if isinstance(error, bc.BrdfError):
                raise
            raise _cannot("written", error) from error

    def place(self, name: str, source: Path, suffix: str) -> None:
        """Move a finished file of this folder to NAME + suffix, while `changing`."""
        others = [path for s in SUFFIXES if s != suffix and (path := self.path / f"{name}{s}").exists()]
        choice = self._choice(name)
        if others:  # killed between the next two steps, `find` still knows which of the two files is meant
            with choice.open("w", encoding="ascii") as file:
                file.write(suffix)
                file.flush()
                os.fsync(file.fileno())
        os.replace(source, self.path / f"{name}{suffix}")
        self._flush()
        for path in (*others, choice):
            path.unlink(missing_ok=True)

    def remove(self, name: str) -> None:
        """Remove all files of a material, while `changing`."""
        for path in (*(self.path / f"{name}{suffix}" for suffix in SUFFIXES), self._choice(name)):
            path.unlink(missing_ok=True)
        self._flush()

    @contextlib.contextmanager
    def new_file(self) -> Iterator[Path]:
        """A place to write a file to that `place` then moves; what is left there is removed."""
        path = self.path / f".new-{secrets.token_hex(8)}.tmp"
        try:
            yield path
        except bc.StorageError as error:
            raise _cannot("written", error) from error
        finally:
            path.unlink(missing_ok=True)

    def new_scratch(self, id: str) -> Path:
        """A new folder for the files of a job, on the same disk so that its result can be moved."""
        path = self.path / f"{self._scratch}{os.getpid()}-{id}"
        try:
            path.mkdir()
        except OSError as error:
            raise _cannot("written", error) from error
        return path

    def clean(self) -> None:
        """Remove what jobs of this machine left behind when their service was killed."""
        for path in self.path.glob(f"{self._scratch}*"):
            number = path.name.removeprefix(self._scratch).partition("-")[0]
            if number.isdigit() and (int(number) == os.getpid() or not _alive(int(number))):
                shutil.rmtree(path, ignore_errors=True)

    def _choice(self, name: str) -> Path:
        """The file that says which of two files of one name is meant, while one replaces the other."""
        return self.path / f".{name}.choice"

    def _flush(self) -> None:
        """See to it that a rename or removal has reached the disk."""
        if fcntl is not None:
            number = os.open(self.path, os.O_RDONLY)
            try:
                os.fsync(number)
            finally:
                os.close(number)


def _file(path: str, kind: Kind) -> File | None:
    try:
        info = os.stat(path)
    except OSError:
        return None
    if not stat.S_ISREG(info.st_mode):  # opening a FIFO would wait for ever
        return None
    return File(path, kind, (info.st_ino, info.st_mtime_ns, info.st_ctime_ns, info.st_size))


def _cannot(what: Literal["read", "written"], error: OSError) -> bc.StorageError:
    reason = error.context.get("got") if isinstance(error, bc.BrdfError) else error.strerror
    return bc.StorageError("data_folder", f"the data folder cannot be {what} ({reason})", where="data")


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
