"""Run work that releases the GIL over a long batch in blocks, on all cores: numpy's steps, or a kernel of much work a
point, whose parallel version would take the compiler three times as long. No numba.

numpy writes each intermediate result out whole: over millions of points every step waits for memory. In blocks the
intermediates stay in the cache, and as numpy releases the GIL inside a step, blocks also run beside each other.
Every numpy function used is elementwise, so the values don't depend on the division; tests hold it to the bit.

Threads live for one call: there is no pool that a fork could leave without its threads. As in `launch`, one batch at a
time is spread over the cores and whoever comes meanwhile runs on the calling thread; BRDF_THREADS=1 keeps all there.
"""

from __future__ import annotations

import contextvars
import os
import threading
from collections.abc import Callable

#: Points of a block: some fifteen float64 intermediates of it fill the second cache (measured: 2,048 to 16,384 are
#: within 10 %; 1,024 pays for the steps' own start, 131,072 for memory).
BLOCK = 8_192
#: Points from which a second thread pays.
PARALLEL_FROM = 4 * BLOCK
#: Beyond, threads wait for the GIL between steps.
_MOST_THREADS = 8

_busy = threading.Lock()
_serial_only = os.environ.get("BRDF_THREADS", "") == "1"


def threads() -> int:
    """Threads that a long batch is spread over: the cores this process may use, at most 8; 1 with BRDF_THREADS=1."""
    if _serial_only:
        return 1
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, _MOST_THREADS)


def run(work: Callable[[int, int], bool], n: int, block: int = BLOCK, parallel_from: int = PARALLEL_FROM) -> bool:
    """work(start, stop) over all blocks of range(n), until one returns False or raises; True if none did.

    Blocks run in any order and beside each other. Numpy's error state and other context variables of the caller hold
    in every thread.

    block          points of a block.
    parallel_from  points from which a second thread pays.
    """
    helpers = threads() - 1 if n >= parallel_from else 0
    if helpers < 1 or not _busy.acquire(blocking=False):
        return all(work(start, min(start + block, n)) for start in range(0, n, block))
    try:
        return _spread(work, n, block, helpers)
    finally:
        _busy.release()


def _spread(work: Callable[[int, int], bool], n: int, block: int, helpers: int) -> bool:
    starts = iter(range(0, n, block))
    taking = threading.Lock()
    failed: list[BaseException | None] = []

    def take() -> None:
        while not failed:
            with taking:
                start = next(starts, n)
            if start >= n:
                return
            try:
                if not work(start, min(start + block, n)):
                    failed.append(None)
            except BaseException as error:
                failed.append(error)

    workers = []
    for _ in range(helpers):
        worker = threading.Thread(target=contextvars.copy_context().run, args=(take,))
        try:
            worker.start()
        except RuntimeError:  # no more threads are to be had
            break
        workers.append(worker)
    take()
    for worker in workers:
        worker.join()
    for error in failed:
        if error is not None:
            raise error
    return not failed


def _after_fork_in_child() -> None:
    global _busy
    _busy = threading.Lock()  # the parent's may be held by a thread that does not exist here


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork_in_child)
