"""Interleaved timing: every candidate in turn, several rounds, so that drift of the machine hits all alike."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np


class Spread(NamedTuple):
    """Seconds: smallest, median and largest of the rounds, and every round."""

    low: float
    median: float
    high: float
    rounds: list[float]


def interleaved(candidates: Mapping[str, Callable[[], object]], *, rounds: int = 7) -> dict[str, Spread]:
    """Time each candidate once a round, in turn, after one uncounted warm-up each."""
    for run in candidates.values():
        run()
    seconds: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, run in candidates.items():
            start = time.perf_counter()
            run()
            seconds[name].append(time.perf_counter() - start)
    return {n: Spread(min(s), float(np.median(s)), max(s), s) for n, s in seconds.items()}


def ratio(slower: Spread, faster: Spread) -> tuple[float, float, float]:
    """How many times faster, round by round: smallest, median, largest of the ratios."""
    each = np.array(slower.rounds) / np.array(faster.rounds)
    return float(each.min()), float(np.median(each)), float(each.max())


def per_call(run: Callable[[], object], *, seconds: float = 0.2) -> float:
    """Median seconds a call over batches that fill about `seconds` each."""
    start = time.perf_counter()
    run()
    count = max(1, int(seconds / 5 / max(time.perf_counter() - start, 1e-7)))
    batches = []
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(count):
            run()
        batches.append((time.perf_counter() - start) / count)
    return float(np.median(batches))


def machine() -> str:
    """What the numbers were measured on."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            name = next(line.split(":", 1)[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}, numpy {np.__version__}"
