"""Where materials lie: one interface, so that a folder and a store of objects serve alike."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import brdfcore as bc

NAME = re.compile(bc.names.MATERIAL_NAME)

Kind = Literal["table", "model"]
#: Each kind by its file name's end.
SUFFIXES: dict[str, Kind] = {".h5": "table", ".json": "model"}


class File(NamedTuple):
    """The file of a material; `stamp` tells its states apart."""

    path: str
    kind: Kind
    stamp: tuple[int, ...]


class Names(NamedTuple):
    """What is in a store: the sorted names of its materials, and of what may become one; `measured` file names by the
    names that they would have; `skipped` files that cannot be addressed; `twice` names of two materials."""

    all: list[str]
    measured: dict[str, str]
    skipped: list[str]
    twice: list[str]


class ChangedError(Exception):
    """The material is in another state than the one that was to be changed."""


class Store(ABC):
    """Materials by name. All methods may be called from several threads; `StorageError` where the store itself cannot
    be read or written. Only `same`, `find` and `close_to` may be called in the event loop."""

    @abstractmethod
    def names(self) -> Names:
        """All names as they are now. The lists are shared: nobody changes them."""

    @abstractmethod
    def close_to(self, name: str) -> list[str]:
        """Up to three names like this one among those known already, in a bounded time."""

    @abstractmethod
    def version(self, name: str) -> Any:
        """The present state of a material, to compare and to hand to `put` and `delete`; None if there is none."""

    @abstractmethod
    def find(self, name: str) -> File | None:
        """The file of a material, None if there is none; `MaterialDamagedError` if two files claim the name."""

    @abstractmethod
    def stamp(self, file: str) -> tuple[int, ...]:
        """What tells the states of a measured file apart; () if it is gone."""

    @abstractmethod
    def same(self, file: File) -> bool:
        """Whether a file that `find` gave is in that state still, by one look at it."""

    @abstractmethod
    def put(self, name: str, source: Path, suffix: str, expected: Any) -> File:
        """Move a finished file out of `scratch` to this name. `ChangedError`, and nothing is changed, unless `version`
        is the expected one."""

    @abstractmethod
    def delete(self, name: str, expected: Any) -> None:
        """Remove a material. `ChangedError`, and nothing is changed, unless `version` is the expected one."""

    @abstractmethod
    def scratch(self) -> AbstractContextManager[Path]:
        """A new folder for files that are not finished, removed in the end."""

    @abstractmethod
    def fetch(self, name: str, into: Path) -> Path | None:
        """A copy of a material's file as it is now, or of a measured file, under its own name; None if there is
        none."""

    @abstractmethod
    def put_record(self, key: str, content: bytes) -> None:
        """Keep some bytes about a job, in place of those of that key."""

    @abstractmethod
    def record(self, key: str) -> bytes | None:
        """The bytes of that key."""

    @abstractmethod
    def records(self, most: int) -> Iterator[bytes]:
        """The newest records, newest first."""

    @abstractmethod
    def failed(self, error: OSError) -> bc.StorageError:
        """What is said where a file of `scratch` cannot be written."""

    @abstractmethod
    def clean(self) -> None:
        """Remove what processes that were killed left behind, and records that are old."""
