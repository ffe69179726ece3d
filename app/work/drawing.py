"""Pictures: kept by ETag, drawn by processes of their own, and once for all who ask for the same one.

matplotlib is Python all through. In a thread of the service a picture takes ten times as long as alone, because the
thread gives the interpreter's lock to the event loop every millisecond, and all other requests wait for it as often.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from queue import LifoQueue

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from brdf_service.http.errors import BusyError
from brdf_service.library.materials import Material
from brdf_service.work.pictures import Picture, draw
from brdf_service.work.subprocesses import Child, rebuilt
from cachetools import LRUCache

log = logging.getLogger("brdf.service")

#: Bytes of pictures that are kept: the start page shows the same ones to everybody.
KEPT_BYTES = 16 * 2**20
#: Seconds that a picture takes, before any was drawn: a twentieth, a sphere a quarter. A start page shows 24.
FIRST_SECONDS = 0.08
#: Weight of the last picture in the mean of their times.
_WEIGHT = 0.1
#: Seconds for which a caller waits: then the picture is still to be drawn, or it is drawn for who asks again.
LONGEST_WAIT = 2.5
#: Seconds that one picture may take; the largest takes about one.
PATIENCE = 20.0
#: Processes: one for every two cores, as look-ups go first.
PROCESSES = max(1, min(4, (os.cpu_count() or 1) // 2))
_RETRY = 3


class _Worker:
    """A process that draws, once one was started; it belongs to whoever took it from those that are free."""

    child: Child | None = None


class Drawing:
    """All pictures of a service. Its coroutines belong to one event loop; `draw` and `stop` block, in any thread."""

    def __init__(self, *, apart: bool) -> None:
        """`apart`: in processes, which start with the first pictures; else in a thread."""
        self._kept: LRUCache[str, bytes] = LRUCache(KEPT_BYTES, getsizeof=len)
        self._making: dict[str, asyncio.Task[bytes]] = {}
        #: In a thread, where nothing is measured or served in earnest, there is time.
        self._wait = LONGEST_WAIT if apart else PATIENCE
        #: Mean of the seconds that pictures take.
        self._seconds = FIRST_SECONDS
        # matplotlib's font cache and lock are shared by all figures of a process: two at once are no faster, and would
        # take the threads that evaluate needs
        self._workers = [_Worker() for _ in range(PROCESSES if apart else 1)]
        self._seats = CapacityLimiter(len(self._workers))
        self._free: LifoQueue[_Worker] = LifoQueue()
        for worker in reversed(self._workers):
            self._free.put(worker)
        self._here = threading.Event()
        if not apart:
            self._here.set()

    def __contains__(self, etag: str) -> bool:
        return etag in self._kept

    async def picture(self, etag: str, material: Material, wanted: Picture) -> bytes:
        """The picture of that ETag. Raises as `draw` and `made`."""
        return await self.made(etag, partial(self.draw, material, wanted))

    async def made(self, etag: str, make: Callable[[], bytes]) -> bytes:
        """What is kept under that ETag, is being made already, or `make` returns (called in a thread).

        Raises what `make` raises, `BusyError` if too many wait.
        """
        held = self._kept.get(etag)
        if held is not None:
            return held
        task = self._making.get(etag)
        if task is None:
            # whoever would wait in vain is refused at once: a picture that comes too late is drawn for nobody
            waiting, most = len(self._making), int(self._wait * len(self._workers) / self._seconds)
            if waiting >= max(most, 1):
                text = f"{waiting} pictures wait to be drawn already; try again later"
                raise BusyError("too_many_pictures", text, got=waiting, limit=most, retry_after=_RETRY)
            task = self._making[etag] = asyncio.create_task(self._made(etag, make))
            # an error of which all who waited have gone away is no news for the log
            task.add_done_callback(lambda done: done.cancelled() or done.exception())
        try:
            # one who goes away does not take the picture from the others
            return await asyncio.wait_for(asyncio.shield(task), self._wait)
        except TimeoutError:
            text = f"the picture is not drawn after {self._wait:g} s, as others are; ask again"
            raise BusyError("drawing_busy", text, retry_after=_RETRY) from None

    async def _made(self, etag: str, make: Callable[[], bytes]) -> bytes:
        try:
            async with asyncio.timeout(self._wait):  # nobody waits any longer for its turn
                await self._seats.acquire_on_behalf_of(etag)
            try:
                begun = time.monotonic()
                made = await run_sync(make)
                self._seconds += _WEIGHT * (time.monotonic() - begun - self._seconds)
            finally:
                self._seats.release_on_behalf_of(etag)
            with contextlib.suppress(ValueError):  # larger than all that is kept
                self._kept[etag] = made
            return made
        finally:
            del self._making[etag]

    def draw(self, material: Material, wanted: Picture) -> bytes:
        """The picture by the process; here, where there is none or the material's file has changed.

        Raises what `pictures.draw` raises, `BusyError` if the process ends or takes too long over it.
        """
        made = self._drawn_apart(material, wanted)
        return draw(material.brdf, wanted) if made is None else made

    def kill(self) -> None:
        """End the processes at once, also in the middle of a picture; no other starts."""
        self._here.set()
        for worker in self._workers:
            if worker.child is not None:
                worker.child.kill()

    def stop(self) -> None:
        """As `kill`, and wait for their end."""
        self.kill()
        for worker in [self._free.get() for _ in self._workers]:  # who waited for them has noticed
            _let_go(worker)
            self._free.put(worker)

    def _drawn_apart(self, material: Material, wanted: Picture) -> bytes | None:
        task = {"name": material.name, "file": material.file, "id": material.id, "picture": wanted}
        worker = self._free.get()
        try:
            for _ in range(2):  # it may have been killed since the last picture, which is no fault of this one
                child = self._running(worker)
                if child is None:
                    return None
                with child.within(PATIENCE):
                    child.send(task)
                    head = child.hear()
                    body = child.read(head.get("bytes", 0)) if head else b""
                if head and len(body) == head.get("bytes", 0):
                    break
                _let_go(worker)
                log.warning("the process that draws ended over a %s", wanted.kind)
                if child.late:
                    raise _failed(f"drawing took more than {PATIENCE:.0f} s")
            else:
                raise _failed("the process that draws ended before the picture was done")
        finally:
            self._free.put(worker)
        if "problem" in head:
            raise rebuilt(head["problem"])
        if "failed" in head:
            raise RuntimeError("the picture could not be drawn; the traceback stands above")
        return None if "changed" in head else body

    def _running(self, worker: _Worker) -> Child | None:
        """Its process, started if need be; None if pictures are drawn here."""
        if self._here.is_set() or (worker.child is not None and worker.child.process.poll() is not None):
            _let_go(worker)
        if worker.child is None and not self._here.is_set():
            # one thread: the cores are for look-ups
            worker.child = Child(
                "drawing_process", NUMBA_NUM_THREADS="1", OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1"
            )
            if self._here.is_set():  # stopped in between
                worker.child.kill()
        return worker.child


def _let_go(worker: _Worker) -> None:
    if worker.child is not None:
        worker.child.close()
        worker.child = None


def _failed(why: str) -> BusyError:
    return BusyError("drawing_failed", f"{why}; try again later", retry_after=_RETRY)
