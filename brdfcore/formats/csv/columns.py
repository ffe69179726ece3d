"""Which column of a text table is what: by its own header, or by options; never by a guess."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError
from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile, printable

#: Roles of columns that hold one number a row.
ROLES = ("theta_i", "phi_i", "theta_o", "phi_o", "delta_phi", "wavelength")
_OWN = re.compile(r"(theta_i|theta_o|delta_phi)_(deg|rad)")
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "": "blanks"}
_MAX_COLUMNS = 4_096


@dataclass(frozen=True)
class Columns:
    """A text table whose columns are known.

    table        (n, width) numbers; columns that nobody asked for are not read and hold 0.
    numbers      (n,) line of each row.
    places       index of the column of each role that has one.
    value_places, names   indices of the value columns; the header, [] without.
    spread_places   indices of the columns of their uncertainties, one a value column; [] without.
    angles, mirror, quantity   "deg" or "rad"; degrees; "f", "f_cos" or "pi_f".
    own_header   whether the header said so itself.
    """

    table: npt.NDArray[np.float64]
    numbers: npt.NDArray[np.int64]
    places: dict[str, int]
    value_places: list[int]
    names: list[str]
    angles: str
    mirror: float
    quantity: str
    own_header: bool
    separator: str
    header_line: int
    title: str
    spread_places: list[int]

    @property
    def width(self) -> int:
        return int(self.table.shape[1])

    def column(self, role: str) -> npt.NDArray[np.float64]:
        """The numbers of a role, 0 where it has no column."""
        place = self.places.get(role)
        return np.zeros(len(self.table)) if place is None else self.table[:, place]

    def values(self) -> npt.NDArray[np.float64]:
        return self.table[:, self.value_places]

    def uncertainty(self, text: TextFile) -> npt.NDArray[np.float64] | None:
        """Those columns, finite and not negative, or None."""
        if not self.spread_places:
            return None
        found = self.table[:, self.spread_places]
        bad = ~(np.isfinite(found) & (found >= 0)).all(axis=1)
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise text.bad(int(self.numbers[row]), "uncertainty", f"{found[row].tolist()}", "finite numbers >= 0")
        return found

    def value_names(self) -> list[str]:
        if not self.names:
            return ["value"] if len(self.value_places) == 1 else [f"column {k + 1}" for k in self.value_places]
        return [self.names[k] for k in self.value_places]

    def described(self) -> dict[str, str]:
        """{role: name or number of its column} for the report."""
        where = {role: [k] for role, k in self.places.items()} | {"value": self.value_places}
        where |= {"uncertainty": self.spread_places} if self.spread_places else {}
        return {
            role: " ".join(self.names[k] if self.names else str(k + 1) for k in places)
            for role, places in where.items()
        }


def split_list(text: str) -> list[str]:
    """ "[a,b]" or "a" as a list."""
    inner = text.strip()
    if inner.startswith("[") and inner.endswith("]"):
        inner = inner[1:-1]
    return [part.strip() for part in inner.split(",")]


def columns_of(text: TextFile, chosen: dict[str, Any]) -> Columns:
    """Read `text` with the options of the csv format; `FileFormatError` names the line, or the options that lack."""
    lines = [(k + 1, line.partition("#")[0].strip()) for k, line in enumerate(text.lines)]
    lines = [(number, line) for number, line in lines if line]
    comments = [line.strip("# \t") for line in text.lines if line.lstrip().startswith("#")]
    if not lines:
        raise text.bad(len(text.lines), "rows", "no rows", "rows of numbers")
    line, first = lines[0]
    separator = next((s for s in ",;\t" if s in first), "")
    names = _cells(first, separator)
    if len(names) > _MAX_COLUMNS:
        raise text.bad(line, "header", f"{len(names)} columns", f"at most {_MAX_COLUMNS}")
    numeric = all(_is_number(name) for name in names)
    header = [] if numeric else [printable(n.strip('"')) for n in names]
    places, values, unit, own = _placed(text, line, header, len(names), chosen)
    missing = _missing(places, values, unit, own, chosen)
    if missing:
        listed = ", ".join(header) if header else f"{len(names)} columns without names: give numbers from 1"
        raise FileFormatError(
            "columns_not_clear",
            f"{text.name}: line {line}: the header does not say everything; pass {', '.join(missing)}. "
            f"Columns: {listed[:400]}",
            where=missing[0].partition("=")[0],
            file=text.name,
            line=line,
            field=missing[0].partition("=")[0],
            expected=", ".join(missing),
        )
    spread = []
    if chosen["uncertainty"] is not None:
        listed_columns = split_list(chosen["uncertainty"])
        spread = [_place(text, line, "uncertainty", part, header, len(names)) for part in listed_columns]
        if len(spread) != len(values):
            raise text.bad(line, "uncertainty", f"{len(spread)} columns for {len(values)} of values", "one for each")
    rows = lines if numeric else lines[1:]
    used = sorted({*places.values(), *values, *spread})
    table, numbers = _numbers(text, rows, separator, len(names), used, header)
    _counted(text, comments, len(table))
    return Columns(
        table=table,
        numbers=numbers,
        places=places,
        value_places=values,
        names=header,
        angles=str(chosen["angles"] or unit),
        mirror=180.0 if chosen["mirror"] is None else float(chosen["mirror"]),
        quantity=str(chosen["quantity"] or "f"),
        own_header=own and all(chosen[k] is None for k in ("angles", "mirror", "quantity", "value", *ROLES)),
        separator=_SEPARATORS[separator],
        header_line=line,
        title=printable(comments[0])[:200] if comments else "",
        spread_places=spread,
    )


def _cells(line: str, separator: str) -> list[str]:
    return [c.strip() for c in line.split(separator)] if separator else line.split()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _placed(
    text: TextFile, line: int, header: list[str], width: int, chosen: dict[str, Any]
) -> tuple[dict[str, int], list[int], str | None, bool]:
    """(column of each role, value columns, unit of the angles, whether the header speaks for itself)."""
    places: dict[str, int] = {}
    units = set()
    for k, name in enumerate(header):
        if found := _OWN.fullmatch(name):
            places.setdefault(found[1], k)
            units.add(found[2])
    own = {"theta_i", "theta_o", "delta_phi"} <= set(places) and len(units) == 1
    if not own:
        places = {}
    for role in ROLES:
        if chosen[role] is not None:
            places[role] = _place(text, line, role, chosen[role], header, width)
    if chosen["value"] is not None:
        values = [_place(text, line, "value", part, header, width) for part in split_list(chosen["value"])]
    else:
        values = [k for k, name in enumerate(header) if name.startswith("f_r_")] if own else []
    if len(set(values)) < len(values):
        raise text.bad(line, "value", f"value={chosen['value']} names a column twice", "each column once")
    return places, values, units.pop() if own else None, own


def _place(text: TextFile, line: int, role: str, name: str, header: list[str], width: int) -> int:
    """Index of the column called `name`, or numbered so from 1."""
    if header.count(name) == 1:
        return header.index(name)
    if name.isascii() and name.isdigit() and len(name) < 6 and 1 <= int(name) <= width and name not in header:
        return int(name) - 1
    listed = ", ".join(header)[:400] if header else f"1 to {width}"
    why = "twice" if name in header else "not there"
    raise text.bad(line, role, f"{role}={name[:40]}: column {why}", f"one of: {listed}", "no_such_column")


def _missing(
    places: dict[str, int], values: list[int], unit: str | None, own: bool, chosen: dict[str, Any]
) -> list[str]:
    """The options that have to be given."""
    missing = [f"{role}=COLUMN" for role in ("theta_i", "theta_o") if role not in places]
    if "delta_phi" not in places and "phi_o" not in places:
        missing.append("phi_o=COLUMN (and phi_i=COLUMN) or delta_phi=COLUMN")
    if not values:
        missing.append("value=COLUMN")
    if unit is None and chosen["angles"] is None:
        missing.append("angles=deg or angles=rad")
    if not own and chosen["mirror"] is None:
        missing.append("mirror=180 (phi_o - phi_i of the mirror direction, or 0)")
    if not (own and chosen["value"] is None) and chosen["quantity"] is None:
        missing.append("quantity=f, f_cos or pi_f")
    return missing


def _numbers(
    text: TextFile, rows: list[tuple[int, str]], separator: str, width: int, used: list[int], header: list[str]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    if not rows:
        raise text.bad(len(text.lines), "rows", "no rows after the header", "rows of numbers")
    if len(rows) * width > MAX_NUMBERS:
        raise text.bad(rows[0][0], "rows", f"more than {MAX_NUMBERS} numbers", "a smaller file")
    table = np.zeros((len(rows), width))
    for k, (number, row) in enumerate(rows):
        cells = _cells(row, separator)
        if len(cells) != width:
            raise text.bad(number, "row", f"{len(cells)} fields", f"{width}, as the first line has")
        for place in used:
            table[k, place] = text.number(cells[place], number, header[place] if header else f"column {place + 1}")
    return table, np.array([number for number, _ in rows], np.int64)


def _counted(text: TextFile, comments: list[str], found: int) -> None:
    """Hold the rows to a comment "rows: n", as files written here have."""
    for number, comment in enumerate(comments, 1):
        if announced := re.fullmatch(r"rows: (\d{1,15})", comment):
            if int(announced[1]) != found:
                raise text.bad(number, "rows", f"{announced[1]} announced, {found} found", "as many rows")
            return
