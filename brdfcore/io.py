"""Read and write files of any registered format, told apart by their content."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from brdfcore.brdf import Brdf
from brdfcore.errors import FileFormatError, InputError, StorageError
from brdfcore.formats.base import Format
from brdfcore.registry import FORMATS

_HEAD = 4096


def sniff(path: str | PathLike[str]) -> str:
    """Name of the format of a file, by its first 4,096 bytes; file names are not trusted.

    Raises `StorageError` if the file can't be opened, `FileFormatError` if no format knows it.
    """
    path = Path(path)
    head = _head(path)
    if not head:
        raise FileFormatError("empty_file", f"{path.name}: the file is empty", where=path.name, offset=0)
    for name in FORMATS.names():
        if _format(name).sniff(head):
            return name
    raise FileFormatError(
        "unknown_format",
        f"{path.name}: no known format begins with {head[:16]!r}; known: {', '.join(FORMATS.names())}",
        where=path.name,
        offset=0,
        got=repr(head[:16]),
        expected=", ".join(FORMATS.names()),
    )


def read(path: str | PathLike[str], format: str | None = None, **options: Any) -> Brdf:
    """Read a measured file or a table; `b.report` says what was found and done.

    format   registry name; None sniffs the content.
    options  the format's own, e.g. `negatives="zero"` for "rgl" (see `brdfcore.formats()`).
    """
    path = Path(path)
    if format is None:
        format = sniff(path)
    else:
        _head(path)  # the same clear error for a missing file
    return _format(format).read(path, **options)


def write(brdf: Brdf, path: str | PathLike[str], format: str | None = None) -> None:
    """Write `brdf` in a format; None chooses it by the path's extension. The file appears whole or not at all."""
    path = Path(path)
    if format is None:
        matches = [n for n in FORMATS.names() if _format(n).writable and path.suffix.lower() in _format(n).EXTENSIONS]
        if len(matches) != 1:
            known = {n: _format(n).EXTENSIONS for n in FORMATS.names() if _format(n).writable}
            listed = ", ".join(f"{n} ({' '.join(e)})" for n, e in known.items())
            raise InputError(
                "format_not_clear",
                f"{path.name}: which format? {'several' if matches else 'none'} end in {path.suffix or 'nothing'!r}; "
                f"pass format=, one of: {listed}",
                where="format",
                got=path.suffix,
                expected=listed,
            )
        format = matches[0]
    _format(format).write(brdf, path)


def _format(name: str) -> Format:
    made: Format = FORMATS.load(name)()
    return made


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        raise StorageError(
            "cannot_open", f"{path}: {error.strerror or error}", where=str(path), got=error.strerror
        ) from error
