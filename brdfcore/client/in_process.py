"""An ASGI application in this process behind both clients: the same requests and answers, without a socket.

The application's lifespan is run: it starts with the first request and ends when the client is closed.
"""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import Future
from typing import Any

import httpx2

from brdfcore.client.errors import ServiceError

#: The address that an application in this process sees itself at.
URL = "http://127.0.0.1"


class Lifespan:
    """Startup and shutdown of an application, in one task of the running loop, as the ASGI specification wants it."""

    def __init__(self, app: Any) -> None:
        self._app = app
        self._task: asyncio.Task[None] | None = None
        self._to_app: asyncio.Queue[str] = asyncio.Queue()
        self._said: asyncio.Queue[dict[str, Any]] = asyncio.Queue()

    async def start(self) -> None:
        """Run the startup once; an application without a lifespan is fine. Raises `ServiceError` if it fails."""
        if self._task is None:
            self._task = asyncio.create_task(self._run())
            await self._step("lifespan.startup")

    async def stop(self) -> None:
        """Run the shutdown, if it was started."""
        if self._task is not None:
            await self._step("lifespan.shutdown")
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None

    async def _run(self) -> None:
        async def receive() -> dict[str, Any]:
            return {"type": await self._to_app.get()}

        async def send(message: dict[str, Any]) -> None:
            await self._said.put(message)

        await self._app({"type": "lifespan", "asgi": {"version": "3.0"}, "state": {}}, receive, send)

    async def _step(self, kind: str) -> None:
        assert self._task is not None
        await self._to_app.put(kind)
        waiting = asyncio.create_task(self._said.get())
        await asyncio.wait({waiting, self._task}, return_when=asyncio.FIRST_COMPLETED)
        if not waiting.done():  # it ended without a word: it has no lifespan
            waiting.cancel()
            return
        message = waiting.result()
        if message["type"].endswith(".failed"):
            raise ServiceError(
                "application_failed", f"the application failed at {kind}: {message.get('message', '')}", where=URL
            )


class AsyncInProcess(httpx2.AsyncBaseTransport):
    """Answers a client of the same event loop."""

    def __init__(self, app: Any) -> None:
        self._inner = httpx2.ASGITransport(app, raise_app_exceptions=False)
        self._app = app
        self._lifespan: Lifespan | None = None
        self._starting: asyncio.Lock | None = None

    async def handle_async_request(self, request: httpx2.Request) -> httpx2.Response:
        if self._starting is None:
            self._starting = asyncio.Lock()
        async with self._starting:
            if self._lifespan is None:
                lifespan = Lifespan(self._app)
                await lifespan.start()
                self._lifespan = lifespan
        return await self._inner.handle_async_request(request)

    async def aclose(self) -> None:
        if self._lifespan is not None:
            await self._lifespan.stop()
            self._lifespan = None


class InProcess(httpx2.BaseTransport):
    """Answers a synchronous client: the application runs in an event loop in a thread of its own."""

    def __init__(self, app: Any) -> None:
        self._inner = AsyncInProcess(app)
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._over: asyncio.Event | None = None
        self._thread: threading.Thread | None = None

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        seconds = request.extensions.get("timeout", {}).get("read")
        future = asyncio.run_coroutine_threadsafe(self._answer(request), self._running_loop())
        try:
            return future.result(seconds)
        except TimeoutError as error:
            future.cancel()
            raise httpx2.ReadTimeout("the application did not answer", request=request) from error

    async def _answer(self, request: httpx2.Request) -> httpx2.Response:
        response = await self._inner.handle_async_request(request)
        assert isinstance(response.stream, httpx2.AsyncByteStream)
        content = b"".join([part async for part in response.stream])
        return httpx2.Response(response.status_code, headers=response.headers, stream=httpx2.ByteStream(content))

    def close(self) -> None:
        with self._lock:
            loop, over, thread = self._loop, self._over, self._thread
            self._loop = self._over = self._thread = None
        if loop is None or over is None or thread is None:
            return
        try:
            asyncio.run_coroutine_threadsafe(self._inner.aclose(), loop).result()
        finally:
            loop.call_soon_threadsafe(over.set)
            thread.join()

    def _running_loop(self) -> asyncio.AbstractEventLoop:
        with self._lock:
            if self._loop is None:
                started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()
                self._thread = threading.Thread(
                    target=lambda: asyncio.run(_run_until_over(started)), name="brdf-in-process", daemon=True
                )
                self._thread.start()
                self._loop, self._over = started.result()
            return self._loop


async def _run_until_over(started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]]) -> None:
    over = asyncio.Event()
    started.set_result((asyncio.get_running_loop(), over))
    await over.wait()
