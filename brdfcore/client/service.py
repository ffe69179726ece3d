"""The clients of a service: `Client` waits, `AsyncClient` is awaited."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from types import TracebackType
from typing import Any, ClassVar, Self

from brdfcore.client import exchanges, in_process, writing
from brdfcore.client.connection import CHUNK_POINTS, Connection
from brdfcore.client.driver import Blocking, Driver, Waiting, finished
from brdfcore.client.exchanges import Exchange
from brdfcore.client.jobs import AsyncJob, AsyncReportJob, Job, ReportJob
from brdfcore.client.material import AsyncMaterial, RemoteBrdf
from brdfcore.client.progress import Progress
from brdfcore.client.questions import Async, Sync, question, question_for


class Service:
    """What both clients have: options, and what is asked of a service itself."""

    _DRIVER: ClassVar[type[Any]]
    _IN_PROCESS: ClassVar[type[Any]]
    _MATERIAL: ClassVar[type[Any]]
    _JOB: ClassVar[type[Any]]
    _REPORT_JOB: ClassVar[type[Any]]
    _driver: Driver

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
        self._driver = self._DRIVER(Connection.checked(url, key, timeout, deadline, progress, chunk_points))

    @classmethod
    def in_process(cls, app: Any, **options: Any) -> Self:
        """A client of an ASGI application in this process, without a socket; options as above but for the address.

        The application starts with the first request and is shut down by `close`. That of an `AsyncClient` runs in
        its event loop, that of a `Client` in a thread.
        """
        self = cls.__new__(cls)
        self._driver = cls._DRIVER(Connection.checked(in_process.URL, **options), cls._IN_PROCESS(app))
        return self

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._driver.connection.base}>"

    # ---- materials ------------------------------------------------------------------------------

    @question
    def materials(self) -> Exchange[list[dict[str, Any]]]:
        """Metadata of all materials in order of their names; one that cannot be used has `problem`."""
        return exchanges.materials()

    @question_for(RemoteBrdf, AsyncMaterial)
    def material(self, name: str) -> Exchange[Any]:
        """The material of that name, as it is now. Raises `UnknownNameError` with close names."""
        facts = yield from exchanges.facts("materials", exchanges.checked_name(name))
        return self._MATERIAL(self._driver, facts)

    @question_for(RemoteBrdf, AsyncMaterial)
    def table(self, id: str) -> Exchange[Any]:
        """The material of that id, whatever its name."""
        facts = yield from exchanges.facts("tables", str(id))
        return self._MATERIAL(self._driver, facts)

    # ---- writing --------------------------------------------------------------------------------

    @question_for(Job, AsyncJob)
    def put(
        self,
        name: str,
        model: str,
        parameters: Mapping[str, Any] | None = None,
        *,
        about: str = "",
        tabulate: Mapping[str, Any] | None = None,
        replace: bool = False,
    ) -> Exchange[Any]:
        """Store an analytic model under a name, evaluated exactly, or with `tabulate` (options of
        `brdfcore.tabulate`, {} for its defaults) a table of it. `wait()` of the job gives the material. `about` is a
        sentence for people.

        Raises `StorageError` if the name is taken and `replace` is not set, `AccessError` if this caller may not.
        """
        facts = yield from writing.put(name, model, parameters or {}, about, tabulate, replace)
        return self._JOB(self._driver, facts)

    @question_for(Job, AsyncJob)
    def upload(
        self,
        name: str,
        file: bytes | str | PathLike[str],
        *,
        format: str | None = None,
        options: Mapping[str, Any] | None = None,
        tabulate: Mapping[str, Any] | None = None,
        replace: bool = False,
    ) -> Exchange[Any]:
        """Store a file (its path or its bytes) that a format of the library reads, sniffed if `format` is None, with
        `options` of its reader. A table in it is stored as it is, anything else is tabulated, with the options of
        `tabulate`. `wait()` of the job gives the material.

        Raises as `put`, and `StorageError` if the file cannot be read here.
        """
        facts = yield from writing.upload(name, file, format, options, tabulate, replace)
        return self._JOB(self._driver, facts)

    @question
    def delete(self, name: str) -> Exchange[None]:
        """Delete a material. Raises `UnknownNameError` if there is none."""
        return writing.delete(name)

    @question_for(ReportJob, AsyncReportJob)
    def pareto(
        self,
        name: str,
        *,
        tolerance: float | None = None,
        max_bytes: int | None = None,
        seconds: float | None = None,
    ) -> Exchange[Any]:
        """Have every representation of a material built, measured and timed by the service, and the one to use named:
        the job's `wait()` gives the report, `picture()` draws it.

        tolerance  error (L1) that is right enough; default .01. max_bytes: nothing larger is chosen. seconds: about
        how long it may take, default 60. Raises `AccessError` if this caller may not: it takes all cores.
        """
        facts = yield from writing.pareto(name, tolerance, max_bytes, seconds)
        return self._REPORT_JOB(self._driver, facts)

    @question_for(Job, AsyncJob)
    def job(self, id: str) -> Exchange[Any]:
        """A job by its id. Raises `JobError` if the service does not know it (any more)."""
        facts = yield from writing.look(id)
        return self._JOB(self._driver, facts)

    @question
    def jobs(self) -> Exchange[list[dict[str, Any]]]:
        """What the service says of the jobs of the last hour, the newest first."""
        return exchanges.jobs()


class Client(Sync, Service):
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

    _DRIVER, _IN_PROCESS = Blocking, in_process.InProcess
    _MATERIAL, _JOB, _REPORT_JOB = RemoteBrdf, Job, ReportJob

    def close(self) -> None:
        """Close the connections."""
        finished(self._driver.close())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


class AsyncClient(Async, Service):
    """A service of BRDF tables, for asyncio: every method of `Client`, to be awaited, with its options and errors.

    async with AsyncClient("http://127.0.0.1:8000") as c:
        gold = await c.material("gold")
        f = await gold.evaluate(theta_i, theta_o, delta_phi)
    """

    _DRIVER, _IN_PROCESS = Waiting, in_process.AsyncInProcess
    _MATERIAL, _JOB, _REPORT_JOB = AsyncMaterial, AsyncJob, AsyncReportJob

    async def close(self) -> None:
        """Close the connections."""
        await self._driver.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.close()
