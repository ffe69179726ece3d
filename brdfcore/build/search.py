"""Which table: of all that meet a tolerance the fewest bytes that are fast enough; or the smallest error that fits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.build.costs import AS_FAST, nanoseconds
from brdfcore.build.judge import Judge
from brdfcore.metrics import albedo_excess
from brdfcore.metrics.incidence import GRAZING_FACTOR
from brdfcore.tables.base.table import BuildOptions, Progress, Table

#: Steps of a ladder are left out where the error says that they won't do (`Table.STEP`), but for no more than so many
#: times the bytes at once.
_MOST_STEP = 4.0
#: Tables whose albedo passes 1 towards the horizon before no larger one is tried for it.
_MORE = 4


@dataclass
class Tried:
    """One candidate: what a look-up costs by the stored table, what the tolerance bounds, and whether its albedo passes
    1 by more than `GRAZING_FACTOR` times the tolerance although the source conserves energy."""

    table: Table
    ns: float
    error: float
    bright: bool = False


@dataclass
class Search:
    """The candidates of `source`, tried one after the other.

    met    those within the tolerance; `best` the least wrong of all. `bright` ones count if there are no others.
    most   bytes that no table may pass: `max_bytes`, and the arrays of a source that is a table itself and a candidate.
    """

    source: Brdf
    judge: Judge
    options: BuildOptions
    tolerance: float | None
    max_bytes: int | None
    progress: Progress | None
    met: list[Tried] = field(default_factory=list)
    bright: list[Tried] = field(default_factory=list)
    best: Tried | None = None
    smallest: int | None = None

    def run(self, classes: Sequence[type[Table]]) -> Table:
        """The table chosen; raises `InputError` if none fits into `max_bytes`."""
        # what holds the source exactly first: nothing larger is worth building
        for cls in sorted(classes, key=lambda c: not isinstance(self.source, c)):
            if self.tolerance is None:
                self._each(cls, cls.candidates(self.source, self.options, self.max_bytes))
            else:
                self._climb(cls, list(cls.candidates(self.source, self.options, None)))
                if self.max_bytes is not None and not any(isinstance(t.table, cls) for t in self.met):
                    self._each(cls, cls.candidates(self.source, self.options, self.max_bytes))
        self.met = self.met or self.bright
        if self.met:
            return chosen(self.met).table
        if self.best is None:
            need = f"; the smallest takes {self.smallest}" if self.smallest else ""
            raise InputError(
                "max_bytes_too_small",
                f"no table fits into max_bytes = {self.max_bytes}{need}",
                where="max_bytes",
                got=self.max_bytes,
                expected=self.smallest,
            )
        return self.best.table

    def _each(self, cls: type[Table], steps: Iterable[BuildOptions]) -> None:
        for step in steps:
            self._try(cls, step)

    def _climb(self, cls: type[Table], steps: Sequence[BuildOptions]) -> None:
        """From the smallest up, until one meets the tolerance or none that is larger could be chosen."""
        assert self.tolerance is not None
        least = 0.0
        for k, step in enumerate(steps):
            if step.nbytes < least and k + 1 < len(steps):
                continue
            if not self._worth(cls, step):
                return
            found = self._try(cls, step)
            if found is None:
                return
            if found.error <= self.tolerance:
                if not found.bright or len(self.bright) > _MORE:
                    return
                continue
            excess, nbytes = found.error / self.tolerance, found.table.nbytes
            largest = max((s.nbytes for s in steps[k + 1 :] if self._worth(cls, s)), default=0)
            if excess > cls.largest_gain(step.interpolation, max(largest / nbytes, 1.0)):
                return
            least = nbytes * min(excess**cls.STEP, _MOST_STEP)

    def _worth(self, cls: type[Table], step: BuildOptions) -> bool:
        return not step.nbytes or self._could_win(step.nbytes, self._ns(cls, step.interpolation, step.nbytes))

    def _could_win(self, nbytes: int, ns: float) -> bool:
        """Whether a table that meets the tolerance would be chosen: it is smaller and fast enough, or so much faster
        that what is chosen now is too slow beside it."""
        if self.max_bytes is not None and nbytes > self.max_bytes:
            return False
        if not self.met:
            return True
        now = chosen(self.met)
        if isinstance(self.source, type(now.table)) and nbytes > now.table.nbytes:
            return False
        fastest = min(t.ns for t in self.met)
        return (nbytes < now.table.nbytes and ns <= AS_FAST * fastest) or AS_FAST * ns < now.ns

    def _ns(self, cls: type[Table], interpolation: str, nbytes: float) -> float:
        return nanoseconds(cls.name, interpolation, len(self.source.channels), nbytes)

    def _try(self, cls: type[Table], step: BuildOptions) -> Tried | None:
        """Build and measure one; None if it is too large."""
        table = cls.build(self.source, replace(step, lobes=self.judge.lobes), self.progress)
        if self.max_bytes is not None and table.nbytes > self.max_bytes:
            self.smallest = min(table.nbytes, self.smallest or table.nbytes)
            return None
        if self.progress is not None:
            self.progress(0, 1, "measuring the error")
        found = Tried(table, self._ns(cls, step.interpolation, table.nbytes), self.judge.error(table, self.tolerance))
        if self.best is None or (found.error, table.nbytes) < (self.best.error, self.best.table.nbytes):
            self.best = found
        if self.tolerance is not None and found.error <= self.tolerance:
            found.bright = albedo_excess(self.source, table) > GRAZING_FACTOR * self.tolerance
            (self.bright if found.bright else self.met).append(found)
        return found


def chosen(met: Sequence[Tried]) -> Tried:
    """Of what meets a tolerance, the fewest bytes within `AS_FAST` times the time of the fastest."""
    fastest = min(t.ns for t in met)
    quick = [t for t in met if t.ns <= AS_FAST * fastest]
    return min(quick, key=lambda t: (t.table.nbytes, t.ns, t.error if math.isfinite(t.error) else math.inf))
