"""BiRD: the JSON of the EMPIR projects BiRD and BxDiff (`.brdf`, `.json`), read.

An object of "metadata", with "type": "BRDF", and "data" in one of two forms. Version 1.0: an object of variables, each
{"unit", "values"}: theta_i, phi_i, theta_r, phi_r, BRDF, perhaps wavelength_i and others. Before it: "variables", a
list of {"name", "unit"}, and "values", a row for each point. Angles in degrees or radians as the unit says, both
directions from the sample's normal, so that the mirror direction is phi_r - phi_i = 180 degrees; BRDF in 1/sr.
Wavelengths become channels; points that differ in another variable only (polarisation, say) are averaged as repeated
ones, which the report says. The uncertainty (uBRDF) is left out.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import VALUE, Channels
from brdfcore.base.errors import FileFormatError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format, read_bytes
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import POLICIES, to_brdf
from brdfcore.formats.base.text_rows import printable

Float64Array = npt.NDArray[np.float64]

#: Largest file read, most points and most wavelengths.
MAX_BYTES, _MOST_POINTS, _MOST_WAVES = 16_000_000, 200_000, 512
_ANGLES = ("theta_i", "phi_i", "theta_r", "phi_r")
_WAVES = ("wavelength_i", "wavelength", "wl", "lambda", "wavelength_r")
_UNITS = {"deg": 1.0, "°": 1.0, "degree": 1.0, "degrees": 1.0, "rad": 180 / np.pi, "radian": 180 / np.pi}
_LENGTHS = {"nm": 1.0, "um": 1_000.0, "µm": 1_000.0, "μm": 1_000.0, "m": 1e9}
_CONVENTIONS = {
    "angles": "from the sample's normal, the azimuths measured the same way round: phi_r - phi_i = 180 degrees is the "
    "mirror direction",
    "value": "BRDF = f_r in 1/sr, without the cosine",
}


class BirdFormat(Format):
    """The universal BRDF data format of the BiRD project. Read to a `scattered` table."""

    name = "bird"
    SUMMARY = "BiRD universal BRDF data format (JSON): measured geometries"
    REFERENCE = (
        "D. Lanevski, A. Ferrero, E. Perales, F. Manoocheri, E. Ikonen, Machine-readable universal data format for "
        "bidirectional reflectance distribution function, Color Research and Application 47(5), 2022"
    )
    EXTENSIONS = (".brdf", ".json")
    PARAMETERS = (
        Parameter(
            "invalid", "", "points with a value that is not finite", "drop", kind="choice", choices=("drop", "error")
        ),
        *POLICIES,
    )

    def sniff(self, head: bytes) -> bool:
        rest = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        kind = b"".join(rest.split()).find(b'"type":"BRDF"')
        return rest.startswith(b"{") and b'"metadata"' in head and kind >= 0

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file; raises `FileFormatError` naming file and field, `StorageError` if it can't be opened."""
        chosen = resolve("format 'bird'", self.PARAMETERS, options)
        policies = {p.name: chosen[p.name] for p in POLICIES}
        return to_brdf(measurements_of(path, chosen["invalid"]), **policies)


def _bad(file: str, field: str, got: Any, expected: str) -> FileFormatError:
    got = printable(str(got))[:80]
    return FileFormatError(
        "damaged_file",
        f"{file}: {field}: {got}; expected {expected}",
        where=field,
        file=file,
        field=field,
        got=got,
        expected=expected,
    )


def measurements_of(path: Path, invalid: str = "drop") -> Measurements:
    """The points of a file; see `BirdFormat.read`."""
    raw = read_bytes(path, MAX_BYTES)
    content = _content(raw, path.name)
    data = content.get("data")
    if not isinstance(data, dict):
        raise _bad(path.name, "data", type(data).__name__, "an object")
    columns, units = _rows_form(data, path.name) if "variables" in data else _values_form(data, path.name)
    done: list[str] = []
    degrees = {name: columns[name] * _unit(path.name, name, units[name], _UNITS) for name in _ANGLES}
    values = columns["BRDF"]
    unit = units["BRDF"].replace(" ", "").lower()
    if unit not in ("", "sr-1", "sr^-1", "1/sr", "sr⁻¹", "na"):
        raise _bad(path.name, "BRDF.unit", units["BRDF"], "sr-1")
    wave = next((name for name in _WAVES if name in columns), None)
    others = [name for name in columns if name not in (*_ANGLES, "BRDF", "uBRDF", *([wave] if wave else []))]
    varied = [n for n in others if len(set(columns[n].tolist())) > 1]
    if varied:
        done.append(f"points that differ in {', '.join(printable(v) for v in varied[:6])} only are averaged as repeats")
    if "uBRDF" in columns:
        done.append("the uncertainty uBRDF is left out")
    angles = np.stack([degrees[name] for name in _ANGLES], axis=1)
    lines = np.arange(1, len(values) + 1)
    channels: Channels = VALUE
    table = values[:, None]
    if wave is not None:
        nm = columns[wave] * _unit(path.name, wave, units[wave], _LENGTHS)
        if not (np.isfinite(nm) & (nm > 0) & (nm < 1e9)).all():
            raise _bad(path.name, wave, f"{nm.min():g}", "positive wavelengths")
        angles, table, lines, channels = _pivoted(path.name, angles, nm, values, bool(varied))
    metadata = content.get("metadata")
    sample = metadata.get("sample") if isinstance(metadata, dict) else None
    name = sample.get("name", "") if isinstance(sample, dict) else sample if isinstance(sample, str) else ""
    return Measurements.from_columns(
        angles[:, 0], angles[:, 1], angles[:, 2], angles[:, 3], table, channels, file=path.name, format="bird",
        lines=lines, invalid="error" if invalid == "error" else "drop", conventions=dict(_CONVENTIONS),
        found={"variables": [printable(n)[:40] for n in columns][:40], "points": len(values)}, done=done,
        source={"sha256": hashlib.sha256(raw).hexdigest(), "bytes": len(raw)}, description=printable(str(name))[:100],
    )  # fmt: skip


def _content(raw: bytes, file: str) -> dict[str, Any]:
    # numbers of JSON that are no numbers elsewhere: a value that is missing
    try:
        content = json.loads(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise _bad(file, "JSON", f"byte {error.start} is no UTF-8", "JSON in UTF-8") from error
    except (ValueError, RecursionError) as error:
        raise _bad(file, "JSON", str(error)[:60], "a JSON object") from error
    if not isinstance(content, dict):
        raise _bad(file, "JSON", type(content).__name__, "an object of metadata and data")
    return content


def _values_form(data: dict[str, Any], file: str) -> tuple[dict[str, Float64Array], dict[str, str]]:
    """Columns and units of version 1.0: one object a variable."""
    columns: dict[str, Float64Array] = {}
    units: dict[str, str] = {}
    for name, variable in list(data.items())[:64]:
        if not isinstance(variable, dict) or not isinstance(variable.get("values"), list):
            if name in (*_ANGLES, "BRDF"):
                raise _bad(file, f"data.{name}", type(variable).__name__, "an object with unit and values")
            continue
        values = variable["values"]
        if len(values) > _MOST_POINTS:
            raise _bad(file, f"data.{name}.values", f"{len(values)} values", f"at most {_MOST_POINTS}")
        units[name] = str(variable.get("unit", ""))[:20]
        columns[name] = _numbers(values, file, f"data.{name}.values", needed=name in (*_ANGLES, "BRDF"))
    return _checked(columns, units, file)


def _rows_form(data: dict[str, Any], file: str) -> tuple[dict[str, Float64Array], dict[str, str]]:
    """Columns and units of the first form: variables by name, a row a point."""
    variables, rows = data["variables"], data.get("values")
    if not isinstance(variables, list) or not all(isinstance(v, dict) and "name" in v for v in variables):
        raise _bad(file, "data.variables", type(variables).__name__, "a list of objects with name and unit")
    if not isinstance(rows, list) or not rows or not variables:
        raise _bad(file, "data.values", "nothing" if not rows else type(rows).__name__, "a row for each point")
    if len(rows) > _MOST_POINTS or len(variables) > 64:
        raise _bad(file, "data.values", f"{len(rows)} rows of {len(variables)}", f"at most {_MOST_POINTS} rows of 64")
    wrong = next((k for k, r in enumerate(rows) if not isinstance(r, list) or len(r) != len(variables)), None)
    if wrong is not None:
        raise _bad(file, f"data.values[{wrong}]", "no row of as many", f"{len(variables)} values, as variables has")
    columns, units = {}, {}
    for k, variable in enumerate(variables):
        name = str(variable["name"])[:60]
        needed = name in (*_ANGLES, "BRDF")
        columns[name] = _numbers([row[k] for row in rows], file, f"data.values, {name}", needed=needed)
        units[name] = str(variable.get("unit", ""))[:20]
    return _checked(columns, units, file)


def _checked(
    columns: dict[str, Float64Array], units: dict[str, str], file: str
) -> tuple[dict[str, Float64Array], dict[str, str]]:
    for name in (*_ANGLES, "BRDF"):
        if name not in columns:
            raise _bad(file, f"data.{name}", "nothing", "theta_i, phi_i, theta_r, phi_r and BRDF")
    count = columns["BRDF"].size
    if not count:
        raise _bad(file, "data.BRDF.values", "no point", "at least one")
    for name, column in columns.items():
        if column.size != count:
            raise _bad(file, f"data.{name}.values", f"{column.size} values", f"{count}, as BRDF has")
    return columns, units


def _numbers(values: list[Any], file: str, field: str, *, needed: bool) -> Float64Array:
    """A column; what is no number is NaN in a column of values, an error in a needed one, a code in any other."""
    codes: dict[str, float] = {}
    found = np.empty(len(values))
    for k, value in enumerate(values):
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            found[k] = float(value) if abs(value) < 1e300 else np.nan
        elif value is None or (isinstance(value, str) and value.strip().lower() in ("", "na", "nan", "null")):
            found[k] = np.nan
        elif needed:
            raise _bad(file, f"{field}[{k}]", repr(value)[:40], "a number")
        else:
            found[k] = codes.setdefault(json.dumps(value)[:200], float(len(codes)))
    return found


def _unit(file: str, name: str, unit: str, known: dict[str, float]) -> float:
    if unit.strip().lower() not in known:
        raise _bad(file, f"{name}.unit", repr(unit), " or ".join(known))
    return known[unit.strip().lower()]


def _pivoted(
    file: str, angles: Float64Array, nm: Float64Array, values: Float64Array, repeated: bool
) -> tuple[Float64Array, Float64Array, npt.NDArray[np.int64], Channels]:
    """(angles, values (n, channels), numbers of the points, channels): a wavelength a channel, repeats averaged."""
    waves, channel = np.unique(nm, return_inverse=True)
    if waves.size > _MOST_WAVES:
        raise _bad(file, "wavelength", f"{waves.size} of them", f"at most {_MOST_WAVES}")
    channels = Channels(waves.tolist(), "wavelength")
    if waves.size == 1:
        return angles, values[:, None], np.arange(1, len(values) + 1), channels
    keys, first, place = np.unique(np.round(angles, 7), axis=0, return_index=True, return_inverse=True)
    slot = place.reshape(-1) * waves.size + channel.reshape(-1)
    total = np.bincount(slot, values, keys.shape[0] * waves.size)
    count = np.bincount(slot, minlength=keys.shape[0] * waves.size)
    with np.errstate(invalid="ignore", divide="ignore"):
        table = (total / count).reshape(keys.shape[0], waves.size)
    return angles[first], table, first + 1, channels
