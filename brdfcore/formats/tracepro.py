"""TracePro surface property export (text): its block `Table_BSDF_Data`, read.

After the header of the property and its own columns a line `Table_BSDF_Data`, a line of names and rows of numbers:
Temperature (K), Wavelength (micrometres), IncAngle and AziAngle (degrees, the light), ScatterBeta, ScatterAzimuth
(degrees), BRDF and BTDF (1/sr). ScatterBeta is Harvey and Shack's |beta - beta0|, the distance between the projections
of the scattered and the mirror direction onto the surface; ScatterAzimuth turns about the mirror direction's
projection. Where its 0 points, no public description was found to say: it is taken to point away from the light, along
beta0, and towards the normal with the option zero='normal'. Places beyond the horizon (|beta| > 1) are padding.

Read to a `scattered` table. BTDF is left out, and so are rows of another temperature than the first.
"""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import VALUE, Channels
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import POLICIES, to_brdf
from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile

Float64Array = npt.NDArray[np.float64]

_BLOCK = "Table_BSDF_Data"
_NEEDED = ("IncAngle", "ScatterBeta", "ScatterAzimuth", "BRDF")
_MOST_WAVES = 512
#: A projection may pass the horizon by this much: seven printed digits.
_SLACK = 1e-6
_CONVENTIONS = {
    "value": "BRDF in 1/sr, without the cosine; BTDF is left out",
    "wavelength": "micrometres in the file, nanometres here",
    "ScatterBeta": "|beta - beta0|, distance of the projected directions; beyond the horizon there is nothing",
    "ScatterAzimuth": "about the projected mirror direction, 0 pointing {zero}, counter-clockwise seen from outside",
}


class TraceProFormat(Format):
    """TracePro surface property with a table of BSDF (`Table_BSDF_Data`), text."""

    name = "tracepro"
    SUMMARY = "TracePro surface property export, text: Table_BSDF_Data in beta - beta0 coordinates"
    REFERENCE = "Lambda Research, TracePro user's manual: surface properties, property import and export formats"
    EXTENSIONS = (".txt",)
    PARAMETERS = (
        Parameter("zero", "", "where ScatterAzimuth 0 points", "horizon", kind="choice", choices=("horizon", "normal")),
        Parameter(
            "invalid", "", "rows with a value that is not finite", "drop", kind="choice", choices=("drop", "error")
        ),
        *POLICIES,
    )

    def sniff(self, head: bytes) -> bool:
        first = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        lines = [line.strip() for line in first.splitlines()]
        return first.startswith(b"TracePro Surface Property") or _BLOCK.encode() in lines

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file; raises `FileFormatError` naming file, line and field, `StorageError` if it can't be opened."""
        chosen = resolve("format 'tracepro'", self.PARAMETERS, options)
        policies = {p.name: chosen[p.name] for p in POLICIES}
        return to_brdf(measurements_of(path, chosen["zero"], chosen["invalid"]), **policies)


def measurements_of(path: Path, zero: str = "horizon", invalid: str = "drop") -> Measurements:
    """The rows of a file; see `TraceProFormat.read`."""
    text = TextFile(path)
    start = next((k for k, line in enumerate(text.lines) if line.strip() == _BLOCK), None)
    if start is None:
        raise text.bad(
            len(text.lines), _BLOCK, "no such block: the property is a model (ABg, Harvey) or has no scatter", _BLOCK
        )
    places, table, lines = _rows(text, start + 1)
    done = []
    if "Temperature" in places:
        hot = table[:, places["Temperature"]]
        if (hot != hot[0]).any():
            done.append(f"{int((hot != hot[0]).sum())} rows of another temperature than {hot[0]:g} K left out")
        table, lines = table[hot == hot[0]], [n for n, t in zip(lines, hot) if t == hot[0]]
    theta_i = table[:, places["IncAngle"]]
    if not ((theta_i >= 0) & (theta_i <= 90)).all():
        k = int(np.flatnonzero(~((theta_i >= 0) & (theta_i <= 90)))[0])
        raise text.bad(lines[k], "IncAngle", f"{theta_i[k]:g}", "0 to 90 degrees")
    beta, azimuth = table[:, places["ScatterBeta"]], np.radians(table[:, places["ScatterAzimuth"]])
    if not ((beta >= 0) & (beta <= 2)).all() or not np.isfinite(azimuth).all():
        k = int(np.flatnonzero(~((beta >= 0) & (beta <= 2) & np.isfinite(azimuth)))[0])
        raise text.bad(lines[k], "ScatterBeta, ScatterAzimuth", f"{beta[k]:g}", "beta from 0 to 2, finite azimuths")
    outwards = 1.0 if zero == "horizon" else -1.0
    # projections, the mirror direction along +x: the light is at -x
    along = np.sin(np.radians(theta_i)) + outwards * beta * np.cos(azimuth)
    across = outwards * beta * np.sin(azimuth)
    length = np.hypot(along, across)
    above = length <= 1 + _SLACK
    if not above.all():
        done.append(f"{int((~above).sum())} of {above.size} rows lie beyond the horizon and are padding: left out")
    if not above.any():
        raise text.bad(lines[0], "ScatterBeta", "no row above the horizon", "directions above it")
    theta_o = np.degrees(np.arcsin(np.minimum(length, 1.0)))
    delta = np.where(length > 1e-9, np.degrees(np.arctan2(across, along)), 0.0) + 180.0
    turn = table[:, places["AziAngle"]] if "AziAngle" in places else np.zeros(len(table))
    value = table[:, places["BRDF"]]
    wave = table[:, places["Wavelength"]] * 1000 if "Wavelength" in places else np.zeros(len(table))
    if "BTDF" in places and (table[:, places["BTDF"]] != 0).any():
        done.append("BTDF left out: only reflectance is held")
    kept = np.flatnonzero(above)
    keys, values, channels = _pivoted(text, np.stack([theta_i, turn, theta_o, delta], axis=1)[kept], wave[kept],
                                      value[kept], lines[0])  # fmt: skip
    first = [lines[k] for k in kept[keys[1]]]
    angles = keys[0]
    conventions = {k: v.format(zero="away from the light" if zero == "horizon" else "towards the normal")
                   for k, v in _CONVENTIONS.items()}  # fmt: skip
    return Measurements.from_columns(
        angles[:, 0], angles[:, 1], angles[:, 2], angles[:, 1] + angles[:, 3], values, channels, file=text.name,
        format="tracepro", lines=first, invalid="error" if invalid == "error" else "drop", conventions=conventions,
        found={"columns": list(places)}, done=done, source=text.source, description=_named(text, start),
    )  # fmt: skip


def _pivoted(
    text: TextFile, geometry: Float64Array, wave: Float64Array, value: Float64Array, line: int
) -> tuple[tuple[Float64Array, npt.NDArray[np.int64]], Float64Array, Channels]:
    """((geometries, first row of each), values (n, channels), channels); every row where there is one wavelength."""
    waves, channel = np.unique(wave, return_inverse=True)
    if waves.size > _MOST_WAVES or not np.isfinite(waves).all():
        raise text.bad(line, "Wavelength", f"{waves.size} of them", f"at most {_MOST_WAVES}, finite")
    if waves.size == 1:
        channels = Channels([float(waves[0])], "wavelength") if 0 < waves[0] <= 1e9 else VALUE
        return (geometry, np.arange(len(geometry))), value[:, None], channels
    if waves[0] <= 0 or waves[-1] > 1e9:
        raise text.bad(line, "Wavelength", f"{waves[0]:g} to {waves[-1]:g} nm", "micrometres from above 0 to a metre")
    keys, first, place = np.unique(np.round(geometry, 6), axis=0, return_index=True, return_inverse=True)
    values = np.full((len(keys), waves.size), np.nan)
    values[place.reshape(-1), channel.reshape(-1)] = value
    return (geometry[first], first), values, Channels(waves.tolist(), "wavelength")


def _rows(text: TextFile, start: int) -> tuple[dict[str, int], Float64Array, list[int]]:
    """(place of each column, rows, their lines) of the block that begins at line index `start`."""
    names = text.lines[start].split() if start < len(text.lines) else []
    places = {name: k for k, name in enumerate(names)}
    missing = [n for n in _NEEDED if n not in places]
    if missing or len(places) < len(names):
        raise text.bad(start + 1, "names of the columns", " ".join(names)[:80] or "nothing", ", ".join(_NEEDED))
    numbers, lines = array("d"), []
    for k in range(start + 1, len(text.lines)):
        words = text.lines[k].split()
        if not words or words[0].upper() in ("SAVE-DATA", "END"):
            break
        if len(words) != len(names):
            raise text.bad(k + 1, "row", f"{len(words)} numbers", f"{len(names)}, as the columns named")
        numbers.extend(text.number(w, k + 1, names[n]) for n, w in enumerate(words))
        lines.append(k + 1)
        if len(numbers) > MAX_NUMBERS:
            raise text.bad(k + 1, "row", f"more than {MAX_NUMBERS} numbers", "a smaller file")
    if not lines:
        raise text.bad(start + 1, "rows", "none", "a row for each direction")
    return places, np.array(numbers, np.float64).reshape(len(lines), len(names)), lines


def _named(text: TextFile, start: int) -> str:
    found = [line.split(None, 1) for line in text.lines[: min(start, 40)]]
    return next((words[1].strip()[:100] for words in found if len(words) == 2 and words[0] == "Name"), "")
