"""Read text files of numbers: bounded memory, and every complaint with file, line and field."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from brdfcore.base.errors import FileFormatError
from brdfcore.formats.base.format import read_bytes

#: Largest file and longest line read, bytes; most lines, and numbers kept of a file: together below 200 MB of memory.
#: Real files have a few MB and lines of 1 kB.
MAX_BYTES, MAX_LINE, MAX_LINES, MAX_NUMBERS = 32_000_000, 100_000, 200_000, 4_000_000
#: What `str.splitlines` takes for the end of a line, of one byte.
_BREAKS = (b"\n", b"\r", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e")


def printable(text: str) -> str:
    """`text` in ASCII, other bytes and control characters as \\x1b: safe on a terminal and in a report."""
    plain = text.encode("ascii", "backslashreplace").decode()
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in plain)


def decoded(raw: bytes) -> bytes:
    """Text as spreadsheets save it in UTF-16, with a byte order mark or plain ASCII without, as UTF-8; any other as it
    is. What is no UTF-16 stays, so that its zero bytes are seen."""
    codec = ""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        codec = "utf-16"
    elif len(raw) >= 8 and not any(raw[1:200:2]) and all(raw[:200:2]):
        codec = "utf-16-le"
    elif len(raw) >= 8 and not any(raw[:200:2]) and all(raw[1:200:2]):
        codec = "utf-16-be"
    if not codec:
        return raw
    try:
        return raw[: len(raw) // 2 * 2].decode(codec).encode()
    except UnicodeError:
        return raw


class TextFile:
    """The lines of a small text file, numbered from 1.

    Raises `StorageError` if it can't be opened, `LimitError` if it is larger than `MAX_BYTES`, `FileFormatError` if it
    is empty, no text, has more than `MAX_LINES` lines or one longer than `MAX_LINE`, or ends within a line: a file cut
    short inside its last number would still read.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name
        raw = read_bytes(path, MAX_BYTES)
        self.bytes, self.sha256 = len(raw), hashlib.sha256(raw).hexdigest()
        raw = decoded(raw)
        if not raw.strip():
            raise self.bad(1, "", "the file is empty", "text")
        self._check(raw)
        self.lines = raw.removeprefix(b"\xef\xbb\xbf").decode("ascii", errors="surrogateescape").splitlines()
        if raw[-1:] not in b"\r\n":
            raise self.bad(
                len(self.lines),
                "",
                "ends within a line, so its last number may be cut; a whole file ends with a line break",
                "a line break",
            )

    def _check(self, raw: bytes) -> None:
        """Refuse what is no text, and lines no real file has, before anything is made of them."""
        place = raw.find(b"\0")
        if place >= 0:
            raise self.bad(raw.count(b"\n", 0, place) + 1, "", f"a zero byte at offset {place}: no text", "text")
        count = sum(raw.count(end) for end in _BREAKS)
        if count > MAX_LINES:
            raise self.bad(MAX_LINES, "", f"{count} lines in all", f"at most {MAX_LINES}")
        start = 0
        for number, piece in enumerate(_pieces(raw), 1):
            if piece > MAX_LINE:
                raise self.bad(number, "", f"{piece} bytes long, from offset {start}", f"at most {MAX_LINE} bytes")
            start += piece

    @property
    def source(self) -> dict[str, Any]:
        return {"sha256": self.sha256, "bytes": self.bytes}

    def bad(self, line: int, field: str, got: str, expected: str, code: str = "bad_row") -> FileFormatError:
        got, expected, field = printable(got), printable(expected), printable(field)
        place = f"line {line}" + (f", {field}" if field else "")
        return FileFormatError(
            code,
            f"{self.name}: {place}: {got}; expected {expected}",
            where=field or self.name,
            file=self.name,
            line=line,
            field=field,
            got=got,
            expected=expected,
        )

    def number(self, text: str, line: int, field: str) -> float:
        """A decimal number; "nan" is one, as the mark of a missing value."""
        try:
            if "_" in text:  # Python's digit groups are no number in a file
                raise ValueError
            return float(text)
        except ValueError:
            shown = text.strip()
            shown = repr(shown if len(shown) <= 40 else shown[:37] + "...") if shown else "nothing"
            raise self.bad(line, field, f"{shown} is no number", "a number") from None


def _pieces(raw: bytes) -> Iterator[int]:
    """Lengths of the lines, their breaks included."""
    start = 0
    while start < len(raw):
        end = raw.find(b"\n", start)
        end = len(raw) if end < 0 else end + 1
        yield end - start
        start = end
