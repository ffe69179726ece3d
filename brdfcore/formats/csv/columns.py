"""Which column of a text table is what: by its own header, or by options; never by a guess."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError
from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile, printable
from brdfcore.formats.csv.geometry import HALF, VECTORS, from_half, from_vectors
from brdfcore.formats.csv.header import meaning, wavelengths
from brdfcore.formats.csv.rows import BLANK, SEPARATORS, Rows, rows_of

#: Roles of columns that hold one number a row.
ROLES = ("theta_i", "phi_i", "theta_o", "phi_o", "delta_phi", *HALF, "wavelength", *VECTORS)
_ANGLES = ROLES[:8]


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
    in_plane     whether there is no azimuth: theta_o > 0 lies on the mirror side, theta_o < 0 on the light's.
    turned       "" for columns of polar angles and azimuths; "half and difference angles" or "vectors", made these.
    done         sentences about that.
    totals       (line, total reflectance that it states, theta_i in degrees or None).
    wavelength_unit   that the header of the wavelength column names, "" without.
    before       lines before the header.
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
    in_plane: bool
    wavelength_unit: str
    before: int
    separator: str
    header_line: int
    title: str
    spread_places: list[int]
    turned: str = ""
    done: tuple[str, ...] = ()
    totals: tuple[tuple[int, float, float | None], ...] = ()

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
        count = len(self.names)
        elsewhere = f"from {self.turned}" if self.turned else "a line above the rows"
        return {
            role: " ".join(self.names[k] if k < count else elsewhere if count or self.turned else str(k + 1)
                           for k in places)
            for role, places in where.items()
        }  # fmt: skip


def split_list(text: str) -> list[str]:
    """ "[a,b]" or "a" as a list."""
    inner = text.strip()
    if inner.startswith("[") and inner.endswith("]"):
        inner = inner[1:-1]
    return [part.strip() for part in inner.split(",")]


def columns_of(text: TextFile, chosen: dict[str, Any]) -> Columns:
    """Read `text` with the options of the csv format; `FileFormatError` names the line, or the options that lack."""
    rows = rows_of(text, chosen["matrix"])
    comments = [line.strip("# \t") for line in text.lines if line.lstrip().startswith("#")]
    header = rows.names
    said = _Said.of(header, rows.given_unit)
    places, values = _placed(text, rows, said, chosen)
    kind = _kind(places)
    unused = {*HALF, *VECTORS} if not kind else {*_ANGLES, *VECTORS} - {*_KINDS[kind]}
    places = {role: k for role, k in places.items() if role not in unused}
    in_plane = not kind and not {"delta_phi", "phi_o"} & set(places) and _signed(rows, places)
    negative = any(
        cell.startswith("-") and cell not in BLANK for _, line in rows.body[:200] for cell in rows.split(line)
    )
    missing = _missing(places, values, said, in_plane, negative, kind, chosen)
    if missing:
        raise _not_clear(text, rows, missing)
    spread = []
    if chosen["uncertainty"] is not None:
        spread = [_place(text, rows, "uncertainty", part) for part in split_list(chosen["uncertainty"])]
        if len(spread) != len(values):
            raise text.bad(
                rows.line, "uncertainty", f"{len(spread)} columns for {len(values)} of values", "one for each"
            )
    table, numbers = _numbers(text, rows, places, spread, values)
    _counted(text, comments, len(table))
    unit = str(chosen["angles"] or said.unit)
    totals = []
    for line, total, block in rows.totals:
        of_block = float(block) * (1 if unit == "deg" else 180 / np.pi) if block else None
        totals.append((line, total.value, of_block if total.theta_i is None else total.theta_i))
    read = Columns(
        table=table,
        numbers=numbers,
        places=places,
        value_places=values,
        names=header,
        angles=unit,
        mirror=0.0 if in_plane else 180.0 if chosen["mirror"] is None or kind else float(chosen["mirror"]),
        quantity=str(chosen["quantity"] or said.quantity or "f"),
        own_header=all(chosen[k] is None for k in ("angles", "mirror", "quantity", "value", *_OPTIONS)),
        in_plane=in_plane,
        wavelength_unit=said.wavelength_unit if chosen["wavelength"] is None else
        meaning(header[places["wavelength"]]).unit if header else "",
        before=rows.before,
        separator=SEPARATORS[rows.separator],
        header_line=rows.line,
        title=printable(comments[0])[:200] if comments else "",
        spread_places=spread,
        totals=tuple(totals),
    )  # fmt: skip
    return _turned(text, read, kind) if kind else read


#: Options that name columns: one a role, and a list for each vector.
_OPTIONS = (*ROLES[:9], "wi", "wo")
_KINDS = {"half and difference angles": HALF, "vectors": VECTORS}


def _kind(places: dict[str, int]) -> str:
    """What the columns are where they are no polar angles, "" where they are."""
    if {"theta_i", "theta_o"} <= set(places):
        return ""
    return next((kind for kind, roles in _KINDS.items() if set(roles[:2]) <= set(places)), "")


def _turned(text: TextFile, read: Columns, kind: str) -> Columns:
    """`read` with columns of theta_i, theta_o, delta_phi in radians behind its own."""
    roles = _KINDS[kind]
    columns = read.table[:, [read.places[role] for role in roles]]
    if kind == "vectors":
        found = from_vectors(text, columns, read.numbers)
    else:
        found = from_half(text, np.radians(columns) if read.angles == "deg" else columns, read.numbers)
    places = {role: k for role, k in read.places.items() if role not in (*_ANGLES, *VECTORS)}
    places |= {role: read.width + k for k, role in enumerate(("theta_i", "theta_o", "delta_phi"))}
    table = np.concatenate([read.table[found.kept], np.stack(found.angles, axis=1)], axis=1)
    return replace(read, table=table, numbers=read.numbers[found.kept], places=places, angles="rad", turned=kind,
                   done=tuple(found.done))  # fmt: skip


def _not_clear(text: TextFile, rows: Rows, missing: list[str]) -> FileFormatError:
    """The same words wherever a file is read: what lacks, the columns there are, how to name one."""
    names = [f'"{name}"' if re.search("[,;]", name) else name for name in rows.names or rows.comment]
    listed = (", ".join(names) if names else f"{rows.width} without names")[:400]
    numbers = sum(bool(re.fullmatch(r"[-+]?[\d.]+", name)) for name in names)
    like_a_matrix = "; a matrix is read with matrix=theta_i, what its header's numbers are" if numbers > 1 else ""
    one_of_each = ",".join(re.split("[ ,]", part.partition(" or delta_phi")[0])[0] for part in missing)
    return FileFormatError(
        "columns_not_clear",
        f"{text.name}: line {rows.line}: the header does not say everything; pass {', '.join(missing)}. "
        f"Columns: {listed}. COLUMN is a name, or a number from 1 to {rows.width}, of these{like_a_matrix}",
        where=missing[0].partition("=")[0],
        file=text.name,
        line=rows.line,
        field=missing[0].partition("=")[0],
        expected=", ".join(missing),
        options=one_of_each,
    )


@dataclass(frozen=True)
class _Said:
    """What a header says: column of each role, value columns, and unit, quantity, mirror as far as it does."""

    places: dict[str, int]
    values: list[int]
    unit: str
    quantity: str
    mirror: bool
    wavelength_unit: str

    @classmethod
    def of(cls, header: list[str], given_unit: str) -> _Said:
        meanings = [meaning(name) for name in header]
        places: dict[str, int] = {}
        for k, found in enumerate(meanings):
            if found.role in ROLES:
                places.setdefault(found.role, k)
        units = {meanings[k].unit for role, k in places.items() if role in _ANGLES}
        units = {given_unit} if given_unit and units <= {"", given_unit} else units
        values = [k for k, found in enumerate(meanings) if found.role == "value"]
        kinds = {meanings[k].quantity for k in values}
        # "dphi" of another program may count from either side; delta_phi and phi_i, phi_o are this project's
        azimuth = header[places["delta_phi"]].lower() if "delta_phi" in places else ""
        both = [header[places[role]].lower() for role in ("phi_i", "phi_o") if role in places]
        mirror = azimuth.startswith("delta_phi")
        mirror = mirror or (not azimuth and len(both) == 2 and all(name.startswith("phi") for name in both))
        wave = places.get("wavelength")
        return cls(places, values, units.pop() if len(units) == 1 else "", kinds.pop() if len(kinds) == 1 else "",
                   mirror, "" if wave is None else meanings[wave].unit)  # fmt: skip


_COLOURS = (["r", "g", "b"], ["red", "green", "blue"])


def _placed(text: TextFile, rows: Rows, said: _Said, chosen: dict[str, Any]) -> tuple[dict[str, int], list[int]]:
    """(column of each role, value columns): options, then what the header says of columns that no option took."""
    places: dict[str, int] = {}
    asked = {role: chosen[role] for role in ROLES[:9]}
    for name in ("wi", "wo"):
        parts = [] if chosen[name] is None else split_list(chosen[name])
        if parts and len(parts) != 3:
            raise text.bad(rows.line, name, f"{name}={chosen[name]}", "three columns, as [X,Y,Z]")
        asked |= {f"{name}_{k}": part for k, part in zip("xyz", parts, strict=False)}
    for role, column in asked.items():
        if column is not None:
            places[role] = _place(text, rows, role, column)
    values = []
    if chosen["value"] is not None:
        values = [_place(text, rows, "value", part) for part in split_list(chosen["value"])]
    if len(set(values)) < len(values):
        raise text.bad(rows.line, "value", f"value={chosen['value']} names a column twice", "each column once")
    taken = {*places.values(), *values}
    azimuth_named = chosen["delta_phi"] is not None or chosen["phi_o"] is not None
    for role, place in said.places.items():
        if role in places or place in taken or (azimuth_named and role in ("phi_i", "phi_o", "delta_phi")):
            continue
        places[role] = place
    for k, role in enumerate(rows.given):  # what a line above the rows says, unless a column does
        azimuth_known = role in ("phi_i", "phi_o", "delta_phi") and {"delta_phi", "phi_o"} & set(places)
        if role not in places and not azimuth_known:
            places[role] = rows.width + k
    if chosen["value"] is None:
        values = [k for k in rows.values or said.values if k not in taken]
        rest = [k for k in range(len(rows.names)) if k not in (*taken, *places.values())]
        names = [rows.names[k] for k in rest]
        # a wavelength a column, without its unit; three colours
        if not values and rest and (wavelengths(names) is not None or [n.lower() for n in names] in _COLOURS):
            values = rest
    if chosen["wavelength"] is None and len(values) != 1:
        places.pop("wavelength", None)  # a column a wavelength: another one says nothing of them
    if "delta_phi" in places and "phi_o" in places:  # one says all; delta_phi is what the look-up takes
        del places["phi_o"]
        places.pop("phi_i", None)
    return places, values


def _place(text: TextFile, rows: Rows, role: str, name: str) -> int:
    """Index of the column called `name`, or numbered so from 1."""
    header, width = rows.names, rows.width
    for names in (header, rows.comment):
        if names.count(name) == 1:
            return names.index(name)
    if name.isascii() and name.isdigit() and len(name) < 6 and 1 <= int(name) <= width and name not in header:
        return int(name) - 1
    names = header or rows.comment
    listed = ", ".join(names)[:400] if names else f"1 to {width}"
    why = "twice" if name in header else "not there"
    raise text.bad(rows.line, role, f"{role}={name[:40]}: column {why}", f"one of: {listed}", "no_such_column")


def _signed(rows: Rows, places: dict[str, int]) -> bool:
    """Whether polar angles carry a sign, so that a file without azimuths says on which side they lie."""
    wanted = [places[role] for role in ("theta_i", "theta_o") if role in places]
    if len(wanted) < 2:
        return False
    if any(value.startswith("-") for role in ("theta_i", "theta_o") for value in rows.given.get(role, ())):
        return True
    for _, line in rows.body:
        cells = rows.split(line)
        if any(k < len(cells) and cells[k][:1] == "-" and cells[k] not in BLANK for k in wanted):
            return True
    return False


def _missing(
    places: dict[str, int],
    values: list[int],
    said: _Said,
    in_plane: bool,
    negative: bool,
    kind: str,
    chosen: dict[str, Any],
) -> list[str]:
    """The options that have to be given; `negative`: whether any number of the table is."""
    if kind:
        missing = [f"{role}=COLUMN" for role in _KINDS[kind] if role not in places]
        if missing and kind == "vectors":
            missing = ["wi=[X,Y,Z] and wo=[X,Y,Z]"]
    else:
        missing = [f"{role}=COLUMN" for role in ("theta_i", "theta_o") if role not in places]
        # whether a polar angle is signed is seen when it is named
        in_plane = in_plane or bool(missing and negative and not {"delta_phi", "phi_o"} & set(places))
        if "delta_phi" not in places and "phi_o" not in places and not in_plane:
            missing.append("phi_o=COLUMN (and phi_i=COLUMN) or delta_phi=COLUMN")
    if not values:
        missing.append("value=COLUMN")
    if not said.unit and chosen["angles"] is None and kind != "vectors":
        missing.append("angles=deg or angles=rad")
    named = any(chosen[role] is not None for role in ("delta_phi", "phi_o"))
    if not in_plane and not kind and (named or not said.mirror) and chosen["mirror"] is None:
        missing.append("mirror=180 (phi_o - phi_i of the mirror direction, or 0)")
    if (chosen["value"] is not None or not said.quantity) and chosen["quantity"] is None:
        missing.append("quantity=f, f_cos or pi_f")
    return missing


def _numbers(
    text: TextFile, rows: Rows, angles: dict[str, int], spread: list[int], values: list[int]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    if not rows.body:
        raise text.bad(len(text.lines), "rows", "no rows after the header", "rows of numbers")
    if len(rows.body) * rows.width > MAX_NUMBERS:
        raise text.bad(rows.body[0][0], "rows", f"more than {MAX_NUMBERS} numbers", "a smaller file")
    used, blank = sorted({k for k in (*angles.values(), *spread, *values) if k < rows.width}), set(values)
    # a block's incidence stands once, in its first row, as a spreadsheet's merged cells are saved
    block = {angles[role] for role in ("theta_i", "phi_i") if role in angles}
    table = np.zeros((len(rows.body), rows.width))
    for k, (number, row) in enumerate(rows.body):
        cells = rows.split(row)
        if len(cells) != rows.width:
            raise text.bad(number, "row", f"{len(cells)} fields", f"{rows.width}, as the first line has")
        for place in used:
            cell = cells[place]
            if place in blank and cell.lower() in BLANK:  # no value was written: counted where rows are chosen
                table[k, place] = np.nan
                continue
            if place in block and not cell and k:
                table[k, place] = table[k - 1, place]
                continue
            name = rows.names[place] if rows.names else f"column {place + 1}"
            table[k, place] = text.number(rows.decimal(cell), number, name)
    if rows.given:
        table = np.concatenate([table, np.array([*rows.given.values()], np.float64).T], axis=1)
    return table, np.array([number for number, _ in rows.body], np.int64)


def _counted(text: TextFile, comments: list[str], found: int) -> None:
    """Hold the rows to a comment "rows: n", as files written here have."""
    for number, comment in enumerate(comments, 1):
        if announced := re.fullmatch(r"rows: (\d{1,15})", comment):
            if int(announced[1]) != found:
                raise text.bad(number, "rows", f"{announced[1]} announced, {found} found", "as many rows")
            return
