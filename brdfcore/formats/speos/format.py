"""Speos (OPTIS) surface files, text: the isotropic content of `.anisotropicbsdf`, and `.brdf`, read.

theta_o from the normal, phi from the mirror direction (phi = 0, theta_o = theta_i), degrees. The numbers are
proportional to f (type of the values 1) or to f cos(theta_o) (type 0), v = pi f up to a level; the level is the stated
reflectance in percent: f = (v / pi) c with c = percent / 100 over (1/pi) int v cos(theta_o) dw. A `.anisotropicbsdf`
states it once, at one incidence, for each wavelength, and its tables carry the ratio between incidences; a `.brdf`
states it for each table. The integral is the trapezoidal rule over the table's own angles.

Read to a `node_grid` of the file's own angles; between two incidences the place about the mirror direction stays the
same. A file of several rotations that differ is refused as anisotropic unless isotropic="mean". Transmission is left
out, by name.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import VALUE, Channels
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format
from brdfcore.formats.base.import_report import measures_of, value_range
from brdfcore.formats.base.measurements import ANISOTROPY
from brdfcore.formats.base.rotations import ISOTROPIC, anisotropic, loss_of_mean, lost_sentence
from brdfcore.formats.speos.text import TITLES, Lines, SpeosFile, Table, parse
from brdfcore.metrics import measured_flags
from brdfcore.tables.node_grid import NodeGrid

Float64Array = npt.NDArray[np.float64]

#: Sides of the plane of incidence this close, relative to the largest value, are one: printed digits.
_ROUNDING = 1e-12
#: Most values of a table, all channels: beyond any file.
_MOST_VALUES = 20_000_000
_CONVENTIONS = {
    "value": "proportional to f (type of the values 1) or to f cos(theta_o) (type 0); the stated reflectance in "
    "percent gives the level, scale='stored' leaves it: f = v / pi",
    "angles": "degrees; theta_o from the normal, phi from the mirror direction, 0 to 360: delta_phi = phi + 180",
    "between incidences": "at the same place about the mirror direction, f cos cos is linear",
    "spectrum": "of a .anisotropicbsdf: wavelength in nm and reflectance in percent at one incidence; the shape is the "
    "same at all wavelengths",
}


class SpeosFormat(Format):
    """Speos's `.anisotropicbsdf` (isotropic content) and `.brdf`, text."""

    name = "speos"
    SUMMARY = "Speos (OPTIS) surface file, text: .anisotropicbsdf of an isotropic sample, and .brdf"
    REFERENCE = "Ansys Speos, structure of anisotropic BSDF files; structure of BRDF files (Speos user's guide)"
    EXTENSIONS = (".anisotropicbsdf", ".brdf")
    PARAMETERS = (
        ISOTROPIC,
        Parameter("scale", "", "the level: the stated reflectance, or the numbers as stored", "stated", kind="choice",
                  choices=("stated", "stored")),
        Parameter("negatives", "", "what negative values become", "keep", kind="choice", choices=("keep", "zero")),
    )  # fmt: skip

    def sniff(self, head: bytes) -> bool:
        first = head.removeprefix(b"\xef\xbb\xbf").partition(b"\n")[0].strip().lower()
        return first.startswith(b"optis - ") and first[8:].startswith(tuple(t.encode() for t in TITLES))

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file. `StorageError` if it can't be opened, `LimitError` if it is too large, `FileFormatError` naming
        file, line and field if it is damaged, binary, anisotropic, or holds transmission only."""
        given = resolve("format 'speos'", self.PARAMETERS, options)
        content, lines = parse(path)
        return _Reader(content, lines, given).brdf()


class _Reader:
    """One file on its way to a table."""

    def __init__(self, content: SpeosFile, lines: Lines, given: dict[str, Any]) -> None:
        self.content, self.lines, self.given = content, lines, given
        self.file = lines.text.name
        self.done: list[str] = []
        self.warnings: list[str] = []
        self.apart = 0.0  # phi 0 and 360, relative to the largest value

    def brdf(self) -> NodeGrid:
        theta_o, phi, stored = self._gridded()  # (rotations, I, W, O, P)
        if self.apart > _ROUNDING:
            self.done.append(
                f"phi 0 and 360, one direction, up to {self.apart:.2g} of the largest value apart: averaged"
            )
        cosine = 1.0 if self.content.intensity else np.cos(np.radians(theta_o))[:, None]
        own = reflectance(stored.mean(axis=0) * cosine, theta_o, phi)  # (I, W), of the numbers as stored
        if self.content.intensity:
            theta_o, stored = self._without_cosine(theta_o, stored)
        mean = self._isotropic(stored, theta_o)  # (I, W, O, P)
        channels, factors = self._levels(own)
        values = np.einsum("iwop,iwc->iopc", mean, factors) / np.pi
        negative = int((values < 0).sum())
        if negative and self.given["negatives"] == "zero":
            values = np.maximum(values, 0)
            self.done.append(f"{negative} negative values set to zero, as asked")
        elif negative:
            self.warnings.append(f"{negative} of {values.size} values are negative; they are kept")
        delta_phi, values, bilateral = _turned(phi, values)
        table = NodeGrid.from_nodes(
            np.radians(self.content.incidences), np.radians(theta_o), delta_phi, values, channels,
            bilateral=bilateral, between="mirror",
        )  # fmt: skip
        if self.content.incidences[0] > 0:
            self.done.append(
                f"nothing measured below theta_i = {self.content.incidences[0]:g} degrees: the first slice, turned to "
                "the normal and averaged over azimuth, stands at 0"
            )
        flags = measured_flags(table) | {"non_negative": bool((values >= 0).all())}
        for flag in FLAGS:
            setattr(table, flag, flags[flag] if flag != "bilateral" else bilateral)
        if self.content.transmission:
            self.warnings.append("the transmission of the file is left out: only reflectance is held")
        self._describe(table, values, own)
        return table

    # ---- one grid of all tables -----------------------------------------------------------------

    def _gridded(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """(theta_o, phi, values (rotations, I, W, O, P)); tables of other angles on the angles of all of them, where
        each is its own bilinear interpolation."""
        tables = [[[self._whole(t) for t in row] for row in rotation] for rotation in self.content.tables]
        flat = [t for rotation in tables for row in rotation for t in row]
        theta_o, phi = (np.unique(np.concatenate([t[k] for t in flat])) for k in (0, 1))
        size = len(flat) * theta_o.size * phi.size
        if max(size, size * len(self.content.wavelengths) // len(tables[0][0])) > _MOST_VALUES:
            raise self.lines.bad("tables", f"{size} values on their common angles", f"at most {_MOST_VALUES}")
        if any(t.theta_o.size != theta_o.size or t.phi.size != phi.size for t in flat):
            self.done.append(
                f"the tables have different angles: each stands, by its own bilinear interpolation, on the "
                f"{theta_o.size} theta_o and {phi.size} phi of all of them"
            )
        shape = (len(tables), len(tables[0]), len(tables[0][0]), theta_o.size, phi.size)
        return theta_o, phi, np.array([_onto(t, theta_o, phi) for t in flat]).reshape(shape)

    def _whole(self, table: Table) -> Table:
        """The table over a whole turn of phi, or half a turn as it is, or one phi."""
        phi, values = table.phi, table.values
        if phi.size == 1 or (phi[0] == 0 and phi[-1] == 180):
            return table
        if phi[0] != 0 or phi[-1] + 1.5 * np.diff(phi).max() < 360:
            raise self.lines.text.bad(
                table.line, "phi", f"{phi[0]:g} to {phi[-1]:g} degrees", "0 to 360, or 0 to 180", "damaged_file"
            )
        if phi[-1] < 360:
            return Table(table.theta_o, np.append(phi, 360.0), np.column_stack([values, values[:, 0]]), table.line)
        ends = np.abs(values[:, 0] - values[:, -1]).max() / max(float(np.abs(values).max()), 1e-300)
        self.apart = max(self.apart, float(ends))
        values = values.copy()
        values[:, 0] = values[:, -1] = 0.5 * (values[:, 0] + values[:, -1])
        return Table(table.theta_o, phi, values, table.line)

    def _without_cosine(self, theta_o: Float64Array, stored: Float64Array) -> tuple[Float64Array, Float64Array]:
        cosine = np.cos(np.radians(theta_o))
        used = theta_o < 90
        if not used.all():
            self.done.append(f"{int((~used).sum())} rows at theta_o = 90 left out: f cos is 0 there whatever f is")
        if not used.any():
            raise self.lines.bad("theta", "90 degrees alone, where f cos says nothing", "rows below 90 degrees")
        self.done.append("values proportional to the intensity divided by cos(theta_o)")
        return theta_o[used], stored[..., used, :] / cosine[used, None]

    def _isotropic(self, stored: Float64Array, theta_o: Float64Array) -> Float64Array:
        """The mean over rotations; refused where they differ and that was not asked for."""
        mean = stored.mean(axis=0)
        if len(stored) == 1:
            return np.asarray(stored[0])
        weights = (np.cos(np.radians(theta_o)) * np.sin(np.radians(theta_o)))[:, None]
        loss = loss_of_mean(stored, weights)
        if self.given["isotropic"] == "mean":
            self.done.append(lost_sentence(f"{len(stored)} rotations of the sample", loss))
        elif loss > ANISOTROPY:
            k = np.unravel_index(int(np.abs(stored - mean).argmax()), stored.shape)
            raise anisotropic(
                self.file, "rotations", loss,
                f"its {len(stored)} rotations differ from their mean by {loss:.1%} (L1, limit {ANISOTROPY:.0%}), most "
                f"at rotation {self.content.rotations[k[0]]:g}, incidence {self.content.incidences[k[1]]:g} degrees",
                line=self.content.tables[k[0]][k[1]][k[2]].line,
            )  # fmt: skip
        else:
            self.done.append(f"{len(stored)} rotations of the sample, {loss:.2g} apart (L1), averaged")
        return np.asarray(mean)

    # ---- the level -------------------------------------------------------------------------------

    def _levels(self, own: Float64Array) -> tuple[Channels, Float64Array]:
        """(channels, factors (I, W, channels) of v) from the reflectance of v as stored (I, W)."""
        waves, percent = self.content.wavelengths, self.content.percent
        stated = self.given["scale"] == "stated"
        if self.content.kind == "brdf":
            channels = Channels(waves, "wavelength") if len(waves) > 1 else VALUE
            level = self._ratio(percent / 100, own) if stated else np.ones(own.shape)
            factors = level[:, :, None] * np.eye(len(waves))
            return channels, factors
        k = int(np.abs(np.array(self.content.incidences) - self.content.reference).argmin())
        if abs(self.content.incidences[k] - self.content.reference) > 1e-3:
            self.warnings.append(
                f"the reflectance is stated at theta_i = {self.content.reference:g} degrees, which no table has: "
                f"that of {self.content.incidences[k]:g} degrees is scaled to it"
            )
        same = bool((percent == percent[0, 0]).all())
        channels = VALUE if same else Channels(waves, "wavelength")
        if same and len(waves) > 1:
            self.done.append(
                f"the reflectance is {percent[0, 0]:g} % at all {len(waves)} wavelengths ({waves[0]:g} to "
                f"{waves[-1]:g} nm): one channel"
            )
        level = self._ratio(percent[0] / 100, np.full(len(waves), own[k, 0])) if stated else np.ones(len(waves))
        factors = np.broadcast_to(level[: len(channels)], (own.shape[0], 1, len(channels)))
        return channels, factors

    def _ratio(self, stated: Float64Array, own: Float64Array) -> Float64Array:
        """stated / own reflectance; 1, with a warning, where one of them is not above 0."""
        good = (stated > 0) & (own > 0)
        if not good.all():
            self.warnings.append(
                f"{int((~good).sum())} of {good.size} tables have no usable reflectance (stated or integrated is not "
                "above 0): their numbers are taken as pi f"
            )
        level = np.where(good, np.divide(stated, own, out=np.ones_like(own), where=good), 1.0)
        spread = f"{level.min():.6g}" if level.min() == level.max() else f"{level.min():.6g} to {level.max():.6g}"
        self.done.append(f"v / pi scaled to the stated reflectance: times {spread}")
        return np.asarray(level)

    # ---- report ------------------------------------------------------------------------------------

    def _describe(self, table: NodeGrid, values: Float64Array, own: Float64Array) -> None:
        content, text = self.content, self.lines.text
        table.source = {"name": self.file, "format": "speos", "sha256": text.sha256}
        table.metadata = {"description": content.description[:200]} if content.description else {}
        table.report = {
            "format": "speos",
            "file": self.file,
            "sha256": text.sha256,
            "bytes": text.bytes,
            "conventions": dict(_CONVENTIONS),
            "found": {
                "kind": content.kind,
                "version": content.version[:20],
                "channels": table.channels.to_json(),
                "rotations": content.rotations[:50],
                "theta_i": content.incidences[:50],
                "type of the values": "f cos(theta_o)" if content.intensity else "f",
                "wavelengths": content.wavelengths[:50],
                "reflectance as stated, percent": content.percent[:50, :50].tolist(),
                "reflectance of the numbers as stored": np.round(own[:50, :50], 6).tolist(),
                "range": value_range(values, table.channels),
            },
            **measures_of(table, values),
            "done": self.done,
            "warnings": self.warnings,
        }


def reflectance(projected: Float64Array, theta_o: Float64Array, phi: Float64Array) -> Float64Array:
    """(1/pi) int (v cos theta_o) sin(theta_o) dtheta dphi of tables (..., O, P) at angles in degrees, trapezoidal."""
    theta, turn = np.radians(theta_o), np.radians(phi)
    over = np.trapezoid(projected, turn, axis=-1) if phi.size > 1 else 2 * np.pi * projected[..., 0]
    if phi.size > 1 and phi[-1] == 180:
        over = 2 * over
    return np.asarray(np.trapezoid(over * np.sin(theta), theta, axis=-1) / np.pi)


def _onto(table: Table, theta_o: Float64Array, phi: Float64Array) -> Float64Array:
    """The bilinear interpolation of a table at other angles, its own among them; beyond its range the edge."""
    if np.array_equal(table.theta_o, theta_o) and np.array_equal(table.phi, phi):
        return table.values
    along = np.array([np.interp(phi, table.phi, row) for row in table.values])
    return np.array([np.interp(theta_o, table.theta_o, column) for column in along.T]).T


def _turned(phi: Float64Array, values: Float64Array) -> tuple[Float64Array, Float64Array, bool]:
    """(delta_phi in rad, values (I, O, D, C) in its order, whether one side stands for both)."""
    if phi.size == 1:
        return np.array([np.pi]), values, True
    if phi[-1] == 180:
        return np.radians(180 - phi[::-1]), values[:, :, ::-1], True
    half, mirrored = phi <= 180, values[:, :, ::-1]
    alike = np.array_equal(phi, 360 - phi[::-1]) and phi[half][-1] == 180
    if alike and np.abs(values - mirrored).max() <= _ROUNDING * np.abs(values).max():
        both = 0.5 * (values + mirrored)
        return np.radians(180 - phi[half][::-1]), both[:, :, half][:, :, ::-1], True
    if 180 not in phi:  # where delta_phi begins; on the line between its neighbours, so nothing changes
        k = int(np.searchsorted(phi, 180))
        share = (180 - phi[k - 1]) / (phi[k] - phi[k - 1])
        between = values[:, :, k - 1] + share * (values[:, :, k] - values[:, :, k - 1])
        phi, values = np.insert(phi, k, 180.0), np.insert(values, k, between, axis=2)
    k = int(np.searchsorted(phi, 180))
    degrees = np.concatenate([phi[k:-1] - 180, phi[: k + 1] + 180])
    return np.radians(degrees), np.concatenate([values[:, :, k:-1], values[:, :, : k + 1]], axis=2), False
