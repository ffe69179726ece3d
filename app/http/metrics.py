"""Counters of the service, and their text for Prometheus. Routes are counted by template: names never become labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from prometheus_client import CollectorRegistry, Counter, Histogram, ProcessCollector, disable_created_metrics
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector

#: Upper bounds of the histogram's buckets, seconds.
BUCKETS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"})
#: The route of a request that no path took.
NO_ROUTE = "none"

disable_created_metrics()  # type: ignore[no-untyped-call]  # a second series beside each


class Metrics:
    """Counted since the process began. What has no lock of its own is touched in the event loop only."""

    def __init__(self) -> None:
        self.lookups = self.running = 0
        self.lookup_seconds = 0.0
        self._registry = registry = CollectorRegistry()
        ProcessCollector(registry=registry)
        labels = ("route", "method", "status")
        self._requests = Counter("brdf_requests", "requests by route template", labels, registry=registry)
        self._seconds = Histogram(
            "brdf_request_seconds", "time from request to answer", ("route",), buckets=BUCKETS, registry=registry
        )
        self._sent = Counter("brdf_response_bytes", "bytes of answers", ("route",), registry=registry)
        # to look children up by their labels takes longer than to count
        self._children: dict[tuple[str, str, int], tuple[Counter, Histogram, Counter]] = {}

    def request(self, route: str, method: str, status: int, seconds: float, sent: int) -> None:
        """One request ended."""
        key = (route, method if method in METHODS else "other", status)
        found = self._children.get(key)
        if found is None:
            found = self._requests.labels(*key), self._seconds.labels(route), self._sent.labels(route)
            self._children[key] = found
        requests, duration, size = found
        requests.inc()
        duration.observe(seconds)
        size.inc(sent)

    def text(self, gauges: Mapping[str, tuple[str, float]], counters: Mapping[str, tuple[str, float]]) -> str:
        """Everything in the text format 0.0.4, with the caller's own name -> (help, value) beside."""
        held = {"brdf_requests_running": ("requests being answered", self.running), **gauges}
        counted = {
            "brdf_lookups_total": ("points evaluated", self.lookups),
            "brdf_lookup_seconds_total": ("time spent evaluating", self.lookup_seconds),
            **counters,
        }
        own: list[Metric] = [GaugeMetricFamily(name, about, value) for name, (about, value) in held.items()]
        own += [CounterMetricFamily(name, about, value) for name, (about, value) in counted.items()]
        return (generate_latest(self._registry) + generate_latest(_Once(own))).decode()


class _Once(Collector):
    def __init__(self, families: Iterable[Metric]) -> None:
        self._families = families

    def collect(self) -> Iterable[Metric]:
        return self._families
