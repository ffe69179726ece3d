"""Changes to materials: whole or not at all, and only if the material is what the caller thinks it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from brdf_service.http.caching import etag_of_material, held_tags
from brdf_service.http.errors import ConflictError, MaterialDamagedError, NotFoundError, PreconditionError
from brdf_service.library.folder import NAME
from brdf_service.library.materials import Library
from starlette.datastructures import Headers

import brdfcore as bc


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
        text = "name: expected 1 to 64 letters, digits, dots, hyphens or underscores, the first a letter or digit"
        raise bc.InputError("bad_name", text, where="name", got=name[:80], expected=NAME.pattern)


class Store:
    """Writes materials. Every method reads or writes files and belongs off the event loop."""

    def __init__(self, library: Library) -> None:
        self.library, self.folder = library, library.folder

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
            text = f"{name}: {what}; ask for it again and send its present ETag as If-Match"
            raise PreconditionError("changed", text, where="If-Match", expected=etag or "no If-Match")
        if exists and condition.match is None:
            text = f"{name}: exists; send If-Match with its ETag (or *) to replace or delete it"
            raise ConflictError("exists", text, where="If-Match", expected=etag or "*")
        return exists

    def put_model(self, name: str, model: bc.Brdf, condition: Condition) -> bool:
        """Store a model as NAME.json; True if it replaced something."""
        with self.folder.new_file() as temporary:
            bc.write(model, temporary, "model")
            return self.place(name, temporary, ".json", condition)

    def place(self, name: str, source: Path, suffix: str, condition: Condition) -> bool:
        """Move a finished file of the data folder to NAME + suffix; True if it replaced a material of that name."""
        check_name(name)
        with self.folder.changing():
            replaced = self.check(name, condition)
            self.folder.place(name, source, suffix)
            return replaced

    def delete(self, name: str, condition: Condition) -> None:
        """Remove a material. Raises `NotFoundError` if there is none."""
        with self.folder.changing():
            if not self.check(name, condition):
                self.library.get(name)  # says what there is instead
            self.folder.remove(name)

    def copy(self, name: str, into: Path) -> Path:
        """A copy of the material's file as it is now, in another folder. Raises `NotFoundError` if there is none."""
        made = self.folder.copy(name, into)
        if made is None:
            raise self.library.unknown(name)
        return made

    def _state(self, name: str) -> tuple[bool, str | None]:
        """Whether the material exists, and its ETag if it can be read."""
        try:
            return True, etag_of_material(name, self.library.get(name).tag)
        except MaterialDamagedError:
            return True, None
        except NotFoundError:
            return False, None
