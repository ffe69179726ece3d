"""What holds for all tests: one thread a worker in the plain run; its end tells what the compiler did."""

from __future__ import annotations

import logging
import os
from collections import Counter
from typing import Any

import pytest

#: Lines shown of the kernels that took longest.
_SHOWN = 12


class _Compiled(logging.Handler):
    """Processor seconds by kernel, as `brdfcore.kernels.machine.jit` logs them."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.seconds: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        if isinstance(record.args, tuple) and record.msg.startswith("compiled "):
            name, seconds = record.args
            self.seconds[str(name).rpartition("_")[0]] += float(str(seconds))


_here = _Compiled()
_workers: dict[str, dict[str, float]] = {}


def pytest_configure(config: pytest.Config) -> None:
    if config.option.markexpr == "not slow":
        # a core for each worker; the parallel versions, half of what the compiler would do, wait for the slow tier
        os.environ.setdefault("BRDF_THREADS", "1")
    log = logging.getLogger("brdfcore.kernels")
    log.setLevel(logging.DEBUG)
    log.addHandler(_here)
    log.propagate = False  # not into what a failing test shows


def pytest_sessionfinish(session: pytest.Session) -> None:
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["compiled"] = dict(_here.seconds)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    _workers[node.gateway.id] = getattr(node, "workeroutput", {}).get("compiled", {})


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Versions compiled for several types count as one; those of the tests' own processes are not seen."""
    total = Counter(_here.seconds)
    for seconds in _workers.values():
        total.update(seconds)
    if not total:
        return
    each = "".join(f", {name} {sum(seconds.values()):.0f} s" for name, seconds in sorted(_workers.items()))
    terminalreporter.section("kernels compiled", sep="-")
    terminalreporter.line(f"{len(total)} in {sum(total.values()):.0f} s of processor time{each}")
    slowest = total.most_common(_SHOWN)
    terminalreporter.line("slowest: " + ", ".join(f"{name} {seconds:.1f}" for name, seconds in slowest))
