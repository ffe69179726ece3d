"""One representation at one size: what it costs and how wrong it is; which of many are beaten, and which to take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from brdfcore.analysis.pareto.timing import MARGIN, REPEATS, Timing, label
from brdfcore.base.brdf import Brdf
from brdfcore.build.costs import AS_FAST, nanoseconds
from brdfcore.metrics import Comparison
from brdfcore.metrics.incidence import GRAZING_FACTOR, known, worst
from brdfcore.tables.base.table import Table

_HEADLINE = label(1_000_000, 1)
#: A table that is less than this many times faster than the formula is not worth its memory and its error.
SLOWEST = 4.0
#: What misplaces more than this share of the energy is no candidate, however small or fast: it is not on the front.
USELESS = 0.25


@dataclass
class Entry:
    """One representation at one size.

    kind          "model" (a formula), "table" (stored arrays), "peer" (another library).
    variant       tier of precision, or nodes per axis and interpolation.
    build_seconds time to make it from the source, without measuring it.
    comparison    its error against the source.
    timings       ns a look-up by batch (`timing.label`).
    dominated_by  label of one that is no larger, no less exact, and not distinctly slower; None: on the front.
    near_tie      label of the one whose speed decides whether this is on the front, where another run may measure it
                  on the other side of what counts as distinctly slower; None where no such run is to be expected.
    """

    representation: str
    variant: str
    kind: Literal["model", "table", "peer"]
    nbytes: int
    build_seconds: float
    comparison: Comparison
    brdf: Brdf | None = field(default=None, repr=False)
    timings: dict[str, Timing] = field(default_factory=dict, repr=False)
    dominated_by: str | None = None
    near_tie: str | None = None
    usual: bool = False

    @property
    def label(self) -> str:
        return f"{self.representation} {self.variant}".strip()

    @property
    def error(self) -> float:
        """What a tolerance of `tabulate` bounds: the worst incidence, and the error of the mirror part."""
        found = max(worst(self._rows), self.comparison.delta)
        return math.inf if math.isnan(found) else found

    @property
    def _rows(self) -> list[dict[str, Any]]:
        return [*self.comparison.by_theta_i, *self.comparison.between]

    @property
    def cost(self) -> float:
        """ns of a look-up: of a table by what was measured once (`build.costs`), so that the choice does not depend on
        the moment; of anything else as measured here."""
        if self.kind != "table" or not isinstance(self.brdf, Table):
            return self.ns.best
        way = str(self.brdf.attributes().get("interpolation", "linear"))
        return nanoseconds(self.representation, way, len(self.brdf.channels), self.nbytes)

    @property
    def on_front(self) -> bool:
        """Nothing of ours dominates it, and it is not `USELESS`."""
        return self.dominated_by is None and self.kind != "peer" and self.error <= USELESS

    @property
    def ns(self) -> Timing:
        """A million look-ups in one call, on one thread; its `best` is what entries are ranked by."""
        return self.timings[_HEADLINE]

    def meets(self, tolerance: float) -> bool:
        """Error within the tolerance, and known well enough for it (`metrics.incidence.known`)."""
        return self.error <= tolerance and known(self._rows, tolerance)

    def to_json(self, tolerance: float) -> dict[str, Any]:
        found = self.comparison
        return {
            "representation": self.representation,
            "variant": self.variant,
            "label": self.label,
            "kind": self.kind,
            "nbytes": self.nbytes,
            "l1": found.l1 if math.isfinite(found.l1) else None,
            "l1_stderr": found.l1_stderr if math.isfinite(found.l1_stderr) else None,
            "error": self.error if math.isfinite(self.error) else None,
            "ns": self.ns.best,
            "ns_median": self.ns.median,
            "ns_high": self.ns.high,
            "ns_batches": {k: t.to_json() for k, t in self.timings.items()},
            "build_seconds": self.build_seconds,
            "on_front": self.on_front,
            "dominated_by": self.dominated_by,
            "near_tie": self.near_tie,
            "meets": self.meets(tolerance),
            "usual_practice": self.usual,
            "measures": found.to_json(),
        }


def mark_dominated(entries: Sequence[Entry]) -> None:
    """Set `dominated_by` and `near_tie` of each; peers stand beside, and dominate nothing.

    Bytes and errors are the same in every run, times are not: each decision is made again with the margin of
    "distinctly slower" moved by what times differ by between runs, and where that changes it, it is a near tie.
    """
    ours = [e for e in entries if e.kind != "peer"]
    for entry in entries:
        lenient, nominal, strict = (_best_of(entry, ours, m) for m in (MARGIN / REPEATS, MARGIN, MARGIN * REPEATS))
        entry.dominated_by = None if nominal is None else nominal.label
        # the lower the margin, the more is distinctly faster, and the less is dominated
        other = strict if nominal is None else nominal if lenient is None else None
        entry.near_tie = None if other is None or entry.error > USELESS else other.label


def beaten_anyway(entries: Sequence[Entry], times: Mapping[str, Timing]) -> set[str]:
    """Labels of what stays dominated even if it should turn out twice as fast as `times` says: not worth timing on."""
    found = set()
    for entry in entries:
        ours = times[entry.label].best
        for other in entries:
            beats = other is not entry and other.nbytes <= entry.nbytes and other.error <= entry.error
            if beats and entry.kind != "peer" and 2 * times[other.label].best < MARGIN * ours and not entry.usual:
                found.add(entry.label)
    return found


def _best_of(entry: Entry, ours: Sequence[Entry], margin: float) -> Entry | None:
    """Of what dominates `entry`, the one with the smallest error."""
    better = [e for e in ours if e is not entry and _dominates(e, entry, margin)]
    return min(better, key=lambda e: (e.error, e.nbytes, e.label), default=None)


def _dominates(a: Entry, b: Entry, margin: float) -> bool:
    if a.nbytes > b.nbytes or a.error > b.error or b.ns.faster_than(a.ns, margin):
        return False
    # of equals the first by name, whatever their times
    return a.nbytes < b.nbytes or a.error < b.error or a.ns.faster_than(b.ns, margin) or a.label < b.label


def choose(
    entries: Sequence[Entry],
    tolerance: float,
    room: float | None,
    *,
    smallest_error: bool = False,
    margin: float = MARGIN,
) -> Entry:
    """Of what is within tolerance and bytes the fewest bytes among what is fast enough, as `tabulate` chooses; else the
    least wrong that fits.

    Fast enough is at most `costs.AS_FAST` times the time of the fastest table, by the stored times; and a formula that
    is less than `SLOWEST` times slower than it, as measured. That alone differs between runs: by `margin`/`MARGIN`.
    """
    fitting = [e for e in entries if e.nbytes <= (room or math.inf)]
    right = [] if smallest_error else [e for e in fitting if e.meets(tolerance)]
    if right:
        # as `build.search`: what passes 1 towards the horizon only if there is nothing else
        right = [e for e in right if e.comparison.albedo_excess <= GRAZING_FACTOR * tolerance] or right
        tables = [e for e in right if e.kind == "table"]
        least = min((e.cost for e in tables), default=math.inf)
        measured = min((e.ns.best for e in tables), default=math.inf)
        alike = [e for e in tables if e.cost <= AS_FAST * least]
        alike += [e for e in right if e.kind != "table" and e.ns.best <= SLOWEST * (margin / MARGIN) * measured]
        return min(alike or right, key=lambda e: (e.nbytes, e.cost, e.error))
    if fitting:
        return min(fitting, key=lambda e: (e.error, e.nbytes))
    return min(entries, key=lambda e: (e.nbytes, e.error))
