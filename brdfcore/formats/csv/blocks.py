"""What stands around the rows of a text table: lines such as "theta_i = 30" above a block of rows, a total that the
file states, the header of a matrix of one polar angle by another."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from brdfcore.formats.csv.header import meaning

#: Roles that a line above rows may give.
GIVEN = ("theta_i", "phi_i", "theta_o", "phi_o", "delta_phi", "wavelength")
_NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_PAIR = re.compile(rf"([A-Za-z][^\d=:]*?)[\s=:]+({_NUMBER})\s*(deg|degrees?|rad|radians?|nm|um)?", re.I)
_TOTAL = re.compile(
    r"(?:TIS|DHR|albedo|total (?:integrated )?(?:scatter(?:ing|ed)?|reflectance|reflectivity)|"
    rf"(?:directional[- ])?hemispherical reflectance)\b[^=:]{{0,40}}[=:]\s*({_NUMBER})\s*(%|percent)?"
    rf"(?:\s*(?:at|@)\s*({_NUMBER})\s*(?:deg|degrees?)?)?", re.I
)  # fmt: skip
_LONGEST, _MARKS = 200, "#%!/* \t\"'"
_ANGLE = re.compile("theta|angle|aoi|inc|@", re.I)


@dataclass(frozen=True)
class Given:
    """What a line above rows says: {role: number as written}, the unit of its angles, "" where it names none."""

    values: dict[str, str]
    unit: str


def given(line: str) -> Given | None:
    """What `line`, comment or not, gives to the rows below it; None for any other line."""
    text = words_of(line)
    if not text:
        return None
    parts = [part.strip(" \"'") for part in re.split("[,;\t]", text)]
    if len(parts) == 2 and re.fullmatch(_NUMBER, parts[1]):  # a spreadsheet's two cells
        parts = [" ".join(parts)]
    values, unit = {}, ""
    for part in parts:
        found = _PAIR.fullmatch(part)
        name = meaning(found[1].strip()) if found else None
        if found is None or name is None or name.role not in GIVEN or name.role in values:
            return None
        values[name.role] = found[2].replace(",", ".")
        said = (found[3] or name.unit or "").lower()[:3]
        if name.role != "wavelength":
            unit = {"deg": "deg", "rad": "rad"}.get(said, unit)
    return Given(values, unit)


@dataclass(frozen=True)
class Total:
    """A total reflectance that a line states, and the incidence in degrees that it or a line above it names."""

    value: float
    theta_i: float | None


def total(line: str) -> Total | None:
    """What `line`, comment or not, states as the total; None for any other line."""
    found = _TOTAL.fullmatch(words_of(line))
    if found is None:
        return None
    value = float(found[1].replace(",", "."))
    # as a number above 1.5 it can only be percent
    value *= 0.01 if found[2] or value > 1.5 else 1
    return Total(value, float(found[3].replace(",", ".")) if found[3] else None)


def words_of(line: str) -> str:
    """The text of a short line that begins with a letter, without the marks of a comment; "" of any other."""
    text = line.lstrip(_MARKS)
    if not text[:1].isalpha() or len(text) > _LONGEST:
        return ""
    return text.rstrip(" \t;,\"'")


@dataclass(frozen=True)
class Matrix:
    """A matrix below a header of angles: what its first column and its header's numbers are."""

    rows: str
    columns: str
    angles: list[str]
    unit: str

    @property
    def turned(self) -> Matrix:
        """With rows and columns the other way round."""
        return Matrix(self.columns, self.rows, self.angles, self.unit)


def matrix(names: list[str], asked: Any) -> Matrix | None:
    """The matrix whose header is `names`, or None.

    asked   "theta_i" or "theta_o": what the header's numbers are; None: as its first cell says, which has to name a
            polar angle, or both as "theta_o \\ theta_i", rows first.
    """
    if len(names) < 3:
        return None
    corner = [meaning(part.strip()) for part in re.split(r"[\\/|]|\bby\b|\bvs\b", names[0]) if part.strip()]
    roles = [name.role for name in corner if name.role in ("theta_i", "theta_o")]
    other = {"theta_i": "theta_o", "theta_o": "theta_i"}
    if asked is None and not roles:
        return None
    columns = asked or (roles[1] if len(roles) > 1 else other[roles[0]])
    angles, units = [], [name.unit for name in corner if name.unit in ("deg", "rad")]
    for name in names[1:]:
        found = re.fullmatch(rf"(.*?)[\s=:_(\[]*({_NUMBER})\s*(deg|degrees?|rad|radians?)?[)\]]?", name.strip(), re.I)
        if found is None:
            return None
        # "AOI 10", "BRDF@10"; of "sample 1" nobody says that it is an angle
        if found[1] and asked is None and not _ANGLE.search(found[1]):
            return None
        if asked is None and abs(float(found[2].replace(",", "."))) > 90:
            return None
        units += [found[3].lower()[:3]] if found[3] else []
        angles.append(found[2].replace(",", "."))
    if len(set(map(float, angles))) < len(angles):
        return None
    return Matrix(other[columns], columns, angles, units[0] if units else "")
