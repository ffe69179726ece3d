"""Changes to materials: whole or not at all, and only if the material is what the caller thinks it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brdf_service.http.caching import etag_of_material, held_tags
from brdf_service.http.errors import (
    BusyError,
    ConflictError,
    MaterialDamagedError,
    NotFoundError,
    PreconditionError,
)
from brdf_service.library.materials import Library, Material, open_material
from brdf_service.library.store import NAME, SUFFIXES, ChangedError, File
from starlette.datastructures import Headers

import brdfcore as bc

#: Times that a change is tried again because another one came between.
_TRIES = 50


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


#: Only where there is none of the name.
IF_NEW = Condition(none_match=frozenset("*"))


def check_name(name: str) -> None:
    """`InputError` unless a material may be stored under `name`."""
    if not NAME.fullmatch(name):
        text = "name: expected 1 to 64 letters, digits, dots, hyphens or underscores, the first a letter or digit"
        raise bc.InputError("bad_name", text, where="name", got=name[:80], expected=NAME.pattern)


class Writer:
    """Writes materials. Every method reads or writes files and belongs off the event loop."""

    def __init__(self, library: Library) -> None:
        self.library, self.store = library, library.store

    def check(self, name: str, condition: Condition) -> Any:
        """The version of the material, which may be replaced or deleted; None if it does not exist.

        Raises `ConflictError` if it exists and the condition does not say that this is known, `PreconditionError` if
        the condition speaks of another state.
        """
        version, etag = self._state(name)
        exists = version is not None
        if condition.none_match is not None and exists and condition.none_match & {"*", etag}:
            raise PreconditionError("exists", f"{name}: exists already, and If-None-Match says it must not", where=name)
        if condition.match is not None and not (exists and condition.match & {"*", etag}):
            what = "is another one by now" if exists else "does not exist"
            text = f"{name}: {what}; ask for it again and send its present ETag as If-Match"
            raise PreconditionError("changed", text, where="If-Match", expected=etag or "no If-Match")
        if exists and condition.match is None:
            text = f"{name}: exists; send If-Match with its ETag (or *) to replace or delete it"
            raise ConflictError("exists", text, where="If-Match", expected=etag or "*")
        return version

    def put_model(self, name: str, model: bc.Brdf, condition: Condition) -> tuple[Material, bool]:
        """Store a model as NAME.json; as `place`."""
        check_name(name)
        with self.store.scratch() as folder:
            path = folder / f"{name}.json"
            bc.write(model, path, "model")
            return self.place(name, path, ".json", condition)

    def place(self, name: str, source: Path, suffix: str, condition: Condition) -> tuple[Material, bool]:
        """Move a finished file of the store's scratch to NAME + suffix: the material that was stored, whatever others
        do to it a moment later, and whether it replaced one.

        The file is read before it takes the old one's place: what cannot be read replaces nothing.
        """
        check_name(name)
        made = open_material(name, File(str(source), SUFFIXES[suffix], ()))
        for _ in range(_TRIES):
            version = self.check(name, condition)
            try:
                file = self.store.put(name, source, suffix, version)
            except ChangedError:
                continue
            return self.library.hold(made, file), version is not None
        raise _restless(name)

    def delete(self, name: str, condition: Condition) -> None:
        """Remove a material. Raises `NotFoundError` if there is none."""
        for _ in range(_TRIES):
            version = self.check(name, condition)
            if version is None:
                raise self.library.unknown(name)
            try:
                return self.store.delete(name, version)
            except ChangedError:
                continue
        raise _restless(name)

    def copy(self, name: str, into: Path) -> Path:
        """A copy of the material's file as it is now, in another folder. Raises `NotFoundError` if there is none."""
        made = self.store.fetch(name, into)
        if made is None:
            raise self.library.unknown(name)
        return made

    def _state(self, name: str) -> tuple[Any, str | None]:
        """The version of the material, and its ETag if it can be read."""
        for _ in range(_TRIES):
            version = self.store.version(name)
            if version is None:
                return None, None
            try:
                etag = etag_of_material(name, self.library.get(name).tag)
            except (MaterialDamagedError, NotFoundError):
                etag = None
            if self.store.version(name) == version:  # so the ETag is that of this version
                return version, etag
        raise _restless(name)


def _restless(name: str) -> BusyError:
    return BusyError("changing", f"{name}: others change it all the time; try again later", where="name", retry_after=1)
