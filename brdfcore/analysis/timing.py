"""How long a look-up takes: candidates interleaved round by round, so that drift of the machine hits all alike."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial

import numpy as np

#: Look-ups of one call.
BATCHES = (1, 1_000, 1_000_000)
ROUNDS = 15
#: What each candidate runs for in a round, at least, and each part of it that the clock is read for, seconds. Short
#: enough that on a busy machine some parts are not interrupted, and ten thousand times the clock's resolution.
_LEAST, _PART = 0.004, 0.0005
#: A candidate whose look-ups take longer than this, ns, is timed on a tenth of the largest batch; the time a look-up
#: does not depend on that.
_SLOW = 300.0
#: Faster by less than this counts as the same: what two runs of one program differ by on a busy machine.
MARGIN = 1.25

Call = Callable[[], object]
#: makes the call to time from the number of look-ups of a batch
Maker = Callable[[int], Call]


@dataclass(frozen=True)
class Timing:
    """ns a look-up of every round, each the best of its parts."""

    rounds: tuple[float, ...]

    @property
    def median(self) -> float:
        return float(np.median(self.rounds))

    @property
    def best(self) -> float:
        """The fastest round: what else runs on the machine only ever makes it slower."""
        return min(self.rounds)

    @property
    def high(self) -> float:
        return max(self.rounds)

    def faster_than(self, other: Timing) -> bool:
        """Distinctly: by more than `MARGIN` in the fastest round, and faster in two rounds of three."""
        ratios = np.array(other.rounds) / np.array(self.rounds)
        return bool(other.best > MARGIN * self.best and (ratios > 1).mean() > 2 / 3)

    def to_json(self) -> dict[str, float]:
        return {"best": self.best, "median": self.median, "high": self.high}


def label(batch: int, threads: int) -> str:
    """Key of a timing: "1", "1000", "1000000", and "1000000x2" with so many threads."""
    return str(batch) if threads == 1 else f"{batch}x{threads}"


def time_all(
    makers: Mapping[str, Maker],
    *,
    rounds: int = ROUNDS,
    single: Mapping[str, Callable[[], object]] | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> dict[str, dict[str, Timing]]:
    """{candidate: {label: `Timing`}} at every batch on one thread, and at the largest on all of them.

    `single` holds context managers that keep a candidate of another library on one thread.
    """
    from brdfcore.kernels import launch

    plans = [(batch, 1) for batch in BATCHES]
    if launch.threads() > 1:
        plans.append((BATCHES[-1], launch.threads()))
    found: dict[str, dict[str, Timing]] = {name: {} for name in makers}
    for k, (batch, threads) in enumerate(plans):
        if progress is not None:
            progress(k, len(plans), f"timing look-ups, {batch} at a time")
        ways: dict[str, Callable[[], float]] = {}
        for name, maker in makers.items():
            alone = (single or {}).get(name, nullcontext) if threads == 1 else nullcontext
            before = found[name].get(label(BATCHES[1], 1))
            count = batch // 10 if batch == BATCHES[-1] and before is not None and before.best > _SLOW else batch
            ways[name] = partial(_round, *_prepared(maker(count), alone, threads), count, alone, threads)
        seconds: dict[str, list[float]] = {name: [] for name in ways}
        for _ in range(rounds):
            for name, way in ways.items():
                seconds[name].append(way())
        for name, each in seconds.items():
            found[name][label(batch, threads)] = Timing(tuple(1e9 * s for s in each))
    return found


def _prepared(call: Call, alone: Call, threads: int) -> tuple[Call, int]:
    """The call, warm, and how often to repeat it."""
    _round(call, 1, 1, alone, threads)  # compiles what is compiled
    once = _round(call, 1, 1, alone, threads)
    return call, max(1, int(_LEAST / max(once, 1e-7)))


def _round(call: Call, repeats: int, count: int, alone: Call, threads: int) -> float:
    """Seconds a look-up, the best part of `repeats` calls of `count` look-ups."""
    from brdfcore.kernels import launch

    with launch.one_thread() if threads == 1 else nullcontext(), alone():  # type: ignore[attr-defined]
        together = max(1, round(repeats * _PART / _LEAST))
        best = float("inf")
        for _ in range(-(-repeats // together)):
            start = time.perf_counter()
            for _ in range(together):
                call()
            best = min(best, (time.perf_counter() - start) / (together * count))
        return best


def machine() -> str:
    """What the times were measured on."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            name = next(line.split(":", 1)[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{name}, {os.cpu_count()} cores"


def versions() -> dict[str, str]:
    """Python, this package and the libraries that answers or times depend on."""
    from importlib.metadata import PackageNotFoundError, version

    from brdfcore.version import __version__

    found = {"brdf-tables": __version__, "python": platform.python_version()}
    for name in ("numpy", "numba", "scipy", "h5py", "interpn", "mitsuba", "flip-evaluator"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
