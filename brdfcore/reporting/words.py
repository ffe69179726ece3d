"""Numbers and choices as a person reads them."""

from __future__ import annotations

import math

from brdfcore.analysis.pareto.entries import Entry
from brdfcore.analysis.pareto.pareto import Pareto
from brdfcore.analysis.pareto.tabulating import USUALLY

#: Below this an error is called exact to float32's precision rather than quoted.
NEXT_TO_NOTHING = 1e-6


def percent(share: float | None) -> str:
    """A share of 1 as "0.8 %", two digits that count; nothing below a millionth is told apart."""
    if share is None or not math.isfinite(share):
        return "not finite"
    if share == 0:
        return "0"
    if abs(share) < NEXT_TO_NOTHING:
        return "below 0.0001 %"
    return f"{_digits(100 * share)} %"


def size(count: int) -> str:
    """Bytes as "122 kB", 1000 to the kB; 0 is "no table"."""
    if count == 0:
        return "no table"
    for unit, step in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= step:
            return f"{count / step:.3g} {unit}"
    return f"{count} bytes"


def nanoseconds(value: float) -> str:
    """ns as "7.2 ns", "12 us": two digits."""
    if value >= 10_000:
        return f"{_digits(value / 1000)} µs"
    return f"{_digits(value)} ns"


def _digits(value: float) -> str:
    """Two digits that count, without an exponent."""
    if value == 0:
        return "0"
    places = max(0, 1 - math.floor(math.log10(abs(value))))
    rounded = round(value, places if places else 1 - math.floor(math.log10(abs(value))))
    return f"{rounded:.{places}f}"


def title(entry: Entry) -> str:
    """What it is, for someone who knows none of the names."""
    if entry.kind == "model":
        return f"the formula itself ({entry.representation}, {entry.variant} tier)"
    if entry.kind == "peer":
        return f"{entry.representation} ({entry.variant})"
    article = "an" if entry.representation[:1] in "aeiou" else "a"
    return f"{article} {entry.representation} table ({entry.variant.removesuffix(USUALLY)})"


def figures(entry: Entry) -> str:
    return f"error {percent(entry.error)}, {size(entry.nbytes)}, {nanoseconds(entry.ns.best)} a look-up"


def advice(found: Pareto) -> str:
    """The one sentence; and a second, if a limit in seconds left something out."""
    left = found.not_tried
    after = f" Not tried, as the time was up: {'; '.join(left[:3])}{', and more' if len(left) > 3 else ''}."
    after = after if left else ""
    if found.met:
        return f"Use {title(found.chosen)}: {figures(found.chosen)}.{after}"
    asked = f"{percent(found.tolerance)}" + (f" in {size(found.max_bytes)}" if found.max_bytes else "")
    return f"Nothing tried is within {asked}. The closest is {title(found.chosen)}: {figures(found.chosen)}.{after}"


def alternatives(found: Pareto) -> list[str]:
    """When to use something else."""
    chosen, said = found.chosen, []
    right = [e for e in found.front if e.meets(found.tolerance) and e is not chosen]
    if chosen.kind == "model" and found.table is not None:
        if found.table.meets(found.tolerance):
            said.append(f"If it has to be a table: {title(found.table)}, {figures(found.table)}.")
        else:
            said.append(f"No table tried is right enough; the closest is {title(found.table)}, {figures(found.table)}.")
    said += [f"As good, as far as times can be told apart: {title(r)}, {figures(r)}." for r in found.rivals]
    smaller = min((e for e in right if e.nbytes < chosen.nbytes), key=lambda e: e.nbytes, default=None)
    if smaller is not None:
        said.append(f"If memory counts more than speed: {title(smaller)}, {figures(smaller)}.")
    better = [e for e in right if e.error < chosen.error / 2 and e.kind == chosen.kind]
    if better:
        best = min(better, key=lambda e: e.error)
        said.append(f"If the error has to be smaller: {title(best)}, {figures(best)}.")
    usual = next((e for e in found.entries if e.usual), None)
    if usual is not None and chosen is not usual:
        said.append(f"The usual practice, {title(usual)}: {figures(usual)}.")
    return said


def verdict(entry: Entry, found: Pareto) -> str:
    """Last column of a table."""
    if entry is found.chosen:
        return "use this" if found.met else "closest"
    if entry.kind == "peer":
        return "another library"
    if entry.dominated_by is not None:
        return f"beaten by {entry.dominated_by}"
    if not entry.on_front:
        return "too wrong to use"
    return "on the front" + (f" by a near tie in speed with {entry.near_tie}" if entry.near_tie else "")
