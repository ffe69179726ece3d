"""The rows of a text table, whatever stands around them: separator, decimal comma, quotes, lines before the header or
between blocks of rows, matrices."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, field, replace
from typing import Any

from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile, printable
from brdfcore.formats.csv.blocks import Given, Matrix, Total, given, matrix, total, words_of
from brdfcore.formats.csv.header import meaning, spelled

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "": "blanks"}
#: What stands for "no value" in a cell, whatever column.
BLANK = frozenset({"", "-", "--", "---", "n/a", "na", "#n/a", "null", "none", "nan", "."})
#: Lines that may stand before the header, and cells of a row.
_BEFORE, MAX_COLUMNS = 200, 4_096
#: Lines of words that are looked at for what they say of the rows below, and stated totals that are kept.
_MOST_SAID, _MOST_TOTALS = 20_000, 200
#: Characters among which the table's begin is looked for, and what a name of a polar angle has in it.
_LOOKED_AT = 200_000
_HINT = re.compile("theta|angle|aoi|incidence|w[io][._ ]?x|light", re.I)


@dataclass(frozen=True)
class Rows:
    """Where a text table lies in its file.

    separator      "," ";" "\\t" or "" for blanks; `comma`: whether a comma is the decimal sign.
    names, line    the header, [] without, and its line (of the first row without).
    body           (line, text) of the rows.
    width          cells of a row.
    before         lines before the header that are neither blank nor a comment.
    comment        names in the last comment before the rows, where there are as many as columns.
    given          {role: number of each row} that lines above blocks of rows give, and the unit of these angles.
    values         indices of columns that hold values though their names don't say so: of a matrix.
    totals         (line, what it states, theta_i of its block as written) of lines that state a total.
    """

    separator: str
    comma: bool
    names: list[str]
    line: int
    body: list[tuple[int, str]]
    width: int
    before: int
    comment: list[str]
    given: dict[str, list[str]] = field(default_factory=dict)
    given_unit: str = ""
    values: tuple[int, ...] = ()
    totals: tuple[tuple[int, Total, str], ...] = ()

    def split(self, text: str) -> list[str]:
        """The cells of a row; empty ones beyond the width are separators that a spreadsheet left behind."""
        found = cells(text, self.separator)
        while len(found) > self.width and not found[-1]:
            found.pop()
        return found

    def decimal(self, cell: str) -> str:
        return cell.replace(",", ".", 1) if self.comma else cell


def cells(line: str, separator: str) -> list[str]:
    """The cells of a line, without their quotes."""
    if not separator:
        return [c.strip('"') for c in line.split()]
    if '"' in line:
        try:
            return [c.strip() for c in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
        except csv.Error:  # a quote within a cell
            pass
    return [c.strip() for c in line.split(separator)]


def rows_of(text: TextFile, asked: Any = None) -> Rows:
    """Find the table in a file; `FileFormatError` where there is none. `asked`: of a matrix, see `blocks.matrix`."""
    every = [spelled(line) for line in text.lines]
    worded = [k for k, line in enumerate(every) if words_of(line)][:_MOST_SAID]
    above = {k + 1: found for k in worded if (found := given(every[k])) is not None}
    totals = {k + 1: what for k in worded if (what := total(every[k])) is not None}
    lines = [(k + 1, line.partition("#")[0].rstrip(" ").lstrip(" ")) for k, line in enumerate(every)]
    lines = [(n, line) for n, line in lines if line.strip(" \t;,") and n not in above and n not in totals]
    if not lines:
        raise text.bad(len(text.lines), "rows", "no rows", "rows of numbers")
    roles = {role for found in above.values() for role in found.values}
    start, header, separator = _found(_first([line for _, line in lines]), roles, asked)
    at = start if header is None else header
    names = _trimmed(cells(lines[at][1], separator))
    if len(names) > MAX_COLUMNS:
        raise text.bad(lines[at][0], "header", f"{len(names)} columns", f"at most {MAX_COLUMNS}")
    body = lines[start:]
    comment: list[str] = []
    if header is None:
        said = [line.strip("# \t") for line in every[: lines[start][0] - 1] if line.lstrip().startswith("#")]
        comment = cells(said[-1], separator) if said else []
        comment = [printable(c) for c in comment] if len(comment) == len(names) else []
    elif body and header + 1 < start:  # a row of units
        units = _trimmed(cells(lines[header + 1][1], separator))
        names = [f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=True)]
    first = next((cells(line, separator) for _, line in body), [])
    comma = separator != "," and any(re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", c, re.I)
                                     for _, line in body[:50] for c in cells(line, separator))  # fmt: skip
    width = len(names) if header is not None else len(_trimmed(first))
    named = [] if header is None else [printable(n) for n in names]
    table = Rows(separator, comma, named, lines[at][0], body, width, at, comment)
    if above:
        if named:  # a block may repeat the header
            table = replace(table, body=[(n, line) for n, line in body if _trimmed(cells(line, separator)) != names])
        table = _with_given(table, above)
    if totals:
        table = replace(table, totals=_of_blocks(totals, above))
    shape = matrix(named, asked) if named else None
    if shape is None and asked is not None:
        raise text.bad(lines[at][0], "matrix", f"matrix={asked}, and no header of a name and angles above rows",
                       "such a header")  # fmt: skip
    if shape is None:
        return table
    if asked is None:  # the first cell may name the header's numbers; only viewers have angles of both signs
        header = any(angle.startswith("-") for angle in shape.angles)
        side = any(table.split(line)[0].startswith("-") for _, line in table.body)
        if header != side and (shape.columns == "theta_o") == side and "\\" not in named[0] and "/" not in named[0]:
            shape = shape.turned
    return _melted(text, table, shape)


def _of_blocks(totals: dict[int, Total], above: dict[int, Given]) -> tuple[tuple[int, Total, str], ...]:
    """Each total with the incidence that the last line above it gives, "" without."""
    found = []
    for number, what in totals.items():
        before = [n for n, line in above.items() if n < number and "theta_i" in line.values]
        found.append((number, what, above[max(before)].values["theta_i"] if before else ""))
    return tuple(found[:_MOST_TOTALS])


def _with_given(table: Rows, above: dict[int, Given]) -> Rows:
    """`table` with what the lines `above` give to each of its rows; a role that lacks above the first row is left out,
    and so is a wavelength that is the same everywhere."""
    state: dict[str, str] = {}
    units: set[str] = set()
    columns: dict[str, list[str]] = {}
    waiting = sorted(above)
    for count, (number, _) in enumerate(table.body):
        while waiting and waiting[0] < number:
            found = above[waiting.pop(0)]
            state |= found.values
            units |= {found.unit} - {""}
        for role, value in state.items():
            columns.setdefault(role, [value] * count if not count else []).append(value)
    full = {role: column for role, column in columns.items() if len(column) == len(table.body)}
    if len(set(full.get("wavelength", []))) == 1:
        del full["wavelength"]
    return replace(table, given=full, given_unit=units.pop() if len(units) == 1 else "")


def _melted(text: TextFile, table: Rows, shape: Matrix) -> Rows:
    """A row for each cell of a matrix."""
    if 3 * len(table.body) * len(shape.angles) > MAX_NUMBERS:
        raise text.bad(table.line, "matrix", f"more than {MAX_NUMBERS // 3} cells", "a smaller file")
    body, columns = [], {role: list[str]() for role in table.given}
    for k, (number, line) in enumerate(table.body):
        found = table.split(line)
        if len(found) != table.width:
            raise text.bad(number, "row", f"{len(found)} fields", f"{table.width}, as the header has")
        for angle, cell in zip(shape.angles, found[1:], strict=True):
            body.append((number, f"{table.decimal(found[0])}\t{angle}\t{table.decimal(cell) or 'nan'}"))
        for role, column in columns.items():
            column += [table.given[role][k]] * len(shape.angles)
    unit = f"_{shape.unit}" if shape.unit else ""
    names = [shape.rows + unit, shape.columns + unit, "values"]
    return replace(table, separator="\t", comma=False, names=names, body=body, width=3, given=columns, values=(2,))


def has_table(head: str) -> bool:
    """Whether a table stands anywhere in the first lines of a file: two rows of three or more numbers, or a header that
    names both polar angles."""
    lines = [line.partition("#")[0].strip(" ") for line in head.splitlines()[:-1]]
    lines = [line for line in lines if line.strip(" \t;,")]
    lines = _first(lines)
    return bool(lines) and (_named(lines) is not None or _first_rows(lines) is not None)


def _first(lines: list[str]) -> list[str]:
    """The lines among which the table has to begin."""
    total = 0
    kept: list[str] = []
    for line in lines[: _BEFORE + 2]:
        total += len(line)
        if kept and total > _LOOKED_AT:
            break
        kept.append(line)
    return kept


def _trimmed(found: list[str]) -> list[str]:
    found = list(found)
    while len(found) > 1 and not found[-1]:
        found.pop()
    return found


def _found(lines: list[str], given: set[str], asked: Any) -> tuple[int, int | None, str]:
    """(index of the first row, of the header or None, separator) of the first table among `lines`, where the roles
    `given` stand above blocks."""
    named = _named(lines, given) or _matrix_header(lines, asked)
    if named is not None:
        return _after(lines, *named), *named
    best = _first_rows(lines, 2 if given else 3)
    if best is None:  # no rows: whatever stands first is the header
        first = next((s for s in (",", ";", "\t") if s in lines[0]), "")
        width, numbers = _numeric(lines[0], first)
        return (0, None, first) if width == numbers else (1, 0, first)
    start, separator = best
    width = _numeric(lines[start], separator)[0]
    for header in (start - 1, start - 2):
        if header < 0:
            break
        above = _trimmed(cells(lines[header], separator))
        if len(above) < min(width, 3) or len(above) > width + 1:
            break
        upper = _trimmed(cells(lines[header - 1], separator)) if header else []
        if header == start - 1 and _are_units(above) and len(upper) == len(above):
            continue
        return start, header, separator
    return start, None, separator


def _named(lines: list[str], given: set[str] = frozenset()) -> tuple[int, str] | None:  # type: ignore[assignment]
    """(index, separator) of a header that names both polar angles but those `given`, half and difference angle, or both
    vectors: it is one, whatever follows."""
    wanted = [{"theta_i", "theta_o"} - given, {"theta_h", "theta_d"}, {"wi_x", "wo_x"}]
    for k, line in enumerate(lines):
        if _HINT.search(line):
            for separator in SEPARATORS:
                roles = {meaning(c).role for c in cells(line, separator)[:MAX_COLUMNS]}
                if any(names and names <= roles for names in wanted) and len(roles) > 1:
                    return k, separator
    return None


def _matrix_header(lines: list[str], asked: Any) -> tuple[int, str] | None:
    """(index, separator) of the header of a matrix: numbers alone below it, as many."""
    for k, line in enumerate(lines[:-1]):
        for separator in SEPARATORS:
            if separator and separator not in line:
                continue
            names = _trimmed(cells(line, separator))[:MAX_COLUMNS]
            width, numbers = _numeric(lines[k + 1], separator)
            if width == len(names) and 2 * numbers >= width and matrix(names, asked) is not None:
                return k, separator
    return None


def _first_rows(lines: list[str], least: int = 3) -> tuple[int, str] | None:
    """(index, separator) of the first of two rows of `least` or more numbers and as many cells."""
    best: tuple[int, str] | None = None
    for separator in (";", "\t", ",", ""):
        kinds = [_numeric(line, separator) for line in lines]
        for k, (width, numbers) in enumerate(kinds):
            if best is not None and k >= best[0]:
                break
            following = kinds[k + 1] if k + 1 < len(kinds) else (width, numbers)
            if numbers < least or following[0] != width or following[1] < least:
                continue
            if following[1] <= numbers or not _words_above(lines[k], lines[k + 1], separator):
                best = k, separator
                break
    return best


def _words_above(line: str, below: str, separator: str) -> bool:
    """Whether a name stands in `line` where there is a number below it: a header of numbers with one name."""
    pairs = zip(cells(line, separator), cells(below, separator), strict=False)
    return any(a.lower() not in BLANK and not _is_number(a, separator) and _is_number(b, separator) for a, b in pairs)


def _after(lines: list[str], header: int, separator: str) -> int:
    """Index of the first row below a header: a row of units is none."""
    if header + 1 < len(lines):
        below = _trimmed(cells(lines[header + 1], separator))
        if _are_units(below) and len(below) == len(_trimmed(cells(lines[header], separator))):
            return header + 2
    return header + 1


def _are_units(found: list[str]) -> bool:
    known = re.compile(r"[\[(]?(deg|degrees?|rad|radians?|1/sr|sr-1|sr\^-1|nm|um|%|-|)[\])]?", re.I)
    return any(re.search("[a-z]", c, re.I) for c in found) and all(known.fullmatch(c) for c in found)


def _numeric(line: str, separator: str) -> tuple[int, int]:
    """(cells, how many of them are numbers) of a line."""
    found = _trimmed(cells(line, separator))
    return len(found), sum(_is_number(c, separator) for c in found)


def _is_number(cell: str, separator: str) -> bool:
    try:
        float(cell.replace(",", ".", 1) if separator != "," else cell)
    except ValueError:
        return False
    return True
