"""Every table that can hold a material, over a range of sizes, until the time is up."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from brdfcore.analysis.pareto.entries import SLOWEST, Entry
from brdfcore.analysis.pareto.timing import at_a_glance
from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.build.judge import Judge
from brdfcore.build.search import Search
from brdfcore.metrics import Comparison
from brdfcore.tables.base.seen import EVERYWHERE, Seen
from brdfcore.tables.base.table import BuildOptions, Progress, Table

#: The usual practice: the layout of the MERL files and the node next to the direction (W. Matusik, H. Pfister,
#: M. Brand, L. McMillan, "A data-driven reflectance model", ACM Trans. Graph. 22(3), 2003).
USUAL = ("half_angle_grid", (90, 90, 180), "nearest")
#: What the variant of such an entry ends with.
USUALLY = ", the usual practice"
#: Shapes of one size that are built to find the best, up to _SEVERAL bytes.
_SHAPES, _SEVERAL = 3, 1_000_000
#: A size is left out if its build would evaluate the material more often than this: by count, as whether others are at
#: work must not decide what is tried. About so many evaluations a byte: 8 a node of two bytes.
_MOST_EVALUATIONS, _A_BYTE = 12_000_000, 4
#: A representation that does not choose its size by bytes is tried at these multiples of its default shape.
_MULTIPLES = (0.25, 0.5, 1.0, 2.0)
#: Why something was left out that a limit in seconds did not let be reached.
TIME_UP = "the time was up"


@dataclass
class Smallest:
    """The smallest that is right enough and quick enough is wanted: what can't be that is not built.

    limit   longest time of a look-up, ns; None: `SLOWEST` times that of the fastest that is right enough.
    wanted  representations that may be taken although something else is smaller.
    speeds  ns of a look-up by (representation, interpolation, channels), of the smallest table of each: it depends on
            the material hardly, so that many materials share them.
    """

    limit: float | None = None
    wanted: frozenset[str] = frozenset()
    speeds: dict[tuple[str, str, int], float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Step:
    """One thing to build: `size` bytes with the class's own candidates, or else one `shape`, `times` the one before."""

    cls: type[Table]
    way: str
    size: int
    shape: tuple[int, ...] | None = None
    own: bool = True
    times: float = 1.0

    def __str__(self) -> str:
        what = f"within {self.size} bytes" if self.own else "x".join(map(str, self.shape or ()))
        return f"{self.cls.name}{'' if self.way == 'linear' else f', {self.way},'} {what}".strip()


@dataclass
class _Way:
    """How far one class and interpolation has come."""

    steps: list[_Step]
    prepared: Any = None
    begun: bool = False
    last: Entry | None = None
    halved: bool = False

    @property
    def size(self) -> float:
        """Expected bytes of what is next."""
        step = self.steps[0]
        if step.own:
            return step.size
        return 0.0 if self.last is None else self.last.nbytes * step.times**3


class Tabulating:
    """Builds and measures, until the time is up.

    enough    of each representation nothing larger than the first table within this error is built.
    smallest  what else need not be built, if only the smallest table is wanted.
    seen      angles that tables are made for.
    """

    def __init__(
        self,
        reference: Brdf,
        measure: Callable[[Brdf, Brdf], Comparison],
        until: float,
        *,
        tolerance: float,
        enough: float | None,
        smallest: Smallest | None,
        progress: Progress | None,
        seen: Seen = EVERYWHERE,
    ) -> None:
        self.seen = seen
        self.reference, self.measure, self.until = reference, measure, until
        self.tolerance, self.enough, self.smallest = tolerance, enough, smallest
        self.progress = progress
        self.left_out: list[str] = []
        self._ids: set[str] = set()
        self._right: list[tuple[int, float]] = []

    def measured(self, b: Brdf) -> Comparison:
        return self.measure(self.reference, b)

    def known(self, table: Table) -> bool:
        """Whether this very table is an entry already; from now on it is."""
        known = table.id in self._ids
        self._ids.add(table.id)
        return known

    def given(self, entry: Entry) -> Entry:
        """`entry`, taken note of: what is no better need not be built."""
        if self.smallest is not None and entry.meets(self.tolerance) and entry.brdf is not None:
            self._right.append((entry.nbytes, at_a_glance(entry.brdf)))
        return entry

    def tables(self, classes: Sequence[type[Table]], sizes: Sequence[int]) -> Iterator[Entry]:
        """Every class and interpolation, the small ones first: what the time does not suffice for is the largest.

        The first of each is always built, and its time not counted.
        """
        ways = _ways(classes, sizes)
        count, done = sum(len(way.steps) for way in ways), 0
        while ways := [way for way in ways if way.steps]:
            way = min(ways, key=lambda each: each.size)
            step = way.steps[0]
            if self.progress is not None:
                self.progress(done, count, f"building {step}")
            done += 1
            why, final = self._needless(way, step)
            if why:
                self.left_out.append(f"{step}{', and larger' if final and len(way.steps) > 1 else ''}: {why}")
                done += len(way.steps) - 1 if final else 0
                way.steps = [] if final else way.steps[1:]
                continue
            way.steps.pop(0)
            try:
                best = self._best(way, step)
            except InputError as error:
                self.left_out.append(f"{step}: {error.detail}")
                continue
            if best is None:
                continue
            way.last = best
            self.given(best)
            if self.enough is not None and best.meets(self.enough):
                done += len(way.steps)
                way.steps = self._between(way, step)
                count += len(way.steps)
            yield best

    def _between(self, way: _Way, step: _Step) -> list[_Step]:
        """Where the smallest is wanted: half way back to the size before, which was not enough."""
        if self.smallest is None or not step.own or way.halved:
            return []
        way.halved = True
        return [replace(step, size=int(step.size / 2**0.5))]

    def _best(self, way: _Way, step: _Step) -> Entry | None:
        """The best table of one step; None if there is none of this size that is not there already."""
        start = time.perf_counter()
        options = BuildOptions(step.shape, step.way, prepared=way.prepared, seen=self.seen)
        first, way.begun = not way.begun, True
        asked = [options]
        if step.own:
            few = _SHAPES if step.size <= _SEVERAL else 1
            asked = list(step.cls.candidates(self.reference, options, step.size))[:few]
            way.prepared = asked[0].prepared if asked else None
        made = [e for e in (self._built(step.cls, o, step.size) for o in asked) if e is not None]
        if first:  # it may have waited for the compiler, which is no measure of anything
            self.until += time.perf_counter() - start
        return min(made, key=lambda e: (e.error, e.nbytes), default=None)

    def _needless(self, way: _Way, step: _Step) -> tuple[str, bool]:
        """(why a step is not worth building, "" if it is; whether that holds for all that follow)."""
        if not way.begun and (self.smallest is None or step.way == "linear"):
            return "", False  # of each representation there is one to compare with
        if self.smallest is not None and (why := self._can_not_win(way, step, self.smallest)):
            return why, True
        last = way.last
        if self.smallest is not None and last is not None:
            largest = max(s.size for s in way.steps)
            if last.error > self.tolerance * step.cls.largest_gain(step.way, largest / last.nbytes):
                return f"{largest} bytes won't do for {self.tolerance:g}", True
            if last.error > self.tolerance * step.cls.largest_gain(step.way, step.size / last.nbytes):
                return f"won't do for {self.tolerance:g}", False
        if time.perf_counter() > self.until and way.begun:
            return TIME_UP, True
        if way.begun and (expected := _A_BYTE * way.size / len(self.reference.channels)) > _MOST_EVALUATIONS:
            return f"some {expected:.2g} evaluations of the material to build", True
        return "", False

    def _can_not_win(self, way: _Way, step: _Step, smallest: Smallest) -> str:
        """Why no table of this way can be chosen any more: something smaller is right, and will stay quick enough."""
        key = (step.cls.name, step.way, len(self.reference.channels))
        if key not in smallest.speeds and way.last is not None and way.last.brdf is not None:
            smallest.speeds[key] = at_a_glance(way.last.brdf)
        if key not in smallest.speeds or step.cls.name in smallest.wanted:
            return ""
        # a larger table of this way is no faster than the smallest, and only what is faster can rule others out
        allowed = SLOWEST * smallest.speeds[key] if smallest.limit is None else smallest.limit
        if any(nbytes < way.size and ns <= allowed for nbytes, ns in self._right):
            return "something smaller is right enough, and quick enough beside it"
        return ""

    def chosen(self, classes: Sequence[type[Table]], max_bytes: int | None) -> Iterator[Entry]:
        """What `tabulate` takes for the tolerance."""
        if self.progress is not None:
            self.progress(0, 1, "choosing as tabulate does")
        options = BuildOptions(seen=self.seen)
        search = Search(self.reference, Judge(self.reference, self.seen, "incidence"), options, self.tolerance,
                        max_bytes, None)  # fmt: skip
        start = time.perf_counter()
        try:
            table = search.run(classes)
        except InputError as error:
            self.left_out.append(f"tabulate's choice: {error.detail}")
            return
        if search.met and not self.known(table):
            yield self._entry(table, None, time.perf_counter() - start)

    def usual(self) -> Iterator[Entry]:
        """`USUAL`. Its layout has no room for what is not reciprocal: who uses it gives that up; the error says so."""
        cls: type[Table] = REPRESENTATIONS.load(USUAL[0])
        fold = frozenset(name for name in ("bilateral", "reciprocal") if not getattr(self.reference, name))
        if self.progress is not None:
            self.progress(0, 1, "building the usual practice")
        try:
            entry = self._built(cls, BuildOptions(USUAL[1], USUAL[2], fold=fold), None)
        except InputError as error:
            self.left_out.append(f"{cls.name}, the usual practice: {error.detail}")
            return
        if entry is not None:
            entry.usual = True
            entry.variant += "".join(f", made {name}" for name in sorted(fold)) + USUALLY
            yield entry

    def _built(self, cls: type[Table], options: BuildOptions, size: int | None) -> Entry | None:
        """The table, measured; None if it is too large or there already."""
        start = time.perf_counter()
        table = cls.build(self.reference, options)
        seconds = time.perf_counter() - start
        if (size is not None and table.nbytes > size) or self.known(table):
            return None
        return self._entry(table, options, seconds)

    def _entry(self, table: Table, options: BuildOptions | None, seconds: float) -> Entry:
        found = self.measured(table)
        table.error = {**found.to_json(), **self.seen.attributes(), "tolerance": None, "warnings": []}
        table.metadata = table.metadata or dict(self.reference.metadata)
        return Entry(table.name, variant_of(table, options), "table", table.nbytes, seconds, found, table)


def _ways(classes: Sequence[type[Table]], sizes: Sequence[int]) -> list[_Way]:
    """What to build of each class and interpolation, by size; ones beside the first at every other size only."""
    ways = []
    most = max(sizes, default=0)
    if not sizes:
        return []
    for cls in classes:
        own = cls.candidates.__func__ is not Table.candidates.__func__  # type: ignore[attr-defined]
        for nth, interpolation in enumerate(_interpolations(cls)):
            shape = _default_shape(cls)
            if own:
                steps = [_Step(cls, interpolation, size) for size in sizes[:: 1 if nth == 0 else 2]]
            elif shape is None:  # it has one size
                steps = [_Step(cls, interpolation, 2**62, own=False)]
            else:
                steps = []
                for k, multiple in enumerate(_MULTIPLES):
                    scaled = tuple(max(2, round(n * multiple)) for n in shape)
                    times = multiple / _MULTIPLES[max(k - 1, 0)]
                    steps.append(_Step(cls, interpolation, max(most, 1), scaled, own=False, times=times))
            ways.append(_Way(steps))
    return ways


def _default_shape(cls: type[Table]) -> tuple[int, ...] | None:
    """What the representation's `shape` is if nothing else is asked for; None if it has none to choose."""
    texts = [str(p.default) for p in cls.PARAMETERS if p.name == "shape" and p.default]
    try:
        return tuple(int(n) for n in texts[0].split(",")) if texts else None
    except ValueError:
        return None


def _interpolations(cls: type[Table]) -> Sequence[str]:
    """The default first."""
    for p in cls.PARAMETERS:
        if p.name == "interpolation" and p.choices:
            return sorted(p.choices, key=lambda way: way != p.default)
    return ("linear",)


def variant_of(table: Table, options: BuildOptions | None = None) -> str:
    """Nodes per axis, and the interpolation where there are several."""
    largest = max(table.to_arrays().values(), key=lambda a: a.size)
    nodes = largest.shape[:3]
    if options is not None and options.shape is not None and largest.ndim < 3:
        nodes = options.shape
    way = str(table.attributes().get("interpolation", "linear")) if options is None else options.interpolation
    several = len(_interpolations(type(table))) > 1
    return " x ".join(str(n) for n in nodes) + (f", {way}" if several else "")
