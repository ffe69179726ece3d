"""ASTM E1392-style text: a header of NAME value lines, then one row a geometry with a column for each wavelength."""

from __future__ import annotations

import re
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import POLICIES, not_scattered, to_brdf
from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile, printable
from brdfcore.tables.scattered.table import Scattered

#: What the angle columns may be called; theta_s and phi_s are the scattered direction.
_ANGLES = ("theta_i", "phi_i", "theta_s", "phi_s")
_SYNONYMS = {"theta_r": "theta_s", "phi_r": "phi_s", "theta_o": "theta_s", "phi_o": "phi_s"}
_WAVELENGTH = re.compile(r"(\d+(?:\.\d*)?(?:e[-+]?\d+)?)\s*(nm|um)", re.IGNORECASE)
_MAX_COLUMNS, _MAX_HEADER = 4_096, 1_000

_CONVENTIONS = {
    "value": "f_r in 1/sr, without the cosine",
    "directions": "theta_i, phi_i the light, theta_s, phi_s the scattered light; both from the normal",
    "azimuth": "phi_s - phi_i = 180 degrees is the mirror direction",
    "zenith": "a negative theta is the other side: (|theta|, phi + 180 degrees)",
}


class AstmFormat(Format):
    """Scattered measurements with a VARS line naming the columns: theta_i, phi_i, theta_s, phi_s, 400nm, 410nm, ...

    Angles are in radians, as in the files of Cornell's light measurement laboratory; the format does not say, so
    `angles` does. Read to a `scattered` table. Written with every geometry and digit: it reads back to the same bits.
    """

    name = "astm"
    SUMMARY = "ASTM E1392-style scattered measurements, one column a wavelength (text)"
    REFERENCE = (
        "ASTM E1392, Standard practice for angle resolved optical scatter measurements on specular or diffuse surfaces"
    )
    EXTENSIONS = (".astm",)
    PARAMETERS = (
        Parameter("angles", "", "unit of the file's angles", "rad", kind="choice", choices=("rad", "deg")),
        Parameter(
            "invalid", "", "rows with a value that is not finite", "drop", kind="choice", choices=("drop", "error")
        ),
        *POLICIES,
    )
    writable = True

    def sniff(self, head: bytes) -> bool:
        lines = head.split(b"\n")
        return any(re.match(rb"(VARS|NUM_POINTS)\s", line) for line in lines) and not head.startswith(b"#")

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file; raises `FileFormatError` naming file, line and field, `StorageError` if it can't be opened."""
        chosen = resolve("format 'astm'", self.PARAMETERS, options)
        policies = {p.name: chosen[p.name] for p in POLICIES}
        return to_brdf(measurements_of(path, chosen["angles"], chosen["invalid"]), **policies)

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write the measured geometries of a `scattered` table; `InputError` for anything else."""
        if not isinstance(brdf, Scattered):
            raise not_scattered(brdf, "an ASTM file")
        names = [f"{c:.17g}nm" if brdf.channels.kind == "wavelength" else str(c) for c in brdf.channels]
        if any("," in name or name != name.strip() or not name.isprintable() for name in names):
            raise InputError(
                "bad_channels", f"channels {names} can't be column names of an ASTM file", where="channels", got=names
            )
        lines = [
            f"LAB_COMMENTS {_one_line(str(brdf.metadata.get('description', '')))}".rstrip(),
            "MEAS_NAME BRDF",
            f"NUM_POINTS {len(brdf.angles)}",
            "VARS " + ",".join([*_ANGLES, *names]),
            "",
        ]
        for (theta_i, theta_o, delta_phi), row in zip(brdf.angles.tolist(), brdf.measured.tolist(), strict=True):
            lines.append(",".join(map(repr, (theta_i, 0.0, theta_o, delta_phi, *row))))
        return write_file(path, ("\n".join(lines) + "\n").encode(), self.read)


def _one_line(text: str) -> str:
    return " ".join(text.encode("ascii", "replace").decode().split())[:500]


def measurements_of(path: Path, angles: str = "rad", invalid: str = "drop") -> Measurements:
    """The rows of an ASTM file; see `AstmFormat.read`."""
    text = TextFile(path)
    header, start = _header(text)
    columns, at = header.pop("VARS")
    names = [name.strip() for name in columns.split(",")]
    if len(names) > _MAX_COLUMNS or "" in names or len(set(names)) < len(names):
        raise text.bad(at, "VARS", f"{len(names)} columns, some without a name or twice", "different names")
    places = {_SYNONYMS.get(name.lower(), name.lower()): k for k, name in reversed(list(enumerate(names)))}
    missing = [name for name in _ANGLES if name not in places]
    if missing:
        raise text.bad(at, "VARS", f"no column {', '.join(missing)}", "theta_i, phi_i, theta_s, phi_s, values")
    used = [places[name] for name in _ANGLES]
    values = [k for k in range(len(names)) if k not in used]
    if not values:
        raise text.bad(at, "VARS", "no column of values", "theta_i, phi_i, theta_s, phi_s, values")
    channels = _channels(text, at, [names[k] for k in values])
    declared = _declared(text, header, len(names))
    table, numbers = _rows(text, start, names, declared)
    if declared is not None and len(table) != declared[0]:
        raise text.bad(declared[1], "NUM_POINTS", f"{declared[0]} announced, {len(table)} rows found", "as many rows")
    if not len(table):
        raise text.bad(len(text.lines), "rows", "no rows after VARS", "a row for each geometry")
    largest = float(np.nan_to_num(np.abs(table[:, [used[0], used[2]]])).max())
    if angles == "rad" and np.pi < largest <= 180:
        raise text.bad(
            numbers[0],
            "theta",
            f"angles reach {largest:g}",
            "radians up to pi/2; pass angles=deg for a file in degrees",
        )
    unit = {"rad": "radians", "deg": "degrees"}[angles]
    return Measurements.from_columns(
        table[:, used[0]],
        table[:, used[1]],
        table[:, used[2]],
        table[:, used[3]],
        table[:, values],
        channels,
        file=text.name,
        format="astm",
        lines=numbers,
        degrees=angles == "deg",
        invalid="error" if invalid == "error" else "drop",
        conventions={**_CONVENTIONS, "angles": f"{unit}: the file does not say, the option angles={angles!r} does"},
        found={"header": {k: v for k, (v, _) in header.items() if v}, "columns": len(names)},
        source=text.source,
        description=header.get("SAMPLE_NAME", ("", 0))[0] or header.get("LAB_COMMENTS", ("", 0))[0],
    )


def _header(text: TextFile) -> tuple[dict[str, tuple[str, int]], int]:
    """{name: (value, line)} up to and with VARS, and the index of the first line after it."""
    header: dict[str, tuple[str, int]] = {}
    for k, line in enumerate(text.lines[:_MAX_HEADER]):
        name, _, value = line.strip().partition(" ")
        if not name:
            continue
        if not re.fullmatch(r"[A-Z][A-Z0-9_]*", name):
            raise text.bad(k + 1, "header", f"{line.strip()[:40]!r}", "NAME value, and a line VARS before the rows")
        if name in header:
            raise text.bad(k + 1, name, f"given twice, first in line {header[name][1]}", "each once")
        header[name] = (printable(value.strip()), k + 1)
        if name == "VARS":
            return header, k + 1
    raise text.bad(min(len(text.lines), _MAX_HEADER), "VARS", "no line VARS", "VARS and the names of the columns")


def _declared(text: TextFile, header: dict[str, tuple[str, int]], columns: int) -> tuple[int, int] | None:
    """(NUM_POINTS, its line), None without; refused where the file is too short to hold as many."""
    if "NUM_POINTS" not in header:
        return None
    value, line = header["NUM_POINTS"]
    if not re.fullmatch(r"\d{1,15}", value):
        raise text.bad(line, "NUM_POINTS", repr(value[:40]), "a whole number")
    if int(value) * 2 * columns > text.bytes:
        raise text.bad(
            line, "NUM_POINTS", f"{int(value)} announced, more than {text.bytes} bytes can hold", "as many as there are"
        )
    return int(value), line


def _rows(
    text: TextFile, start: int, names: list[str], declared: tuple[int, int] | None
) -> tuple[npt.NDArray[np.float64], list[int]]:
    rows, numbers = array("d"), []
    for k in range(start, len(text.lines)):
        line = text.lines[k].strip()
        if not line:
            continue
        cells = line.split(",") if "," in line else line.split()
        if len(cells) != len(names):
            raise text.bad(k + 1, "row", f"{len(cells)} fields", f"{len(names)}, as VARS names")
        rows.extend(text.number(c, k + 1, names[n]) for n, c in enumerate(cells))
        numbers.append(k + 1)
        if declared is not None and len(numbers) > declared[0]:
            raise text.bad(k + 1, "NUM_POINTS", f"more rows than the {declared[0]} announced", "as many")
        if len(rows) > MAX_NUMBERS:
            raise text.bad(k + 1, "row", f"more than {MAX_NUMBERS} numbers", "a smaller file")
    return np.array(rows, np.float64).reshape(len(numbers), len(names)), numbers


def _channels(text: TextFile, line: int, names: list[str]) -> Channels:
    found = [_WAVELENGTH.fullmatch(name) for name in names]
    try:
        if all(found):
            return Channels([float(m[1]) * (1000 if m[2].lower() == "um" else 1) for m in found if m], "wavelength")
        return Channels([printable(n) for n in names])
    except InputError as error:
        raise text.bad(line, "VARS", f"columns {', '.join(names)[:80]}: {error.detail[:120]}", "wavelengths") from error
