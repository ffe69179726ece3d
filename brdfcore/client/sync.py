"""The synchronous client: drives the exchanges over one `httpx2.Client`."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from time import sleep
from types import TracebackType
from typing import Any, Self, TypeVar

import httpx2

from brdfcore.base.errors import BrdfError
from brdfcore.client import exchanges, in_process, writing
from brdfcore.client.calls import Answer, Call, Pause
from brdfcore.client.connection import CHUNK_POINTS, Connection
from brdfcore.client.errors import ServiceError, error_of
from brdfcore.client.exchanges import Exchange
from brdfcore.client.jobs import Job, ReportJob
from brdfcore.client.material import RemoteBrdf
from brdfcore.client.progress import Progress
from brdfcore.client.retry import Attempts

T = TypeVar("T")


class Client:
    """A service of BRDF tables.

        with Client("http://127.0.0.1:8000") as c:
            f = c.material("gold").evaluate(theta_i, theta_o, delta_phi)

    Parameters
    ----------
    url : str
        Address of the service, without /v1.
    key : str, optional
        What writing takes where the service has a key; default: the variable BRDF_API_KEY.
    timeout : float
        Seconds that the service may be silent, connecting included.
    deadline : float
        Seconds for one request with all its attempts; 0 means one attempt. A refused connection and a 503 are tried
        again with growing pauses, as are a broken connection, 502 and 504 where the request changes nothing; a
        Retry-After is obeyed. A batch sent in several requests has the deadline for each.
    progress : bool or callable
        True: a bar on stderr for work of several requests, if that is a terminal. A function is called as
        progress(done, total, stage) instead.
    chunk_points : int
        Most points of one request.

    Errors of the service are raised as the library's own (`InputError`, `UnknownNameError`, `LimitError`, ...) with
    where, index, got and expected; beside them `ServiceError` (unreachable, broken), `DeadlineError` (too late) and
    `AccessError` (not allowed). May be used by several threads at once. Close it, or use it as a context manager.
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
        self._http = httpx2.Client(**self._connection.options())

    @classmethod
    def in_process(cls, app: Any, **options: Any) -> Self:
        """A client of an ASGI application in this process, without a socket; options as above but for the address.

        The application starts with the first request and is shut down by `close`.
        """
        self = cls(in_process.URL, **options)
        self._http.close()
        self._http = httpx2.Client(**self._connection.options(), transport=in_process.InProcess(app))
        return self

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._connection.base}>"

    # ---- materials ------------------------------------------------------------------------------

    def materials(self) -> list[dict[str, Any]]:
        """Metadata of all materials in order of their names; one that cannot be used has `problem`."""
        return self._run(exchanges.materials())

    def material(self, name: str) -> RemoteBrdf:
        """The material of that name, as it is now. Raises `UnknownNameError` with close names."""
        return self._material(exchanges.facts("materials", exchanges.checked_name(name)))

    def table(self, id: str) -> RemoteBrdf:
        """The material of that id, whatever its name."""
        return self._material(exchanges.facts("tables", str(id)))

    def _material(self, exchange: Exchange[dict[str, Any]]) -> RemoteBrdf:
        return RemoteBrdf(self._run, self._connection, self._run(exchange))

    # ---- writing --------------------------------------------------------------------------------

    def put(
        self,
        name: str,
        model: str,
        parameters: Mapping[str, Any] | None = None,
        *,
        about: str = "",
        tabulate: Mapping[str, Any] | None = None,
        replace: bool = False,
    ) -> Job:
        """Store an analytic model under a name, evaluated exactly, or with `tabulate` (options of
        `brdfcore.tabulate`, {} for its defaults) a table of it. `wait()` of the job gives the material. `about` is a
        sentence for people.

        Raises `StorageError` if the name is taken and `replace` is not set, `AccessError` if this caller may not.
        """
        return self._job(self._run(writing.put(name, model, parameters or {}, about, tabulate, replace)))

    def upload(
        self,
        name: str,
        file: bytes | str | PathLike[str],
        *,
        format: str | None = None,
        options: Mapping[str, Any] | None = None,
        tabulate: Mapping[str, Any] | None = None,
        replace: bool = False,
    ) -> Job:
        """Store a file (its path or its bytes) that a format of the library reads, sniffed if `format` is None, with
        `options` of its reader. A table in it is stored as it is, anything else is tabulated, with the options of
        `tabulate`. `wait()` of the job gives the material.

        Raises as `put`, and `StorageError` if the file cannot be read here.
        """
        content = file if isinstance(file, bytes) else writing.content_of(file)
        return self._job(self._run(writing.upload(name, content, format, options, tabulate, replace)))

    def delete(self, name: str) -> None:
        """Delete a material. Raises `UnknownNameError` if there is none."""
        self._run(writing.delete(name))

    def pareto(
        self,
        name: str,
        *,
        tolerance: float | None = None,
        max_bytes: int | None = None,
        seconds: float | None = None,
    ) -> ReportJob:
        """Have every representation of a material built, measured and timed by the service, and the one to use named:
        the job's `wait()` gives the report, `picture()` draws it.

        tolerance  error (L1) that is right enough; default .01. max_bytes: nothing larger is chosen. seconds: about
        how long it may take, default 60. Raises `AccessError` if this caller may not: it takes all cores.
        """
        return ReportJob(self._run, self._connection, self._run(writing.pareto(name, tolerance, max_bytes, seconds)))

    def job(self, id: str) -> Job:
        """A job by its id. Raises `JobError` if the service does not know it (any more)."""
        return self._job(self._run(writing.look(id)))

    def _job(self, facts: dict[str, Any]) -> Job:
        return Job(self._run, self._connection, facts, self.material)

    # ---- how ------------------------------------------------------------------------------------

    def _run(self, exchange: Exchange[T]) -> T:
        try:
            step = next(exchange)
            while True:
                try:
                    answer = self._step(step)
                except BrdfError as error:
                    step = exchange.throw(error)
                else:
                    step = exchange.send(answer)
        except StopIteration as done:
            result: T = done.value
            return result
        finally:
            exchange.close()

    def _step(self, step: Call | Pause) -> Answer | None:
        if isinstance(step, Pause):
            sleep(step.seconds)
            return None
        attempts = Attempts(step, self._connection.policy, self._connection.base)
        while True:
            try:
                answer = self._once(step, attempts)
                pause = attempts.after_answer(answer)
            except httpx2.TransportError as error:
                pause = attempts.after_failure(error)
            except httpx2.DecodingError as error:
                raise ServiceError("bad_answer", f"the answer cannot be decoded: {error}", where=step.path) from error
            if pause is None:
                break
            sleep(pause)
        if not 200 <= answer.status < 300:
            raise error_of(answer.status, answer.content, answer.url)
        return answer

    def _once(self, call: Call, attempts: Attempts) -> Answer:
        seconds = min(self._connection.timeout, attempts.left())
        with self._http.stream(
            call.method, call.path, headers=dict(call.headers), content=call.content or None, timeout=seconds
        ) as response:
            parts = []
            for part in response.iter_bytes():
                parts.append(part)
                attempts.check_time()
        content = parts[0] if len(parts) == 1 else b"".join(parts)
        return Answer(response.status_code, response.headers, content, str(response.url))
