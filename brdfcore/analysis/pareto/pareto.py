"""Speed against error: what every representation of one material costs, how wrong it is, and which to use."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from brdfcore.analysis.pareto.entries import Entry, beaten_anyway, choose, mark_dominated
from brdfcore.analysis.pareto.tabulating import TIME_UP, USUAL, Smallest, Tabulating, variant_of
from brdfcore.analysis.pareto.timing import (
    MARGIN,
    REPEATS,
    ROUNDS,
    Maker,
    look_up_maker,
    look_ups,
    machine,
    time_all,
    versions,
)
from brdfcore.base.brdf import Brdf, Scaled, Sum
from brdfcore.base.errors import InputError
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.build.tabulate import DEFAULT_TOLERANCE, positive
from brdfcore.metrics import WHOLE, Range, compare
from brdfcore.models.base.model import Model
from brdfcore.tables.base.seen import Seen
from brdfcore.tables.base.table import Progress, Table

#: Bytes that each representation is built within, in turn.
SIZES = tuple(8_000 * 2**k for k in range(11))
#: Nothing more is built after this share of the time; the rest is for timing and pictures.
_BUILDING = 0.6
#: Of each representation nothing larger is built than the first with this share of the tolerance: who wants less error
#: asks for it. A limit by error, not by time, leaves the same tables in every run.
_FINE = 0.1


@dataclass
class Pareto:
    """The answer of `pareto`: `entries` by bytes, then error; `chosen` is one of them.

    rivals  what another run might have chosen, since times differ a little between runs.
    """

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
    rivals: list[Entry] = field(default_factory=list)
    machine: str = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)

    @property
    def front(self) -> list[Entry]:
        """What nothing else dominates, smallest first."""
        return [e for e in self.entries if e.on_front]

    @property
    def not_tried(self) -> list[str]:
        """What the limit in seconds kept from being tried."""
        return [text.removesuffix(f": {TIME_UP}") for text in self.left_out if text.endswith(TIME_UP)]

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
            "rivals": [e.label for e in self.rivals],
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
    seconds: float | None = None,
    peers: bool = False,
    path: Path | None = None,
    light: Range = WHOLE,
    view: Range = WHOLE,
    smallest: Smallest | None = None,
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
        Error that is right enough, as `tabulate` bounds it for each angle of incidence; default 0.01. What is chosen is
        what `tabulate` would choose, unless the formula itself is fast enough.
    max_bytes : int, optional
        Limit on the size of what is chosen. Without a tolerance the smallest error within it is chosen.
    sizes : sequence of int
        Bytes that each representation is built within.
    representations : sequence of str, optional
        Only these tables; default: all that can hold `b`.
    directions, rounds : int
        Draws an error is measured on; interleaved rounds of timing.
    seconds : float, optional
        About how long it may take: sizes not reached by then are left out, and `not_tried` names them. Without it the
        same is tried on every machine, whatever else it does.
    peers : bool
        Also scipy, interpn and, with the `path` of a file of the RGL database, Mitsuba 3, where installed.
    light, view : (float, float)
        Ranges of theta_i and theta_o, radians, that tables are made for and the error is measured over.
    smallest : Smallest, optional
        Only the smallest that is right enough and quick enough is wanted: what can't be that is neither built nor
        timed at small batches (`tabulating.Smallest`).
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

    >>> few = {"sizes": (8000,), "representations": ["angle_grid"], "rounds": 1, "directions": 20_000}
    >>> found = bc.pareto(bc.model("lambert"), **few)
    >>> sorted({entry.representation for entry in found.entries})
    ['angle_grid', 'lambert']
    """
    tolerance, room = positive("tolerance", tolerance), positive("max_bytes", max_bytes)
    smallest_error = tolerance is None and room is not None
    tolerance = DEFAULT_TOLERANCE if tolerance is None else tolerance
    limit = positive("seconds", seconds)
    start = time.perf_counter()
    names = list(REPRESENTATIONS.names()) if representations is None else list(representations)
    classes: list[type[Table]] = [c for c in map(REPRESENTATIONS.load, names) if c.can_hold(b)]
    reference = _exact(b)
    measure = partial(compare, directions=directions, light=light, view=view)
    enough = None if smallest_error else tolerance if smallest is not None else _FINE * tolerance
    until = math.inf if limit is None else start + _BUILDING * limit
    work = Tabulating(
        reference, measure, until, tolerance=tolerance, enough=enough, smallest=smallest,
        progress=progress, seen=Seen(light, view),
    )  # fmt: skip
    entries = [*_given(b, reference, work), *work.tables(classes, sorted(set(map(int, sizes))))]
    if smallest is None and not smallest_error:
        entries += work.chosen([c for c in classes if c.FOR_AUTO], None if room is None else int(room))
    if smallest is None and USUAL[0] in names:
        entries += work.usual()
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
    headline = smallest is not None
    settled = None if headline else partial(beaten_anyway, [e for e in entries if e.kind != "peer"])
    times = time_all(makers, rounds=rounds, single=single, headline=headline, settled=settled, progress=progress)
    for name, timings in times.items():
        next(e for e in entries if e.label == name).timings = timings
    entries.sort(key=lambda e: (e.nbytes, e.error, e.label))
    mark_dominated(entries)
    ours = [e for e in entries if e.kind != "peer"]
    tables = [e for e in ours if e.kind == "table"]
    chosen, *others = (
        choose(ours, tolerance, room, smallest_error=smallest_error, margin=m)
        for m in (MARGIN, MARGIN / REPEATS, MARGIN * REPEATS)
    )
    from brdfcore.kernels.machine import launch

    return Pareto(
        material=material or str(b.metadata.get("model", "")),
        source=reference,
        tolerance=tolerance,
        max_bytes=None if room is None else int(room),
        entries=entries,
        chosen=chosen,
        rivals=[e for e in ours if e is not chosen and any(e is other for other in others)],
        table=choose(tables, tolerance, room, smallest_error=smallest_error) if tables else None,
        left_out=work.left_out,
        seconds=time.perf_counter() - start,
        threads=launch.threads(),
    )


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


def _given(b: Brdf, reference: Brdf, work: Tabulating) -> Iterator[Entry]:
    """The source itself: a formula in its tiers, or a table as it was read."""
    if isinstance(reference, Table):
        work.known(reference)
        detail = variant_of(reference)
        yield work.given(Entry(
            reference.name, f"{detail}, as given", "table", reference.nbytes, 0.0, work.measured(reference), reference
        ))  # fmt: skip
    elif is_formula(reference):
        name = reference.name if isinstance(reference, Model) else "formula"
        yield work.given(Entry(name, "exact", "model", 0, 0.0, work.measured(reference), reference))
        if isinstance(reference, Model) and reference.FAST:
            fast = _tier(reference, "fast")
            yield work.given(Entry(name, "fast", "model", 0, 0.0, work.measured(fast), fast))


def _peers(
    reference: Brdf, entries: Sequence[Entry], path: Path | None, work: Tabulating
) -> Iterator[tuple[Entry, Maker, Any]]:
    """Others' libraries: on the nodes of the largest angle grid of at most 2 MB, and on the file."""
    from brdfcore.analysis.pareto.peers import grid_peers, mitsuba_peer

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
        yield entry, (lambda n, peer=peer: peer.maker(look_ups(n))), peer.single  # type: ignore[misc]
