"""Changes to the data folder: whole or not at all, and only if the material is what the caller thinks it is."""

from __future__ import annotations

import contextlib
import os
import secrets
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from brdf_service.http.caching import etag_of_material, held_tags
from brdf_service.http.errors import ConflictError, MaterialDamagedError, NotFoundError, PreconditionError
from brdf_service.library.materials import NAME, SUFFIXES, Library
from starlette.datastructures import Headers

import brdfcore as bc

try:
    import fcntl
except ImportError:  # not POSIX: one process a data folder then
    fcntl = None  # type: ignore[assignment]

_LOCK = ".lock"


@dataclass(frozen=True)
class Condition:
    """If-Match and If-None-Match of a request; None where it has no such header."""

    match: frozenset[str] | None = None
    none_match: frozenset[str] | None = None

    @classmethod
    def of(cls, headers: Headers) -> Condition:
        """The conditions of a request."""
        match, none_match = headers.getlist("if-match"), headers.getlist("if-none-match")
        return cls(
            frozenset(held_tags(match)) if match else None, frozenset(held_tags(none_match)) if none_match else None
        )


def check_name(name: str) -> None:
    """`InputError` unless a material may be stored under `name`."""
    if not NAME.fullmatch(name):
        raise bc.InputError(
            "bad_name",
            "name: expected 1 to 64 letters, digits, dots, hyphens or underscores, the first a letter or digit",
            where="name",
            got=name[:80],
            expected=NAME.pattern,
        )


class Store:
    """Writes materials. Every method reads or writes files and belongs off the event loop.

    One change at a time: among threads by a lock, among services that share the folder by a lock on a hidden file.
    """

    def __init__(self, folder: Path, library: Library) -> None:
        self.folder = folder
        self.library = library
        self._writing = threading.Lock()

    def check(self, name: str, condition: Condition) -> bool:
        """True if the material exists and may be replaced or deleted, False if it does not exist.

        Raises `ConflictError` if it exists and the condition does not say that this is known, `PreconditionError` if
        the condition speaks of another state.
        """
        exists, etag = self._state(name)
        if condition.none_match is not None and exists and condition.none_match & {"*", etag}:
            raise PreconditionError("exists", f"{name}: exists already, and If-None-Match says it must not", where=name)
        if condition.match is not None and not (exists and condition.match & {"*", etag}):
            what = "is another one by now" if exists else "does not exist"
            raise PreconditionError(
                "changed",
                f"{name}: {what}; ask for it again and send its present ETag as If-Match",
                where="If-Match",
                expected=etag or "no If-Match",
            )
        if exists and condition.match is None:
            raise ConflictError(
                "exists",
                f"{name}: exists; send If-Match with its ETag (or *) to replace or delete it",
                where="If-Match",
                expected=etag or "*",
            )
        return exists

    def put_model(self, name: str, model: bc.Brdf, condition: Condition) -> bool:
        """Store a model as NAME.json; True if it replaced something."""
        with self._new_file() as temporary:
            bc.write(model, temporary, "model")
            return self.place(name, temporary, ".json", condition)

    def place(self, name: str, source: Path, suffix: str, condition: Condition) -> bool:
        """Move a finished file of this folder to NAME + suffix; True if it replaced a material of that name."""
        check_name(name)
        with self._changing():
            replaced = self.check(name, condition)
            others = [self.folder / f"{name}{s}" for s in SUFFIXES if s != suffix]
            others = [path for path in others if path.exists()]
            choice = self.library.choice_of(name)
            if others:  # killed between the next two steps, the library still knows which of the two files is meant
                _write_durably(choice, suffix)
            os.replace(source, self.folder / f"{name}{suffix}")
            _flush(self.folder)
            for path in (*others, choice):
                path.unlink(missing_ok=True)
            return replaced

    def delete(self, name: str, condition: Condition) -> None:
        """Remove a material. Raises `NotFoundError` if there is none."""
        with self._changing():
            if not self.check(name, condition):
                self.library.get(name)  # says what there is instead
            for suffix in SUFFIXES:
                (self.folder / f"{name}{suffix}").unlink(missing_ok=True)
            self.library.choice_of(name).unlink(missing_ok=True)
            _flush(self.folder)

    def _state(self, name: str) -> tuple[bool, str | None]:
        """Whether the material exists, and its ETag if it can be read."""
        try:
            return True, etag_of_material(name, self.library.get(name).tag)
        except MaterialDamagedError:
            return True, None
        except NotFoundError:
            return False, None

    @contextlib.contextmanager
    def _new_file(self) -> Iterator[Path]:
        path = self.folder / f".new-{secrets.token_hex(8)}.tmp"
        try:
            yield path
        except bc.StorageError as error:
            raise _cannot_write(error) from error
        finally:
            path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _changing(self) -> Iterator[None]:
        try:
            with self._writing, (self.folder / _LOCK).open("a") as file:
                if fcntl is not None:
                    fcntl.flock(file, fcntl.LOCK_EX)  # let go when the file is closed
                yield
        except bc.BrdfError:
            raise
        except OSError as error:
            raise _cannot_write(error) from error


def _cannot_write(error: OSError) -> bc.StorageError:
    reason = error.context.get("got") if isinstance(error, bc.BrdfError) else error.strerror
    return bc.StorageError("data_folder", f"the data folder cannot be written ({reason})", where="data")


def _write_durably(path: Path, text: str) -> None:
    with path.open("w", encoding="ascii") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _flush(folder: Path) -> None:
    """See to it that a rename or removal has reached the disk."""
    if os.name != "posix":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
