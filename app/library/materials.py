"""The data folder: NAME.h5 tables and NAME.json models, looked at anew by every request, loaded when asked for."""

from __future__ import annotations

import contextlib
import difflib
import hashlib
import json
import logging
import os
import re
import stat
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from brdf_service.http.errors import MaterialDamagedError, NotFoundError, describe
from brdf_service.library.lru import ByteLru

import brdfcore as bc

log = logging.getLogger("brdf.library")

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
ID = re.compile(r"[0-9a-f]{64}")

Kind = Literal["table", "model"]
#: Each kind by its file name's end.
SUFFIXES: dict[str, Kind] = {".h5": "table", ".json": "model"}

#: Seconds for which a name's file is taken for its only one.
_SURE_SECONDS = 0.25

#: Materials of a folder that is so small that its list is made in the event loop: some milliseconds at most.
_FEW = 200

#: What tells one state of a file from another: inode, mtime in ns, size.
Stamp = tuple[int, int, int]


@dataclass(frozen=True)
class Material:
    """A loaded material. `facts` is what lists and metadata say of it; `tag` changes whenever they do."""

    name: str
    path: Path
    brdf: bc.Brdf
    id: str
    nbytes: int
    facts: dict[str, Any]
    tag: str
    #: Pieces of answers that are the same for every request, made when first needed.
    parts: dict[Any, Any] = field(default_factory=dict)
    #: The same for `quick`, by kind of address and unit.
    fixed: dict[tuple[bool, str], Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Listed:
    """One line of a list: facts of a usable material, or what is wrong with its file."""

    name: str
    facts: dict[str, Any]
    usable: bool


@dataclass(frozen=True)
class Page:
    """Some lines of the list, how many there are, and the files that look like materials but whose names cannot be
    addressed."""

    lines: list[Listed]
    total: int
    skipped: list[str]


@dataclass(frozen=True)
class _Known:
    """What was learnt when a file was last read; kept after its table was let go."""

    stamp: Stamp
    facts: dict[str, Any]
    id: str | None
    error: Exception | None


class Library:
    """Materials by name and by id. All methods may be called from several threads; those that may read a file
    say so, and belong off the event loop."""

    def __init__(self, folder: Path, cache_bytes: int) -> None:
        self.folder = folder
        self._prefix = f"{folder}{os.sep}"
        #: Requests whose material was loaded already, and those that had to read its file.
        self.hits = self.misses = 0
        self._loaded: ByteLru[str, tuple[Stamp, Material]] = ByteLru(cache_bytes)
        self._known: dict[str, _Known] = {}
        self._names_of: dict[str, str] = {}  # id -> name
        self._sure: dict[str, tuple[str, float]] = {}  # name -> its one file, and until when that is believed
        self._count: int | None = None  # of all materials, when last listed
        self._lock = threading.Lock()
        # one file is read at a time: two requests for one table must not hold it twice
        self._reading = threading.Lock()

    @property
    def loaded_bytes(self) -> int:
        """Bytes of the tables held at the moment."""
        return self._loaded.nbytes

    @property
    def loaded(self) -> int:
        """Number of the materials held at the moment."""
        return len(self._loaded)

    def names(self) -> list[str]:
        """Names of all materials, sorted."""
        return sorted({path.stem for path in self._files() if NAME.fullmatch(path.stem)})

    def peek(self, name: str) -> Material | None:
        """The material if it is loaded and its file unchanged; reads no file."""
        sure = self._sure.get(name)
        now = time.monotonic()
        # the one call of stat that notices a changed file; whether a second of the name has come is asked less often
        stamp = _stamp(sure[0]) if sure is not None and now < sure[1] else None
        if stamp is None:
            path, _, stamp = self._find(name)
            self._sure[name] = path, now + _SURE_SECONDS
        with self._lock:
            held = self._loaded.get(name)
            if held is None or held[0] != stamp:
                self._sure.pop(name, None)
                return None
            self.hits += 1
        return held[1]

    def get(self, name: str) -> Material:
        """The material, loaded if need be (reads a file).

        Raises `NotFoundError` with close names, `MaterialDamagedError` with the file's error.
        """
        material = self.peek(name)
        if material is None:
            with self._reading:
                material = self.peek(name)
                if material is None:
                    self.misses += 1
                    material = self._load(name)
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
            for name in self.names():
                known = self._know(name)
                if known is not None and known.id == id:
                    material = self.get(name)
                    if material.id == id:
                        return material
        raise NotFoundError(
            "unknown_table",
            "no table or model of this id is in the data folder; /v1/materials lists the ids",
            where="id",
            got=id[:80],
            expected="the id of a material, 64 hexadecimal digits",
        )

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
        files = list(self._files())
        names = sorted({path.stem for path in files if NAME.fullmatch(path.stem)})
        skipped = sorted(path.name for path in files if not NAME.fullmatch(path.stem))
        self._count = len(names)
        with self._lock:
            for gone in self._known.keys() - set(names):
                del self._known[gone]
                self._loaded.drop(gone)
            self._names_of = {k: v for k, v in self._names_of.items() if v in self._known}
        lines = []
        for name in names[offset : offset + limit]:
            known = self._know(name, reading=reading)
            if known is None:
                return None
            lines.append(Listed(name, known.facts, known.error is None))
        return Page(lines, len(names), skipped)

    def choice_of(self, name: str) -> Path:
        """The hidden file that says which of two files of one name is meant, while one replaces the other."""
        return self.folder / f".{name}.choice"

    def _files(self) -> Iterable[Path]:
        try:
            with os.scandir(self.folder) as entries:
                # a leading dot marks what a writer has not finished yet
                found = [Path(e.path) for e in entries if not e.name.startswith(".") and e.is_file()]
        except OSError as error:
            raise bc.StorageError(
                "data_folder", f"the data folder cannot be read ({error.strerror})", where="data"
            ) from error
        return [path for path in found if path.suffix in SUFFIXES]

    def _find(self, name: str) -> tuple[str, Kind, Stamp]:
        """The one file of a material, by name; `NotFoundError`, or `MaterialDamagedError` if two files claim it."""
        found: list[tuple[str, Kind, Stamp]] = []
        if NAME.fullmatch(name):
            for suffix, kind in SUFFIXES.items():
                path = f"{self._prefix}{name}{suffix}"  # every request comes here: pathlib would cost more than stat
                stamp = _stamp(path)
                if stamp is not None:
                    found.append((path, kind, stamp))
        if len(found) == 1:
            return found[0]
        if found:
            with contextlib.suppress(
                OSError, StopIteration
            ):  # a change of kind was cut off after the new file was in place
                chosen = self.choice_of(name).read_text(encoding="ascii")
                return next(f for f in found if f[0] == f"{self._prefix}{name}{chosen}")
            raise MaterialDamagedError(
                "material_ambiguous",
                f"{name}: both {name}.h5 and {name}.json are in the data folder; remove or rename one",
                where="name",
                got=name,
            )
        raise self._unknown(name)

    def _unknown(self, name: str) -> NotFoundError:
        close = difflib.get_close_matches(name[:64], self.names(), n=3, cutoff=0.5)
        meant = f"; did you mean {' or '.join(close)}?" if close else "; /v1/materials lists what there is"
        return NotFoundError(
            "unknown_material",
            f"no material of this name{meant}",
            where="name",
            got=name[:80],
            expected=", ".join(close) if close else "the name of a material",
        )

    def _know(self, name: str, *, reading: bool = True) -> _Known | None:
        """What is known of a file, after reading it if it is new or has changed; None if it is, and is not to be
        read."""
        try:
            _, kind, stamp = self._find(name)
        except MaterialDamagedError as error:
            return _Known((0, 0, 0), {"name": name, "problem": describe(error)}, None, error)
        except NotFoundError as error:  # deleted a moment ago
            return _Known((0, 0, 0), {"name": name, "problem": describe(error)}, None, error)
        with self._lock:
            known = self._known.get(name)
        if known is not None and known.stamp == stamp:
            return known
        if not reading:
            return None
        try:
            material = self.get(name)
        except (NotFoundError, MaterialDamagedError) as error:
            cause = error.__cause__ if isinstance(error.__cause__, Exception) else error
            return _Known(stamp, {"name": name, "kind": kind, "problem": describe(cause)}, None, cause)
        return _Known(stamp, material.facts, material.id, None)

    def _load(self, name: str) -> Material:
        place, kind, stamp = self._find(name)
        path = Path(place)
        with self._lock:
            known = self._known.get(name)
        if known is not None and known.stamp == stamp and known.error is not None:
            raise _damaged(name, known.error)  # it was read in this state and will not have healed
        try:
            material = open_material(name, path, kind)
        except Exception as raised:
            # whatever a stranger's file does to the reader, the list and the other materials go on
            if not path.exists():  # deleted a moment ago
                raise self._unknown(name) from None
            error = _without_folder(raised, path)
            known_error = isinstance(error, bc.BrdfError)
            log.warning("%s cannot be used: %s", path.name, error, exc_info=None if known_error else error)
            if not isinstance(error, (OSError, MemoryError)):  # those may be gone at the next try
                facts = {"name": name, "kind": kind, "problem": describe(error)}
                error.with_traceback(None)  # it would keep all that the reader had in memory
                with self._lock:
                    self._known[name] = _Known(stamp, facts, None, error)
            raise _damaged(name, error) from error
        with self._lock:
            if not self._loaded.put(name, (stamp, material), material.nbytes):
                log.warning(
                    "%s has %d bytes, more than BRDF_CACHE_BYTES = %d: it is read again for every request",
                    path.name,
                    material.nbytes,
                    self._loaded.limit,
                )
            self._known[name] = _Known(stamp, material.facts, material.id, None)
            self._names_of[material.id] = name
        return material


def _stamp(path: str) -> Stamp | None:
    """State of a file; None if it is none."""
    try:
        info = os.stat(path)
    except OSError:
        return None
    # opening a FIFO would wait for ever
    return (info.st_ino, info.st_mtime_ns, info.st_size) if stat.S_ISREG(info.st_mode) else None


def open_material(name: str, path: Path, kind: Kind) -> Material:
    """Read a material's file. Raises what the library's readers raise."""
    brdf: bc.Brdf
    if kind == "table":
        brdf = table = bc.open_table(path)
        id, nbytes = table.id, table.nbytes
    else:
        brdf = bc.read(path, "model")
        id, nbytes = _model_id(brdf), 0
    described = brdf.describe()
    facts = {"name": name, "kind": kind, "id": id, "nbytes": nbytes, "error": {}, "source": {}, **described}
    facts["id"] = id
    tag = hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()
    return Material(name, path, brdf, id, nbytes, facts, tag)


def _model_id(brdf: bc.Brdf) -> str:
    """sha256 over model, resolved parameters and package version: all that its answers depend on."""
    metadata = brdf.metadata
    named = {"model": metadata["model"], "parameters": metadata["parameters"], "version": bc.__version__}
    return hashlib.sha256(json.dumps(named, sort_keys=True, default=str).encode()).hexdigest()


def _without_folder(error: Exception, path: Path) -> Exception:
    """The error of a file named without its folder, which is no business of the service's callers."""
    if isinstance(error, bc.BrdfError) and str(path) in error.detail:
        return type(error)(error.code, error.detail.replace(str(path), path.name), **error.context)
    return error


def _damaged(name: str, error: Exception) -> MaterialDamagedError:
    said = describe(error)
    return MaterialDamagedError(
        "material_damaged",
        f"{name}: its file cannot be used: {said['detail']}",
        where="name",
        got=name,
        expected="a material file that can be read",
    )
