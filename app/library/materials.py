"""Materials by name and by id: their files looked at anew by every request, loaded when asked for, kept while used."""

from __future__ import annotations

import difflib
import hashlib
import json
import logging
import re
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from brdf_service.http.errors import MaterialDamagedError, NotFoundError, describe
from brdf_service.library.folder import File, Folder
from brdf_service.library.lru import keep
from cachetools import LRUCache

import brdfcore as bc

log = logging.getLogger("brdf.library")

ID = re.compile(r"[0-9a-f]{64}")

#: Materials of a folder that is so small that its list is made in the event loop: some milliseconds at most.
_FEW = 200


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
    """All methods may be called from several threads; those that may read a file say so, and belong off the event
    loop."""

    def __init__(self, folder: Path, cache_bytes: int) -> None:
        self.folder = Folder(folder)
        #: Requests whose material was loaded already, and those that had to read its file.
        self.hits = self.misses = 0
        self._loaded: LRUCache[str, Material] = LRUCache(cache_bytes, getsizeof=lambda material: material.nbytes)
        self._known: dict[str, Listed] = {}  # also of tables that were let go
        self._names_of: dict[str, str] = {}  # id -> name
        self._count: int | None = None  # of all materials, when last listed
        self._lock = threading.Lock()
        # one file is read at a time: two requests for one table must not hold it twice
        self._reading = threading.Lock()

    @property
    def loaded_bytes(self) -> int:
        """Bytes of the tables held at the moment."""
        return int(self._loaded.currsize)

    @property
    def loaded(self) -> int:
        """Number of the materials held at the moment."""
        return len(self._loaded)

    def peek(self, name: str) -> Material | None:
        """The material if it is loaded and its file unchanged; reads no file."""
        file = self._find(name)
        with self._lock:
            held = self._loaded.get(name)
            if held is None or held.file != file:
                return None
            self.hits += 1
        return held

    def get(self, name: str) -> Material:
        """The material, loaded if need be (reads a file).

        Raises `NotFoundError` with close names, `MaterialDamagedError` with the file's error.
        """
        material = self.peek(name)
        if material is None:
            with self._reading:
                material = self.peek(name) or self._load(name)
        return material

    def peek_id(self, id: str) -> Material | None:
        """As `peek`, by id."""
        name = self._names_of.get(id)
        try:
            material = self.peek(name) if name is not None else None
        except (NotFoundError, MaterialDamagedError):
            return None
        return material if material is not None and material.id == id else None

    def get_id(self, id: str) -> Material:
        """As `get`, by id (reads every file that was never read)."""
        if ID.fullmatch(id):
            material = self.peek_id(id)
            if material is not None:
                return material
            for name in self.folder.names()[0]:
                line = self._line(name)
                if line is not None and line.facts.get("id") == id:
                    material = self.get(name)
                    if material.id == id:
                        return material
        text = "no table or model of this id is in the data folder; /v1/materials lists the ids"
        expected = "the id of a material, 64 hexadecimal digits"
        raise NotFoundError("unknown_table", text, where="id", got=id[:80], expected=expected)

    def peek_page(self, offset: int, limit: int) -> Page | None:
        """As `page` if the folder was small and no file has to be read; None otherwise."""
        if self._count is None or self._count > _FEW:
            return None
        return self._page(offset, limit, reading=False)

    def page(self, offset: int, limit: int) -> Page:
        """`limit` materials from `offset` in order of their names (reads files never read)."""
        page = self._page(offset, limit, reading=True)
        assert page is not None
        return page

    def _page(self, offset: int, limit: int, *, reading: bool) -> Page | None:
        names, skipped = self.folder.names()
        self._count = len(names)
        with self._lock:
            for gone in self._known.keys() - set(names):
                del self._known[gone]
                self._loaded.pop(gone, None)
            self._names_of = {id: name for id, name in self._names_of.items() if name in self._known}
        lines = []
        for name in names[offset : offset + limit]:
            line = self._line(name, reading=reading)
            if line is None:
                return None
            lines.append(line)
        return Page(lines, len(names), skipped)

    def _line(self, name: str, *, reading: bool = True) -> Listed | None:
        """What is known of a file, after reading it if it is new or has changed; None if it is, and is not to be
        read."""
        file = None
        try:
            file = self._find(name)
            with self._lock:
                known = self._known.get(name)
            if known is not None and known.file == file:
                return known
            return Listed(name, self.get(name).facts, file) if reading else None
        except NotFoundError as error:  # deleted a moment ago
            return Listed(name, {"name": name, "problem": describe(error)}, error=error)
        except MaterialDamagedError as error:
            cause = error.__cause__ if isinstance(error.__cause__, Exception) else error
            return _unusable(name, file, cause)

    def _find(self, name: str) -> File:
        file = self.folder.find(name)
        if file is None:
            raise self.unknown(name)
        return file

    def unknown(self, name: str) -> NotFoundError:
        """What is said of a name that there is not, with those close to it."""
        close = difflib.get_close_matches(name[:64], self.folder.names()[0], n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(close)}?" if close else "/v1/materials lists what there is"
        expected, text = ", ".join(close) or "the name of a material", f"no material of this name; {hint}"
        return NotFoundError("unknown_material", text, where="name", got=name[:80], expected=expected)

    def _load(self, name: str) -> Material:
        self.misses += 1
        file = self._find(name)
        with self._lock:
            known = self._known.get(name)
        if known is not None and known.file == file and known.error is not None:
            raise _damaged(name, known.error)  # it was read in this state and will not have healed
        try:
            material = open_material(name, file)
        except Exception as raised:
            # whatever a stranger's file does to the reader, the list and the other materials go on
            self._find(name)  # it may have been deleted a moment ago
            error = _without_folder(raised, Path(file.path))
            traceback = None if isinstance(error, bc.BrdfError) else error
            log.warning("%s cannot be used: %s", Path(file.path).name, error, exc_info=traceback)
            if not isinstance(error, (OSError, MemoryError)):  # those may be gone at the next try
                error.with_traceback(None)  # it would keep all that the reader had in memory
                with self._lock:
                    self._known[name] = _unusable(name, file, error)
            raise _damaged(name, error) from error
        with self._lock:
            kept = keep(self._loaded, name, material)
            self._known[name] = Listed(name, material.facts, file)
            self._names_of[material.id] = name
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
        of = {"model": brdf.metadata["model"], "parameters": brdf.metadata["parameters"], "version": bc.__version__}
        id, nbytes = _digest(of), 0
    facts = {"name": name, "kind": file.kind, "id": id, "nbytes": nbytes, "error": {}, "source": {}, **brdf.describe()}
    facts["id"] = id
    return Material(name, file, brdf, id, nbytes, facts, _digest(facts))


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


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
