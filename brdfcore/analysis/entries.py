"""One representation at one size: what it costs and how wrong it is; which of many are beaten, and which to take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from brdfcore.analysis.timing import Timing, label
from brdfcore.brdf import Brdf
from brdfcore.metrics import Comparison

_HEADLINE = label(1_000_000, 1)
#: A table that is less than this many times faster than the formula is not worth its memory and its error.
SLOWEST = 4.0
#: What misplaces more than this share of the energy is no candidate, however small or fast: it is not on the front.
USELESS = 0.25
#: A table chosen for a tolerance is measured again on other directions; what the first measurement leaves open has to
#: stay within this factor.
CERTAIN = 1.1


@dataclass
class Entry:
    """One representation at one size.

    kind          "model" (a formula), "table" (stored arrays), "peer" (another library).
    variant       tier of precision, or nodes per axis and interpolation.
    build_seconds time to make it from the source, without measuring it.
    comparison    its error against the source.
    timings       ns a look-up by batch (`timing.label`).
    dominated_by  label of one that is no larger, no less exact, and not distinctly slower; None: on the front.
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
    usual: bool = False

    @property
    def label(self) -> str:
        return f"{self.representation} {self.variant}".strip()

    @property
    def error(self) -> float:
        """What a tolerance bounds: L1 of the regular part, if there is one, and the error of the mirror part."""
        l1 = self.comparison.l1 if self.comparison.regular else 0.0
        worst = max(l1, self.comparison.delta)
        return math.inf if math.isnan(l1) or math.isnan(worst) else worst

    @property
    def on_front(self) -> bool:
        """Nothing of ours dominates it, and it is not `USELESS`."""
        return self.dominated_by is None and self.kind != "peer" and self.error <= USELESS

    @property
    def ns(self) -> Timing:
        """A million look-ups in one call, on one thread; its `best` is what entries are ranked by."""
        return self.timings[_HEADLINE]

    def meets(self, tolerance: float) -> bool:
        """Error within the tolerance, and known well enough: 1.96 standard errors stay within `CERTAIN` times it."""
        spread = self.comparison.l1_stderr if self.comparison.regular else 0.0
        return self.error <= tolerance and self.error + 1.96 * spread <= CERTAIN * tolerance

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
            "meets": self.meets(tolerance),
            "usual_practice": self.usual,
            "measures": found.to_json(),
        }


def mark_dominated(entries: Sequence[Entry]) -> None:
    """Set `dominated_by` of each; peers stand beside, and dominate nothing."""
    ours = [e for e in entries if e.kind != "peer"]
    for entry in entries:
        better = [e for e in ours if e is not entry and _dominates(e, entry)]
        entry.dominated_by = min(better, key=lambda e: (e.error, e.nbytes)).label if better else None


def _dominates(a: Entry, b: Entry) -> bool:
    if a.nbytes > b.nbytes or a.error > b.error or b.ns.faster_than(a.ns):
        return False
    return a.nbytes < b.nbytes or a.error < b.error or a.ns.faster_than(b.ns) or a.label < b.label


def choose(entries: Sequence[Entry], tolerance: float, room: float | None, *, smallest_error: bool = False) -> Entry:
    """The fastest within tolerance and bytes, of equally fast ones the smallest; else the least wrong that fits.

    A formula that is less than `SLOWEST` times slower than the fastest counts as equally fast.
    """
    fitting = [e for e in entries if e.nbytes <= (room or math.inf)]
    right = [] if smallest_error else [e for e in fitting if e.meets(tolerance)]
    if right:
        fastest = min(right, key=lambda e: e.ns.best)
        alike = [
            e
            for e in right
            if not fastest.ns.faster_than(e.ns) or (e.kind == "model" and e.ns.best <= SLOWEST * fastest.ns.best)
        ]
        return min(alike, key=lambda e: (e.nbytes, e.ns.best, e.error))
    if fitting:
        return min(fitting, key=lambda e: (e.error, e.nbytes))
    return min(entries, key=lambda e: (e.nbytes, e.error))
