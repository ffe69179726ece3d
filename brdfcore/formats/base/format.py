"""What every file format is: recognised by content, read to a `Brdf` with a report, perhaps written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError, LimitError, StorageError
from brdfcore.base.parameters import Parameter


def read_bytes(path: Path, most: int) -> bytes:
    """A file as a whole. `LimitError` above `most` bytes, before any is read; `StorageError` if it can't be opened."""
    try:
        size = path.stat().st_size
        data = path.read_bytes() if size <= most else b""
    except OSError as error:
        reason = error.strerror or str(error)
        raise StorageError("cannot_open", f"{path}: {reason}", where=str(path), got=reason) from error
    if size > most:
        raise LimitError(
            "file_too_large",
            f"{path.name}: {size} bytes; at most {most} are read",
            where=path.name,
            got=size,
            limit=most,
        )
    return data


class LossWarning(UserWarning):
    """A format can't hold everything of the material that was written; the text says what is missing or changed."""


class Format(ABC):
    """A file format. Instances hold nothing; `io` calls `sniff`, `read` and `write`.

    A reader declares the conventions of its source and says in `brdf.report` what it found and did. The
    report's shared keys: `format`, `file`, `sha256`, `bytes`, `conventions` (text by topic), `found` (counts
    and ranges), `done` (list of sentences: every change to the data), `warnings` (list of sentences).
    """

    name: ClassVar[str]
    SUMMARY: ClassVar[str] = ""
    REFERENCE: ClassVar[str] = ""
    EXTENSIONS: ClassVar[tuple[str, ...]] = ()
    #: Options of `read`.
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    #: Options of `write`.
    WRITE_PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    writable: ClassVar[bool] = False
    #: Whether what it writes reads to the same answers; False for a layout that samples anew.
    #: Either way, a file that was read and is written again has the same answers.
    exact: ClassVar[bool] = True

    @abstractmethod
    def sniff(self, head: bytes) -> bool:
        """True if a file that begins with `head` (its first 16,384 bytes or fewer) is of this format."""

    def may_be(self, name: str, head: bytes, options: Iterable[str]) -> bool:
        """Asked of a file called `name` that no format's `sniff` knows: whether this one reads it, seeing the names of
        the options that the reader was given."""
        return False

    def can_write(self, brdf: Brdf) -> bool:
        """Whether `write` takes this kind of material; asked where several formats share an extension."""
        return self.writable

    def keeps_every_bit(self, brdf: Brdf) -> bool:
        """Whether what `write` makes of this material reads to the same answers; asked where that is not clear by
        `exact`."""
        return self.exact

    @abstractmethod
    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file. `FileFormatError` names file, field and offset; `StorageError` if it can't be opened."""

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf | None:
        """Write `brdf` by `base.atomic.write_file`, with `read` as its check, and return what that read.

        `InputError` if this format can't hold it, a `LossWarning` for each thing that is left out.
        """
        raise InputError(
            "format_not_writable",
            f"format {self.name!r} can be read, not written",
            where="format",
            got=self.name,
        )
