"""ASAM OpenMATERIAL 3D BRDF look-up tables (JSON rows of wavelength, theta_i, theta_o, phi, f), read and written.

The standard's rows may lie anywhere: they are read as scattered measurements. Files written here declare in a block of
their own, `brdfTables`, which nodes about the mirror direction their rows are (`tables.specular_grid`); read again,
such a file is the same table, and to any other reader it is a file of the standard.
"""

from __future__ import annotations

import hashlib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import VALUE, Channels
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.errors import BrdfError, FileFormatError, InputError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format, LossWarning, read_bytes
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.formats.openmaterial.text import COLUMNS, Rows, bad, compose, offset_of, parse
from brdfcore.formats.openmaterial.write import KEY, document, node_rows
from brdfcore.metrics import measured_flags
from brdfcore.tables.specular_grid import SpecularGrid

Float64Array = npt.NDArray[np.float64]

#: What the standard's schema asks the name of such a file to end in.
NAME_END = "_brdf.xompt"
#: Largest file read: 5 million rows; reading takes about six times a file's size.
MAX_BYTES = 256_000_000
#: Distance, rad in theta_i, theta_o and delta_phi, within which a row counts as the node of a declared grid, and the
#: share of rows that may lie farther off: a slip in a row or two must not turn a grid into scattered points.
_NEAR_NODE, _MOST_ODD = 1e-4, 1e-3
#: Most wavelengths: a nanometre step over the optical range, and far beyond any file.
_MOST_CHANNELS = 4_096
#: The standard's own limits of each column, rounded as its schema rounds pi.
_LIMITS = ((1e-9, 17.16e-3), (0.0, HALF_PI + 1e-6), (0.0, HALF_PI + 1e-6), (-1e-6, 2 * np.pi + 1e-6))
#: Longest axis that a declared grid may have, and most nodes.
_MOST_NODES, _MOST_GRID = 10_000, 20_000_000

_CONVENTIONS = {
    "value": "BRDF = f_r in 1/sr, without the cosine",
    "angles": "radians; zenith angles from the normal",
    "phi": "exit azimuth minus incident azimuth, both of directions that leave the surface: the mirror direction is pi "
    "(the common definition, as agreed in issue 436 of the standard's repository; its text names the incident ray as "
    "the reference and does not say which way it points; mirror='0' reads the other way)",
    "wavelength": "metres in the file, nanometres here; null means that none is stated",
    "null": "a value of null is no measurement",
}


class OpenMaterialFormat(Format):
    """BRDF look-up table of ASAM OpenMATERIAL 3D 1.0, whose name ends in `_brdf.xompt`."""

    name = "openmaterial"
    SUMMARY = "ASAM OpenMATERIAL 3D BRDF look-up table (JSON rows), NAME_brdf.xompt"
    REFERENCE = "ASAM OpenMATERIAL 3D 1.0.0, schemas/material_brdf_schema.json, ASAM e.V., 2025"
    EXTENSIONS = (".xompt",)
    PARAMETERS = (
        Parameter("mirror", "", "phi of the mirror direction, degrees", "180", kind="choice", choices=("180", "0")),
        Parameter("negatives", "", "what negative values become", "keep", kind="choice", choices=("keep", "zero")),
        Parameter("grid", "", "use the declared grid, or only the rows", "declared", kind="choice",
                  choices=("declared", "rows")),
    )  # fmt: skip
    WRITE_PARAMETERS = (
        Parameter("shape", "", "nodes of theta_i, azimuth over half a turn and distance", "28,19,40", kind="text"),
        Parameter(
            "wavelengths", "lambda", "one for each channel that has a name, nm", None, kind="wavelengths",
            bounds=(1.0, 17.16e6), unit="nm",
        ),
        Parameter("negatives", "", "negative values, which the standard forbids", "zero", kind="choice",
                  choices=("zero", "keep")),
        Parameter("license", "", "licence to state", "not stated", kind="text"),
        Parameter("author", "", "author to state", "not stated", kind="text"),
        Parameter("copyright", "", "copyright to state", "not stated", kind="text"),
    )  # fmt: skip
    writable = True
    exact = False

    def sniff(self, head: bytes) -> bool:
        rest = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        return rest.startswith(b"{") and (b"material_brdf_schema" in head or b'"brdf"' in head)

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file. `StorageError` if it can't be opened, `LimitError` above `MAX_BYTES`, `FileFormatError` naming
        file, field and byte offset if it is damaged or not within the standard's limits."""
        given = resolve("format 'openmaterial'", self.PARAMETERS, options)
        data = read_bytes(path, MAX_BYTES)
        return _Reader(path.name, data, parse(data, path.name), given).brdf()

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write the rows of a material that was read from scattered rows, the nodes of a `specular_grid`, or f at such
        nodes of anything else. The file says in its description what was done.

        Raises `InputError` for a perfect mirror part, and for named channels without wavelengths (R, G, B have nominal
        ones; one channel "value" is written without).
        """
        given = resolve("writing format 'openmaterial'", self.WRITE_PARAMETERS, options)
        content, rows, losses = document(brdf, given)
        if not path.name.endswith(NAME_END):
            losses.append(
                f"the standard calls such a file NAME{NAME_END}, and its public checker refuses {path.name!r}: rename "
                "it for that"
            )
        again = write_file(path, compose(content, rows), self.read)
        for text in losses:
            warnings.warn(text, LossWarning, stacklevel=2)
        return again


class _Reader:
    """One file on its way to a table."""

    def __init__(self, file: str, data: bytes, content: Rows, given: dict[str, Any]) -> None:
        self.file, self.data, self.given = file, data, given
        self.rows, self.start = content.rows, content.offset
        self.content = content.content
        self.done: list[str] = []
        self.warnings: list[str] = []

    def fail(self, row: int, column: int, reason: str, got: Any, expected: str) -> FileFormatError:
        at = offset_of(self.data, self.start, 5 * row + column)
        return bad(self.file, f"brdf.lookupTable[{row}], {COLUMNS[column]}", at, reason, got, expected, row=row)

    def brdf(self) -> Brdf:
        rows = self._checked()
        block = self._block()
        waves, channel = np.unique(rows[:, 0], return_inverse=True)  # NaN, if there is one, is the last
        if waves.size > _MOST_CHANNELS:
            raise bad(self.file, "wavelengths", self.start, "too many", waves.size, f"at most {_MOST_CHANNELS}")
        channels, position = self._channels(waves, block)
        angles, place = np.unique(np.round(rows[:, 1:4], 9), axis=0, return_inverse=True)
        values = np.full((angles.shape[0], waves.size), np.nan)
        place, channel = place.reshape(-1), position[channel.reshape(-1)]
        twice = rows.shape[0] - np.unique(place * waves.size + channel).size
        values[place, channel] = rows[:, 4]
        if self.given["negatives"] == "zero" and (values < 0).any():
            self.done.append(f"{int((values < 0).sum())} negative values set to zero, as asked")
            values = np.where(values < 0, 0.0, values)
        found = {
            "rows": int(rows.shape[0]),
            "geometries": int(angles.shape[0]),
            "channels": channels.to_json(),
            "negative": self._counts(channels, rows[:, 4] < 0, channel),
            "zero": self._counts(channels, rows[:, 4] == 0, channel),
            "null": self._counts(channels, np.isnan(rows[:, 4]), channel),
            "repeated": int(twice),
            "angles covered": f"theta_i {np.degrees(angles[:, 0].min()):.4g} to {np.degrees(angles[:, 0].max()):.4g}, "
            f"theta_o {np.degrees(angles[:, 1].min()):.4g} to {np.degrees(angles[:, 1].max()):.4g} degrees",
        }
        if (rows[:, 4] < 0).any() and self.given["negatives"] == "keep":
            self.warnings.append("some values are negative, which the standard forbids; they are kept")
        declared = self._declared(block, angles, values, channels) if self.given["grid"] == "declared" else None
        if declared is not None:
            return self._described(declared, found, block)
        return self._described(self._scattered(rows, place, angles, values, channels, twice), found, block)

    def _counts(self, channels: Channels, hit: npt.NDArray[np.bool_], channel: npt.NDArray[np.int64]) -> dict[str, int]:
        counts = np.bincount(channel[hit], minlength=len(channels))
        return dict(zip(map(str, channels), counts.tolist()))

    def _checked(self) -> Float64Array:
        """The rows, their first four columns within the standard's limits."""
        rows = self.rows
        for column, (low, high) in enumerate(_LIMITS):
            values = rows[:, column]
            wrong = ~((values >= low) & (values <= high))
            if column == 0:
                wrong &= ~np.isnan(values)
            if wrong.any():
                row = int(np.flatnonzero(wrong)[0])
                raise self.fail(
                    row, column, "outside the standard's limits", f"{values[row]:g}", f"{low:g} to {high:.6f}"
                )
        if np.isnan(rows[:, 0]).any() and not np.isnan(rows[:, 0]).all():
            row = int(np.flatnonzero(np.isnan(rows[:, 0]))[0])
            raise self.fail(row, 0, "no wavelength, where other rows have one", "null", "a wavelength, or null in all")
        step = np.diff(rows[:, :4], axis=0)
        first = np.argmax(step != 0, axis=1)
        if (step[np.arange(step.shape[0]), first] < 0).any():
            self.warnings.append("the rows are not sorted by their columns, as the standard wants them")
        stated = self.content["brdf"].get("wavelengths")
        if isinstance(stated, list) and all(isinstance(w, (int, float)) for w in stated):
            known = np.unique(rows[~np.isnan(rows[:, 0]), 0])
            if sorted({float(w) for w in stated}) != known.tolist():
                self.warnings.append("brdf.wavelengths does not list the rows' wavelengths; the rows are believed")
        else:
            raise bad(self.file, "brdf.wavelengths", 0, "is missing or no list", repr(stated)[:60], "a list of metres")
        return np.where(np.isnan(rows), np.nan, rows)

    def _block(self) -> dict[str, Any]:
        block = self.content.get(KEY)
        return block if isinstance(block, dict) else {}

    def _channels(self, waves: Float64Array, block: dict[str, Any]) -> tuple[Channels, npt.NDArray[np.int64]]:
        """The channels, and the position among them of each wavelength of `waves`, which ascend."""
        names, stated = block.get("channels"), block.get("wavelengths")
        try:
            if isinstance(names, list) and isinstance(stated, list) and len(names) == len(stated) == waves.size:
                position = np.argsort(np.argsort(np.array(stated, np.float64)))
                if sorted(stated) == waves.tolist():
                    return Channels([str(n) for n in names], "name"), np.argsort(position)
            if names is not None:
                self.warnings.append(f"{KEY}.channels does not fit the rows' wavelengths and is left aside")
            if np.isnan(waves[-1]):
                return VALUE, np.zeros(1, np.int64)
            return Channels([float(f"{1e9 * w:.12g}") for w in waves], "wavelength"), np.arange(waves.size)
        except (BrdfError, TypeError, ValueError, OverflowError) as error:
            raise bad(self.file, f"{KEY}.channels", 0, "can't be used", str(error)[:80], "names of channels") from error

    def _declared(
        self, block: dict[str, Any], angles: Float64Array, values: Float64Array, channels: Channels
    ) -> SpecularGrid | None:
        """The declared grid, or None without one or where the rows are not its nodes (with a warning)."""
        grid = block.get("grid")
        if grid is None:
            return None
        try:
            nodes = [np.array(grid[n], np.float64) for n in ("theta_i", "azimuth", "radial")]
            bilateral = bool(grid["bilateral"])
            sizes = [n.size for n in nodes]
            if max(sizes) > _MOST_NODES or np.prod([float(n) for n in sizes]) * len(channels) > _MOST_GRID:
                raise ValueError
            if any(n.ndim != 1 or n.size < 2 or not (np.diff(n) > 0).all() for n in nodes):
                raise ValueError
            last = np.pi if bilateral else 2 * np.pi
            if nodes[0][0] < 0 or nodes[0][-1] > HALF_PI or nodes[1][0] or abs(nodes[1][-1] - last) > 1e-9:
                raise ValueError
            if nodes[2][0] or nodes[2][-1] > np.pi:
                raise ValueError
        except (TypeError, ValueError, KeyError, OverflowError) as error:
            expected = "ascending theta_i, azimuth, radial"
            raise bad(self.file, f"{KEY}.grid", 0, "is no grid", repr(grid)[:60], expected) from error
        cells, directions = node_rows(*nodes, bilateral=bilateral)
        from scipy.spatial import cKDTree  # here: a list of formats needs no scipy

        away, at = map(np.asarray, cKDTree(directions).query(angles, distance_upper_bound=_NEAR_NODE))
        odd = int((~np.isfinite(away)).sum())
        if odd > _MOST_ODD * len(angles):
            self.warnings.append(f"{odd} geometries are no nodes of the grid that {KEY} declares: it is left aside")
            return None
        if odd:
            text = f"{odd} of {len(angles)} geometries are left aside: they are farther than {_NEAR_NODE:g} rad from"
            self.warnings.append(f"{text} every node of the grid that {KEY} declares")
        full = np.full((*sizes, len(channels)), np.nan)
        listed = np.full((len(directions), len(channels)), np.nan)
        listed[at[np.isfinite(away)]] = values[np.isfinite(away)]
        k, a, r = cells
        full[k, a, r] = listed
        # one row stands for all azimuths at the mirror direction, and at theta_i = 0
        full[:, :, 0] = full[:, :1, 0]
        if nodes[0][0] == 0:
            full[0] = full[0, :1]
        if not bilateral:
            full[:, -1] = full[:, 0]
        try:
            table, done = SpecularGrid.from_nodes(nodes[0], nodes[1], nodes[2], full, channels, bilateral=bilateral)
        except InputError as error:
            self.warnings.append(f"the grid that {KEY} declares is left aside: {error.detail}")
            return None
        self.done += done
        return table

    def _scattered(
        self,
        rows: Float64Array,
        place: npt.NDArray[np.int64],
        angles: Float64Array,
        values: Float64Array,
        channels: Channels,
        twice: int,
    ) -> Brdf:
        """The rows regridded. Repeated rows stay repeats where there is one channel; of several, the last stands."""
        lines = np.zeros(angles.shape[0], np.int64)
        lines[place[::-1]] = np.arange(rows.shape[0], 0, -1)
        if twice and len(channels) == 1:
            angles, values, lines = rows[:, 1:4], rows[:, 4:], np.arange(1, rows.shape[0] + 1)
        elif twice:
            self.done.append(f"of {twice} rows that repeat a wavelength and geometry the last is used")
        measurements = Measurements.from_columns(
            angles[:, 0], 0.0, angles[:, 1], angles[:, 2], values, channels,
            file=self.file, format="openmaterial", lines=lines, degrees=False, mirror=float(self.given["mirror"]),
            conventions=_CONVENTIONS,
        )  # fmt: skip
        table = to_brdf(measurements)
        self.done += [d for d in table.report.get("done", []) if d not in self.done]
        self.warnings += [w for w in table.report.get("warnings", []) if w not in self.warnings]
        return table

    def _described(self, table: Brdf, found: dict[str, Any], block: dict[str, Any]) -> Brdf:
        if isinstance(table, SpecularGrid):
            flags = measured_flags(table) | {"non_negative": bool((table.values >= 0).all())}
            flags["bilateral"] = table.bilateral
            for flag in FLAGS:
                setattr(table, flag, flags[flag])
        metadata = self.content.get("metadata")
        metadata = metadata if isinstance(metadata, dict) else {}
        sha = hashlib.sha256(self.data).hexdigest()
        told = block.get("done")
        told = [t[:300] for t in told[:20] if isinstance(t, str)] if isinstance(told, list) else []
        self.done[:0] = told
        table.source = {"name": self.file, "format": "openmaterial", "sha256": sha}  # type: ignore[attr-defined]
        table.metadata = {
            "description": str(metadata.get("description") or metadata.get("name") or "")[:400],
            "openmaterial": {"metadata": metadata, "done": told},
        }
        conventions = dict(_CONVENTIONS)
        if self.given["mirror"] == "0":
            conventions["phi"] = "exit azimuth counted from the mirror direction, as asked (mirror='0')"
        table.report = {
            **table.report,
            "format": "openmaterial",
            "file": self.file,
            "sha256": sha,
            "bytes": len(self.data),
            "conventions": conventions,
            "found": {**table.report.get("found", {}), **found},
            "done": self.done,
            "warnings": self.warnings,
        }
        return table
