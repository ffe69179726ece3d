"""A service that rows of `faults` attack, and how each says what it found."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2

from tests.app.running import Running

missed: list[str] = []


def said(row: str, what: str, good: bool) -> None:
    """One figure."""
    print(f"{row:8s} {'ok    ' if good else 'MISSED'} {what}", flush=True)
    if not good:
        missed.append(row)


def white(value: float) -> dict[str, Any]:
    return {"model": "lambert", "parameters": {"reflectance": value}}


@contextlib.contextmanager
def service(data: Path, *arguments: str) -> Iterator[Running]:
    running = Running(data, "--no-starter", "--log-level", "warning", *arguments)
    try:
        yield running
    finally:
        running.process.kill()
        running.process.wait()


def client(running: Running, seconds: float = 60) -> httpx2.Client:
    return httpx2.Client(base_url=f"http://127.0.0.1:{running.port}", timeout=seconds, trust_env=False)


def wait_ready(http: httpx2.Client) -> None:
    until = time.monotonic() + 300
    while http.get("/health/ready").status_code != 200 and time.monotonic() < until:
        time.sleep(0.2)


def leftovers(data: Path) -> list[str]:
    return [p.name for p in data.iterdir() if p.name.startswith(".") and p.name not in (".lock", ".jobs")]


def percentile(times: list[float], share: float) -> float:
    return sorted(times)[min(len(times) - 1, int(share * len(times)))]


def resident(pid: int) -> float:
    """Megabytes that a process holds."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
