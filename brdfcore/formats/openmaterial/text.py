"""The JSON of an ASAM OpenMATERIAL 3D BRDF look-up table: parsed without trusting it, and written.

`{"metadata": {...}, "brdf": {"wavelengths": [m], "lookupTable": [[wavelength, theta_i, theta_o, phi, f], ...]}}`; the
schema is material_brdf_schema.json of the standard (version 1.0.0). The rows, nearly all of the file, are parsed as one
array of numbers; only the rest goes through a JSON parser, so that memory is a few times the file's size.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError

Float64Array = npt.NDArray[np.float64]

COLUMNS = ("wavelength", "theta_i", "theta_o", "phi", "f")
#: Bytes of the file beside its rows: far above any metadata.
_MOST_BESIDE = 4_000_000
_KEY = re.compile(rb'"lookupTable"\s*:\s*\[')
_END = re.compile(rb"\]\s*\]")
#: Where a text could hold the key, a file is tried at most this often.
_MOST_KEYS = 16
_NUMBER = re.compile(rb"-?(?:0|[1-9][0-9]{0,300})(?:\.[0-9]{1,400})?(?:[eE][+-]?[0-9]{1,6})?|null")
_CELL = re.compile(rb"[^\[\],\s]+")
_PIECE = 1 << 20
_BLANKS = bytes.maketrans(b"[]\t\r\n", b"     ")
_NOT_STRUCTURE = bytes(set(range(256)) - set(b"[],"))


@dataclass
class Rows:
    """rows (n, 5) as in the file, null is NaN; offset, the byte where they begin; content, the file without them."""

    rows: Float64Array
    offset: int
    content: dict[str, Any]


def bad(file: str, field: str, offset: int, reason: str, got: Any, expected: str, **context: Any) -> FileFormatError:
    """The error for one thing wrong: names file, field and byte offset."""
    return FileFormatError(
        "damaged_file",
        f"{file}: {field} at byte {offset}: {reason}; got {got}, expected {expected}",
        where=file,
        file=file,
        field=field,
        offset=offset,
        got=got,
        expected=expected,
        **context,
    )


def parse(data: bytes, file: str) -> Rows:
    """The rows and the rest of a file; `FileFormatError` naming file, field and byte offset."""
    for found, _ in zip(_KEY.finditer(data), range(_MOST_KEYS)):
        start = found.end() - 1  # the bracket
        closing = _closing(data, start, file)
        beside = data[: start + 1] + data[closing:]
        if len(beside) > _MOST_BESIDE:
            raise bad(file, "metadata", 0, "too much beside the rows", f"{len(beside)} bytes", f"{_MOST_BESIDE} bytes")
        content = _parsed(beside, file, start, closing - start - 1)
        brdf = content.get("brdf") if isinstance(content, dict) else None
        if isinstance(brdf, dict) and brdf.get("lookupTable") == []:
            return Rows(_numbers(data, start + 1, closing, file), start, content)
    content = _parsed(data[:_MOST_BESIDE], file, len(data), 0) if len(data) <= _MOST_BESIDE else None
    got = f"an object with {', '.join(map(str, content))}"[:120] if isinstance(content, dict) else "no object"
    raise bad(file, "brdf.lookupTable", 0, "the table is missing", got, 'an object with "brdf": {"lookupTable": [...]}')


def _closing(data: bytes, start: int, file: str) -> int:
    """Byte of the bracket that closes the array opened at `start`."""
    first = re.compile(rb"\s*\]").match(data, start + 1)
    if first is not None:  # an empty table
        return first.end() - 1
    end = _END.search(data, start)
    if end is None:
        raise _misplaced(data, start + 1, len(data), file)
    return end.end() - 1


def _parsed(beside: bytes, file: str, start: int, removed: int) -> Any:
    try:
        return json.loads(beside.decode("utf-8-sig"), parse_constant=_no_constant)
    except UnicodeDecodeError as error:
        raise bad(file, "text", error.start, "this is no UTF-8", hex(beside[error.start]), "UTF-8 text") from error
    except RecursionError as error:
        raise bad(file, "text", 0, "nested too deep", "more levels than any such file has", "4 levels") from error
    except ValueError as error:
        place = int(getattr(error, "pos", 0))
        place = place if place <= start else place + removed
        raise bad(file, "text", place, "this is no JSON", f"{error}"[:120], "JSON") from error


def _no_constant(name: str) -> Any:
    raise ValueError(f"{name} is no JSON number")


def _numbers(data: bytes, start: int, end: int, file: str) -> Float64Array:
    """(n, 5) numbers of the rows between `start` and `end`, null as NaN."""
    part = data[start:end]
    brackets = part.translate(None, _NOT_STRUCTURE)
    count = brackets.count(b"[")
    if brackets != b",".join([b"[,,,,]"] * count) or not _plain(part):
        raise _misplaced(data, start, end, file)
    if not count:
        raise bad(file, "brdf.lookupTable", start, "the table is empty", "no rows", "at least one row of 5 numbers")
    found = np.empty(5 * count)
    at = got = 0
    while at < len(part):  # in pieces: a list of numbers takes twenty times their bytes
        stop = part.find(b"]", at + _PIECE)
        stop = len(part) if stop < 0 else stop + 1
        words = part[at:stop].replace(b"null", b"nan").translate(_BLANKS).strip(b" ,").split(b",")
        try:
            if got + len(words) > found.size:
                raise ValueError
            found[got : got + len(words)] = [float(word) for word in words]
        except ValueError:
            raise _misplaced(data, start, end, file) from None
        got += len(words)
        at = stop
    if got != 5 * count:
        raise _misplaced(data, start, end, file)
    infinite = np.isinf(found)
    if infinite.any():
        place = int(np.flatnonzero(infinite)[0])
        raise bad(
            file, f"brdf.lookupTable[{place // 5}], {COLUMNS[place % 5]}", offset_of(data, start, place),
            "beyond the numbers of float64", str(found[place]), "a finite number", row=place // 5,
        )  # fmt: skip
    return found.reshape(-1, 5)


def _plain(part: bytes) -> bool:
    """Whether nothing but numbers, null, brackets, commas and blanks stands in the rows."""
    return not part.replace(b"null", b"").translate(None, b"0123456789+-.eE[], \t\r\n")


def offset_of(data: bytes, start: int, cell: int) -> int:
    """Byte of number `cell` of the rows that begin at `start`, counted through all rows."""
    for k, found in enumerate(_CELL.finditer(data, start)):
        if k == cell:
            return found.start()
    return start


def _misplaced(data: bytes, start: int, end: int, file: str) -> FileFormatError:
    """The error for the first thing in the rows that is no [number, number, number, number, number]."""
    depth, column, row, at = 0, 0, 0, start
    token = re.compile(rb'\s*([\[\],]|"(?:[^"\\]|\\.)*"|[^\[\],\s"]+|")')
    expect_value = False
    while at < end:
        found = token.match(data, at, end)
        if found is None:
            break
        word, place = found.group(1), found.start(1)
        name = f"brdf.lookupTable[{row}]"
        if word == b"[":
            if depth:
                return bad(file, name, place, "an array inside a row", "'['", "5 numbers a row", row=row)
            depth, column, expect_value = 1, 0, True
        elif word == b"]" and not depth:
            return bad(file, name, place, "the table ends after a comma", "']'", "a row", row=row)
        elif word == b"]":
            if expect_value or column != 4:
                return bad(file, name, place, "a row of another length", column + (not expect_value), "5", row=row)
            depth, row = 0, row + 1
        elif word == b",":
            if depth and expect_value:
                return bad(file, name, place, "a number is missing", "','", COLUMNS[min(column, 4)], row=row)
            if depth:
                column, expect_value = column + 1, True
                if column > 4:
                    return bad(file, name, place, "more than 5 numbers in a row", column + 1, "5", row=row)
        else:
            shown = repr(word[:40].decode("latin-1"))
            if not depth or not expect_value or _NUMBER.fullmatch(word) is None:
                expected = "[" if not depth else "a number or null" if expect_value else ", or ]"
                place_name = f"{name}, {COLUMNS[min(column, 4)]}" if depth else name
                return bad(file, place_name, place, "not what belongs here", shown, expected, row=row)
            expect_value = False
        at = found.end()
    if depth or end == len(data):
        got = repr(data[-40:].decode("latin-1"))
        return bad(
            file, f"brdf.lookupTable[{row}]", end, "the file ends inside the table", got, "]] after the last row"
        )
    return bad(file, "brdf.lookupTable", at, "the rows are not separated by commas", f"{row} rows", "[...], [...]")


def compose(content: dict[str, Any], rows: Float64Array) -> bytes:
    """The text of a file: `content` (whose brdf has no lookupTable), its rows last, one a line, NaN as null; numbers in
    the shortest form that reads back as the same."""
    beside = dict(content)
    brdf = {**beside.pop("brdf"), "lookupTable": []}
    head = json.dumps({**beside, "brdf": brdf}, indent=1, ensure_ascii=False, allow_nan=False)
    opening, closing = head.rsplit("[]", 1)
    # only NaN differs from itself
    lines = [
        f"[{'null' if w != w else repr(w)},{i!r},{o!r},{p!r},{'null' if v != v else repr(v)}]"
        for w, i, o, p, v in rows.tolist()
    ]
    return (opening + "[\n" + ",\n".join(lines) + "\n]" + closing + "\n").encode()
