"""Pictures: kept by ETag, drawn one at a time by a process of their own, and once for all who ask for the same one.

matplotlib is Python all through. In a thread of the service a picture takes ten times as long as alone, because the
thread gives the interpreter's lock to the event loop every millisecond, and all other requests wait for it as often.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from functools import partial

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from brdf_service.http.errors import BusyError
from brdf_service.library.lru import keep
from brdf_service.library.materials import Material
from brdf_service.work.pictures import Picture, draw
from brdf_service.work.subprocesses import Child, rebuilt
from cachetools import LRUCache

log = logging.getLogger("brdf.service")

#: Bytes of pictures that are kept: the start page shows the same ones to everybody.
KEPT_BYTES = 16 * 2**20
#: Pictures that may wait to be drawn; a start page shows 24. Each takes a twentieth of a second, a sphere a quarter.
WAITING = 256
#: Seconds that one picture may take; the largest takes about one.
PATIENCE = 60.0
_RETRY = 5


class Drawing:
    """All pictures of a service. Its coroutines belong to one event loop; `draw` and `stop` block, in any thread."""

    def __init__(self, *, apart: bool) -> None:
        """`apart`: in a process, which starts with the first picture; else in a thread."""
        self._kept: LRUCache[str, bytes] = LRUCache(KEPT_BYTES, getsizeof=len)
        self._making: dict[str, asyncio.Task[bytes]] = {}
        # matplotlib's font cache and lock are shared by all figures: two at once are no faster, and would take the
        # threads that evaluate needs
        self._one = CapacityLimiter(1)
        self._child: Child | None = None
        self._drawing = threading.Lock()
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
            waiting = len(self._making)
            if waiting >= WAITING:
                text = f"{waiting} pictures wait to be drawn already; try again later"
                raise BusyError("too_many_pictures", text, got=waiting, limit=WAITING, retry_after=_RETRY)
            task = self._making[etag] = asyncio.create_task(self._made(etag, make))
            # an error of which all who waited have gone away is no news for the log
            task.add_done_callback(lambda done: done.cancelled() or done.exception())
        # one who goes away does not take the picture from the others
        return await asyncio.shield(task)

    async def _made(self, etag: str, make: Callable[[], bytes]) -> bytes:
        try:
            made = await run_sync(make, limiter=self._one)
            keep(self._kept, etag, made)
            return made
        finally:
            del self._making[etag]

    def draw(self, material: Material, wanted: Picture) -> bytes:
        """The picture by the process; here, where there is none or the material's file has changed.

        Raises what `pictures.draw` raises, `BusyError` if the process ends or takes too long over it.
        """
        made = self._drawn_apart(material, wanted)
        return draw(material.brdf, wanted) if made is None else made

    def stop(self) -> None:
        """End the process, also in the middle of a picture; no other starts."""
        self._here.set()
        child = self._child
        if child is not None:
            child.kill()
        with self._drawing:  # who waited for it has noticed
            self._let_go()

    def _drawn_apart(self, material: Material, wanted: Picture) -> bytes | None:
        task = {"name": material.name, "file": material.file, "id": material.id, "picture": wanted}
        with self._drawing:
            for _ in range(2):  # it may have been killed since the last picture, which is no fault of this one
                child = self._running()
                if child is None:
                    return None
                with child.within(PATIENCE):
                    child.send(task)
                    head = child.hear()
                    body = child.read(head.get("bytes", 0)) if head else b""
                if head and len(body) == head.get("bytes", 0):
                    break
                self._let_go()
                log.warning("the process that draws ended over a %s", wanted.kind)
                if child.late:
                    raise _failed(f"drawing took more than {PATIENCE:.0f} s")
            else:
                raise _failed("the process that draws ended before the picture was done")
        if "problem" in head:
            raise rebuilt(head["problem"])
        if "failed" in head:
            raise RuntimeError("the picture could not be drawn; the traceback stands above")
        return None if "changed" in head else body

    def _running(self) -> Child | None:
        """The process, started if need be; None if pictures are drawn here."""
        if self._here.is_set() or (self._child is not None and self._child.process.poll() is not None):
            self._let_go()
        if self._child is None and not self._here.is_set():
            # one thread: the cores are for look-ups
            self._child = Child("drawing_process", NUMBA_NUM_THREADS="1", OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
            if self._here.is_set():  # stopped in between
                self._child.kill()
        return self._child

    def _let_go(self) -> None:
        if self._child is not None:
            self._child.close()
            self._child = None


def _failed(why: str) -> BusyError:
    return BusyError("drawing_failed", f"{why}; try again later", retry_after=_RETRY)
