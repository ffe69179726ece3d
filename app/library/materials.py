"""Materials by name and by id: their files looked at anew by every request, loaded when asked for, kept while used."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import re
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from brdf_service.http.errors import MaterialDamagedError, NotFoundError, NotReadyError, describe
from brdf_service.library.store import File, Names, Store
from brdf_service.schemas.materials import MeasuredError
from cachetools import LRUCache
from pydantic import ValidationError

import brdfcore as bc

log = logging.getLogger("brdf.library")

ID = re.compile(r"[0-9a-f]{64}")

#: Lines of lists that are remembered.
_LINES = 20_000
#: Seconds for which files may be read to find an id.
_SEARCH_SECONDS = 2.0
#: Sentences that a file's reader warned with, which lists and pages show.
_MOST_WARNINGS = 20
#: Bytes that a material counts for beside its arrays and its facts.
_LEAST_BYTES = 8192


@dataclass(frozen=True)
class Material:
    """A loaded material. `facts` is what lists and metadata say of it; `tag` changes whenever they do."""

    name: str
    file: File
    brdf: bc.Brdf
    id: str
    nbytes: int
    facts: dict[str, Any]
    tag: str
    held_bytes: int
    #: Pieces of answers that are the same for every request, made when first needed.
    parts: dict[Any, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Listed:
    """One line of a list, learnt when the file was last read: facts of a usable material, or what is wrong with it."""

    name: str
    facts: dict[str, Any]
    file: File | None = None
    error: Exception | None = field(default=None, compare=False)

    @property
    def usable(self) -> bool:
        return self.error is None


@dataclass(frozen=True)
class Page:
    """Some lines of the list, how many there are, and the files that look like materials but whose names cannot be
    addressed."""

    lines: list[Listed]
    total: int
    skipped: list[str]


class Library:
    """All methods may be called from several threads; `peek`, `peek_id` and `find` also in the event loop, as they cost
    a look at one or two files; the others read."""

    def __init__(self, store: Store, cache_bytes: int) -> None:
        self.store = store
        #: Requests whose material was loaded already, and those that had to read its file.
        self.hits = self.misses = 0
        #: What is to be said of measured files that are not read yet, by name.
        self.waiting: dict[str, bc.BrdfError] = {}
        self._loaded: LRUCache[str, Material] = LRUCache(cache_bytes, getsizeof=lambda material: material.held_bytes)
        self._known: LRUCache[str, Listed] = LRUCache(_LINES)  # also of tables that were let go
        self._ids: dict[str, tuple[File, str]] = {}  # name -> file as it was read, id
        self._names_of: dict[str, str] = {}  # id -> name
        self._lock = threading.Lock()
        # one file is read at a time: two requests for one table must not hold it twice
        self._reading = threading.Lock()
        self._searching, self._searched = threading.Lock(), ([""], 0.0)

    @property
    def loaded_bytes(self) -> int:
        """Bytes of the materials held at the moment."""
        return int(self._loaded.currsize)

    @property
    def loaded(self) -> int:
        """Number of the materials held at the moment."""
        return len(self._loaded)

    def peek(self, name: str) -> Material | None:
        """The material if it is loaded and its file unchanged: one look at it."""
        with self._lock:
            held = self._loaded.get(name)
        if held is None or not self.store.same(held.file):
            return None
        self.hits += 1
        return held

    def get(self, name: str) -> Material:
        """The material, loaded if need be (reads a file).

        Raises `NotFoundError` with close names, `MaterialDamagedError` with the file's error.
        """
        material = self.peek(name)
        if material is None:
            self.find(name)  # nobody waits to hear that there is none
            with self._reading:
                material = self.peek(name) or self._load(name)
        return material

    def peek_id(self, id: str) -> Material | None:
        """As `peek`, by id."""
        name = self._names_of.get(id)
        material = self.peek(name) if name is not None else None
        return material if material is not None and material.id == id else None

    def get_id(self, id: str) -> Material:
        """As `get`, by id. Reads files never read, for a bounded time: `NotReadyError` if some are left then."""
        if ID.fullmatch(id):
            material = self.peek_id(id) or self._search(id)
            if material is not None:
                return material
        text = "no table or model of this id is in the data folder; /v1/materials lists the ids"
        expected = "the id of a material, 64 hexadecimal digits"
        raise NotFoundError("unknown_table", text, where="id", got=id[:80], expected=expected)

    def _search(self, id: str) -> Material | None:
        with contextlib.suppress(NotFoundError, MaterialDamagedError):
            if id in self._names_of:
                material = self.get(self._names_of[id])
                if material.id == id:
                    return material
        if not self._searching.acquire(blocking=False):
            raise _not_read()
        try:
            names, until = self.store.names().all, time.monotonic() + _SEARCH_SECONDS
            if self._searched[0] is names and time.monotonic() < self._searched[1]:
                return None
            for name in names:
                if time.monotonic() > until:
                    raise _not_read()
                with contextlib.suppress(NotFoundError, MaterialDamagedError):
                    file, read = self.find(name), self._ids.get(name)
                    if read is None or read[0] != file:
                        self.get(name)
                    if self._ids.get(name, (None, ""))[1] == id:
                        return self.get(name)
            self._searched = names, time.monotonic() + _SEARCH_SECONDS
            return None
        finally:
            self._searching.release()

    def page(self, offset: int, limit: int) -> Page:
        """`limit` materials from `offset` in order of their names (reads files never read)."""
        names = self.store.names()
        lines = [line for name in names.all[offset : offset + limit] if (line := self._line(name, names)) is not None]
        return Page(lines, len(names.all), names.skipped)

    def _line(self, name: str, names: Names) -> Listed | None:
        """What is known of a file, after reading it if it is new or has changed."""
        file = None
        try:
            file = self.store.find(name)
            with self._lock:
                known = self._known.get(name)
            if known is not None and known.file == file:
                return known
            if file is None and name in names.measured:
                return _unusable(name, None, self.waiting.get(name) or _unread(names.measured[name]))
            if file is None:
                return _unusable(name, None, _nowhere(name))
            return Listed(name, self.get(name).facts, file)
        except NotFoundError:  # deleted a moment ago
            return None
        except MaterialDamagedError as error:
            return _unusable(name, file, error)

    def find(self, name: str) -> File:
        """Its file, by a look at the two that it may have. Raises `NotFoundError` with close names, or
        `MaterialDamagedError`."""
        file = self.store.find(name)
        if file is None:
            if name in self.waiting:
                raise _damaged(name, self.waiting[name])
            self.forget([name])
            raise self.unknown(name)
        return file

    def unknown(self, name: str) -> NotFoundError:
        """What is said of a name that there is not, with those close to it."""
        close = self.store.close_to(name)
        hint = f"did you mean {' or '.join(close)}?" if close else "/v1/materials lists what there is"
        expected, text = ", ".join(close) or "the name of a material", f"no material of this name; {hint}"
        return NotFoundError("unknown_material", text, where="name", got=name[:80], expected=expected)

    def forget(self, gone: Iterable[str]) -> None:
        """Let go of materials, to look at them anew."""
        with self._lock:
            for name in gone:
                self._loaded.pop(name, None)
                self._known.pop(name, None)
                _, id = self._ids.pop(name, (None, ""))
                self._names_of.pop(id, None)

    def _load(self, name: str) -> Material:
        self.misses += 1
        file = self.find(name)
        with self._lock:
            known = self._known.get(name)
        if known is not None and known.file == file and known.error is not None:
            raise _damaged(name, known.error)  # it was read in this state and will not have healed
        try:
            material = open_material(name, file)
        except Exception as raised:
            # whatever a stranger's file does to the reader, the list and the other materials go on
            self.find(name)  # it may have been deleted a moment ago
            error = _without_folder(raised, Path(file.path))
            traceback = None if isinstance(error, bc.BrdfError) else error
            log.warning("%s cannot be used: %s", Path(file.path).name, error, exc_info=traceback)
            if not isinstance(error, (OSError, MemoryError)):  # those may be gone at the next try
                error.with_traceback(None)  # it would keep all that the reader had in memory
                with self._lock:
                    self._known[name] = _unusable(name, file, error)
                    self._ids[name] = file, ""
            raise _damaged(name, error) from error
        return self.hold(material, file)

    def hold(self, material: Material, file: File) -> Material:
        """Keep a material that was read, as the one of this file."""
        material, name = replace(material, file=file), material.name
        with self._lock:
            self._loaded.pop(name, None)
            kept = material.held_bytes <= self._loaded.maxsize
            if kept:
                self._loaded[name] = material
            self._known[name] = Listed(name, material.facts, file)
            before = self._ids.get(name)
            if before is not None and self._names_of.get(before[1]) == name:
                del self._names_of[before[1]]
            self._ids[name], self._names_of[material.id] = (file, material.id), name
        if not kept:
            text = "%s has %d bytes, more than BRDF_CACHE_BYTES = %d: it is read again for every request"
            log.warning(text, Path(file.path).name, material.nbytes, self._loaded.maxsize)
        return material


def open_material(name: str, file: File) -> Material:
    """Read a material's file. Raises what the library's readers raise."""
    brdf: bc.Brdf
    if file.kind == "table":
        brdf = table = bc.open_table(Path(file.path))
        id, nbytes = table.id, table.nbytes
    else:
        brdf = bc.read(Path(file.path), "model")
        # all that its answers depend on: model, resolved parameters and package version
        of: dict[str, Any] = {"version": bc.__version__}
        of |= {key: brdf.metadata[key] for key in ("model", "parameters", "sum") if key in brdf.metadata}
        id, nbytes = _digest(of), 0
    facts = {"name": name, "kind": file.kind, "id": id, "nbytes": nbytes, "error": {}, "source": {}, **brdf.describe()}
    facts["id"] = id
    facts["warnings"] = [str(text) for text in brdf.report.get("warnings", ())][:_MOST_WARNINGS]
    try:
        MeasuredError.model_validate(facts["error"])
    except ValidationError:  # a file from outside may say anything
        facts["error"] = {}
        facts["warnings"].append("what the file says of its measured error is not in the form that is read here")
    # a number of a list takes as much again as its text: parameters and channels weigh, not only arrays
    held = nbytes + 4 * len(_text(facts)) + _LEAST_BYTES
    return Material(name, file, brdf, id, nbytes, facts, _digest(facts), held)


def _text(content: dict[str, Any]) -> bytes:
    return json.dumps(content, sort_keys=True, default=str).encode()


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(_text(content)).hexdigest()


def _without_folder(error: Exception, path: Path) -> Exception:
    """The error of a file named without its folder, which is no business of the service's callers."""
    if isinstance(error, bc.BrdfError) and str(path) in error.detail:
        return type(error)(error.code, error.detail.replace(str(path), path.name), **error.context)
    return error


def _unusable(name: str, file: File | None, error: Exception) -> Listed:
    kind = {} if file is None else {"kind": file.kind}
    return Listed(name, {"name": name, **kind, "problem": describe(error)}, file, error)


def _damaged(name: str, error: Exception) -> MaterialDamagedError:
    text, expected = f"{name}: its file cannot be used: {describe(error)['detail']}", "a material file that can be read"
    return MaterialDamagedError("material_damaged", text, where="name", got=name, expected=expected)


def _unread(file: str) -> bc.BrdfError:
    return bc.FileFormatError("not_read_yet", f"{file} is a measured file that waits to be read", where=file)


def _nowhere(name: str) -> bc.BrdfError:
    text = f"{name}: its file is a link that leads nowhere, or no regular file; remove it"
    return bc.StorageError("cannot_open", text, where=name)


def _not_read() -> NotReadyError:
    text = "files are being read to find this id; ask again, or ask by name"
    return NotReadyError("ids_unread", text, where="id", retry_after=1)
