"""Scattered measurements: what every reader of lists of geometries hands over, checked, in the project's convention.

Signed zenith angles and azimuths become (theta_i, theta_o, delta_phi); rows that cannot be used are refused with their
line, or dropped and counted. `regrid.to_brdf` makes a table of the result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.errors import FileFormatError, InputError

Float64Array = npt.NDArray[np.float64]
Invalid = Literal["drop", "error"]

#: Geometries closer than this in every angle are one geometry: files print angles to 1e-3 degrees (1.7e-5 rad).
SAME_ANGLE = 1e-4
#: A zenith angle may pass 90 degrees by this much, rad: six printed decimals.
_HORIZON_SLACK = 1e-6
#: Azimuths phi_i whose shared geometries differ by more than this (sum |a - b| / sum (a + b)) are not of one isotropic
#: surface: repeated goniometer runs agree to a few percent.
ANISOTROPY = 0.1


@dataclass(frozen=True, eq=False)
class Measurements:
    """n geometries with f_r in 1/sr, in the order of the file; immutable.

    theta_i, theta_o  (n,) rad, in [0, pi/2].
    delta_phi         (n,) rad, in [-pi, pi]; pi is the mirror direction; 0 where a theta is below `SAME_ANGLE`.
    values            (n, channels) f_r without the cosine; finite, negative values as measured.
    uncertainty       (n, channels) standard uncertainty (one sigma) that the file states of each value, 1/sr; or None.
    lines             (n,) number of the line, row or record in the file, for messages; from 1.
    file, format      name of the file and of its format.
    conventions       text by topic: what the reader declares about its source.
    found             counts and ranges; JSON-ready.
    done, warnings    sentences.
    source            sha256 and bytes of the file, beside name and format.
    description       one sentence for lists.
    """

    theta_i: Float64Array
    theta_o: Float64Array
    delta_phi: Float64Array
    values: Float64Array
    channels: Channels
    lines: npt.NDArray[np.int64]
    file: str = "measurements"
    format: str = ""
    conventions: Mapping[str, str] = field(default_factory=dict)
    found: Mapping[str, Any] = field(default_factory=dict)
    done: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    source: Mapping[str, Any] = field(default_factory=dict)
    description: str = ""
    uncertainty: Float64Array | None = None

    def __post_init__(self) -> None:
        n = self.theta_i.size
        if self.values.shape != (n, len(self.channels)) or any(
            a.shape != (n,) for a in (self.theta_i, self.theta_o, self.delta_phi, self.lines)
        ):
            raise InputError("bad_measurements", "angles, values and lines of measurements differ in length")
        if self.uncertainty is not None and self.uncertainty.shape != self.values.shape:
            raise InputError("bad_measurements", "values and uncertainty of measurements differ in shape")
        for name in self._columns:
            array = np.array(getattr(self, name))
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name in ("conventions", "found", "source"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def _columns(self) -> tuple[str, ...]:
        more = () if self.uncertainty is None else ("uncertainty",)
        return ("theta_i", "theta_o", "delta_phi", "values", "lines", *more)

    def __len__(self) -> int:
        return int(self.theta_i.size)

    @classmethod
    def from_columns(
        cls,
        theta_i: npt.ArrayLike,
        phi_i: npt.ArrayLike,
        theta_o: npt.ArrayLike,
        phi_o: npt.ArrayLike,
        values: npt.ArrayLike,
        channels: Channels,
        *,
        file: str,
        format: str,
        lines: Sequence[int] | npt.NDArray[np.int64] | None = None,
        degrees: bool = True,
        mirror: float = 180.0,
        invalid: Invalid = "drop",
        conventions: Mapping[str, str] | None = None,
        found: Mapping[str, Any] | None = None,
        done: Sequence[str] = (),
        warnings: Sequence[str] = (),
        source: Mapping[str, Any] | None = None,
        description: str = "",
        uncertainty: npt.ArrayLike | None = None,
    ) -> Self:
        """Measurements from a file's columns, (n,) each, `values` and `uncertainty` (n, channels); a scalar phi_i is
        one for all rows.

        degrees  whether the angles are in degrees (turned by numpy.radians) or radians.
        mirror   phi_o - phi_i of the mirror direction with both zenith angles positive, in degrees: 180 where azimuths
                 are measured the same way round, 0 where the source counts phi_o from the mirror direction.
        invalid  "drop" leaves out rows with a value that is not finite and says how many; "error" refuses them.

        A negative zenith angle means the other side: (|theta|, phi + 180 degrees). Raises `FileFormatError` naming file
        and line for an angle that is not finite or past the horizon, for a file without a usable row, and for
        measurements at several phi_i that differ (anisotropic), with the evidence.
        """
        table = np.atleast_2d(np.asarray(values, np.float64))
        n = table.shape[0]
        rows = np.arange(1, n + 1) if lines is None else np.asarray(lines, np.int64)
        columns = {
            name: np.broadcast_to(np.asarray(column, np.float64), (n,))
            for name, column in (("theta_i", theta_i), ("phi_i", phi_i), ("theta_o", theta_o), ("phi_o", phi_o))
        }
        for name, column in columns.items():
            turned = np.radians(column) if degrees else column
            bad = ~np.isfinite(column) if name.startswith("phi") else ~(np.abs(turned) <= HALF_PI + _HORIZON_SLACK)
            if bad.any():
                place = int(np.flatnonzero(bad)[0])
                expected = "a finite angle" if name.startswith("phi") else "a zenith angle within 90 degrees"
                if not degrees and np.abs(column[bad]).max() > 2:
                    expected += " in radians; degrees are read with angles=deg"
                raise _bad(file, int(rows[place]), name, f"{column[place]:g}", expected)
            columns[name] = turned
        signed = {name: int((columns[name] < 0).sum()) for name in ("theta_i", "theta_o")}
        delta = columns["phi_o"] - columns["phi_i"] + (np.pi - np.radians(mirror))
        delta = delta + np.pi * ((columns["theta_i"] < 0).astype(float) + (columns["theta_o"] < 0))
        thetas = [np.minimum(np.abs(columns[name]), HALF_PI) for name in ("theta_i", "theta_o")]
        delta = _reduced(delta)
        delta = np.where(np.minimum(*thetas) < SAME_ANGLE, 0.0, delta)
        notes = list(done)
        for name, count in signed.items():
            if count:
                notes.append(f"{count} negative {name} turned to the other side: (|theta|, phi + 180 degrees)")
        usable = np.isfinite(table).all(axis=1)
        facts = dict(found or {})
        facts["rows"] = n
        facts["invalid"] = dict(zip(channels.labels(), (~np.isfinite(table)).sum(axis=0).tolist()))
        if not usable.all():
            place = int(np.flatnonzero(~usable)[0])
            if invalid == "error":
                raise _bad(file, int(rows[place]), "value", "not a finite number", "finite values")
            notes.append(f"{int((~usable).sum())} rows with a value that is not finite left out, the first: "
                         f"line {int(rows[place])}")  # fmt: skip
        if not usable.any():
            raise FileFormatError(
                "no_measurements", f"{file}: no usable row of {n}", where=file, file=file, got=n, expected="rows"
            )
        made = cls(
            theta_i=thetas[0][usable],
            theta_o=thetas[1][usable],
            delta_phi=delta[usable],
            values=table[usable],
            channels=channels,
            lines=rows[usable],
            file=file,
            format=format,
            conventions=conventions or {},
            found=facts,
            done=tuple(notes),
            warnings=tuple(warnings),
            source=source or {},
            description=description,
            uncertainty=None if uncertainty is None else np.asarray(uncertainty, np.float64)[usable],
        )
        remarks = made._check_isotropic(
            np.asarray(_reduced(columns["phi_i"] + np.pi * (columns["theta_i"] < 0)))[usable]
        )
        return replace(made, warnings=(*made.warnings, *remarks))

    # ---- what the rows share ------------------------------------------------------------------

    def groups(self) -> npt.NDArray[np.int64]:
        """(n,) number of each row's geometry: rows closer than `SAME_ANGLE` share it, delta_phi = -pi and pi too."""
        keys = np.stack([np.rint(a / SAME_ANGLE) for a in (self.theta_i, self.theta_o, self.delta_phi)], axis=1)
        keys[np.abs(keys[:, 2]) >= np.floor(np.pi / SAME_ANGLE), 2] = np.rint(np.pi / SAME_ANGLE)
        return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1], np.int64).reshape(-1)

    def select(self, rows: npt.ArrayLike) -> Self:
        """These rows only, by index or mask."""
        kept = {name: getattr(self, name)[rows] for name in self._columns}
        return replace(self, **kept)

    def one_sided(self) -> bool:
        """Whether no two sides of the plane of incidence were measured; the plane itself belongs to both."""
        side = np.sin(self.delta_phi) * np.sin(self.theta_i) * np.sin(self.theta_o)
        return not ((side > SAME_ANGLE).any() and (side < -SAME_ANGLE).any())

    def _check_isotropic(self, phi_i: Float64Array) -> tuple[str, ...]:
        """Refuse shared geometries that differ between azimuths phi_i; a sentence where it can't be told."""
        azimuth = np.rint(phi_i / SAME_ANGLE).astype(np.int64)
        # at theta_i = 0 the azimuth of the light has no meaning
        azimuth[self.theta_i < SAME_ANGLE] = azimuth[np.argmax(self.theta_i)]
        azimuth[np.abs(azimuth) >= int(np.pi / SAME_ANGLE)] = int(np.pi / SAME_ANGLE)
        if np.unique(azimuth).size == 1:
            return ()
        order = np.lexsort((azimuth, self.groups()))
        group, turn = self.groups()[order], azimuth[order]
        same = (group[1:] == group[:-1]) & (turn[1:] != turn[:-1])
        angles = np.degrees(np.unique(azimuth) * SAME_ANGLE)
        listed = ", ".join(f"{a:.4g}" for a in angles[:6]) + (", ..." if angles.size > 6 else "")
        if not same.any():
            return (f"measured at phi_i = {listed} degrees without shared geometries: isotropy could not be tested",)
        a, b = order[:-1][same], order[1:][same]
        difference = np.abs(self.values[a] - self.values[b]).sum(axis=1)
        total = (np.abs(self.values[a]) + np.abs(self.values[b])).sum(axis=1)
        spread = float(difference.sum() / total.sum()) if total.sum() > 0 else 0.0
        if spread <= ANISOTROPY:
            return ()
        worst = int(difference.argmax())
        at, other = int(a[worst]), int(b[worst])
        ti, to, dp = (float(np.degrees(x[at])) for x in (self.theta_i, self.theta_o, self.delta_phi))
        k = int(np.abs(self.values[at] - self.values[other]).argmax())
        raise FileFormatError(
            "anisotropic",
            f"{self.file}: the material is anisotropic, only isotropic ones can be read: {int(same.sum())} geometries "
            f"measured at several phi_i ({listed} degrees) differ by {spread:.1%} of their sum (limit "
            f"{ANISOTROPY:.0%}); "
            f"the worst: theta_i = {ti:.4g}, theta_o = {to:.4g}, delta_phi = {dp:.4g} degrees is "
            f"{self.values[at, k]:.4g}/sr at phi_i = {np.degrees(phi_i[at]):.4g} (line {self.lines[at]}) and "
            f"{self.values[other, k]:.4g}/sr at phi_i = {np.degrees(phi_i[other]):.4g} (line {self.lines[other]})",
            where=self.file,
            file=self.file,
            got=spread,
            expected=f"at most {ANISOTROPY}",
            line=int(self.lines[at]),
        )


def _reduced(angle: Float64Array) -> Float64Array:
    """`angle` modulo 2 pi in [-pi, pi], those already there as they are; within 1e-9 of -pi it becomes pi: the plane
    of incidence has one mirror side."""
    turned = np.where(np.abs(angle) <= np.pi, angle, np.remainder(angle + np.pi, 2 * np.pi) - np.pi)
    return np.asarray(np.where(turned <= -np.pi + 1e-9, np.pi, turned))


def _bad(file: str, line: int, field: str, got: str, expected: str) -> FileFormatError:
    return FileFormatError(
        "bad_row",
        f"{file}: line {line}, {field}: got {got}, expected {expected}",
        where=field,
        file=file,
        line=line,
        field=field,
        got=got,
        expected=expected,
    )
