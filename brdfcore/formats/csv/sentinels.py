"""Numbers that instruments write for "no value": found, named, counted."""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError

#: What is taken for such a mark. A negative one has to stand apart from the noise, a positive one from the signal.
_KNOWN = (-99.0, -999.0, -9_999.0, -99_999.0, -999.9, -9_999.9, -1e30, -1e34, 999.0, 9_999.0, 99_999.0, 1e30, 1e34)
_APART = 4.0
#: Part of the median below which a value comes near 0.
_NEAR = 0.1


def find(values: npt.NDArray[np.float64], asked: str) -> dict[float, int]:
    """{mark: how often} in `values` as they stand in the file, nan being none.

    asked   "auto", "none", or the marks, as "-9999" or "[-1,999]".

    "auto": a known mark below 0 more than 4 times as far from 0 as any other value below it; one above 0 more than 4
    times the largest other value, or met twice and at least as large; and -1 where no other value lies below -.25.
    """
    if asked == "none":
        return {}
    flat = values[np.isfinite(values)]
    if asked != "auto":
        found = {mark: int((flat == mark).sum()) for mark in _marks(asked)}
        return {mark: count for mark, count in found.items() if count}
    marks = {m for m in _KNOWN if (flat == m).any()}
    rest = flat[~np.isin(flat, sorted(marks))]
    lowest, highest = (float(rest.min()), float(rest.max())) if rest.size else (0.0, 0.0)
    kept = {}
    for mark in sorted(marks):
        count = int((flat == mark).sum())
        if mark < 0:
            apart = mark < _APART * min(lowest, 0.0)
        else:
            apart = mark > _APART * highest or (count > 1 and mark > highest)
        if apart:
            kept[mark] = count
    rest = rest[rest != -1]
    if (flat == -1).any() and (not rest.size or float(rest.min()) > -0.25):
        kept[-1.0] = int((flat == -1).sum())
    return kept


def zeros_apart(values: npt.NDArray[np.float64]) -> int:
    """Rows of `values` (n, channels) that are exactly 0 in every channel though no other value comes near it: below a
    tenth of the median. Instruments write 0 too where the detector stands before the lamp."""
    size = np.abs(values[np.isfinite(values).all(axis=1)])
    zero = (size == 0).all(axis=1)
    rest = size[~zero]
    if not zero.any() or not rest.size or float(rest.min()) < _NEAR * float(np.median(rest)):
        return 0
    return int(zero.sum())


def _marks(asked: str) -> list[float]:
    if not re.fullmatch(r"\[?[-+0-9.eE, ]+\]?", asked):
        raise _bad(asked)
    try:
        return [float(part) for part in asked.strip("[] ").split(",")]
    except ValueError:
        raise _bad(asked) from None


def _bad(asked: str) -> InputError:
    return InputError(
        "bad_parameter",
        f"sentinel = {asked[:40]!r}: expected auto, none, or the numbers that mark a missing value, as [-9999,-1]",
        where="sentinel",
        got=asked[:40],
        expected="auto, none or numbers",
    )
