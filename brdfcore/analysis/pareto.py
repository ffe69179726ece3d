"""Speed against error: what every representation of one material costs, how wrong it is, and which to use."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from brdfcore.analysis.timing import ROUNDS, Maker, Timing, label, machine, time_all, versions
from brdfcore.brdf import Brdf, Scaled, Sum
from brdfcore.build import DEFAULT_TOLERANCE, positive
from brdfcore.conventions import FloatArray
from brdfcore.directions import cosine_pairs
from brdfcore.errors import InputError
from brdfcore.metrics import WHOLE, Comparison, Range, compare
from brdfcore.models.base import Model
from brdfcore.registry import REPRESENTATIONS
from brdfcore.tables.base import BuildOptions, Progress, Table

#: Bytes that each representation is built within, in turn.
SIZES = tuple(8_000 * 2**k for k in range(11))
#: The usual practice: the layout of the MERL files and the node next to the direction (W. Matusik, H. Pfister,
#: M. Brand, L. McMillan, "A data-driven reflectance model", ACM Trans. Graph. 22(3), 2003).
USUAL = ("half_angle_grid", (90, 90, 180), "nearest")
#: Shapes of one size that are built to find the best, up to _SEVERAL bytes.
_SHAPES, _SEVERAL = 3, 1_000_000
#: A size is left out if the one before says that its build takes longer than this, seconds.
_LONGEST_BUILD = 15.0
#: Nothing more is built after this share of the time; the rest is for timing and pictures.
_BUILDING = 0.6
_HEADLINE = label(1_000_000, 1)
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


@dataclass
class Pareto:
    """The answer of `pareto`: `entries` by bytes, then error; `chosen` is one of them."""

    material: str
    source: Brdf = field(repr=False)
    tolerance: float
    max_bytes: int | None
    entries: list[Entry]
    chosen: Entry
    table: Entry | None
    left_out: list[str]
    seconds: float
    threads: int
    machine: str = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)

    @property
    def front(self) -> list[Entry]:
        """What nothing else dominates, smallest first."""
        return [e for e in self.entries if e.on_front]

    @property
    def met(self) -> bool:
        """Whether `chosen` does what was asked for."""
        return self.chosen.meets(self.tolerance) and self.chosen.nbytes <= (self.max_bytes or math.inf)

    def to_json(self) -> dict[str, Any]:
        """JSON-ready; nothing is not finite."""
        return {
            "material": self.material,
            "tolerance": self.tolerance,
            "max_bytes": self.max_bytes,
            "machine": {"processor": self.machine, "threads": self.threads, "versions": self.versions},
            "chosen": self.chosen.to_json(self.tolerance),
            "met": self.met,
            "table": None if self.table is None else self.table.to_json(self.tolerance),
            "front": [e.to_json(self.tolerance) for e in self.front],
            "entries": [e.to_json(self.tolerance) for e in self.entries],
            "left_out": self.left_out,
            "seconds": self.seconds,
        }


def pareto(
    b: Brdf,
    *,
    material: str = "",
    tolerance: float | None = None,
    max_bytes: int | None = None,
    sizes: Sequence[int] = SIZES,
    representations: Sequence[str] | None = None,
    directions: int = 200_000,
    rounds: int = ROUNDS,
    seconds: float = 240.0,
    peers: bool = False,
    path: Path | None = None,
    light: Range = WHOLE,
    view: Range = WHOLE,
    refine: bool = True,
    progress: Progress | None = None,
) -> Pareto:
    """Build every applicable representation of `b` over a range of sizes, measure error and speed, and choose.

    Parameters
    ----------
    b : Brdf
        The material; it is its own reference (an analytic model in its exact tier).
    material : str
        What the answer calls it.
    tolerance : float, optional
        Error (L1, and that of the mirror part) that is right enough; default 0.01. The fastest within it is chosen,
        of several equally fast ones the smallest.
    max_bytes : int, optional
        Limit on the size of what is chosen. Without a tolerance the smallest error within it is chosen.
    sizes : sequence of int
        Bytes that each representation is built within.
    representations : sequence of str, optional
        Only these tables; default: all that can hold `b`.
    directions, rounds : int
        Draws an error is measured on; interleaved rounds of timing.
    seconds : float
        About how long it may take: sizes not reached by then are left out, and said.
    peers : bool
        Also scipy, interpn and, with the `path` of a file of the RGL database, Mitsuba 3, where installed.
    light, view : (float, float)
        Ranges of theta_i and theta_o, radians, that the error is measured over.
    refine : bool
        False: of each representation nothing larger than the first size within the tolerance is built.
    progress : callable(done, total, stage), optional

    Returns
    -------
    Pareto
        One entry dominates another if it is no larger, its error no larger, and it is not distinctly slower: a
        difference below `timing.MARGIN`, or within the spread of the rounds, is none. Look-ups are timed with float32
        angles, cosine-distributed.

    Raises
    ------
    InputError
        A bad option, or a source that no representation can hold.
    """
    tolerance, room = positive("tolerance", tolerance), positive("max_bytes", max_bytes)
    smallest_error = tolerance is None and room is not None
    tolerance = DEFAULT_TOLERANCE if tolerance is None else tolerance
    positive("seconds", seconds)
    start = time.perf_counter()
    names = list(REPRESENTATIONS.names()) if representations is None else list(representations)
    classes: list[type[Table]] = [c for c in map(REPRESENTATIONS.load, names) if c.can_hold(b)]
    reference = _exact(b)
    measure = partial(compare, directions=directions, light=light, view=view)
    work = _Work(reference, measure, start + _BUILDING * seconds, None if refine else tolerance, progress)
    entries = [*_given(b, reference, work), *work.tables(classes, sorted(set(map(int, sizes))))]
    makers = {e.label: look_up_maker(e.brdf) for e in entries if e.brdf is not None}
    single: dict[str, Any] = {}
    if peers:
        for entry, maker, alone in _peers(reference, entries, path, work):
            entries.append(entry)
            makers[entry.label], single[entry.label] = maker, alone
    if not entries:
        raise InputError(
            "no_representation",
            f"nothing can hold it{': ' + '; '.join(work.left_out) if work.left_out else ''}",
            where="representations",
        )
    for name, timings in time_all(makers, rounds=rounds, single=single, progress=progress).items():
        next(e for e in entries if e.label == name).timings = timings
    entries.sort(key=lambda e: (e.nbytes, e.error, e.label))
    mark_dominated(entries)
    ours = [e for e in entries if e.kind != "peer"]
    tables = [e for e in ours if e.kind == "table"]
    from brdfcore.kernels import launch

    return Pareto(
        material=material or str(b.metadata.get("model", "")),
        source=reference,
        tolerance=tolerance,
        max_bytes=None if room is None else int(room),
        entries=entries,
        chosen=choose(ours, tolerance, room, smallest_error=smallest_error),
        table=choose(tables, tolerance, room, smallest_error=smallest_error) if tables else None,
        left_out=work.left_out,
        seconds=time.perf_counter() - start,
        threads=launch.threads(),
    )


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
    """The fastest within tolerance and bytes, of equally fast ones the smallest; else the least wrong that fits."""
    fitting = [e for e in entries if e.nbytes <= (room or math.inf)]
    right = [] if smallest_error else [e for e in fitting if e.meets(tolerance)]
    if right:
        fastest = min(right, key=lambda e: e.ns.best)
        alike = [e for e in right if not fastest.ns.faster_than(e.ns)]
        return min(alike, key=lambda e: (e.nbytes, e.error))
    if fitting:
        return min(fitting, key=lambda e: (e.error, e.nbytes))
    return min(entries, key=lambda e: (e.nbytes, e.error))


class _Work:
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
        """Every class and interpolation, at every size in turn: what the time does not suffice for is the largest."""
        ways = [(cls, way) for cls in classes for way in _interpolations(cls)]
        prepared: dict[tuple[str, str], Any] = {}
        last: dict[tuple[str, str], float] = {}
        done: set[tuple[str, str]] = set()
        steps = [(size, cls, way) for size in sizes for cls, way in ways]
        for k, (size, cls, way) in enumerate(steps):
            if self.progress is not None:
                self.progress(k, len(steps), f"building {cls.name} within {size} bytes")
            if (cls.name, way) in done:
                continue
            if time.perf_counter() > self.until:
                self.left_out.append(f"{cls.name}{_shown(way)} within {size} bytes: the time was up")
                continue
            if (expected := 2.5 * last.get((cls.name, way), 0.0)) > _LONGEST_BUILD:
                self.left_out.append(f"{cls.name}{_shown(way)} within {size} bytes: some {expected:.0f} s to build")
                continue
            options = BuildOptions(interpolation=way, prepared=prepared.get((cls.name, way)))
            try:
                asked = list(cls.candidates(self.reference, options, size))[: _SHAPES if size <= _SEVERAL else 1]
                if asked:
                    prepared[cls.name, way] = asked[0].prepared
                made = [e for e in (self._built(cls, o, size) for o in asked) if e is not None]
            except InputError as error:
                self.left_out.append(f"{cls.name}{_shown(way)} within {size} bytes: {error.detail}")
                continue
            if made:
                last[cls.name, way] = max(e.build_seconds for e in made)
                best = min(made, key=lambda e: (e.error, e.nbytes))
                if self.enough is not None and best.meets(self.enough):
                    done.add((cls.name, way))
                yield best
        usual = [cls for cls in classes if cls.name == USUAL[0]]
        for cls in usual:
            entry = self._built(cls, BuildOptions(USUAL[1], USUAL[2]), None)
            if entry is not None:
                entry.usual = True
                entry.variant += ", the usual practice"
                yield entry

    def _built(self, cls: type[Table], options: BuildOptions, size: int | None) -> Entry | None:
        start = time.perf_counter()
        table = cls.build(self.reference, options)
        seconds = time.perf_counter() - start
        if (size is not None and table.nbytes > size and not _only_one(cls)) or self.known(table):
            return None
        found = self.measured(table)
        table.error = {**found.to_json(), "tolerance": None, "warnings": []}
        table.metadata = table.metadata or dict(self.reference.metadata)
        return Entry(table.name, _variant(table, options.interpolation), "table", table.nbytes, seconds, found, table)


def _exact(b: Brdf) -> Brdf:
    """What errors are measured against: a model's exact tier."""
    if isinstance(b, Model) and b.parameters.get("precision") == "fast":
        return _tier(b, "exact")
    return b


def is_formula(b: Brdf) -> bool:
    """Whether `b` is a model, or sums and multiples of models."""
    if isinstance(b, Sum):
        return all(is_formula(part) for part in b.parts)
    return is_formula(b.part) if isinstance(b, Scaled) else isinstance(b, Model)


def _tier(b: Model, precision: str) -> Model:
    made = type(b)(**{**b.parameters, "precision": precision})
    made.metadata = {**b.metadata, **made.metadata}
    return made


def _given(b: Brdf, reference: Brdf, work: _Work) -> Iterator[Entry]:
    """The source itself: a formula in its tiers, or a table as it was read."""
    if isinstance(reference, Table):
        work.known(reference)
        detail = _variant(reference, str(reference.attributes().get("interpolation", "linear")))
        yield Entry(
            reference.name, f"{detail}, as given", "table", reference.nbytes, 0.0, work.measured(reference), reference
        )
    elif is_formula(reference):
        name = reference.name if isinstance(reference, Model) else "formula"
        yield Entry(name, "exact", "model", 0, 0.0, work.measured(reference), reference)
        if isinstance(reference, Model) and reference.FAST:
            fast = _tier(reference, "fast")
            yield Entry(name, "fast", "model", 0, 0.0, work.measured(fast), fast)


def _peers(
    reference: Brdf, entries: Sequence[Entry], path: Path | None, work: _Work
) -> Iterator[tuple[Entry, Maker, Any]]:
    """Others' libraries: on the nodes of the largest angle grid of at most 2 MB, and on the file."""
    from brdfcore.analysis.peers import grid_peers, mitsuba_peer

    found = []
    grids = [e for e in entries if e.representation == "angle_grid" and e.nbytes <= 2_000_000]
    like = max(grids, key=lambda e: e.nbytes, default=None)
    if like is not None and isinstance(like.brdf, Table):
        made, why = grid_peers(like.brdf.to_arrays()["values"], like.brdf.bilateral)
        found += made
        work.left_out += why
    if path is not None and isinstance(reference, Table) and reference.name == "vndf_warp":
        made, why = mitsuba_peer(path, reference)
        found += made
        work.left_out += why
    for peer in found:
        if peer.brdf is not None:
            comparison = work.measured(peer.brdf)
        else:
            assert like is not None
            comparison = like.comparison
        entry = Entry(peer.name, peer.detail, "peer", peer.nbytes, 0.0, comparison)
        yield entry, (lambda n, peer=peer: peer.maker(_angles(n))), peer.single  # type: ignore[misc]


def _angles(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    theta_i, theta_o, delta_phi = (x.astype(np.float32) for x in cosine_pairs(n, 1))
    return theta_i, theta_o, delta_phi


def look_up_maker(b: Brdf) -> Maker:
    """What `time_all` times: float32 look-ups of `b` into an array that exists."""

    def make(n: int) -> Any:
        angles = _angles(n)
        out = np.empty((n, len(b.channels)), np.float32)
        return lambda: b.evaluate(*angles, out=out)

    return make


def _interpolations(cls: type[Table]) -> Sequence[str]:
    offered = [p.choices for p in cls.PARAMETERS if p.name == "interpolation"]
    return offered[0] if offered and offered[0] else ("linear",)


def _only_one(cls: type[Table]) -> bool:
    """A representation without a shape to choose has one size, whatever was asked for."""
    return all(p.name != "shape" for p in cls.PARAMETERS)


def _variant(table: Table, interpolation: str) -> str:
    largest = max(table.to_arrays().values(), key=lambda a: a.size)
    size = " x ".join(str(n) for n in largest.shape[:3])
    several = len(_interpolations(type(table))) > 1
    return f"{size}{', ' + interpolation if several else ''}"


def _shown(interpolation: str) -> str:
    return "" if interpolation == "linear" else f", {interpolation},"
