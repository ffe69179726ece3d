"""Long work: one job at a time in a process of its own, a few waiting, each told about for an hour after its end."""

from __future__ import annotations

import json
import logging
import os
import secrets
import shutil
import signal
import threading
import time
from collections import Counter
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any, Literal

from brdf_service.http.errors import BusyError, NotFoundError, describe, status_of
from brdf_service.library.writing import Condition, Store
from brdf_service.settings import Settings
from brdf_service.work.subprocesses import Child, rebuilt

import brdfcore as bc

log = logging.getLogger("brdf.jobs")

JobKind = Literal["upload", "tabulate", "pareto"]
JobState = Literal["receiving", "queued", "running", "done", "failed", "cancelled"]

#: Jobs that may wait beside the one that runs.
QUEUED = 8
KEPT_SECONDS = 3600.0
#: Seconds after which a refused caller may try again.
_RETRY = 10
#: Wall-clock time a job may take, for each second of processor time it may.
_PATIENCE = 2


@dataclass
class Job:
    """One upload, tabulation or report. `version` counts its changes; `picture` is a report's, PNG; `folder` takes its
    files, of which its own begin with a dot, as no name of a material does."""

    id: str
    kind: JobKind
    material: str
    condition: Condition
    folder: Path
    task: dict[str, Any] = field(default_factory=dict)
    state: JobState = "receiving"
    progress: tuple[int, int, str] = (0, 1, "waiting")
    created: float = field(default_factory=time.time)
    queued: float = 0.0
    finished: float | None = None
    problem: dict[str, Any] | None = None
    made: dict[str, Any] | None = None
    picture: bytes | None = None
    version: int = 0
    child: Child | None = None

    @property
    def ended(self) -> bool:
        return self.state in ("done", "failed", "cancelled")

    def change(self, **changes: Any) -> None:
        """New values of some fields."""
        for name, value in changes.items():
            setattr(self, name, value)
        self.version += 1

    def to_json(self, ahead: int) -> dict[str, Any]:
        """What is told of it; `ahead`: jobs before it in the queue."""
        done, total, stage = self.progress
        return {
            "id": self.id,
            "kind": self.kind,
            "material": self.material,
            "state": self.state,
            "progress": {"done": done, "total": total, "stage": stage},
            "ahead": ahead,
            "created": _time(self.created),
            "finished": None if self.finished is None else _time(self.finished),
            "problem": self.problem,
            "result": self.made,
            "links": {
                "self": f"/v1/jobs/{self.id}",
                "events": f"/v1/jobs/{self.id}/events",
                "material": f"/v1/materials/{self.material}",
                **({} if self.picture is None else {"picture": f"/v1/jobs/{self.id}/pareto.png"}),
            },
        }


class Jobs:
    """All jobs of this process. Methods may be called from several threads, and none of them waits for work."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self.settings, self.store = settings, store
        self._jobs: dict[str, Job] = {}
        self._queue: SimpleQueue[Job | None] = SimpleQueue()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._stopping = False

    def start(self, kind: JobKind, material: str, condition: Condition) -> Job:
        """A new job with a place in the queue, and a folder for its files; `submit` or `drop` it.

        Raises `BusyError` if there is no place (makes a folder).
        """
        id = secrets.token_hex(16)
        folder = self.store.folder.new_scratch(id)
        with self._lock:
            self._forget()
            waiting = sum(not job.ended and job.state != "running" for job in self._jobs.values())
            if waiting < QUEUED and not self._stopping:
                job = self._jobs[id] = Job(id, kind, material, condition, folder)
                return job
        shutil.rmtree(folder, ignore_errors=True)
        text = f"{waiting} jobs wait already; the limit is {QUEUED}; try again later"
        raise BusyError("queue_full", text, got=waiting, limit=QUEUED, retry_after=_RETRY)

    def submit(self, job: Job, task: dict[str, Any]) -> None:
        """Queue a job that `start` made."""
        job.task = {
            "result": str(job.folder / ".result"),
            "picture": str(job.folder / ".picture"),
            "memory": self.settings.job_memory_bytes,
            "seconds": self.settings.job_seconds,
            "max_bytes": self.settings.max_table_bytes,
            **task,
        }
        with self._lock:
            if job.ended:  # cancelled while it was received
                return
            job.change(state="queued", queued=time.monotonic())
            self._queue.put(job)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="jobs", daemon=True)
                self._thread.start()

    def drop(self, job: Job) -> None:
        """Forget a job that was never submitted."""
        with self._lock:
            self._jobs.pop(job.id, None)
        shutil.rmtree(job.folder, ignore_errors=True)

    def get(self, id: str) -> Job:
        """The job. Raises `NotFoundError` if it is not known (any more)."""
        with self._lock:
            self._forget()
            job = self._jobs.get(id)
        if job is None:
            text = (
                "no job of this id: it never was, ended more than an hour ago, was lost when the service restarted, or "
                "is another replica's; its material tells whether it was done"
            )
            raise NotFoundError("job_lost", text, where="id", got=id[:80], expected="the id of a job of this process")
        return job

    def ahead(self, job: Job) -> int:
        """Its place in the queue, from 1; 0 once it runs."""
        with self._lock:
            queued = [other for other in self._jobs.values() if other.state == "queued"]
            return sum(other.queued <= job.queued for other in queued) if job.state == "queued" else 0

    def cancel(self, job: Job) -> None:
        """End a job; one that has ended stays as it is."""
        with self._lock:
            if job.ended:
                return
            job.change(state="cancelled", finished=time.time())
            child = job.child
        if child is not None:
            child.kill()
        else:
            shutil.rmtree(job.folder, ignore_errors=True)

    def counts(self) -> Counter[str]:
        """Number of jobs by state."""
        with self._lock:
            return Counter(job.state for job in self._jobs.values())

    def stop(self) -> None:
        """End all of them: the service ends."""
        with self._lock:
            self._stopping = True
            jobs, thread = list(self._jobs.values()), self._thread
        self._queue.put(None)
        for job in jobs:
            self.cancel(job)
        if thread is not None:
            thread.join(timeout=5)

    def _forget(self) -> None:
        old = time.time() - KEPT_SECONDS
        for id in [id for id, job in self._jobs.items() if job.finished is not None and job.finished < old]:
            del self._jobs[id]

    # ---- the thread that runs them --------------------------------------------------------------------

    def _run(self) -> None:
        while (job := self._queue.get()) is not None:
            with self._lock:
                if job.ended:  # cancelled while it waited
                    continue
                job.change(state="running", progress=(0, 1, "starting"))
            try:
                with (job.folder / ".stderr").open("w+b") as errors:
                    end = self._do(job, errors)
            except Exception as error:
                if not isinstance(error, bc.BrdfError):
                    log.exception("job %s failed", job.id)
                end = _failed(job, error)
            shutil.rmtree(job.folder, ignore_errors=True)
            with self._lock:
                if not job.ended:
                    job.change(finished=time.time(), **end)

    def _do(self, job: Job, errors: IO[bytes]) -> dict[str, Any]:
        """Do a job; the fields that its success changes."""
        said: dict[str, Any] = {}
        seconds = self.settings.job_seconds * _PATIENCE
        with closing(Child("job_process", errors=errors)) as child, child.within(seconds):
            with self._lock:
                job.child = child
                if job.ended:  # cancelled in between
                    child.kill()
            child.send(job.task)
            while (line := child.hear()) is not None:
                said = line
                if "progress" in said:
                    done, total, stage = said["progress"]
                    with self._lock:
                        job.change(progress=(int(done), int(total), str(stage)[:200]))
            child.process.wait()
        job.child = None
        if job.ended:
            return {}
        if "problem" in said:
            raise rebuilt(said["problem"])
        if "made" not in said:
            raise self._died(job, child, errors)
        if job.kind == "pareto":
            told, picture = (Path(job.task[key]).read_bytes() for key in ("result", "picture"))
            return {"state": "done", "made": json.loads(told), "picture": picture, "progress": (1, 1, "done")}
        self.store.place(job.material, Path(job.task["result"]), said["made"], job.condition)
        material = self.store.library.get(job.material)
        made = {"id": material.id, "nbytes": material.nbytes, "error": material.facts["error"]}
        return {"state": "done", "made": made, "progress": (1, 1, "done")}

    def _died(self, job: Job, child: Child, errors: IO[bytes]) -> bc.BrdfError:
        """Why there is no result: the process was ended, or ended itself."""
        code = child.process.returncode
        errors.seek(max(0, errors.seek(0, os.SEEK_END) - 2000))
        log.warning("the process of job %s ended with %d: %s", job.id, code, errors.read().decode(errors="replace"))
        seconds = self.settings.job_seconds
        if child.late or -code == getattr(signal, "SIGXCPU", 0):
            return bc.LimitError("job_seconds", f"it took more than {seconds} seconds", limit=seconds)
        if -code == signal.SIGKILL:
            text = "its process was ended from outside, as happens where memory runs out; try again later"
            return BusyError("job_killed", text, retry_after=_RETRY)
        if -code == getattr(signal, "SIGXFSZ", 0):
            return bc.LimitError("table_too_large", "the table is larger than a request may make")
        text = "the process that read it ended before it was done: the file is damaged, or too large for it"
        return bc.FileFormatError("job_crashed", text)


def _failed(job: Job, error: Exception) -> dict[str, Any]:
    """The fields of a job that an error changes."""
    said = {"code": "internal_error", "detail": "an error inside the service; the service's log says more"}
    if isinstance(error, bc.BrdfError):
        said = describe(error)
        said["detail"] = said["detail"].replace(f"{job.folder}/", "")
    return {"state": "failed", "problem": {"status": status_of(error), **said}}


def _time(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")
