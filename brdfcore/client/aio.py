"""The asynchronous client: the same exchanges, driven over one `httpx2.AsyncClient` under asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from os import PathLike
from types import TracebackType
from typing import Any, Self, TypeVar

import httpx2

from brdfcore.base.errors import BrdfError
from brdfcore.client import exchanges, in_process, writing
from brdfcore.client.async_material import AsyncMaterial
from brdfcore.client.calls import Answer, Call, Pause
from brdfcore.client.connection import CHUNK_POINTS, Connection
from brdfcore.client.errors import ServiceError, error_of
from brdfcore.client.exchanges import Exchange
from brdfcore.client.jobs import AsyncJob, AsyncReportJob
from brdfcore.client.progress import Progress
from brdfcore.client.retry import Attempts

T = TypeVar("T")


class AsyncClient:
    """A service of BRDF tables, for asyncio: every method of `Client`, to be awaited, with its options and errors.

    async with AsyncClient("http://127.0.0.1:8000") as c:
        gold = await c.material("gold")
        f = await gold.evaluate(theta_i, theta_o, delta_phi)
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8000",
        *,
        key: str | None = None,
        timeout: float = 30.0,
        deadline: float = 60.0,
        progress: Progress | bool = True,
        chunk_points: int = CHUNK_POINTS,
    ) -> None:
        self._connection = Connection.checked(url, key, timeout, deadline, progress, chunk_points)
        self._http = httpx2.AsyncClient(**self._connection.options())

    @classmethod
    def in_process(cls, app: Any, **options: Any) -> Self:
        """A client of an ASGI application in this event loop, without a socket; see `Client.in_process`."""
        self = cls(in_process.URL, **options)  # its connections are made when they are needed: there is none to close
        self._http = httpx2.AsyncClient(**self._connection.options(), transport=in_process.AsyncInProcess(app))
        return self

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._connection.base}>"

    # ---- materials ------------------------------------------------------------------------------

    async def materials(self) -> list[dict[str, Any]]:
        """Metadata of all materials in order of their names; one that cannot be used has `problem`."""
        return await self._run(exchanges.materials())

    async def material(self, name: str) -> AsyncMaterial:
        """The material of that name, as it is now. Raises `UnknownNameError` with close names."""
        return await self._material(exchanges.facts("materials", exchanges.checked_name(name)))

    async def table(self, id: str) -> AsyncMaterial:
        """The material of that id, whatever its name."""
        return await self._material(exchanges.facts("tables", str(id)))

    async def _material(self, exchange: Exchange[dict[str, Any]]) -> AsyncMaterial:
        return AsyncMaterial(self._run, self._connection, await self._run(exchange))

    # ---- writing --------------------------------------------------------------------------------

    async def put(
        self,
        name: str,
        model: str,
        parameters: Mapping[str, Any] | None = None,
        *,
        about: str = "",
        tabulate: Mapping[str, Any] | None = None,
        replace: bool = False,
    ) -> AsyncJob:
        """Store an analytic model, or a table of it; see `Client.put`."""
        return self._job(await self._run(writing.put(name, model, parameters or {}, about, tabulate, replace)))

    async def upload(
        self,
        name: str,
        file: bytes | str | PathLike[str],
        *,
        format: str | None = None,
        options: Mapping[str, Any] | None = None,
        tabulate: Mapping[str, Any] | None = None,
        replace: bool = False,
    ) -> AsyncJob:
        """Store a file; see `Client.upload`."""
        content = file if isinstance(file, bytes) else await asyncio.to_thread(writing.content_of, file)
        return self._job(await self._run(writing.upload(name, content, format, options, tabulate, replace)))

    async def delete(self, name: str) -> None:
        """Delete a material. Raises `UnknownNameError` if there is none."""
        await self._run(writing.delete(name))

    async def pareto(
        self,
        name: str,
        *,
        tolerance: float | None = None,
        max_bytes: int | None = None,
        seconds: float | None = None,
    ) -> AsyncReportJob:
        """Have the representations of a material weighed; see `Client.pareto`."""
        facts = await self._run(writing.pareto(name, tolerance, max_bytes, seconds))
        return AsyncReportJob(self._run, self._connection, facts)

    async def job(self, id: str) -> AsyncJob:
        """A job by its id. Raises `JobError` if the service does not know it (any more)."""
        return self._job(await self._run(writing.look(id)))

    def _job(self, facts: dict[str, Any]) -> AsyncJob:
        return AsyncJob(self._run, self._connection, facts, self.material)

    # ---- how ------------------------------------------------------------------------------------

    async def _run(self, exchange: Exchange[T]) -> T:
        try:
            step = next(exchange)
            while True:
                try:
                    answer = await self._step(step)
                except BrdfError as error:
                    step = exchange.throw(error)
                else:
                    step = exchange.send(answer)
        except StopIteration as done:
            result: T = done.value
            return result
        finally:
            exchange.close()

    async def _step(self, step: Call | Pause) -> Answer | None:
        if isinstance(step, Pause):
            await asyncio.sleep(step.seconds)
            return None
        attempts = Attempts(step, self._connection.policy, self._connection.base)
        while True:
            try:
                answer = await self._once(step, attempts)
                pause = attempts.after_answer(answer)
            except httpx2.TransportError as error:
                pause = attempts.after_failure(error)
            except httpx2.DecodingError as error:
                raise ServiceError("bad_answer", f"the answer cannot be decoded: {error}", where=step.path) from error
            if pause is None:
                break
            await asyncio.sleep(pause)
        if not 200 <= answer.status < 300:
            raise error_of(answer.status, answer.content, answer.url)
        return answer

    async def _once(self, call: Call, attempts: Attempts) -> Answer:
        seconds = min(self._connection.timeout, attempts.left())
        async with self._http.stream(
            call.method, call.path, headers=dict(call.headers), content=call.content or None, timeout=seconds
        ) as response:
            parts = []
            async for part in response.aiter_bytes():
                parts.append(part)
                attempts.check_time()
        content = parts[0] if len(parts) == 1 else b"".join(parts)
        return Answer(response.status_code, response.headers, content, str(response.url))
