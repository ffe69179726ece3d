"""Work that a service does for longer than a request may take, synchronous and for asyncio."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Generic, TypeVar

from brdfcore.client import writing
from brdfcore.client.async_material import AsyncMaterial, AsyncRun
from brdfcore.client.connection import Connection
from brdfcore.client.errors import ServiceError
from brdfcore.client.material import RemoteBrdf, Run

R = TypeVar("R")


class JobState(Generic[R]):
    """What is known of a job: its facts as of the last look.

    id        None if the service was done at once.
    material  name of the material that it makes.
    state     "receiving", "queued", "running", "done", "failed" or "cancelled".
    progress  (done, total, stage).
    facts     all that the service says of it.
    """

    def __init__(self, run: R, connection: Connection, facts: Mapping[str, Any]) -> None:
        self._run, self._connection = run, connection
        self._adopt(facts)

    def _adopt(self, facts: Mapping[str, Any]) -> None:
        self.facts = dict(facts)
        self.id: str | None = facts["id"]
        self.material, self.state = str(facts["material"]), str(facts["state"])

    @property
    def ended(self) -> bool:
        return self.state in writing.ENDED

    @property
    def progress(self) -> tuple[int, int, str]:
        said = self.facts["progress"]
        return int(said.get("done", 0)), int(said.get("total", 1)), str(said.get("stage", ""))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id or 'without id'} making {self.material}: {self.state}>"


class Job(JobState[Run]):
    """A job of `Client`."""

    def __init__(
        self, run: Run, connection: Connection, facts: Mapping[str, Any], material: Callable[[str], RemoteBrdf]
    ) -> None:
        super().__init__(run, connection, facts)
        self._material = material

    def wait(self, timeout: float | None = None) -> RemoteBrdf:
        """The material once it is there; with a bar on a terminal.

        Raises what the job failed with as a local error, `JobError` if it was cancelled or the service has lost it,
        `DeadlineError` after `timeout` seconds: it goes on, and may be waited for again.
        """
        if self.state != "done":
            self._adopt(self._run(writing.follow(self.facts, timeout, self._connection)))
        return self._material(self.material)

    def refresh(self) -> Job:
        """Look again, and return itself."""
        if self.id is not None:
            self._adopt(self._run(writing.look(self.id)))
        return self

    def cancel(self) -> None:
        """End it; one that has ended stays as it is."""
        if self.id is not None:
            self._run(writing.cancel(self.id))
            self.refresh()


class ReportJob(JobState[Run]):
    """A job of `Client.pareto`."""

    def wait(self, timeout: float | None = None) -> dict[str, Any]:
        """The report once it is there: {material, tolerance, chosen, front, entries, advice, ...}; raises as
        `Job.wait`."""
        if self.state != "done":
            self._adopt(self._run(writing.follow(self.facts, timeout, self._connection)))
        return report_of(self.facts)

    def picture(self) -> bytes:
        """The report as PNG, once it is done."""
        found: bytes = self._run(writing.picture(str(self.id)))
        return found


class AsyncReportJob(JobState[AsyncRun]):
    """A job of `AsyncClient.pareto`: the methods of `ReportJob`, to be awaited."""

    async def wait(self, timeout: float | None = None) -> dict[str, Any]:
        """The report once it is there; see `ReportJob.wait`."""
        if self.state != "done":
            self._adopt(await self._run(writing.follow(self.facts, timeout, self._connection)))
        return report_of(self.facts)

    async def picture(self) -> bytes:
        """The report as PNG, once it is done."""
        found: bytes = await self._run(writing.picture(str(self.id)))
        return found


def report_of(facts: Mapping[str, Any]) -> dict[str, Any]:
    """The one material's part of the report that a job made."""
    try:
        return dict(facts["result"]["materials"][0])
    except (KeyError, TypeError, IndexError, ValueError) as error:
        raise ServiceError(
            "bad_answer",
            "the job is done, and has no report; is it one of `pareto`, and of this version?",
            where="result",
        ) from error


class AsyncJob(JobState[AsyncRun]):
    """A job of `AsyncClient`: the methods of `Job`, to be awaited."""

    def __init__(
        self,
        run: AsyncRun,
        connection: Connection,
        facts: Mapping[str, Any],
        material: Callable[[str], Awaitable[AsyncMaterial]],
    ) -> None:
        super().__init__(run, connection, facts)
        self._material = material

    async def wait(self, timeout: float | None = None) -> AsyncMaterial:
        """The material once it is there; see `Job.wait`."""
        if self.state != "done":
            self._adopt(await self._run(writing.follow(self.facts, timeout, self._connection)))
        return await self._material(self.material)

    async def refresh(self) -> AsyncJob:
        """Look again, and return itself."""
        if self.id is not None:
            self._adopt(await self._run(writing.look(self.id)))
        return self

    async def cancel(self) -> None:
        """End it; one that has ended stays as it is."""
        if self.id is not None:
            await self._run(writing.cancel(self.id))
            await self.refresh()
