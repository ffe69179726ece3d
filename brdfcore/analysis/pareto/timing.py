"""How long a look-up takes: candidates interleaved round by round, so that drift of the machine hits all alike."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial

import numpy as np

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray
from brdfcore.base.directions import cosine_pairs

#: Look-ups of one call.
BATCHES = (1, 1_000, 1_000_000)
ROUNDS = 9
#: Rounds of what nothing is ranked by: small batches, and all threads.
_ROUNDS_BESIDE = 7
#: Rounds after which it is asked who need not be timed on.
_FIRST_ROUNDS = 4
#: What each candidate runs for in a round, at least, and each part of it that the clock is read for, seconds. Short
#: enough that on a busy machine some parts are not interrupted, and ten thousand times the clock's resolution.
_LEAST, _PART = 0.004, 0.0005
#: A call of the largest batch may take this long, seconds; slower candidates get a tenth or a hundredth of it. They
#: compute for most of their time, so that the time of a look-up does not depend on that.
_LONGEST_CALL = 0.02
#: Faster by less than this counts as the same: what two runs of one program differ by on a busy machine.
MARGIN = 1.25
#: The fastest rounds of one candidate in two runs of the program differ by up to this factor, however many rounds: the
#: memory lies elsewhere. A ratio this close to `MARGIN` may fall on its other side next time.
REPEATS = 1.1

Call = Callable[[], object]
Clock = Callable[[], float]
#: makes the call to time from the number of look-ups of a batch
Maker = Callable[[int], Call]


@dataclass(frozen=True)
class Timing:
    """ns a look-up of every round, each the best of its parts; on one thread in processor time (`_clock`)."""

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

    def faster_than(self, other: Timing, margin: float = MARGIN) -> bool:
        """Distinctly: by more than `margin` in the fastest round, and faster in two rounds of three."""
        both = min(len(self.rounds), len(other.rounds))  # one may have been timed longer than the other
        ratios = np.array(other.rounds[:both]) / np.array(self.rounds[:both])
        return bool(other.best > margin * self.best and (ratios > 1).mean() > 2 / 3)

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
    headline: bool = False,
    settled: Callable[[Mapping[str, Timing]], Collection[str]] | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> dict[str, dict[str, Timing]]:
    """{candidate: {label: `Timing`}} at every batch on one thread, and at the largest on all of them.

    `single` holds context managers that keep a candidate of another library on one thread. `headline`: only the
    largest batch on one thread, which entries are ranked by. `settled` is given its first rounds and names those whose
    rank no more rounds can change: they get no more. What nothing is ranked by takes half as many rounds, 7 at most.
    """
    from brdfcore.kernels.machine import launch

    plans = [(BATCHES[-1], 1)] + ([] if headline else [(batch, 1) for batch in BATCHES[:-1]])
    if launch.threads() > 1 and not headline:
        plans.append((BATCHES[-1], launch.threads()))
    found: dict[str, dict[str, Timing]] = {name: {} for name in makers}
    rest: Collection[str] = ()
    for k, (batch, threads) in enumerate(plans):
        if progress is not None:
            using = f" on {threads} threads" if threads > 1 else ""
            progress(k, len(plans), f"timing look-ups of {len(makers)} candidates, {batch} at a time{using}")
        ways: dict[str, Callable[[], float]] = {}
        for name, maker in makers.items():
            alone = (single or {}).get(name, nullcontext) if threads == 1 else nullcontext
            count = batch if batch < BATCHES[-1] else _affordable(maker)
            clock = _clock(threads, name in (single or {}))
            ways[name] = partial(_round, *_prepared(maker(count), alone, threads), count, alone, threads, clock)
        seconds: dict[str, list[float]] = {name: [] for name in ways}
        ranked = k == 0
        for done in range(rounds if ranked else min(rounds, max(3, rounds // 2), _ROUNDS_BESIDE)):
            if ranked and done == _FIRST_ROUNDS and settled is not None:
                rest = settled({name: _timing(each) for name, each in seconds.items()})
            for name, way in ways.items():
                if name not in rest or done < (_FIRST_ROUNDS if ranked else _FIRST_ROUNDS - 1):
                    seconds[name].append(way())
        for name, each in seconds.items():
            found[name][label(batch, threads)] = _timing(each)
    return found


def _timing(seconds: list[float]) -> Timing:
    return Timing(tuple(1e9 * s for s in seconds))


def look_up_maker(b: Brdf) -> Maker:
    """What `time_all` times: float32 look-ups of `b` into an array that exists."""

    def make(n: int) -> Call:
        angles = look_ups(n)
        out = np.empty((n, len(b.channels)), np.float32)
        return lambda: b.evaluate(*angles, out=out)

    return make


def look_ups(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The float32 angles that everybody is timed on, cosine-distributed."""
    theta_i, theta_o, delta_phi = (x.astype(np.float32) for x in cosine_pairs(n, 1))
    return theta_i, theta_o, delta_phi


def at_a_glance(b: Brdf) -> float:
    """About how many ns a look-up takes, on one thread: to decide what is worth building, not to quote."""
    maker = look_up_maker(b)
    count = _affordable(maker) // 10
    call, repeats = _prepared(maker(count), nullcontext, 1)
    return 1e9 * min(_round(call, repeats, count, nullcontext, 1, time.thread_time) for _ in range(3))


def _affordable(maker: Maker) -> int:
    """Look-ups of a call of the largest batch: all, a tenth or a hundredth of it."""
    call, repeats = _prepared(maker(BATCHES[1]), nullcontext, 1)
    once = _round(call, repeats, BATCHES[1], nullcontext, 1, time.thread_time)
    count = BATCHES[-1]
    while count > BATCHES[-1] // 100 and count * once > _LONGEST_CALL:
        count //= 10
    return count


def _prepared(call: Call, alone: Call, threads: int) -> tuple[Call, int]:
    """The call, warm, and how often to repeat it."""
    _round(call, 1, 1, alone, threads)  # compiles what is compiled
    once = _round(call, 1, 1, alone, threads)
    return call, max(1, int(_LEAST / max(once, 1e-7)))


def _clock(threads: int, own_thread: bool) -> Clock:
    """Seconds that count. On one thread those of the processor: a call of a million look-ups takes longer than a busy
    machine leaves a thread in peace, and every round would hold somebody else's work. `own_thread`: it works in a
    thread of another library."""
    if threads > 1:
        return time.perf_counter
    return time.process_time if own_thread else time.thread_time


def _round(call: Call, repeats: int, count: int, alone: Call, threads: int, clock: Clock = time.perf_counter) -> float:
    """Seconds a look-up, the best part of `repeats` calls of `count` look-ups."""
    from brdfcore.kernels.machine import launch

    with launch.one_thread() if threads == 1 else nullcontext(), alone():  # type: ignore[attr-defined]
        together = max(1, round(repeats * _PART / _LEAST))
        best = float("inf")
        for _ in range(-(-repeats // together)):
            start = clock()
            for _ in range(together):
                call()
            best = min(best, (clock() - start) / (together * count))
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
