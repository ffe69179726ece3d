"""The text of Speos surface files: parsed line by line, nothing allocated by what a count claims.

`OPTIS - Anisotropic BSDF surface file v8.0` (.anisotropicbsdf), one item a line: title; 0 for text; comment; number of
characters of the description; the description; direction of the anisotropy (3 numbers); flags of reflection and
transmission; type of the values; for reflection, then transmission: number of rotations of the sample and their list,
and for each its number of angles of incidence and their list; for reflection, then transmission: the incidence and
azimuth that the spectrum belongs to, a comment, number of wavelengths, and for each its nm and percent; then the
tables, rotation by rotation and incidence by incidence. `OPTIS - brdf surface file v9.0` (.brdf) has, after the type of
the values, the numbers of incidences and wavelengths and their lists, and a percentage before each table, incidence by
incidence and wavelength by wavelength. A table: numbers of theta and phi; the phi; a line a theta: theta, its values.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError
from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile

Float64Array = npt.NDArray[np.float64]

TITLES = {"anisotropic bsdf surface file": "anisotropicbsdf", "brdf surface file": "brdf"}
#: Most angles of a list, and of a table's axis: a hundredth of a degree over a turn.
_MOST = 36_001


class Table(NamedTuple):
    """One table: theta_o (n,) and phi (m,) in degrees, values (n, m), the line that it begins at."""

    theta_o: Float64Array
    phi: Float64Array
    values: Float64Array
    line: int


@dataclass
class SpeosFile:
    """What a file says of reflection; angles in degrees.

    tables     [rotation][incidence][wavelength]; one "wavelength" in a .anisotropicbsdf.
    percent    (incidences, wavelengths) in a .brdf; (1, wavelengths) in a .anisotropicbsdf, at `reference`.
    intensity  whether the values are proportional to f cos(theta_o) rather than f.
    """

    kind: str
    version: str
    description: str
    transmission: bool
    intensity: bool
    rotations: list[float]
    incidences: list[float]
    wavelengths: list[float]
    percent: Float64Array
    reference: float
    tables: list[list[list[Table]]]


class Lines:
    """The lines of a file one after the other, each complaint with its number."""

    def __init__(self, path: Path) -> None:
        self.text = TextFile(path)
        self.at = 0
        self.numbers_read = 0

    @property
    def left(self) -> int:
        return len(self.text.lines) - self.at

    def bad(self, field: str, got: str, expected: str) -> FileFormatError:
        return self.text.bad(max(self.at, 1), field, got, expected, "damaged_file")

    def take(self, field: str) -> str:
        if not self.left:
            raise self.bad(field, "the file ends before it", field)
        self.at += 1
        return self.text.lines[self.at - 1]

    def numbers(self, field: str, count: int | None = None) -> list[float]:
        """The finite numbers of the next line, `count` of them."""
        words = self.take(field).split()
        if count is not None and len(words) != count:
            raise self.bad(field, f"{len(words)} values", f"{count}")
        self.numbers_read += len(words)
        if self.numbers_read > MAX_NUMBERS:
            raise self.bad(field, f"more than {MAX_NUMBERS} numbers in all", f"at most {MAX_NUMBERS}")
        found = [self.text.number(word, self.at, field) for word in words]
        if not np.isfinite(found).all():
            raise self.bad(field, "a number that is not finite", "finite numbers")
        return found

    def counts(self, field: str, count: int, most: int = _MOST, least: int = 1) -> list[int]:
        found = self.numbers(field, count)
        if not all(x == int(x) and least <= x <= most for x in found):
            raise self.bad(field, " ".join(f"{x:g}" for x in found)[:40], f"whole numbers from {least} to {most}")
        return [int(x) for x in found]

    def ascending(self, field: str, count: int, low: float, high: float) -> list[float]:
        found = self.numbers(field, count)
        if not all(low <= x <= high for x in found) or (np.diff(found) <= 0).any():
            shown = " ".join(f"{x:g}" for x in found[:6])
            raise self.bad(field, f"{shown} ...", f"ascending angles from {low:g} to {high:g} degrees")
        return found


def parse(path: Path) -> tuple[SpeosFile, Lines]:
    """The contents of a file, and its lines for further complaints; `FileFormatError` with file and line."""
    lines = Lines(path)
    title = lines.take("title").split(" - ", 1)[-1].strip()
    kind = next((k for t, k in TITLES.items() if title.lower().startswith(t)), None)
    if kind is None:
        raise lines.bad("title", title[:60], " or ".join(TITLES))
    if lines.counts("mode", 1, 1, 0)[0] != 0:
        raise lines.bad(
            "mode", "1: the binary form", "0, the text form: open the file in Speos's BSDF viewer and save it as text"
        )
    lines.take("comment")
    description = _description(lines)
    if kind == "anisotropicbsdf":
        lines.numbers("direction of the anisotropy", 3)
    reflection, transmission = lines.counts("flags of reflection and transmission", 2, 1, 0)
    if not reflection:
        raise FileFormatError(
            "transmission_only",
            f"{path.name}: line {lines.at}: the file holds transmission only, and reflectance is read only",
            where=path.name,
            file=path.name,
            line=lines.at,
            field="flags of reflection and transmission",
            got="transmission",
            expected="reflection",
        )
    intensity = lines.counts("type of the values", 1, 1, 0)[0] == 0
    read = _anisotropic if kind == "anisotropicbsdf" else _brdf
    rotations, incidences, wavelengths, percent, reference, tables = read(lines, bool(transmission))
    if not transmission:
        rest = [x for x in lines.text.lines[lines.at :] if x.strip() and x.strip().lower() != "end of file"]
        if rest:
            lines.take("the end")
            raise lines.bad("the end", f"{rest[0].strip()[:40]!r} after the last table", "the end of the file")
    version = title.rsplit(" ", 1)[-1]
    return (
        SpeosFile(
            kind, version, description, bool(transmission), intensity, rotations, incidences, wavelengths, percent,
            reference, tables,
        ),
        lines,
    )  # fmt: skip


_Parts = tuple[list[float], list[float], list[float], Float64Array, float, list[list[list[Table]]]]


def _description(lines: Lines) -> str:
    """As many lines as hold the stated number of characters, at least one."""
    (count,) = lines.counts("characters of the description", 1, 1_000_000, 0)
    text = lines.take("description")
    while len(text) < count and lines.left:
        text += "\n" + lines.take("description")
    return text.strip()


def _anisotropic(lines: Lines, transmission: bool) -> _Parts:
    sides = 1 + int(transmission)
    listed: list[tuple[list[float], list[float]]] = []
    for side in range(sides):
        name = "transmission" if side else "reflection"
        (count,) = lines.counts(f"number of rotations, {name}", 1)
        rotations = lines.ascending(f"rotations, {name}", count, -360, 360)
        incidences: list[float] = []
        for k in range(count):
            (n,) = lines.counts(f"number of incidences of rotation {k + 1}, {name}", 1)
            found = lines.ascending(f"incidences of rotation {k + 1}, {name}", n, 0, 90 if not side else 180)
            if k and found != incidences:
                raise lines.bad(
                    f"incidences of rotation {k + 1}", "others than of the first", "the same for all rotations"
                )
            incidences = found
        listed.append((rotations, incidences))
    spectra = []
    for _ in range(sides):
        reference = lines.numbers("incidence and azimuth of the spectrum", 2)[0]
        lines.take("comment of the spectrum")
        (n,) = lines.counts("number of wavelengths", 1)
        rows = np.array([lines.numbers("wavelength and percentage", 2) for _ in range(min(n, lines.left + 1))])
        spectra.append((reference, rows))
    (rotations, incidences), (reference, spectrum) = listed[0], spectra[0]
    _check_wavelengths(lines, spectrum[:, 0])
    tables = [[[_table(lines)] for _ in incidences] for _ in rotations]
    return rotations, incidences, spectrum[:, 0].tolist(), spectrum[:, 1][None], reference, tables


def _brdf(lines: Lines, _: bool) -> _Parts:
    n_i, n_w = lines.counts("numbers of incidences and wavelengths", 2)
    incidences = lines.ascending("incidences", n_i, 0, 90)
    wavelengths = lines.numbers("wavelengths", n_w)
    _check_wavelengths(lines, np.array(wavelengths))
    percent = np.empty((n_i, n_w))
    tables: list[list[Table]] = []
    for i in range(n_i):
        row = []
        for w in range(n_w):
            percent[i, w] = lines.numbers("percentage of the table", 1)[0]
            row.append(_table(lines))
        tables.append(row)
    return [0.0], incidences, wavelengths, percent, incidences[0], [tables]


def _check_wavelengths(lines: Lines, found: Float64Array) -> None:
    if not ((found > 0) & (found <= 1e6)).all() or (np.diff(found) <= 0).any():
        raise lines.bad("wavelengths", " ".join(f"{x:g}" for x in found[:6]), "ascending wavelengths in nm")


def _table(lines: Lines) -> Table:
    n, m = lines.counts("numbers of theta and phi", 2)
    start = lines.at
    if n + 1 > lines.left:
        raise lines.bad("numbers of theta and phi", f"{n} rows, and {lines.left} lines follow", "a line a theta")
    phi = lines.ascending("phi", m, 0, 360)
    rows = np.array([lines.numbers(f"row {k + 1} of the table of line {start}", m + 1) for k in range(n)])
    theta = rows[:, 0]
    if theta[0] >= 90 and n > 1:
        raise lines.bad("theta", f"{theta[0]:g} to {theta[-1]:g} degrees, which is transmission", "0 to 90 degrees")
    if not ((theta >= 0) & (theta <= 90)).all() or (np.diff(theta) <= 0).any():
        raise lines.bad("theta", f"{theta[0]:g} to {theta[-1]:g}", "ascending angles from 0 to 90 degrees")
    return Table(theta, np.array(phi), rows[:, 1:], start)
