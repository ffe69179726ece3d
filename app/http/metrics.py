"""Counters of the service, and their text for Prometheus. Routes are counted by template: names never become labels."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import accumulate

from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector

#: Upper bounds of the histogram's buckets, seconds.
BUCKETS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"})
#: The route of a request that no path took.
NO_ROUTE = "none"


class _Route:
    """What was counted of one route."""

    def __init__(self) -> None:
        self.answers: Counter[tuple[str, int]] = Counter()  # by method and status
        self.buckets = [0] * (len(BUCKETS) + 1)
        self.seconds, self.sent = 0.0, 0


class Metrics(Collector):
    """Counted since the process began, in the event loop only: no lock, and plain numbers, as a counter with labels and
    a lock of its own costs a tenth of a look-up."""

    def __init__(self) -> None:
        self.lookups = self.running = 0
        self.lookup_seconds = 0.0
        self._routes: dict[str, _Route] = {}
        self._others: list[Metric] = []
        self._registry = CollectorRegistry()
        ProcessCollector(registry=self._registry)
        self._registry.register(self)

    def request(self, route: str, method: str, status: int, seconds: float, sent: int) -> None:
        """One request ended."""
        found = self._routes.get(route)
        if found is None:
            found = self._routes[route] = _Route()
        found.answers[method if method in METHODS else "other", status] += 1
        found.buckets[bisect_left(BUCKETS, seconds)] += 1
        found.seconds += seconds
        found.sent += sent

    def text(self, gauges: Mapping[str, tuple[str, float]], counters: Mapping[str, tuple[str, float]]) -> str:
        """Everything in the text format 0.0.4, with the caller's own name -> (help, value) beside."""
        held = {"brdf_requests_running": ("requests being answered", self.running), **gauges}
        counted = {
            "brdf_lookups_total": ("points evaluated", self.lookups),
            "brdf_lookup_seconds_total": ("time spent evaluating", self.lookup_seconds),
            **counters,
        }
        self._others = [GaugeMetricFamily(name, about, value) for name, (about, value) in held.items()]
        self._others += [CounterMetricFamily(name, about, value) for name, (about, value) in counted.items()]
        return generate_latest(self._registry).decode()

    def collect(self) -> Iterable[Metric]:
        requests = CounterMetricFamily(
            "brdf_requests", "requests by route template", None, ("route", "method", "status")
        )
        spent = HistogramMetricFamily("brdf_request_seconds", "time from request to answer", None, None, ("route",))
        sent = CounterMetricFamily("brdf_response_bytes", "bytes of answers", None, ("route",))
        bounds = [*map(str, BUCKETS), "+Inf"]
        for route, found in self._routes.items():
            for (method, status), count in found.answers.items():
                requests.add_metric((route, method, str(status)), count)
            spent.add_metric((route,), [*zip(bounds, accumulate(found.buckets), strict=True)], found.seconds)
            sent.add_metric((route,), found.sent)
        return [requests, spent, sent, *self._others]
