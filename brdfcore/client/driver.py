"""Runs exchanges over httpx2: attempts, pauses, errors; written once for both clients.

`Blocking` has the coroutines of `Waiting` and suspends in none of them: `finished` runs one to its end.
"""

from __future__ import annotations

import asyncio
import math
from abc import ABC, abstractmethod
from collections.abc import Coroutine
from os import PathLike
from time import sleep
from typing import Any, TypeVar

import httpx2

from brdfcore.base.errors import BrdfError
from brdfcore.client.calls import MOST_ANSWER, Answer, Call, Pause, Read
from brdfcore.client.connection import Connection
from brdfcore.client.deadlines import watch, within
from brdfcore.client.errors import ServiceError, error_of
from brdfcore.client.exchanges import Exchange
from brdfcore.client.retry import Attempts
from brdfcore.client.writing import content_of

T = TypeVar("T")


def finished(work: Coroutine[Any, Any, T]) -> T:
    """The result of a coroutine that never suspends."""
    try:
        work.send(None)
    except StopIteration as done:
        result: T = done.value
        return result
    raise RuntimeError("a coroutine of a blocking client suspended")


class Driver(ABC):
    """Takes an exchange from step to step."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection

    @abstractmethod
    async def close(self) -> None:
        """Close the connections."""

    @abstractmethod
    async def _sleep(self, seconds: float) -> None: ...

    @abstractmethod
    async def _read(self, file: str | PathLike[str]) -> bytes: ...

    @abstractmethod
    async def _once(self, call: Call, attempts: Attempts) -> Answer:
        """One attempt; raises httpx2's errors."""

    async def run(self, exchange: Exchange[T]) -> T:
        """The result of an exchange."""
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

    async def _step(self, step: Call | Pause | Read) -> Answer | bytes | None:
        if isinstance(step, Pause):
            await self._sleep(step.seconds)
            return None
        if isinstance(step, Read):
            return await self._read(step.file)
        attempts = Attempts(step, self.connection.policy, self.connection.base)
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
            await self._sleep(pause)
        if not 200 <= answer.status < 300:
            raise error_of(answer.status, answer.content, answer.url)
        return answer

    def _request(self, call: Call, attempts: Attempts) -> dict[str, Any]:
        """Arguments of httpx2's `stream`."""
        return {
            "method": call.method,
            "url": call.path,
            "headers": dict(call.headers),
            "content": call.content or None,
            "timeout": min(self.connection.timeout, attempts.left()),
        }


class Blocking(Driver):
    """Over one `httpx2.Client`."""

    def __init__(self, connection: Connection, transport: httpx2.BaseTransport | None = None) -> None:
        super().__init__(connection)
        self._http = httpx2.Client(**connection.options(), transport=transport)
        watch(self._http)

    async def close(self) -> None:
        self._http.close()

    async def _sleep(self, seconds: float) -> None:
        sleep(seconds)

    async def _read(self, file: str | PathLike[str]) -> bytes:
        return content_of(file)

    async def _once(self, call: Call, attempts: Attempts) -> Answer:
        parts, size = [], 0
        try:
            with within(attempts.left()), self._http.stream(**self._request(call, attempts)) as response:
                for part in response.iter_bytes():
                    parts.append(part)
                    size = _counted(size, part, call)
                    attempts.check_time()
        except httpx2.ReadTimeout:
            if parts:
                attempts.check_time()
            raise
        return _answer(response, parts)


class Waiting(Driver):
    """Over one `httpx2.AsyncClient`, under asyncio."""

    def __init__(self, connection: Connection, transport: httpx2.AsyncBaseTransport | None = None) -> None:
        super().__init__(connection)
        self._http = httpx2.AsyncClient(**connection.options(), transport=transport)

    async def close(self) -> None:
        await self._http.aclose()

    async def _sleep(self, seconds: float) -> None:
        await asyncio.sleep(seconds)

    async def _read(self, file: str | PathLike[str]) -> bytes:
        return await asyncio.to_thread(content_of, file)

    async def _once(self, call: Call, attempts: Attempts) -> Answer:
        parts, size, left = [], 0, attempts.left()
        try:
            async with asyncio.timeout(None if left == math.inf else max(left, 0)):
                async with self._http.stream(**self._request(call, attempts)) as response:
                    async for part in response.aiter_bytes():
                        parts.append(part)
                        size = _counted(size, part, call)
        except TimeoutError as error:
            if parts:
                attempts.check_time()
            raise httpx2.ReadTimeout("the answer was still arriving") from error
        return _answer(response, parts)


def _counted(size: int, part: bytes, call: Call) -> int:
    """Bytes of an answer with this part of it, as they are unpacked; `ServiceError` if they are too many."""
    size += len(part)
    if size > MOST_ANSWER:
        said = f"{call.method} {call.path[:200]}: the answer is larger than {MOST_ANSWER} bytes; is it a service?"
        raise ServiceError("answer_too_large", said, where=call.path[:200], limit=MOST_ANSWER)
    return size


def _answer(response: httpx2.Response, parts: list[bytes]) -> Answer:
    content = parts[0] if len(parts) == 1 else b"".join(parts)
    return Answer(response.status_code, response.headers, content, str(response.url))
