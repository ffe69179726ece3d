"""Work that a service does for longer than a request may take."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from typing import Any, ClassVar

from brdfcore.client import exchanges, writing
from brdfcore.client.driver import Driver
from brdfcore.client.errors import ServiceError
from brdfcore.client.exchanges import Exchange
from brdfcore.client.material import AsyncMaterial, RemoteBrdf
from brdfcore.client.questions import Asked, Async, Sync, question, question_for


class JobState:
    """What is known of a job: its facts as of the last look.

    id        None if the service was done at once.
    material  name of the material that it makes.
    state     "receiving", "queued", "running", "done", "failed" or "cancelled".
    progress  (done, total, stage).
    facts     all that the service says of it.
    """

    def __init__(self, driver: Driver, facts: Mapping[str, Any]) -> None:
        self._driver = driver
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

    def _end(self, timeout: float | None) -> Exchange[None]:
        if self.state != "done":
            self._adopt((yield from writing.follow(self.facts, timeout, self._driver.connection)))


class MaterialJob(JobState):
    """A job that makes a material."""

    _MATERIAL: ClassVar[type[Any]]

    @question_for(RemoteBrdf, AsyncMaterial)
    def wait(self, timeout: float | None = None) -> Exchange[Any]:
        """The material once it is there; with a bar on a terminal.

        Raises what the job failed with as a local error, `JobError` if it was cancelled or the service has lost it,
        `DeadlineError` after `timeout` seconds: it goes on, and may be waited for again.
        """
        yield from self._end(timeout)
        facts = yield from exchanges.facts("materials", exchanges.checked_name(self.material))
        return self._MATERIAL(self._driver, facts)

    def _look(self) -> Exchange[Any]:
        """Look again, and return itself."""
        if self.id is not None:
            self._adopt((yield from writing.look(self.id)))
        return self

    refresh: Asked[Callable[[], Job], Callable[[], Coroutine[Any, Any, AsyncJob]]] = question(_look)

    @question
    def cancel(self) -> Exchange[None]:
        """End it; one that has ended stays as it is."""
        if self.id is not None:
            yield from writing.cancel(self.id)
            yield from self._look()


class ReportOfJob(JobState):
    """A job that makes a report."""

    @question
    def wait(self, timeout: float | None = None) -> Exchange[dict[str, Any]]:
        """The report once it is there: {material, tolerance, chosen, front, entries, advice, ...}; raises as
        `Job.wait`."""
        yield from self._end(timeout)
        return report_of(self.facts)

    @question
    def picture(self) -> Exchange[bytes]:
        """The report as PNG, once it is done."""
        return exchanges.drawn("jobs", str(self.id), "pareto.png")


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


class Job(Sync, MaterialJob):
    """A job of `Client`."""

    _MATERIAL = RemoteBrdf


class AsyncJob(Async, MaterialJob):
    """A job of `AsyncClient`: the methods of `Job`, to be awaited."""

    _MATERIAL = AsyncMaterial


class ReportJob(Sync, ReportOfJob):
    """A job of `Client.pareto`."""


class AsyncReportJob(Async, ReportOfJob):
    """A job of `AsyncClient.pareto`: the methods of `ReportJob`, to be awaited."""
