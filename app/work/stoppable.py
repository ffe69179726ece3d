"""Work that ends when nobody waits for it any more: in a thread of its own, which can be interrupted.

An exception is sent to the thread, which gets it between two steps of Python: a call of numpy or of a kernel is
finished first. Where that does not do, at the end of the process, the process ends regardless (`server.process`).
"""

from __future__ import annotations

import asyncio
import ctypes
import threading
from collections.abc import Callable
from typing import TypeVar

from anyio import CapacityLimiter
from starlette.requests import ClientDisconnect, Request

import brdfcore as bc

T = TypeVar("T")

#: Seconds between two looks whether the client is there.
_LOOK = 0.2


class StoppedError(SystemExit):
    """Nobody waits for this work: not an `Exception`, so that nobody takes it for a failure of the work; and a thread
    that it reaches at its very end ends in silence."""


async def run_stoppable(request: Request, work: Callable[[], T], seats: CapacityLimiter) -> T:
    """What `work` returns or raises; `seats` work at once. `ClientDisconnect`, and the work is stopped, once the client
    is gone; it keeps its seat until it has stopped."""
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[T] = loop.create_future()

    seated = [ended]

    def tell(result: T | None, error: BaseException | None) -> None:
        if seated:  # told twice where it was stopped while it told
            seats.release_on_behalf_of(seated.pop())
        if ended.done():
            return
        if error is None:
            ended.set_result(result)  # type: ignore[arg-type]  # what work returned
        else:
            ended.set_exception(ClientDisconnect() if isinstance(error, StoppedError) else error)

    def run() -> None:
        result, raised = None, None
        try:
            result = work()
        except BaseException as error:
            raised = error
        try:
            loop.call_soon_threadsafe(tell, result, raised)
        except (RuntimeError, StoppedError):  # the loop is closed; or it was stopped a moment too late
            loop.is_closed() or loop.call_soon_threadsafe(tell, None, ClientDisconnect())

    await seats.acquire_on_behalf_of(ended)
    thread = threading.Thread(target=run, name="analysis", daemon=True)
    thread.start()
    try:
        while not ended.done():
            await asyncio.wait((ended,), timeout=_LOOK)
            if not ended.done() and await request.is_disconnected():
                raise ClientDisconnect
        return ended.result()
    except BaseException:
        if thread.is_alive() and not ended.done():
            ended.cancel()
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(thread.ident or 0), ctypes.py_object(StoppedError)
            )
        raise


def check_seconds(seconds: float, channels: int, limit: float, hint: str) -> None:
    """`LimitError` if work on so many channels would take longer, by an estimate, than the service allows."""
    if seconds > limit:
        text = f"about {seconds:.0f} s of work for {channels} channels; the limit is {limit:g} s; {hint}"
        raise bc.LimitError(
            "too_much_work", text, where="channels", got=channels, limit=int(limit * channels / seconds)
        )
