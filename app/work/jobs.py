"""Long work: a process of its own for each job, few at once; a record of each in the store, an hour after its end."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import secrets
import signal
import threading
import time
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Literal

from brdf_service.http.errors import BusyError, NotFoundError, describe, status_of
from brdf_service.library.writing import Condition, Writer
from brdf_service.settings import Settings
from brdf_service.work.subprocesses import Child, rebuilt

import brdfcore as bc

log = logging.getLogger("brdf.jobs")

JobKind = Literal["upload", "import", "tabulate", "pareto"]
JobState = Literal["receiving", "queued", "running", "done", "failed", "cancelled"]

#: Jobs that may wait beside those that run.
QUEUED = 8
#: Jobs that run at most, of which no more than one in its first seconds: a short one never waits for long ones, unless
#: there are as many of those.
RUNNING, YOUNG_SECONDS = 3, 10.0
KEPT_SECONDS = 3600.0
#: Jobs of other processes that are told of.
_TOLD = 200
#: Seconds after which a refused caller may try again, and between two records of a job's progress.
_RETRY, _RECORD = 10, 1.0
#: Wall-clock time a job may take, for each second of processor time it may.
_PATIENCE = 2


@dataclass
class Job:
    """One upload, import, tabulation or report. `version` counts its changes; `picture` is a report's, PNG; `folder`
    takes its files, of which its own begin with a dot, as no name of a material does."""

    id: str
    kind: JobKind
    material: str
    condition: Condition
    folder: Path
    keeping: ExitStack = field(default_factory=ExitStack)
    task: dict[str, Any] = field(default_factory=dict)
    state: JobState = "receiving"
    progress: tuple[int, int, str] = (0, 1, "waiting")
    created: float = field(default_factory=time.time)
    queued: float = 0.0
    started: float = 0.0
    recorded: float = 0.0
    finished: float | None = None
    problem: dict[str, Any] | None = None
    made: dict[str, Any] | None = None
    picture: bytes | None = None
    version: int = 0
    child: Child | None = None
    #: Its file is being put into its place: it can't be cancelled any more.
    placing: bool = False

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
    """All jobs of this process. Methods may be called from several threads; those that say so touch files."""

    def __init__(self, settings: Settings, writer: Writer) -> None:
        self.settings, self.writer = settings, writer
        self._jobs: dict[str, Job] = {}
        self._lock = threading.Lock()
        self._threads: set[threading.Thread] = set()
        self._stopping = False

    def start(self, kind: JobKind, material: str, condition: Condition) -> Job:
        """A new job with a place in the queue, and a folder for its files; `submit` or `drop` it.

        Raises `BusyError` if there is no place (makes a folder).
        """
        id, keeping = secrets.token_hex(16), ExitStack()
        folder = keeping.enter_context(self.writer.store.scratch())
        with self._lock:
            self._forget()
            waiting = sum(not job.ended and job.state != "running" for job in self._jobs.values())
            if waiting < QUEUED and not self._stopping:
                job = self._jobs[id] = Job(id, kind, material, condition, folder, keeping)
                return job
        keeping.close()
        text = f"{waiting} jobs wait already; the limit is {QUEUED}; try again later"
        raise BusyError("queue_full", text, got=waiting, limit=QUEUED, retry_after=_RETRY)

    def submit(self, job: Job, task: dict[str, Any]) -> None:
        """Queue a job that `start` made (writes its record)."""
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
        self._record(job)
        self._begin()

    def drop(self, job: Job, error: BaseException | None = None) -> None:
        """End a job that was never submitted: with the error for which it was not, or without a trace (removes its
        files)."""
        with self._lock:
            if error is None or not isinstance(error, bc.BrdfError):
                self._jobs.pop(job.id, None)
            elif not job.ended:
                job.change(finished=time.time(), **_failed(job, error))
        if job.id in self._jobs:
            self._record(job)
        job.keeping.close()

    def get(self, id: str) -> Job:
        """The job. Raises `NotFoundError` if this process does not know it (any more)."""
        with self._lock:
            self._forget()
            job = self._jobs.get(id)
        if job is None:
            text = (
                "no job of this id is known here: it never was, ended more than an hour ago, or belongs to another "
                "replica, of which /v1/jobs and /v1/jobs/{id} tell; its material tells whether it was done"
            )
            raise NotFoundError("job_lost", text, where="id", got=id[:80], expected="the id of a job of this process")
        return job

    def told(self, id: str) -> dict[str, Any]:
        """The job as JSON, by its record if it is not of this process (reads a file). Raises as `get`."""
        try:
            job = self.get(id)
        except NotFoundError:
            found = _read(self.writer.store.record(id))
            if found is None:
                raise
            return found
        return job.to_json(self.ahead(job))

    def newest(self) -> list[dict[str, Any]]:
        """All jobs as JSON, the newest first, with those of other processes as far as they are recorded (reads
        files)."""
        with self._lock:
            self._forget()
            own = list(self._jobs.values())
        found = {job.id: job.to_json(self.ahead(job)) for job in own}
        for raw in self.writer.store.records(_TOLD):
            told = _read(raw)
            if told is not None:
                found.setdefault(told["id"], told)
        return sorted(found.values(), key=lambda told: str(told["created"]), reverse=True)

    def ahead(self, job: Job) -> int:
        """Its place in the queue, from 1; 0 once it runs."""
        with self._lock:
            queued = [other for other in self._jobs.values() if other.state == "queued"]
            return sum(other.queued <= job.queued for other in queued) if job.state == "queued" else 0

    def cancel(self, job: Job) -> None:
        """End a job; one that has ended, or whose file is being put into its place, stays as it is."""
        with self._lock:
            if job.ended or job.placing:
                return
            before = job.state
            job.change(state="cancelled", finished=time.time())
            child = job.child
        if child is not None:
            child.kill()
        self._record(job)
        if before == "queued":  # one that is received or runs is looked after by who does it
            job.keeping.close()

    def counts(self) -> Counter[str]:
        """Number of jobs by state."""
        with self._lock:
            return Counter(job.state for job in self._jobs.values())

    def kill(self) -> None:
        """End all processes at once: nobody waits for them."""
        self._stopping = True
        for job in list(self._jobs.values()):
            if job.child is not None:
                job.child.kill()

    def stop(self) -> None:
        """End all of them: the service ends."""
        with self._lock:
            self._stopping = True
            jobs, threads = list(self._jobs.values()), list(self._threads)
        for job in jobs:
            self.cancel(job)
        for thread in threads:
            thread.join(timeout=5)

    def _forget(self) -> None:
        old = time.time() - KEPT_SECONDS
        for id in [id for id, job in self._jobs.items() if job.finished is not None and job.finished < old]:
            del self._jobs[id]

    def _record(self, job: Job) -> None:
        job.recorded = time.monotonic()
        owner = {"owner": [bc.atomic.host(), os.getpid()]}
        with contextlib.suppress(bc.StorageError):  # it is told of as long as this process lives
            content = json.dumps({**job.to_json(self.ahead(job)), **owner}, default=str)
            self.writer.store.put_record(job.id, content.encode())

    # ---- the threads that run them --------------------------------------------------------------------

    def _begin(self) -> None:
        """Start the next job if it may run; look again when one ends, or is not young any more."""
        with self._lock:
            now, running = time.monotonic(), [job for job in self._jobs.values() if job.state == "running"]
            waiting = [job for job in self._jobs.values() if job.state == "queued"]
            if self._stopping or not waiting or len(running) >= RUNNING:
                return
            oldest = min(waiting, key=lambda job: job.queued)
            young = [job.started + YOUNG_SECONDS - now for job in running if now - job.started < YOUNG_SECONDS]
            if young:
                timer = threading.Timer(min(young) + 0.01, self._begin)
                timer.daemon = True
                timer.start()
                return
            oldest.change(state="running", started=now, progress=(0, 1, "starting"))
            thread = threading.Thread(target=self._run, args=(oldest,), name="job", daemon=True)
            self._threads.add(thread)
            thread.start()

    def _run(self, job: Job) -> None:
        self._record(job)
        try:
            with (job.folder / ".stderr").open("w+b") as errors:
                end = self._do(job, errors)
        except Exception as error:
            if not isinstance(error, bc.BrdfError):
                log.exception("job %s failed", job.id)
            end = _failed(job, error)
        with contextlib.suppress(Exception):
            job.keeping.close()
        with self._lock:
            if not job.ended:
                job.change(finished=time.time(), **end)
            self._threads.discard(threading.current_thread())
        self._record(job)
        self._begin()

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
                    if time.monotonic() - job.recorded > _RECORD:
                        self._record(job)
            child.process.wait()
        with self._lock:
            job.child, job.placing = None, not job.ended  # from here on it is done, or fails for another reason
        if job.ended:
            return {}
        if "problem" in said:
            raise rebuilt(said["problem"])
        if "made" not in said:
            raise self._died(job, child, errors)
        if job.kind == "pareto":
            told, picture = (Path(job.task[key]).read_bytes() for key in ("result", "picture"))
            return {"state": "done", "made": json.loads(told), "picture": picture, "progress": (1, 1, "done")}
        material, _ = self.writer.place(job.material, Path(job.task["result"]), said["made"], job.condition)
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


def _read(raw: bytes | None) -> dict[str, Any] | None:
    """What a record tells; a job whose process is gone has failed."""
    try:
        told = json.loads(raw or b"null")
        host, pid = told.pop("owner")
        ended = told["finished"]
        if ended is not None and datetime.fromisoformat(ended).timestamp() < time.time() - KEPT_SECONDS:
            return None
        if ended is None and host == bc.atomic.host() and not bc.atomic.alive(int(pid)):
            text = "the service ended before the job was done; ask for it again"
            told |= {"state": "failed", "problem": {"status": 503, "code": "job_lost", "detail": text}}
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
    return dict(told)
