"""Read and write files of any registered format, told apart by their content."""

from __future__ import annotations

import stat
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import FileFormatError, InputError, StorageError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.base.registry import FORMATS
from brdfcore.formats.base.foreign import refuse_foreign
from brdfcore.formats.base.format import Format

#: Bytes that a file is told by: comments before the first line of data may be long.
_HEAD = 16_384


def sniff(path: str | PathLike[str], options: Iterable[str] = ()) -> str:
    """Name of the format of a file, by its first 16,384 bytes.

    options  names of the options that it is to be read with: what names columns says that it is text. Where the bytes
             leave it open, that and the end of the file's name (.csv, .txt, .dat) decide; else names are not trusted.

    Raises `StorageError` if the file can't be opened, `FileFormatError` if no format knows it; that error names the
    kinds of file that are recognised and not read, and says what to do with them.

    >>> [bc.sniff(path) for path in bc.example_files(".")]
    ['model', 'csv', 'rgl']
    """
    path = Path(path)
    head = _head(path)
    if not head:
        raise FileFormatError("empty_file", f"{path.name}: the file is empty", where=path.name, offset=0)
    for name in FORMATS.names():
        if _format(name).sniff(head):
            return name
    named = tuple(options)
    for name in FORMATS.names():
        if _format(name).may_be("", head, named):
            return name
    refuse_foreign(head, path.name)
    for name in FORMATS.names():
        if _format(name).may_be(path.name, head, ()):
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

    >>> truth, scan, grid = (bc.read(path) for path in bc.example_files("."))
    >>> scan.report["format"], list(scan.channels), grid.report["found"]["angles covered"]
    ('csv', ['R', 'G', 'B'], 'theta_i 0 to 85 degrees; every theta_o and delta_phi')
    """
    path = Path(path)
    if format is None:
        format = sniff(path, options)
    else:
        _head(path)  # the same clear error for a missing file
    return _format(format).read(path, **options)


def write(brdf: Brdf, path: str | PathLike[str], format: str | None = None, **options: Any) -> Brdf:
    """Write `brdf` in a format; None chooses it by the path's extension. What was read back, before it took the place
    of a file of that name: it appears whole and readable or not at all (`base.atomic.write_file`).

    options  the format's own (its `WRITE_PARAMETERS`), e.g. `grid="angles"` for "openmaterial".

    >>> stored = bc.write(bc.model("lambert", reflectance=0.5), "white.json")
    >>> bc.read("white.json").evaluate(0.3, 0.2, 1.0).round(6)
    array([0.159155])
    """
    path = Path(path)
    format = format_for(brdf, path, format)
    entry = _format(format)
    if options:  # checked here, so that a format without any need not
        resolve(f"writing format {format!r}", entry.WRITE_PARAMETERS, options)
    return entry.write(brdf, path, **options) or entry.read(path)


def format_for(brdf: Brdf, path: str | PathLike[str], format: str | None = None) -> str:
    """The format that `write` would choose for `brdf` and `path`: of those with its extension the one that can hold
    the material; of several the one that keeps every bit. `InputError` where that leaves none or several."""
    if format is not None:
        _format(format)  # the error for an unknown name, before any work
        return format
    suffix = Path(path).suffix.lower()
    writable = [n for n in FORMATS.names() if _format(n).writable]
    matches = [n for n in writable if suffix in _format(n).EXTENSIONS]
    if len(matches) > 1:
        matches = [n for n in matches if _format(n).can_write(brdf)] or matches
        matches = [n for n in matches if _format(n).keeps_every_bit(brdf)] or matches
    if len(matches) != 1:
        listed = ", ".join(f"{n} ({' '.join(_format(n).EXTENSIONS)})" for n in writable)
        raise InputError(
            "format_not_clear",
            f"{Path(path).name}: which format? {'several' if matches else 'none'} end in {suffix or 'nothing'!r}; "
            f"name it (format=, in the shell --to), one of: {listed}",
            where="format",
            got=suffix,
            expected=listed,
        )
    return matches[0]


def read_options(format: str) -> tuple[Parameter, ...]:
    """What `read` takes for a format."""
    return _format(format).PARAMETERS


def write_options(format: str) -> tuple[Parameter, ...]:
    """What `write` takes for a format."""
    return _format(format).WRITE_PARAMETERS


def _format(name: str) -> Format:
    made: Format = FORMATS.load(name)()
    return made


def _head(path: Path) -> bytes:
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # to open a FIFO would wait for ever
            said = f"{path}: is {'a folder' if path.is_dir() else 'no regular file'}; save what it holds as a file"
            raise StorageError("cannot_open", said, where=str(path), got="no regular file")
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        if isinstance(error, StorageError):
            raise
        raise StorageError(
            "cannot_open", f"{path}: {error.strerror or error}", where=str(path), got=error.strerror
        ) from error
