"""ALTA (Inria's library for BRDF fitting), text: its isotropic and complete parametrisations, read.

Lines of the header begin with #: `#DIM x y` (coordinates and values a row), `#PARAM_IN NAME`, `#PARAM_OUT NAME` (what
they are), `#VS n` (confidence intervals after the values: 1, a radius; 2, low and high); rows of numbers follow,
radians. Coordinates, L the light and V the view, both from the surface, so that an azimuth between them of 0 is the
RETRO side and pi the mirror's:

    ISOTROPIC_TV_TL_DPHI        theta_V, theta_L, phi_L - phi_V
    ISOTROPIC_TL_TV_PROJ_DPHI   theta_L, theta_V cos d, theta_V sin d with d = phi_V - phi_L
    RUSIN_TH_TD_PD, RUSIN_TH_PH_TD_PD   half and difference angles (Rusinkiewicz), without and with the azimuth of H
    SPHERICAL_TL_PL_TV_PV       both directions
    CARTESIAN                   both vectors, V first

Values: INV_STERADIAN is f; INV_STERADIAN_COSINE_FACTOR is f cos(theta_V), divided by the cosine here, and a row at
theta_V = 90 degrees, where that is 0/0, is left out and counted; RGB_COLOR and XYZ_COLOR are f of three channels.
Slices (one or two coordinates, as COS_TH) don't say the geometry and are refused by name.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB, VALUE, Channels
from brdfcore.base.errors import FileFormatError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import POLICIES, to_brdf
from brdfcore.formats.base.text_rows import MAX_NUMBERS, TextFile, printable

Float64Array = npt.NDArray[np.float64]
#: theta_i, phi_i, theta_o, phi_o
_Geometry = tuple[Float64Array, Float64Array, Float64Array, Float64Array]

#: Longest header, lines, and most values a row.
_MOST_HEADER, _MOST_VALUES = 1_000, 4_096
#: A cosine below this is the horizon: 0.06 degrees.
_HORIZON = 1e-3
#: A vector may miss the length 1 by this much: printed digits.
_UNIT_SLACK = 1e-3


def _view_light_azimuth(c: Float64Array) -> _Geometry:
    return c[:, 1], np.zeros(len(c)), c[:, 0], -c[:, 2]


def _light_projected_view(c: Float64Array) -> _Geometry:
    return c[:, 0], np.zeros(len(c)), np.hypot(c[:, 1], c[:, 2]), np.arctan2(c[:, 2], c[:, 1])


def _spherical(c: Float64Array) -> _Geometry:
    return c[:, 0], c[:, 1], c[:, 2], c[:, 3]


def _cartesian(c: Float64Array) -> _Geometry:
    def angles(v: Float64Array) -> tuple[Float64Array, Float64Array]:
        across = np.hypot(v[:, 0], v[:, 1])
        return np.arctan2(across, v[:, 2]), np.where(across > 1e-12, np.arctan2(v[:, 1], v[:, 0]), 0.0)

    return (*angles(c[:, 3:]), *angles(c[:, :3]))


def _half_difference(c: Float64Array) -> _Geometry:
    """V is the difference vector turned by theta_h about y, then by phi_h about z; L is V turned about H by pi."""
    h, ph, d, pd = c[:, 0], c[:, 1], c[:, 2], c[:, 3]
    x, y, z = np.sin(d) * np.cos(pd), np.sin(d) * np.sin(pd), np.cos(d)
    x, z = np.cos(h) * x + np.sin(h) * z, -np.sin(h) * x + np.cos(h) * z
    x, y = np.cos(ph) * x - np.sin(ph) * y, np.sin(ph) * x + np.cos(ph) * y
    half = np.stack([np.sin(h) * np.cos(ph), np.sin(h) * np.sin(ph), np.cos(h)], axis=1)
    view = np.stack([x, y, z], axis=1)
    light = 2 * (view * half).sum(axis=1, keepdims=True) * half - view
    return _cartesian(np.concatenate([view, light], axis=1))


#: Number of coordinates and what they mean.
PARAMETRISATIONS: dict[str, tuple[int, Callable[[Float64Array], _Geometry]]] = {
    "ISOTROPIC_TV_TL_DPHI": (3, _view_light_azimuth),
    "ISOTROPIC_TL_TV_PROJ_DPHI": (3, _light_projected_view),
    "RUSIN_TH_TD_PD": (3, lambda c: _half_difference(np.insert(c, 1, 0.0, axis=1))),
    "RUSIN_TH_PH_TD_PD": (4, _half_difference),
    "SPHERICAL_TL_PL_TV_PV": (4, _spherical),
    "CARTESIAN": (6, _cartesian),
}
#: One or two coordinates: what they leave open.
SLICES = {
    "COS_TH": "the half vector's polar angle alone",
    "COS_TK": "the back vector's polar angle alone",
    "COS_TLV": "the angle between light and view alone",
    "COS_TLR": "the angle between light and mirror direction alone",
    "RUSIN_TH_TD": "half and difference angle without the azimuth phi_d",
    "COS_TH_TD": "half and difference angle without the azimuth phi_d",
    "ISOTROPIC_TV_TL": "two polar angles without an azimuth",
    "ISOTROPIC_TV_PROJ_DPHI": "the view alone, the light at the normal",
    "STARK_2D": "two lengths of half and back vector without an azimuth",
    "NEUMANN_2D": "two lengths of half and back vector without an azimuth",
    "RUSIN_VH": "the half vector alone",
    "SCHLICK_VK": "the back vector alone",
}
OUTPUTS = ("INV_STERADIAN", "INV_STERADIAN_COSINE_FACTOR", "RGB_COLOR", "XYZ_COLOR")
_XYZ = Channels(("X", "Y", "Z"))


class AltaFormat(Format):
    """ALTA text: lists of geometries in one of its parametrisations. Read to a `scattered` table."""

    name = "alta"
    SUMMARY = "ALTA text (Inria): measured geometries in isotropic or complete parametrisations"
    REFERENCE = (
        "L. Belcour, P. Barla, R. Pacanowski, ALTA: a BRDF analysis library, MAM workshop 2014, "
        "DOI 10.2312/mam.20141293; params.h of its source"
    )
    EXTENSIONS = (".dat", ".alta")
    PARAMETERS = (
        Parameter(
            "invalid", "", "rows with a value that is not finite", "drop", kind="choice", choices=("drop", "error")
        ),
        *POLICIES,
    )

    def sniff(self, head: bytes) -> bool:
        lines = head.removeprefix(b"\xef\xbb\xbf").lstrip().splitlines()
        comments = []
        for line in lines:
            if not line.startswith(b"#"):
                break
            comments.append(line)
        return any(line.startswith(b"#PARAM_IN") for line in comments)

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file; raises `FileFormatError` naming file, line and field, `StorageError` if it can't be opened."""
        chosen = resolve("format 'alta'", self.PARAMETERS, options)
        policies = {p.name: chosen[p.name] for p in POLICIES}
        return to_brdf(measurements_of(path, chosen["invalid"]), **policies)


def measurements_of(path: Path, invalid: str = "drop") -> Measurements:
    """The rows of an ALTA file; see `AltaFormat.read`."""
    text = TextFile(path)
    header = _header(text)
    turn, coordinates = _parametrisation(text, header)
    count = _count(text, header, coordinates)
    output = header.get("PARAM_OUT", ("", 0))[0].split()
    quantity = output[0] if output else "INV_STERADIAN"
    done, said = [], []
    if not output:
        said.append("PARAM_OUT is not stated: the values are taken as f in 1/sr")
    elif quantity not in OUTPUTS:
        known = ", ".join(OUTPUTS)
        raise text.bad(header["PARAM_OUT"][1], "PARAM_OUT", f"{quantity[:40]}, which is no reflectance", known)
    channels = _channels(text, header, quantity, count, said)
    table, lines, extra = _rows(text, coordinates, count, header)
    if extra:
        done.append(f"{extra} number(s) a row of confidence intervals (#VS) left out")
    if turn is _cartesian:
        lengths = np.stack([np.linalg.norm(table[:, k : k + 3], axis=1) for k in (0, 3)])
        for row in np.flatnonzero((np.abs(lengths - 1) > _UNIT_SLACK).any(axis=0))[:1]:
            raise text.bad(lines[row], "CARTESIAN", f"a vector of length {lengths[:, row].max():.4g}", "unit vectors")
    angles = turn(table[:, :coordinates])
    values = table[:, coordinates : coordinates + count]
    if quantity == "INV_STERADIAN_COSINE_FACTOR":
        cosine = np.cos(angles[2])
        used = cosine > _HORIZON
        if not used.all():
            done.append(
                f"{int((~used).sum())} rows at theta_o = 90 degrees left out, where f cos(theta_o) is 0 whatever f is; "
                f"the first: line {lines[int(np.flatnonzero(~used)[0])]}"
            )
        angles = (angles[0][used], angles[1][used], angles[2][used], angles[3][used])
        lines = [n for n, keep in zip(lines, used) if keep]
        values = values[used] / cosine[used, None]
        done.append("values divided by cos(theta_o): the file holds f cos(theta_o)")
    if not len(values):
        raise text.bad(len(text.lines), "rows", "no usable row", "rows of numbers")
    name = header["PARAM_IN"][0].split()[0]
    return Measurements.from_columns(
        *angles, values, channels, file=text.name, format="alta", lines=lines, degrees=False,
        invalid="error" if invalid == "error" else "drop",
        conventions={
            "angles": f"radians; {name}: azimuth 0 between view and light is the retro side, pi the mirror's",
            "value": f"{quantity}: " + ("f cos(theta_o)" if "COSINE" in quantity else "f in 1/sr"),
        },
        found={"parametrisation": name, "header": {k: v for k, (v, _) in list(header.items())[:40]}},
        done=done, warnings=said, source=text.source,
        description=header.get("SAMPLE", ("", 0))[0].strip('"'),
    )  # fmt: skip


def _header(text: TextFile) -> dict[str, tuple[str, int]]:
    """{name: (rest of the line, line)} of the lines that begin with # before the first row."""
    header: dict[str, tuple[str, int]] = {}
    for k, line in enumerate(text.lines[:_MOST_HEADER], 1):
        if line.strip() and not line.startswith("#"):
            break
        name, _, rest = line[1:].strip().partition(" ")
        if name.isupper():
            header.setdefault(name, (printable(rest.strip())[:200], k))
    for name in ("DIM", "PARAM_IN"):
        if name not in header:
            raise text.bad(1, name, f"no line #{name} before the rows", f"#{name}, as ALTA writes it")
    if "binary" in header.get("FORMAT", ("", 0))[0].lower():
        raise text.bad(header["FORMAT"][1], "FORMAT", "binary", "text: convert it with ALTA's data2data")
    return header


def _parametrisation(
    text: TextFile, header: dict[str, tuple[str, int]]
) -> tuple[Callable[[Float64Array], _Geometry], int]:
    words, line = header["PARAM_IN"][0].split(), header["PARAM_IN"][1]
    name = words[0] if words else "nothing"
    if name in SLICES:
        raise FileFormatError(
            "slice_only",
            f"{text.name}: line {line}: {name} is a slice, {SLICES[name]}: it does not say the geometry, so it is no "
            f"BRDF; read the measurement that it was made from, in one of {', '.join(PARAMETRISATIONS)}",
            where="PARAM_IN",
            file=text.name,
            line=line,
            field="PARAM_IN",
            got=name,
            expected=", ".join(PARAMETRISATIONS),
        )
    if name not in PARAMETRISATIONS:
        known = ", ".join(PARAMETRISATIONS)
        raise text.bad(line, "PARAM_IN", name[:60], f"one of {known} (ALTA's data2data converts to these)")
    count, turn = PARAMETRISATIONS[name]
    return turn, count


def _count(text: TextFile, header: dict[str, tuple[str, int]], coordinates: int) -> int:
    """Values a row, from #DIM, whose first number has to fit the parametrisation."""
    words, line = header["DIM"][0].split(), header["DIM"][1]
    if len(words) != 2 or not all(w.isascii() and w.isdigit() and len(w) < 6 for w in words):
        raise text.bad(line, "DIM", header["DIM"][0][:40], "two whole numbers")
    if int(words[0]) != coordinates:
        raise text.bad(line, "DIM", f"{words[0]} coordinates", f"{coordinates}, as PARAM_IN has")
    if not 1 <= int(words[1]) <= _MOST_VALUES:
        raise text.bad(line, "DIM", f"{words[1]} values a row", f"1 to {_MOST_VALUES}")
    return int(words[1])


def _channels(
    text: TextFile, header: dict[str, tuple[str, int]], quantity: str, count: int, said: list[str]
) -> Channels:
    if quantity in ("RGB_COLOR", "XYZ_COLOR"):
        if count != 3:
            raise text.bad(header["DIM"][1], "DIM", f"{count} values a row", f"3, as {quantity} has")
        return RGB if quantity == "RGB_COLOR" else _XYZ
    if count == 1:
        return VALUE
    if count == 3:
        said.append("three values a row without names are taken as R, G, B")
        return RGB
    return Channels([f"value {k}" for k in range(1, count + 1)])


def _rows(
    text: TextFile, coordinates: int, count: int, header: dict[str, tuple[str, int]]
) -> tuple[Float64Array, list[int], int]:
    """(rows, their lines, numbers a row beyond coordinates and values)."""
    kind = (header.get("VS", ("0", 0))[0].split() or ["0"])[0]
    allowed = {"1": (0, 1, count), "2": (0, 2, 2 * count)}.get(kind, (0,))
    numbers, lines, width = array("d"), [], 0
    for k, line in enumerate(text.lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        words = line.split()
        if not width:
            width = len(words)
            if width - coordinates - count not in allowed:
                expected = f"{coordinates} coordinates and {count} values, as #DIM says"
                raise text.bad(k, "row", f"{width} numbers", expected)
        if len(words) != width:
            raise text.bad(k, "row", f"{len(words)} numbers", f"{width}, as in the rows before")
        numbers.extend(text.number(word, k, "row") for word in words)
        lines.append(k)
        if len(numbers) > MAX_NUMBERS:
            raise text.bad(k, "row", f"more than {MAX_NUMBERS} numbers", "a smaller file")
    if not lines:
        raise text.bad(len(text.lines), "rows", "no rows after the header", "a row for each geometry")
    return np.array(numbers, np.float64).reshape(len(lines), width), lines, width - coordinates - count
