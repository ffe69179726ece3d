"""The values of a text table in 1/sr: marks for "no value" taken out, percent, scale, cosine and pi undone."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.formats.base.text_rows import TextFile
from brdfcore.formats.csv import sentinels
from brdfcore.formats.csv.columns import Columns

#: Below this cos(theta_o), f cos(theta_o) says nothing about f.
_HORIZON = 1e-6


@dataclass
class Values:
    """rows (k,) of the table that are kept; values (k, channels) f_r in 1/sr, nan where there is none.

    scale   factor from the file's number to 1/sr, as text where it changes by row.
    factor  (k, 1) its size, by row: what a stated uncertainty is multiplied by.
    counts, done, warnings   for the report.
    """

    rows: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]
    scale: float | str
    factor: npt.NDArray[np.float64]
    counts: dict[str, Any] = field(default_factory=dict)
    done: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def values_of(text: TextFile, columns: Columns, chosen: dict[str, Any]) -> Values:
    """The values of `columns`; raises `FileFormatError` where nothing is left."""
    raw = columns.values()
    rows = np.arange(len(raw))
    found = Values(rows, raw, 1.0, np.ones((len(raw), 1)))
    blank = int(np.isnan(raw).sum())
    if blank:
        found.counts["blank values"] = blank
    marks = sentinels.find(raw, chosen["sentinel"])
    if marks:
        found.counts["sentinels"] = {f"{mark:g}": count for mark, count in marks.items()}
        said = ", ".join(f"{count} of {raw.size} values are {mark:g}" for mark, count in marks.items())
        found.done.append(f"{said}: taken as no value (sentinel=none keeps them)")
        found.warnings.append(f"{said}, which marks a missing value: left out")
        raw = np.where(np.isin(raw, list(marks)), np.nan, raw)
    kept, cosine = np.ones(len(raw), np.bool_), np.ones(len(raw))
    factor = float(chosen["scale"]) * (0.01 if chosen["unit"] == "percent" else 1.0)
    if columns.quantity == "pi_f":
        factor /= np.pi
        found.done.append("values divided by pi: the file holds pi f_r")
    found.scale = factor
    if chosen["unit"] == "percent":
        found.done.append("values divided by 100: the file holds percent")
    if chosen["scale"] != 1:
        found.done.append(f"values multiplied by {chosen['scale']:g}, as asked")
    if columns.quantity == "f_cos":
        theta_o = columns.column("theta_o")
        with np.errstate(invalid="ignore"):  # of an infinite angle, which is refused with its line below
            cosine = np.cos(np.radians(theta_o) if columns.angles == "deg" else theta_o)
        kept = ~(np.abs(cosine) <= _HORIZON)
        if not kept.all():
            at = int(columns.numbers[np.flatnonzero(~kept)[0]])
            found.counts["rows at the horizon"] = int((~kept).sum())
            found.done.append(f"{int((~kept).sum())} rows at theta_o = 90 degrees left out, where f cos(theta_o) is 0 "
                              f"whatever f is; the first: line {at}")  # fmt: skip
        if not kept.any():
            raise text.bad(
                int(columns.numbers[0]), "theta_o", "all rows lie at the horizon", "theta_o below 90 degrees"
            )
        with np.errstate(over="ignore", invalid="ignore"):
            raw = np.divide(raw, cosine[:, None], out=np.zeros_like(raw), where=kept[:, None])
        found.scale = f"{factor:.6g}/cos(theta_o)" if factor != 1 else "1/cos(theta_o)"
        found.done.append("values divided by cos(theta_o): the file holds f_r cos(theta_o)")
    with np.errstate(over="ignore"):  # what overflows is no value
        # the bits of the division
        found.values = raw / np.pi if columns.quantity == "pi_f" and factor == 1 / np.pi else raw * factor
    found.rows, found.values = rows[kept], found.values[kept]
    found.factor = np.abs(factor / cosine[kept])[:, None]
    zeros = sentinels.zeros_apart(found.values)
    if zeros:
        found.warnings.append(
            f"{zeros} of {len(found.values)} rows are exactly 0, and no other value is below a tenth of the median: "
            "was nothing measured there, as where the detector shades the light? sentinel=0 leaves them out"
        )
    return found
