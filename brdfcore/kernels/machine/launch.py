"""Decide where a kernel runs: on the calling thread, or on all cores.

Rules, each from a measured failure:
- Two Python threads inside parallel kernels at once abort the process on numba's workqueue layer, and
  over-subscribe the others: one process-wide lock, and whoever does not get it at once runs the serial
  version, which gives the same bits and releases the GIL.
- A forked child of a process that has launched OpenMP threads hangs or dies at its first parallel region:
  after a fork the child stays serial. Start processes with the spawn method to have all cores.
- Waking the threads costs some 20 microseconds: small batches run on the calling thread.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from brdfcore.kernels.machine import blocks

#: Elements from which the parallel version wins, measured on 2 cores (break-even near 6,000 for a plain table).
PARALLEL_FROM = 8_192


class Versions(Protocol):
    """One loop compiled twice, `jit.Kernel`: for the calling thread, and for all cores."""

    serial: Any
    parallel: Any


_lock = threading.Lock()
_launched = False
_serial_only = os.environ.get("BRDF_THREADS", "") == "1"


def threads() -> int:
    """Threads a parallel kernel uses: numba's setting (NUMBA_NUM_THREADS), 1 after a fork or with BRDF_THREADS=1."""
    if _serial_only:
        return 1
    import numba

    return int(numba.get_num_threads())


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep every look-up of this process on its calling thread, to time it there. Not for use by several threads."""
    global _serial_only
    before = _serial_only, blocks._serial_only
    _serial_only = blocks._serial_only = True
    try:
        yield
    finally:
        _serial_only, blocks._serial_only = before


def run(kernel: Versions, n: int, args: tuple[Any, ...]) -> Any:
    """Run `kernel` over n elements, on all cores if that pays and nobody else is doing so."""
    global _launched
    if n < PARALLEL_FROM or _serial_only or not _lock.acquire(blocking=False):
        return kernel.serial(*args)
    try:
        if threads() == 1:
            return kernel.serial(*args)
        _launched = True
        return kernel.parallel(*args)
    finally:
        _lock.release()


def _after_fork_in_child() -> None:
    global _lock, _serial_only
    _lock = threading.Lock()  # the parent's may be held by a thread that does not exist here
    if _launched:
        _serial_only = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork_in_child)
