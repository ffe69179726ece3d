"""What a scene needs: for each material the smallest representation that is right enough where it is seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from brdfcore.analysis.pareto.entries import SLOWEST, Entry
from brdfcore.analysis.pareto.pareto import Pareto, is_formula, pareto
from brdfcore.analysis.pareto.tabulating import Smallest
from brdfcore.analysis.pareto.timing import machine, versions
from brdfcore.analysis.plan.scene import Scene, SceneMaterial, Selected, read_scene
from brdfcore.base.brdf import Brdf
from brdfcore.metrics import Range
from brdfcore.tables.base.seen import Seen
from brdfcore.tables.base.table import Progress

#: A file of the MERL database: what everybody takes for every material.
MERL_BYTES = 34_992_012
#: Bytes that tables are tried within, from the smallest that any representation needs.
SIZES = tuple(2_000 * 2**k for k in range(13))
#: An expansion in harmonics up to this size is taken under an environment, bytes: it answers for the whole environment
#: with one product of coefficients, where anything else is looked up once a direction.
HARMONICS_WITHIN = 64_000
#: Draws within the angles seen that errors are measured on.
DIRECTIONS = 60_000
_ROUNDS = 9


@dataclass
class Choice:
    """What one material gets. `names` are the scene's materials that it serves: they are equal.

    alternatives  what else was right enough, and of each representation that was not, the closest: with a reason.
    verified      error of the built file on other directions, once built: `build.judge.verified`.
    """

    names: list[str]
    source: Brdf
    light: Range
    view: Range
    tolerance: float
    entry: Entry
    reason: str
    met: bool
    alternatives: list[tuple[Entry, str]]
    directions: int
    path: Path | None = None
    verified: dict[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        return {
            "names": self.names,
            **_numbers(self.entry),
            "tolerance": self.tolerance,
            "met": self.met,
            "reason": self.reason,
            "channels": self.source.channels.to_json(),
            "light": _degrees(self.light),
            "view": _degrees(self.view),
            "alternatives": [{**_numbers(e), "reason": why} for e, why in self.alternatives],
            "file": None if self.path is None else self.path.name,
            "verified": self.verified,
        }


@dataclass
class Plan:
    """The answer for a scene: one `Choice` for each set of equal materials."""

    scene: Scene
    choices: list[Choice]
    machine: str = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)

    @property
    def nbytes(self) -> int:
        """Bytes of all tables, shared ones once."""
        return sum(c.entry.nbytes for c in self.choices)

    @property
    def ns(self) -> float:
        """One look-up of every material of the scene, one after the other."""
        return sum(c.entry.ns.best * len(c.names) for c in self.choices)

    @property
    def naive_bytes(self) -> int:
        return MERL_BYTES * len(self.scene.materials)

    @property
    def problems(self) -> list[str]:
        """Where the budget is not met."""
        said = [
            f"{c.names[0]}: nothing tried is within {c.tolerance:g}"
            + (f" and {self.scene.ns:g} ns" if self.scene.ns else "")
            for c in self.choices
            if not c.met
        ]
        if self.scene.bytes is not None and self.nbytes > self.scene.bytes:
            largest = max(self.choices, key=lambda c: c.entry.nbytes)
            said.append(
                f"the tables take {self.nbytes} bytes, the budget is {self.scene.bytes:.0f}; the largest is that of "
                f"{largest.names[0]}, {largest.entry.nbytes}: allow it a larger error"
            )
        return said

    def to_json(self) -> dict[str, Any]:
        return {
            "budget": {"error": self.scene.error, "bytes": self.scene.bytes, "ns": self.scene.ns},
            "materials": [c.to_json() for c in self.choices],
            "total": {
                "materials": len(self.scene.materials),
                "bytes": self.nbytes,
                "ns": self.ns,
                "naive_bytes": self.naive_bytes,
                "share_of_naive": self.nbytes / self.naive_bytes,
            },
            "met": not self.problems,
            "problems": self.problems,
            "machine": {"processor": self.machine, "versions": self.versions},
        }


def plan(
    scene: Mapping[str, Any] | str | Path,
    *,
    sizes: Sequence[int] = SIZES,
    directions: int = DIRECTIONS,
    representations: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Plan:
    """The smallest set of representations that is right enough for a scene (`analysis.plan.scene` describes its JSON).

    Equal materials share one table, made for all the angles and channels that any of them is seen in and for the least
    error. Of each material only the channels needed are tabulated, and errors are measured over the angles it is seen
    in. A half_difference table has its nodes there too, so that it is smaller, and `Brdf.status` says EXTRAPOLATED
    beyond; outside those angles every table answers with an error that nobody measured. A formula is not tabulated
    unless that makes it at least `SLOWEST` times faster. Nothing is written: see `analysis.plan.build.build`.

    sizes, directions, representations are those of `pareto`. Raises what `read_scene` raises.

    >>> scene = {"materials": [{"name": "wall", "model": "lambert", "parameters": {"reflectance": 0.8}}]}
    >>> found = bc.plan(scene, sizes=(8000,), representations=["angle_grid"], directions=20_000)
    >>> [(choice.names, choice.entry.representation) for choice in found.choices]
    [(['wall'], 'lambert')]
    """
    found = scene if isinstance(scene, Scene) else read_scene(scene)
    groups: dict[str, list[SceneMaterial]] = {}
    for material in found.materials:
        groups.setdefault(material.identity, []).append(material)
    choices = []
    speeds: dict[tuple[str, str, int], float] = {}
    for k, group in enumerate(groups.values()):
        told = _told(progress, group[0].name, k, len(groups))
        wanted = frozenset({"harmonic"}) if _environment(group) else frozenset()
        smallest = Smallest(found.ns, wanted, speeds)
        choices.append(
            _choice(group, found, told, smallest, sizes=sizes, directions=directions, representations=representations)
        )
    return Plan(found, choices)


def _choice(
    group: list[SceneMaterial],
    scene: Scene,
    progress: Progress | None,
    smallest: Smallest,
    *,
    sizes: Sequence[int],
    directions: int,
    representations: Sequence[str] | None,
) -> Choice:
    first = group[0]
    light, view = (_span(ranges) for ranges in zip(*((m.light, m.view) for m in group)))
    tolerance = min(m.error for m in group)
    wanted = {c for m in group for c in m.channels or first.brdf.channels}
    picks = [k for k, c in enumerate(first.brdf.channels) if c in wanted]
    # a formula costs no memory, whatever its channels
    whole = len(picks) == len(first.brdf.channels)
    source = first.brdf if whole else Selected(first.brdf, picks)
    drawn = Seen(light, view).draws(directions)
    found = pareto(
        source, material=first.name, tolerance=tolerance, sizes=sizes, directions=drawn, rounds=_ROUNDS,
        light=light, view=view, smallest=smallest, representations=representations, progress=progress,
    )  # fmt: skip
    if not whole:
        _with_formula(found, first.brdf, drawn, light, view)
    entry, reason, met = decide(found, scene.ns, _environment(group))
    names, others = [m.name for m in group], _alternatives(found, entry, scene.ns)
    return Choice(names, source, light, view, tolerance, entry, reason, met, others, drawn)


def _environment(group: list[SceneMaterial]) -> bool:
    return all(m.lighting == "environment" for m in group)


def _span(ranges: Sequence[Range]) -> Range:
    """From the least to the largest."""
    return min(r[0] for r in ranges), max(r[1] for r in ranges)


def _with_formula(found: Pareto, b: Brdf, directions: int, light: Range, view: Range) -> None:
    """Add the formula with all its channels, where a table would hold some of them."""
    if is_formula(b):
        more = pareto(
            b, material=found.material, tolerance=found.tolerance, sizes=(), directions=directions, rounds=_ROUNDS,
            light=light, view=view, smallest=Smallest(),
        )  # fmt: skip
        found.entries += more.entries


def decide(found: Pareto, limit: float | None, environment: bool) -> tuple[Entry, str, bool]:
    """(what to take, why, whether it is within the budget), from everything that was measured."""
    right = [e for e in found.entries if e.kind != "peer" and e.meets(found.tolerance)]
    fastest = min((e.ns.best for e in right), default=math.inf)
    # without a limit: memory saved by what is far slower is paid for at every look-up
    allowed = limit if limit is not None else SLOWEST * fastest
    quick = [e for e in right if e.ns.best <= allowed]
    if not quick:
        closest = min(right or found.entries, key=lambda e: (e.ns.best if right else e.error, e.nbytes))
        why = "the fastest that is right enough" if right else "nothing tried is right enough: the smallest error"
        return closest, why, False
    harmonics = [e for e in quick if e.representation == "harmonic" and e.nbytes <= HARMONICS_WITHIN]
    if environment and harmonics and not _constant(found):
        best = min(harmonics, key=lambda e: e.nbytes)
        return best, "lit by an environment: one product of coefficients instead of a look-up for each direction", True
    best = min(quick, key=lambda e: (e.nbytes, e.ns.best))
    if best.kind == "model":
        table = min((e for e in right if e.kind == "table"), key=lambda e: e.ns.best, default=None)
        if table is None:
            return best, _without_table(best, found), True
        ratio = best.ns.best / table.ns.best
        speed = f"is {1 / ratio:.1f} x as fast as" if ratio < 1 else f"takes {ratio:.1f} x the time of"
        return best, f"no table needed: the formula {speed} the fastest table that is right enough", True
    return best, "the smallest that is right enough" + (" and fast enough" if len(quick) < len(right) else ""), True


def _without_table(formula: Entry, found: Pareto) -> str:
    """Why a formula is taken where no table that is right enough was built."""
    tried = min((e.ns.best for e in found.entries if e.kind == "table"), default=math.inf)
    if formula.ns.best > SLOWEST * tried:
        return "no table is right enough, and the formula needs none"
    return (
        f"no table needed: the formula takes {formula.ns.best / tried:.1f} x the time of the fastest table of any size"
    )


def _constant(found: Pareto) -> bool:
    """A Lambertian: its answer under an environment is the irradiance, whatever it is stored as."""
    return str(found.source.metadata.get("model")) == "lambert"


def _alternatives(found: Pareto, chosen: Entry, limit: float | None) -> list[tuple[Entry, str]]:
    """Of each representation, what was right enough and smallest, or else the closest."""
    listed: list[tuple[Entry, str]] = []
    for name in dict.fromkeys((e.representation, e.kind == "model" and e.variant) for e in found.entries):
        same = [e for e in found.entries if (e.representation, e.kind == "model" and e.variant) == name]
        right = [e for e in same if e.meets(found.tolerance)]
        best = min(right, key=lambda e: e.nbytes) if right else min(same, key=lambda e: e.error)
        if best is chosen:
            continue
        if not right:
            why = "not right enough"
        elif limit is not None and best.ns.best > limit:
            why = "too slow"
        elif best.nbytes > chosen.nbytes:
            why = "larger"
        else:
            why = f"{best.ns.best / chosen.ns.best:.1f} x the time of a look-up"
        listed.append((best, why))
    return listed


def _numbers(e: Entry) -> dict[str, Any]:
    return {
        "representation": e.representation,
        "variant": e.variant,
        "nbytes": e.nbytes,
        "l1": e.comparison.l1 if math.isfinite(e.comparison.l1) else None,
        "l1_stderr": e.comparison.l1_stderr if math.isfinite(e.comparison.l1_stderr) else None,
        "error": e.error if math.isfinite(e.error) else None,
        "ns": e.ns.best,
        "ns_median": e.ns.median,
    }


def _degrees(given: Range) -> list[float]:
    return [round(math.degrees(given[0]), 9), round(min(math.degrees(given[1]), 90.0), 9)]


def _told(progress: Progress | None, name: str, k: int, count: int) -> Progress | None:
    if progress is None:
        return None

    def told(done: int, total: int, stage: str) -> None:
        progress(k * 100 + int(100 * done / max(total, 1)), 100 * count, f"{name}: {stage}"[:100])

    return told
