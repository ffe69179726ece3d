"""Every analytic model against mpmath where formulas fail: `python -m tests.benchmarks.hard_cases [--quick]`.

Sharp and broad lobes (m = 1 to 1e-6), directions at and beside the mirror direction, retro-reflection, the pole and the
horizon, weak and absorbing interfaces, with and without a diffuse part. The reference is the textbook formula at 60
digits (`tests.support.oracle`) on exactly the floats that the model reads, from angles and from vectors separately.

Printed for each model and option, the largest error by each goal, and where it was met:
- float64: of |f| where |f| >= 1e-290; where phong and oren_nayar cross 0, of max(|f|, 1e-3 peak). Goal 1e-12.
- float32 in and out, float64 inside: where 1e-30 <= |f| <= 1e38, goal 1e-6; outside, 0 or infinity correctly rounded.
- the fast tier, where a model has one: of max(|f|, 1e-6 peak), the peak that of the model for that theta_i. Goal 2e-5.
NaN, negative values and infinities that are not the rounded value are counted; none is the goal.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import mpmath as mp
import numpy as np

from tests.benchmarks import hard_grid
from tests.benchmarks.hard_grid import Case

GOALS = {"float64": 1e-12, "float32": 1e-6, "fast": 2e-5}
ENTRY_POINTS = ("angles", "vectors")
FLOAT32_MAX, FLOAT32_TINY = 3.4028236e38, 7.0e-46  # beyond, and below half the smallest, rounding gives inf and 0


@dataclass
class Found:
    """What one model and option came to, over all roughnesses, materials and diffuse parts."""

    label: str
    cases: int = 0
    worst: dict[str, tuple[float, str]] = field(default_factory=dict)  # "float64 angles" -> error and inputs
    nan: int = 0
    negative: int = 0
    infinite: int = 0
    wrongly_rounded: int = 0
    outside: int = 0

    def note(self, key: str, error: float, inputs: str) -> None:
        if key not in self.worst or error > self.worst[key][0]:
            self.worst[key] = (error, inputs)

    def merge(self, other: Found) -> None:
        for key, (error, inputs) in other.worst.items():
            self.note(key, error, inputs)
        for name in ("cases", "nan", "negative", "infinite", "wrongly_rounded", "outside"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def missed(self) -> list[str]:
        """Goals not met, in words."""
        lost = [f"{key} {error:.2g}" for key, (error, _) in self.worst.items() if not error <= GOALS[key.split()[0]]]
        counted = {"NaN": self.nan, "negative": self.negative, "infinite": self.infinite}
        counted["wrongly rounded"] = self.wrongly_rounded
        return lost + [f"{count} {name}" for name, count in counted.items() if count]


def run(models: list[str], roughness: float, entry: str, dtype: str, stride: int) -> list[Found]:
    """All options of some models at one roughness, through one entry point with inputs of one dtype."""
    inputs = hard_grid.inputs(roughness, entry, dtype, stride)
    cases = [case for name in models for case in hard_grid.cases(name, roughness, entry)]
    tiers = [(case, tier) for case in cases for tier in case.tiers(dtype)]
    got = [evaluate(case.model(tier), entry, inputs.arrays) for case, tier in tiers]
    wanted: dict[int, list[Any]] = {id(case): [] for case in cases}
    for directions in inputs.directions:  # pairs outermost: the parts of a pair's value are worked out once
        parts = hard_grid.Parts(*directions, roughness)
        for case in cases:
            wanted[id(case)].append(case.want(parts))
    found: dict[str, Found] = {}
    for (case, tier), values in zip(tiers, got, strict=True):
        one = found.setdefault(case.label, Found(case.label))
        measure(one, case, tier, values, wanted[id(case)], inputs)
    return list(found.values())


def evaluate(model: Any, entry: str, arrays: tuple[np.ndarray, ...]) -> np.ndarray:
    with np.errstate(all="ignore"):
        values = model.evaluate(*arrays) if entry == "angles" else model.evaluate_vectors(*arrays)
    return np.asarray(values[:, 0])


def measure(
    one: Found,
    case: Case,
    tier: str,
    values: np.ndarray,
    wanted: list[Any],
    inputs: hard_grid.Inputs,
) -> None:
    """Compare one tier's values of one case with the reference, and note what was found in `one`."""
    entry, dtype = inputs.entry, inputs.arrays[0].dtype.name
    want = np.array([float(w) for w in wanted])
    off = np.array([float(abs(mp.mpf(float(v)) - w)) if np.isfinite(v) else np.inf for v, w in zip(values, wanted)])
    floor = case.floor(inputs)
    if dtype == "float64":
        goal, scale = "float64", np.maximum(want, floor)
        usable = scale >= 1e-290
    elif tier == "exact":
        goal, scale = "float32", np.maximum(want, floor)
        usable = (scale >= 1e-30) & (want <= 1e38)
        rounded = np.where(want > FLOAT32_MAX, np.inf, 0.0)
        settled = (want > FLOAT32_MAX) | (want < FLOAT32_TINY) & ~usable
        one.outside += int((~usable).sum())
        one.wrongly_rounded += int((settled & (values != rounded)).sum())
    else:
        goal, usable = "fast", want <= 1e38
        scale = np.maximum(want, 1e-6 * hard_grid.peaks(case, inputs, want))
    one.cases += want.size
    one.nan += int(np.isnan(values).sum())
    one.negative += int((values < 0).sum())
    one.infinite += int((np.isinf(values) & ((dtype == "float64") | (want <= FLOAT32_MAX))).sum())
    usable = usable & (scale > 0)
    error = np.divide(off, scale, out=np.zeros_like(off), where=usable)
    if dtype == "float64":
        error[~usable & (values > 1.1e-290)] = np.inf  # has to be as small as the reference
    k = int(error.argmax())
    one.note(f"{goal} {entry}", float(error[k]), f"{case.describe()} at {inputs.describe(k)}, f = {want[k]:.3g}")


def work(task: tuple[list[str], float, str, str, int]) -> list[Found]:
    return run(*task)


def everything(models: list[str], stride: int, jobs: int) -> list[Found]:
    """Every option of `models`, in the order of the registry."""
    tasks = [
        ([name], m, entry, dtype, stride)
        for m in hard_grid.ROUGHNESS
        for dtype in ("float64", "float32")
        for entry in ENTRY_POINTS
        for name in sorted(models, key=lambda n: n != "cook_torrance")  # the longest first
    ]
    tasks.sort(key=lambda task: task[0] != ["cook_torrance"])
    found: dict[str, Found] = {}
    if jobs == 1:
        parts = [work(task) for task in tasks]
    else:
        with multiprocessing.get_context("spawn").Pool(jobs) as pool:
            parts = pool.map(work, tasks, chunksize=1)
    for part in parts:
        for one in part:
            found.setdefault(one.label, Found(one.label)).merge(one)
    return sorted(found.values(), key=lambda f: models.index(f.label.split()[0]))


def report(found: list[Found]) -> str:
    keys = [f"{goal} {entry}" for goal in GOALS for entry in ENTRY_POINTS]
    keys = [k for k in keys if any(k in f.worst for f in found)]
    width = max(len(f.label) for f in found)
    lines = ["largest error by each goal: " + ", ".join(f"{goal} {limit:g}" for goal, limit in GOALS.items()), ""]
    header = f"{'model and option':{width}}  {'cases':>7}" + "".join(f"  {k:>15}" for k in keys)
    lines += [header + "  NaN  negative  infinite  rounded wrongly/outside range", "-" * len(header)]
    for f in found:
        errors = "".join(f"  {f.worst[k][0]:15.2g}" if k in f.worst else f"  {'-':>15}" for k in keys)
        counts = f"  {f.nan:3d}  {f.negative:8d}  {f.infinite:8d}  {f.wrongly_rounded}/{f.outside}"
        lines.append(f"{f.label:{width}}  {f.cases:7d}{errors}{counts}")
    lines += ["", "where the largest errors are"]
    for f in found:
        lines += [f"{f.label}: {key} {error:.2g}: {inputs}" for key, (error, inputs) in f.worst.items()]
    missed = [f"{f.label}: {', '.join(f.missed())}" for f in found if f.missed()]
    lines += ["", "goals missed:" if missed else "every goal is met", *missed]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Analytic models against mpmath in hard cases.")
    parser.add_argument("--quick", action="store_true", help="one pair of directions in sixteen, under a minute")
    parser.add_argument("--model", action="append", choices=hard_grid.MODELS, help="only this model (repeatable)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    chosen = parser.parse_args(arguments)
    start = time.perf_counter()
    found = everything(chosen.model or list(hard_grid.MODELS), 16 if chosen.quick else 1, chosen.jobs)
    print(report(found))
    print(f"{sum(f.cases for f in found)} cases in {time.perf_counter() - start:.0f} s")
    return 1 if any(f.missed() for f in found) else 0


if __name__ == "__main__":
    sys.exit(main())
