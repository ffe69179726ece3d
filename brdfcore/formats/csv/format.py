"""Columns of a text table: each is named by an option, or by a header that leaves nothing to guess."""

from __future__ import annotations

import re
from collections.abc import Iterable
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
from brdfcore.formats.base.text_rows import TextFile, decoded
from brdfcore.formats.csv.columns import Columns, columns_of, split_list
from brdfcore.formats.csv.header import wavelengths, without_unit
from brdfcore.formats.csv.rows import has_table
from brdfcore.formats.csv.values import values_of
from brdfcore.tables.scattered.table import Scattered

Float64Array = npt.NDArray[np.float64]

#: Ends of names of text tables, which many programs write.
_TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc")
_TITLE = "# BRDF measurements"
_QUANTITIES = {
    "f": "f_r in 1/sr, without the cosine",
    "f_cos": "f_r cos(theta_o); divided by the cosine on reading",
    "pi_f": "pi f_r (BRF; relative to a white diffuser); divided by pi on reading",
}


def _text(name: str, meaning: str) -> Parameter:
    return Parameter(name, "", meaning, None, kind="text")


class CsvFormat(Format):
    """Scattered measurements in columns, separated by commas, semicolons, tabs or blanks; # begins a comment.

    A header of theta_i_deg, theta_o_deg, delta_phi_deg (or _rad) and f_r_NAME or f_r_550nm says all: so are files
    written here and by `brdf eval --csv`. Of any other the columns (by name, or by number from 1), the unit of the
    angles, the azimuth of the mirror direction and the quantity have to be given as far as usual names do not say
    them; what is missing is an error that names the option. Lines before the header, quotes, decimal commas, blank
    cells and UTF-16 are read, lines above blocks of rows (theta_i = 30), matrices of theta_o by theta_i, half and
    difference angles, vectors. Without azimuths a signed theta_o lies in the plane of incidence, positive on the mirror
    side. Read to a `scattered` table.
    """

    name = "csv"
    SUMMARY = "scattered measurements in columns, mapped by options (text)"
    EXTENSIONS = (".csv",)
    PARAMETERS = (
        _text("theta_i", "column of the light's polar angle: its name, or its number from 1"),
        _text("phi_i", "column of the light's azimuth; not given: 0"),
        _text("theta_o", "column of the viewer's polar angle"),
        _text("phi_o", "column of the viewer's azimuth"),
        _text("delta_phi", "column of phi_o - phi_i, instead of the azimuths"),
        _text("theta_h", "column of the half vector's polar angle, instead of theta_i and theta_o"),
        _text("theta_d", "column of the difference angle, between wi and the half vector"),
        _text("phi_d", "column of wi's azimuth about the half vector, 0 away from the normal"),
        _text("wi", "columns of the vector to the light, as [X,Y,Z], instead of angles"),
        _text("wo", "columns of the vector to the viewer, as [X,Y,Z]"),
        Parameter("matrix", "", "of a matrix of values: the angle in its header; not given: as its first cell says, "
                  "theta_o or theta_i of the rows", None, kind="choice", choices=("theta_i", "theta_o")),
        _text("value", "column of the value, or [several], one a channel"),
        _text("channels", "names or wavelengths (as 550nm) of the value columns, as [R,G,B]; not given: the header's"),
        _text("uncertainty", "column of the standard uncertainty of the value, in its unit, or [several]"),
        _text("wavelength", "column of the wavelength: each row is one channel of a geometry"),
        Parameter(
            "wavelength_unit", "", "of that column; not given: its header's, else um where all lie below 30, else nm",
            None, kind="choice", choices=("nm", "um"),
        ),
        Parameter("angles", "", "unit of the angles; not given: the header's", None, kind="choice",
                  choices=("deg", "rad")),
        Parameter("mirror", "", "phi_o - phi_i of the mirror direction; not given: 180 where the header says delta_phi",
                  None, bounds=(-360, 360), unit="degrees", per_channel=False),
        Parameter("quantity", "", "what the values are", None, kind="choice", choices=tuple(_QUANTITIES)),
        Parameter("unit", "", "of the values: as they are, or percent", "one", kind="choice",
                  choices=("one", "percent")),
        Parameter("scale", "", "the values are multiplied by it", 1.0, bounds=(0, 1e12), open_bounds=("low",),
                  per_channel=False),
        Parameter("sentinel", "", "values that mean none: auto (-9999, -1, 999 and the like, where they stand apart), "
                  "none, or the numbers, as [-9999,-1]", "auto", kind="text"),
        Parameter(
            "invalid", "", "rows with a value that is not finite", "drop", kind="choice", choices=("drop", "error")
        ),
        *POLICIES,
    )  # fmt: skip
    writable = True

    def sniff(self, head: bytes) -> bool:
        """Rows of numbers, a header naming angles, or a header of any names above a row of as many numbers."""
        head = decoded(head)
        if b"\0" in head or not head.strip():
            return False
        lines = head.decode("latin-1").splitlines()
        rows = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
        if not rows:
            return lines[0].startswith(_TITLE)
        separator = next((s for s in ",;\t" if s in rows[0]), None)  # None: any blanks
        first, second = ([c.strip() for c in row.lower().split(separator) if c.strip()] for row in [*rows, ""][:2])
        if len(first) < 3 or rows[0].startswith(("{", "[", "<", "VARS")):
            return False
        if any("theta" in c or c.startswith("f_r") for c in first):
            return True
        numbers = [all(re.fullmatch(r"[-+0-9.e]+|nan|inf", c) for c in cells) for cells in (first, second)]
        return len(first) > 3 and (numbers[0] or (numbers[1] and len(second) == len(first)))

    def may_be(self, name: str, head: bytes, options: Iterable[str]) -> bool:
        """Text whose columns are named by options, whose name ends as text does, or with a table anywhere in it."""
        head = decoded(head)
        if b"\0" in head or not head.strip() or head.lstrip().startswith((b"{", b"<")):
            return False
        printing = sum(byte >= 32 or byte in b"\t\n\r\f" for byte in head)
        if printing < 0.98 * len(head):
            return False
        if {"theta_i", "theta_o", "value"} & set(options) or Path(name).suffix.lower() in _TEXT:
            return True
        return bool(name) and has_table(head.decode("latin-1"))

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file; raises `FileFormatError` naming file, line and field, `StorageError` if it can't be opened."""
        chosen = resolve("format 'csv'", self.PARAMETERS, options)
        policies = {p.name: chosen[p.name] for p in POLICIES}
        return to_brdf(measurements_of(path, chosen), **policies)

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write the measured geometries of a `scattered` table; `InputError` for anything else."""
        if not isinstance(brdf, Scattered):
            raise not_scattered(brdf, "a CSV file of measurements")
        names = [f"{c:.17g}nm" if brdf.channels.kind == "wavelength" else str(c) for c in brdf.channels]
        if any(re.search(r"[,;\t#\"]|^\s|\s$", name) or not name.isascii() or not name.isprintable() for name in names):
            raise InputError("bad_channels", f"channels {names} can't be column names", where="channels", got=names)
        head = ["theta_i_rad", "theta_o_rad", "delta_phi_rad", *(f"f_r_{name}" for name in names)]
        table = np.concatenate([brdf.angles, brdf.measured], axis=1).tolist()
        lines = [
            f"{_TITLE}: f_r in 1/sr, without the cosine; the mirror direction is delta_phi = pi",
            f"# rows: {len(table)}",
            ",".join(head),
            *(",".join(map(repr, row)) for row in table),
        ]
        return write_file(path, ("\n".join(lines) + "\n").encode(), self.read)


def measurements_of(path: Path, chosen: dict[str, Any]) -> Measurements:
    """The rows of a file of columns; `chosen`: every option of `CsvFormat`."""
    text = TextFile(path)
    columns = columns_of(text, chosen)
    found = values_of(text, columns, chosen)
    rows, values, done = columns.numbers[found.rows], found.values, [*columns.done, *found.done]
    angle = {name: columns.column(name)[found.rows] for name in ("theta_i", "phi_i", "theta_o", "phi_o", "delta_phi")}
    channels = _channels(text, columns, chosen)
    spread = columns.uncertainty(text)
    if spread is not None:
        spread = spread[found.rows] * found.factor
    if "wavelength" in columns.places:
        waves = columns.column("wavelength")[found.rows]
        unit = chosen["wavelength_unit"] or columns.wavelength_unit
        if unit not in ("nm", "um"):
            unit = "um" if waves.size and float(waves.max()) < 30 else "nm"
            done.append(f"wavelengths taken as {unit}: from {waves.min():g} to {waves.max():g}")
        waves = waves * (1000 if unit == "um" else 1)
        spread = None if spread is None else _pivoted(text, angle, spread, rows, waves)[1]
        angle, values, rows, channels = _pivoted(text, angle, values, rows, waves)
        done.append(f"rows of {len(channels)} wavelengths joined into one a geometry")
        if unit == "nm" and waves.size and float(waves.max()) < 30:
            found.warnings.append(f"wavelengths up to {waves.max():g} nm: are they micrometres (wavelength_unit=um)?")
    if columns.before:
        done.append(f"{columns.before} lines before the header left out")
    found.warnings.extend(_unit_doubts(columns.angles, angle["theta_i"], angle["theta_o"]))
    azimuth = "no column: a negative theta_o lies on the light's side, a positive one on the mirror side"
    if not columns.in_plane:
        azimuth = f"phi_o - phi_i = {columns.mirror:g} degrees is the mirror direction"
    return Measurements.from_columns(
        angle["theta_i"],
        angle["phi_i"],
        angle["theta_o"],
        angle["delta_phi"] + angle["phi_i"] if "delta_phi" in columns.places else angle["phi_o"],
        values,
        channels,
        file=text.name,
        format="csv",
        lines=rows,
        degrees=columns.angles == "deg",
        mirror=columns.mirror,
        invalid="error" if chosen["invalid"] == "error" else "drop",
        conventions={
            "value": _QUANTITIES[columns.quantity],
            "angles": {"deg": "degrees", "rad": "radians"}[columns.angles],
            "azimuth": azimuth,
            **({"geometry": f"{columns.turned} in the file"} if columns.turned else {}),
            "zenith": "a negative theta is the other side: (|theta|, phi + 180 degrees)",
            **({} if "delta_phi" in columns.places or "phi_i" in columns.places else {"phi_i": "no column: 0"}),
            "columns": ", ".join(f"{k} = {v}" for k, v in columns.described().items()),
            "said by": "the file's header" if columns.own_header else "the reader's options",
        },
        found={
            "columns": columns.width,
            "separator": columns.separator,
            "scale factor": found.scale,
            **found.counts,
            **({"stated totals": [list(t) for t in columns.totals]} if columns.totals else {}),
        },
        done=done,
        warnings=found.warnings,
        source=text.source,
        description=columns.title,
        uncertainty=spread,
    )


def _unit_doubts(unit: str, *thetas: Float64Array) -> list[str]:
    """Whether degrees may be radians."""
    largest = max((float(np.abs(t).max()) for t in thetas if t.size), default=0.0)
    if unit == "rad" or not 0 < largest <= 1.6:
        return []
    return [f"no polar angle is above {largest:.3g} degrees: are they radians (angles=rad)?"]


def _channels(text: TextFile, columns: Columns, chosen: dict[str, Any]) -> Channels:
    names = split_list(chosen["channels"]) if chosen["channels"] else columns.value_names()
    if len(names) != len(columns.value_places):
        raise text.bad(
            columns.header_line,
            "channels",
            f"channels={chosen['channels']} names {len(names)} for {len(columns.value_places)} value columns",
            "one name or wavelength a column",
        )
    try:
        if columns.names or chosen["channels"]:
            nanometres = wavelengths(names)
            if nanometres is not None:
                return Channels(nanometres, "wavelength")
        return Channels([name.removeprefix("f_r_") or name for name in map(without_unit, names)])
    except InputError as error:
        raise text.bad(columns.header_line, "channels", error.detail[:200], "different names or wavelengths") from error


def _pivoted(
    text: TextFile,
    angle: dict[str, Float64Array],
    values: Float64Array,
    rows: npt.NDArray[np.int64],
    wavelengths: Float64Array,
) -> tuple[dict[str, Float64Array], Float64Array, npt.NDArray[np.int64], Channels]:
    """One row a geometry with a channel a wavelength; every geometry must have been measured at each, as often.

    The k-th row of a geometry at one wavelength belongs to the k-th at the others.
    """
    bad = ~((wavelengths > 0) & (wavelengths < 1e9))
    if bad.any():
        raise text.bad(int(rows[np.flatnonzero(bad)[0]]), "wavelength", "no wavelength", "a positive number")
    if values.shape[1] != 1:
        raise text.bad(1, "value", f"{values.shape[1]} value columns beside a wavelength column", "one")
    bands, band = np.unique(np.round(wavelengths, 9), return_inverse=True)
    band = band.reshape(-1)
    if bands.size > 4_096:
        raise text.bad(1, "wavelength", f"{bands.size} different wavelengths", "at most 4096")
    geometry = np.stack(list(angle.values()), axis=1)
    group = np.unique(geometry, axis=0, return_inverse=True)[1].reshape(-1)
    order = np.lexsort((np.arange(band.size), band, group))
    ranks = np.empty(band.size, np.int64)  # number of the row among those of its geometry and wavelength
    key = group[order] * bands.size + band[order]
    start = np.concatenate([[True], key[1:] != key[:-1]])
    ranks[order] = np.arange(key.size) - np.maximum.accumulate(np.where(start, np.arange(key.size), 0))
    cell = group * (int(ranks.max()) + 1) + ranks
    cells, first, cell, count = np.unique(cell, return_index=True, return_inverse=True, return_counts=True)
    lacking = np.flatnonzero(count < bands.size)
    if lacking.size:
        at = int(first[lacking[0]])
        raise text.bad(
            int(rows[at]),
            "wavelength",
            f"this geometry is there for {int(count[lacking[0]])} of {bands.size} wavelengths; {lacking.size} such",
            "every geometry at every wavelength",
        )
    table = np.empty((cells.size, bands.size))
    table[cell.reshape(-1), band] = values[:, 0]
    kept = np.argsort(first)
    table, first = table[kept], first[kept]
    return (
        {name: column[first] for name, column in angle.items()},
        table,
        rows[first],
        Channels(bands.tolist(), "wavelength"),
    )
