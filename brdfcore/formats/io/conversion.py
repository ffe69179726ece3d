"""Write a material in another format, read it back, and say what the round trip cost."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.directions import mixture
from brdfcore.base.status import Status
from brdfcore.formats.base.format import LossWarning
from brdfcore.formats.base.one_channel import OneChannel
from brdfcore.formats.io import files as io
from brdfcore.metrics import Comparison, compare

#: Directions among which the worst one and those without a value are looked for; seeded, as those of `compare` are.
_DIRECTIONS, _SEED = 50_000, 20_261_123


@dataclass(frozen=True)
class Conversion:
    """What a round trip through a file cost.

    file, format, bytes  what was written.
    comparison           `metrics.compare` of the material with what was read back; None where the channels differ.
    worst                the direction where |f' - f| cos(theta_i) cos(theta_o) is largest: angles in degrees, channel,
                         f (`before`), f' (`after`); {} without a regular part.
    losses               what the writer said that it leaves out or changes (`LossWarning`).
    lost                 what a comparison finds: channels, wavelengths, angles, symmetries,
                         signs that the file did not keep.
    result               what was read back.
    """

    file: str
    format: str
    bytes: int
    comparison: Comparison | None
    worst: dict[str, Any]
    losses: list[str]
    lost: list[str]
    result: Brdf

    def to_json(self) -> dict[str, Any]:
        return {
            "file": self.file,
            "format": self.format,
            "file_bytes": self.bytes,
            "round_trip": None if self.comparison is None else self.comparison.to_json(),
            "worst": self.worst,
            "losses": self.losses,
            "lost": self.lost,
            "report": self.result.report,
        }


def convert(
    brdf: Brdf, path: str | PathLike[str], format: str | None = None, options: Mapping[str, Any] | None = None
) -> Conversion:
    """Write `brdf` to `path`, read it back, compare.

    format   registry name; None chooses by the extension, as `io.write` does.
    options  of the format's writer.
    Raises what `io.write` and `io.read` raise; a material that a format can't hold is an `InputError`.

    >>> grid = bc.read(bc.example_files(".")[2])
    >>> found = bc.convert(grid, "again.bsdf", "rgl")
    >>> found.format, found.comparison.l1  # the same bits
    ('rgl', 0.0)
    """
    path = Path(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", LossWarning)
        again = io.write(brdf, path, format, **(options or {}))
    written = format or str(again.report.get("format") or io.sniff(path))
    losses = [str(w.message) for w in caught if issubclass(w.category, LossWarning)]
    lost = _lost_channels(brdf, again)
    chosen = (options or {}).get("channel")
    if chosen is not None and len(again.channels) == 1:
        brdf = OneChannel(brdf, chosen)
    same = brdf.channels == again.channels or 1 in (len(brdf.channels), len(again.channels))
    comparison = compare(brdf, again) if same else None
    worst: dict[str, Any] = {}
    if comparison is not None:
        worst, more = _directions(brdf, again)
        lost += more
        if comparison.delta:
            lost.append(f"the perfect mirror part differs by {comparison.delta:.3g} in reflectance")
    lost += _lost_flags(brdf, again)
    return Conversion(str(path), written, path.stat().st_size, comparison, worst, losses, lost, again)


def _lost_channels(brdf: Brdf, again: Brdf) -> list[str]:
    before, after = brdf.channels, again.channels
    if before == after and before.kind == after.kind:
        return []
    if before.kind == "wavelength" and after.kind != "wavelength":
        return [f"the wavelengths {', '.join(before.labels())}: the file has channels {', '.join(after.labels())}"]
    if len(before) == len(after):
        return [f"the names of the channels: {', '.join(before.labels())} became {', '.join(after.labels())}"]
    return [f"of the channels {', '.join(before.labels())}: the file has {', '.join(after.labels())}"]


def _directions(brdf: Brdf, again: Brdf) -> tuple[dict[str, Any], list[str]]:
    """The worst direction, and what else the directions tell was lost."""
    drawn = mixture(_DIRECTIONS, _SEED)
    used = drawn.weight > 0
    angles = (drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used])
    f, g = np.broadcast_arrays(brdf.evaluate(*angles), again.evaluate(*angles))
    lost = []
    negative = int(((f < 0) & (g >= 0)).sum())
    if negative:
        lost.append(f"the sign of {negative} of {f.size} values below 0")
    weak = (Status.EXTRAPOLATED, Status.FILLED)
    before, after = (np.isin(b.status(*angles), weak) for b in (brdf, again))
    gone = after & ~before
    if gone.any():
        theta_o = np.degrees(angles[1][gone].min())
        share = float(gone.mean())
        lost.append(
            f"{100 * share:.2g} % of the directions, nearest the horizon or beyond the angles written (theta_o from "
            f"{theta_o:.3g} degrees), are extrapolated or filled in what was read back"
        )
    error = np.abs(g - f) * (np.cos(angles[0]) * np.cos(angles[1]))[:, None]
    if not np.isfinite(error).all() or not f.any():
        return {}, lost
    n, c = (int(k) for k in np.unravel_index(int(error.argmax()), error.shape))
    return _named(angles, n, again if len(again.channels) > 1 else brdf, c, f, g), lost


def _named(
    angles: tuple[npt.NDArray[np.float64], ...], n: int, named: Brdf, channel: int, f: Any, g: Any
) -> dict[str, Any]:
    degrees = [round(float(np.degrees(a[n])), 4) for a in angles]
    return {
        "theta_i": degrees[0],
        "theta_o": degrees[1],
        "delta_phi": degrees[2],
        "angles": "deg",
        "channel": named.channels.to_json()[channel],
        "before": float(f[n, channel]),
        "after": float(g[n, channel]),
    }


def _lost_flags(brdf: Brdf, again: Brdf) -> list[str]:
    told = {
        "bilateral": ("both sides of the plane of incidence became one", "bilateral symmetry is no longer exact"),
        "reciprocal": ("the order of the directions: the file is reciprocal", "reciprocity is no longer exact"),
        "energy_conserving": ("", "conservation of energy at every angle"),
        "non_negative": ("", "the sign: there are values below 0"),
    }
    lost = []
    for flag in FLAGS:
        before, after = getattr(brdf, flag), getattr(again, flag)
        if before != after and told[flag][before]:
            lost.append(told[flag][before])
    return lost
