"""Counters of the service, and their text for Prometheus. Routes are counted by template: names never become labels.

All of it is touched in the event loop only, so that nothing needs a lock.
"""

from __future__ import annotations

import os
import time
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

#: Upper bounds of the histogram's buckets, seconds.
BUCKETS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"})
#: The route of a request that no path took.
NO_ROUTE = "none"


@dataclass
class _Route:
    """What one route template has seen."""

    statuses: Counter[tuple[str, int]] = field(default_factory=Counter)
    buckets: list[int] = field(default_factory=lambda: [0] * (len(BUCKETS) + 1))
    seconds: float = 0.0
    sent: int = 0


class Metrics:
    """Counted since the process began."""

    def __init__(self) -> None:
        self.started = time.time()
        self.lookups = 0
        self.lookup_seconds = 0.0
        self.running = 0
        self._routes: dict[str, _Route] = {}

    def request(self, route: str, method: str, status: int, seconds: float, sent: int) -> None:
        """One request ended."""
        seen = self._routes.get(route)
        if seen is None:
            seen = self._routes[route] = _Route()
        seen.statuses[method if method in METHODS else "other", status] += 1
        seen.buckets[bisect_left(BUCKETS, seconds)] += 1
        seen.seconds += seconds
        seen.sent += sent

    def text(self, gauges: Mapping[str, tuple[str, float]], counters: Mapping[str, tuple[str, float]]) -> str:
        """Everything in the text format 0.0.4, with the caller's own name -> (help, value) beside."""
        lines = _block("brdf_requests_total", "counter", "requests by route template, method and status", self._count())
        lines += _block("brdf_request_seconds", "histogram", "time from request to answer", self._histogram())
        sent = ((f'_total{{route="{_escaped(r)}"}}', seen.sent) for r, seen in self._routes.items())
        lines += _block("brdf_response_bytes", "counter", "bytes of answers", sent, suffix="_total")
        own = {
            "brdf_lookups_total": ("points evaluated", self.lookups),
            "brdf_lookup_seconds_total": ("time spent evaluating", self.lookup_seconds),
            **counters,
        }
        for name, (about, value) in own.items():
            lines += _block(name, "counter", about, [("", value)])
        held = {
            "brdf_requests_running": ("requests being answered", self.running),
            "process_start_time_seconds": ("start of the process since the epoch", self.started),
            **gauges,
        }
        resident = resident_bytes()
        if resident is not None:
            held["process_resident_memory_bytes"] = ("memory of the process", resident)
        for name, (about, value) in held.items():
            lines += _block(name, "gauge", about, [("", value)])
        return "\n".join(lines) + "\n"

    def _count(self) -> Iterable[tuple[str, float]]:
        for route, seen in self._routes.items():
            for (method, status), count in sorted(seen.statuses.items()):
                yield f'{{route="{_escaped(route)}",method="{method}",status="{status}"}}', count

    def _histogram(self) -> Iterable[tuple[str, float]]:
        for route, seen in self._routes.items():
            label, total = f'route="{_escaped(route)}"', 0
            for bound, count in zip((*map(str, BUCKETS), "+Inf"), seen.buckets, strict=True):
                total += count
                yield f'_bucket{{{label},le="{bound}"}}', total
            yield f"_sum{{{label}}}", seen.seconds
            yield f"_count{{{label}}}", total


def resident_bytes() -> int | None:
    """Memory that the process holds, where the system says so in /proc."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return None


def _block(name: str, kind: str, about: str, samples: Iterable[tuple[str, float]], suffix: str = "") -> list[str]:
    head = [f"# HELP {name}{suffix} {about}", f"# TYPE {name}{suffix} {kind}"]
    return head + [f"{name}{label} {value!r}" for label, value in samples]


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
