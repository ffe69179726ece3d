"""Every table that can hold a material, over a range of sizes, until the time is up."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from brdfcore.analysis.entries import Entry
from brdfcore.brdf import Brdf
from brdfcore.errors import InputError
from brdfcore.metrics import Comparison
from brdfcore.tables.base import BuildOptions, Progress, Table

#: The usual practice: the layout of the MERL files and the node next to the direction (W. Matusik, H. Pfister,
#: M. Brand, L. McMillan, "A data-driven reflectance model", ACM Trans. Graph. 22(3), 2003).
USUAL = ("half_angle_grid", (90, 90, 180), "nearest")
#: Shapes of one size that are built to find the best, up to _SEVERAL bytes.
_SHAPES, _SEVERAL = 3, 1_000_000
#: A size is left out if the one before says that its build takes longer than this, seconds.
_LONGEST_BUILD = 15.0
#: A representation that does not choose its size by bytes is tried at these multiples of its default shape; each takes
#: about so many times longer to build than the one before.
_MULTIPLES, _LONGER = (0.25, 0.5, 1.0, 2.0), 8.0
#: The same of twice the bytes.
_TWICE = 2.5


@dataclass(frozen=True)
class _Step:
    """One thing to build: `size` bytes with the class's own candidates, or else one `shape`."""

    cls: type[Table]
    way: str
    size: int
    shape: tuple[int, ...] | None = None
    own: bool = True

    def __str__(self) -> str:
        what = f"within {self.size} bytes" if self.own else "x".join(map(str, self.shape or ()))
        return f"{self.cls.name}{'' if self.way == 'linear' else f', {self.way},'} {what}".strip()


class Tabulating:
    """Builds and measures, until the time is up."""

    def __init__(
        self,
        reference: Brdf,
        measure: Callable[[Brdf, Brdf], Comparison],
        until: float,
        enough: float | None,
        progress: Progress | None,
    ) -> None:
        self.reference, self.measure, self.until, self.enough = reference, measure, until, enough
        self.progress = progress
        self.left_out: list[str] = []
        self._ids: set[str] = set()

    def measured(self, b: Brdf) -> Comparison:
        return self.measure(self.reference, b)

    def known(self, table: Table) -> bool:
        """Whether this very table is an entry already; from now on it is."""
        known = table.id in self._ids
        self._ids.add(table.id)
        return known

    def tables(self, classes: Sequence[type[Table]], sizes: Sequence[int]) -> Iterator[Entry]:
        """Every class and interpolation, the small ones first: what the time does not suffice for is the largest.

        The first of each is always built, and its time not counted.
        """
        prepared: dict[tuple[str, str], Any] = {}
        last: dict[tuple[str, str], float] = {}
        done: set[tuple[str, str]] = set()
        begun: set[tuple[str, str]] = set()
        steps = _steps(classes, sizes)
        for k, step in enumerate(steps):
            way = (step.cls.name, step.way)
            if self.progress is not None:
                self.progress(k, len(steps), f"building {step}")
            if way in done:
                continue
            start = time.perf_counter()
            first = way not in begun
            begun.add(way)
            if start > self.until and not first:
                self.left_out.append(f"{step}: the time was up")
                continue
            if (expected := (_TWICE if step.own else _LONGER) * last.get(way, 0.0)) > _LONGEST_BUILD:
                self.left_out.append(f"{step}: some {expected:.0f} s to build")
                continue
            options = BuildOptions(step.shape, step.way, prepared=prepared.get(way))
            try:
                asked = [options]
                if step.own:
                    few = _SHAPES if step.size <= _SEVERAL else 1
                    asked = list(step.cls.candidates(self.reference, options, step.size))[:few]
                    prepared[way] = asked[0].prepared if asked else None
                made = [e for e in (self._built(step.cls, o, step.size) for o in asked) if e is not None]
            except InputError as error:
                self.left_out.append(f"{step}: {error.detail}")
                continue
            if first:  # it may have waited for the compiler, which is no measure of anything
                self.until += time.perf_counter() - start
            elif made:
                last[way] = max(e.build_seconds for e in made)
            if made:
                best = min(made, key=lambda e: (e.error, e.nbytes))
                if self.enough is not None and best.meets(self.enough):
                    done.add(way)
                yield best
        if self.enough is None:
            yield from self._usual([cls for cls in classes if cls.name == USUAL[0]])

    def _usual(self, classes: Sequence[type[Table]]) -> Iterator[Entry]:
        for cls in classes:
            try:
                entry = self._built(cls, BuildOptions(USUAL[1], USUAL[2]), None)
            except InputError as error:
                self.left_out.append(f"{cls.name}, the usual practice: {error.detail}")
                continue
            if entry is not None:
                entry.usual = True
                entry.variant += ", the usual practice"
                yield entry

    def _built(self, cls: type[Table], options: BuildOptions, size: int | None) -> Entry | None:
        """The table, measured; None if it is too large or there already."""
        start = time.perf_counter()
        table = cls.build(self.reference, options)
        seconds = time.perf_counter() - start
        if (size is not None and table.nbytes > size) or self.known(table):
            return None
        found = self.measured(table)
        table.error = {**found.to_json(), "tolerance": None, "warnings": []}
        table.metadata = table.metadata or dict(self.reference.metadata)
        return Entry(table.name, variant_of(table, options), "table", table.nbytes, seconds, found, table)


def _steps(classes: Sequence[type[Table]], sizes: Sequence[int]) -> list[_Step]:
    """What to build, by size; ways to interpolate beside the first one at every other size only."""
    steps = []
    most = max(sizes, default=0)
    for cls in classes:
        own = cls.candidates.__func__ is not Table.candidates.__func__  # type: ignore[attr-defined]
        for nth, way in enumerate(_interpolations(cls)):
            if own:
                steps += [_Step(cls, way, size) for size in sizes[:: 1 if nth == 0 else 2]]
                continue
            shape = _default_shape(cls)
            if shape is None:  # it has one size
                steps.append(_Step(cls, way, 2**62, own=False))
                continue
            for multiple in _MULTIPLES:
                scaled = tuple(max(2, round(n * multiple)) for n in shape)
                steps.append(_Step(cls, way, max(most, 1), scaled, own=False))
    if not sizes:
        return []
    return sorted(steps, key=lambda step: step.size if step.own else 0)


def _default_shape(cls: type[Table]) -> tuple[int, ...] | None:
    """What the representation's `shape` is if nothing else is asked for; None if it has none to choose."""
    texts = [str(p.default) for p in cls.PARAMETERS if p.name == "shape" and p.default]
    try:
        return tuple(int(n) for n in texts[0].split(",")) if texts else None
    except ValueError:
        return None


def _interpolations(cls: type[Table]) -> Sequence[str]:
    offered = [p.choices for p in cls.PARAMETERS if p.name == "interpolation"]
    return offered[0] if offered and offered[0] else ("linear",)


def variant_of(table: Table, options: BuildOptions | None = None) -> str:
    """Nodes per axis, and the interpolation where there are several."""
    largest = max(table.to_arrays().values(), key=lambda a: a.size)
    nodes = largest.shape[:3]
    if options is not None and options.shape is not None and largest.ndim < 3:
        nodes = options.shape
    way = str(table.attributes().get("interpolation", "linear")) if options is None else options.interpolation
    several = len(_interpolations(type(table))) > 1
    return " x ".join(str(n) for n in nodes) + (f", {way}" if several else "")
