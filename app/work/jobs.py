"""Long work: one job at a time in a process of its own, a few waiting, each told about for an hour after its end."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from brdf_service.http.errors import BusyError, NotFoundError, describe, status_of
from brdf_service.library.writing import Condition, Store
from brdf_service.settings import Settings
from brdf_service.work.subprocesses import environment, rebuilt

import brdfcore as bc

log = logging.getLogger("brdf.jobs")

JobKind = Literal["upload", "tabulate", "pareto"]
JobState = Literal["receiving", "queued", "running", "done", "failed", "cancelled"]

#: Jobs that may wait beside the one that runs.
QUEUED = 8
KEPT_SECONDS = 3600.0
#: Seconds after which a refused caller may try again.
_RETRY = 10
_FOLDER = ".job-"
#: Name of a report's picture in the folder of its job.
PICTURE = "picture.png"
_LONGEST_LINE = 65_536
#: Wall-clock time a job may take, for each second of processor time it may.
_PATIENCE = 2


@dataclass
class Job:
    """One upload, tabulation or report. `version` counts its changes; `picture` is a report's, PNG."""

    id: str
    kind: JobKind
    material: str
    condition: Condition
    folder: Path
    task: dict[str, Any] = field(default_factory=dict)
    state: JobState = "receiving"
    progress: tuple[int, int, str] = (0, 1, "waiting")
    created: float = field(default_factory=time.time)
    finished: float | None = None
    problem: dict[str, Any] | None = None
    made: dict[str, Any] | None = None
    picture: bytes | None = None
    version: int = 0
    process: subprocess.Popen[bytes] | None = None

    @property
    def ended(self) -> bool:
        return self.state in ("done", "failed", "cancelled")

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
        self.settings = settings
        self.store = store
        self._jobs: dict[str, Job] = {}
        self._queue: deque[Job] = deque()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._stopping = False

    def start(self, kind: JobKind, material: str, condition: Condition) -> Job:
        """A new job with a place in the queue, and a folder for its files; `submit` or `drop` it.

        Raises `BusyError` if there is no place (makes a folder).
        """
        id = secrets.token_hex(16)
        with self._changed:
            self._forget()
            waiting = sum(not job.ended and job.state != "running" for job in self._jobs.values())
            if waiting >= QUEUED or self._stopping:
                raise BusyError(
                    "queue_full",
                    f"{waiting} jobs wait already; the limit is {QUEUED}; try again later",
                    got=waiting,
                    limit=QUEUED,
                    retry_after=_RETRY,
                )
            folder = self.store.folder / f"{_FOLDER}{_host()}-{os.getpid()}-{id}"
            job = self._jobs[id] = Job(id, kind, material, condition, folder)
        try:
            folder.mkdir()
        except OSError as error:
            self.drop(job)
            raise bc.StorageError(
                "data_folder", f"the data folder cannot be written ({error.strerror})", where="data"
            ) from error
        return job

    def submit(self, job: Job, task: dict[str, Any]) -> None:
        """Queue a job that `start` made."""
        job.task = {
            "result": str(job.folder / "result"),
            "memory": self.settings.job_memory_bytes,
            "seconds": self.settings.job_seconds,
            "max_bytes": self.settings.max_table_bytes,
            **task,
        }
        with self._changed:
            if job.ended:  # cancelled while it was received
                return
            self._set(job, state="queued")
            self._queue.append(job)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="jobs", daemon=True)
                self._thread.start()

    def drop(self, job: Job) -> None:
        """Forget a job that was never submitted."""
        with self._changed:
            self._jobs.pop(job.id, None)
        shutil.rmtree(job.folder, ignore_errors=True)

    def get(self, id: str) -> Job:
        """The job. Raises `NotFoundError` if it is not known (any more)."""
        with self._changed:
            self._forget()
            job = self._jobs.get(id)
        if job is None:
            raise NotFoundError(
                "job_lost",
                "no job of this id: it never was, ended more than an hour ago, was lost when the service restarted, or "
                "is another replica's; its material tells whether it was done",
                where="id",
                got=id[:80],
                expected="the id of a job of this process",
            )
        return job

    def ahead(self, job: Job) -> int:
        """Jobs that come before it."""
        with self._changed:
            return self._queue.index(job) + 1 if job in self._queue else 0

    def cancel(self, job: Job) -> None:
        """End a job; one that has ended stays as it is."""
        with self._changed:
            if job.ended:
                return
            if job in self._queue:
                self._queue.remove(job)
            self._set(job, state="cancelled", finished=time.time())
            process = job.process
        if process is not None:
            process.kill()
        else:
            shutil.rmtree(job.folder, ignore_errors=True)

    def counts(self) -> Counter[str]:
        """Number of jobs by state."""
        with self._changed:
            return Counter(job.state for job in self._jobs.values())

    def stop(self) -> None:
        """End all of them: the service ends."""
        with self._changed:
            self._stopping = True
            jobs, thread = list(self._jobs.values()), self._thread
            self._changed.notify_all()
        for job in jobs:
            self.cancel(job)
        if thread is not None:
            thread.join(timeout=5)

    def clean(self) -> None:
        """Remove what jobs of this machine left behind when their service was killed."""
        for folder in self.store.folder.glob(f"{_FOLDER}{_host()}-*"):
            number = folder.name.removeprefix(f"{_FOLDER}{_host()}-").partition("-")[0]
            if number.isdigit() and (int(number) == os.getpid() or not _alive(int(number))):
                shutil.rmtree(folder, ignore_errors=True)

    # ---- the thread that runs them --------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._queue and not self._stopping:
                    self._changed.wait()
                if self._stopping:
                    return
                job = self._queue.popleft()
                self._set(job, state="running", progress=(0, 1, "starting"))
            try:
                end = self._do(job)
            except Exception as error:
                if not isinstance(error, bc.BrdfError):
                    log.exception("job %s failed", job.id)
                end = _failed(job, error)
            shutil.rmtree(job.folder, ignore_errors=True)
            with self._changed:
                if not job.ended:
                    self._set(job, finished=time.time(), **end)

    def _do(self, job: Job) -> dict[str, Any]:
        """Do a job; the fields that its success changes."""
        with (job.folder / "stderr").open("wb") as errors:
            process = subprocess.Popen(
                [sys.executable, "-m", "brdf_service.work.job_process"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=environment(),
            )
        with process:
            with self._changed:
                job.process = process
                if job.ended:  # cancelled in between
                    process.kill()
            watch = threading.Timer(self.settings.job_seconds * _PATIENCE, process.kill)
            watch.daemon = True
            watch.start()
            try:
                said = self._listen(job, process)
            finally:
                watch.cancel()
                process.kill()
        job.process = None
        if job.ended:
            return {}
        if "problem" in said:
            raise rebuilt(said["problem"])
        if "made" not in said:
            raise self._died(job, process.returncode)
        if job.kind == "pareto":
            answer = json.loads((job.folder / "result").read_bytes())
            picture = (job.folder / PICTURE).read_bytes()
            return {"state": "done", "made": answer, "picture": picture, "progress": (1, 1, "done")}
        self.store.place(job.material, job.folder / "result", said["made"], job.condition)
        material = self.store.library.get(job.material)
        made = {"id": material.id, "nbytes": material.nbytes, "error": material.facts["error"]}
        return {"state": "done", "made": made, "progress": (1, 1, "done")}

    def _listen(self, job: Job, process: subprocess.Popen[bytes]) -> dict[str, Any]:
        """Send the task and follow what the process says; its last word."""
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(OSError), process.stdin as pipe:  # it may have died already
            pipe.write(json.dumps(job.task).encode())
        said: dict[str, Any] = {}
        while line := process.stdout.readline(_LONGEST_LINE):
            try:
                said = json.loads(line)
            except ValueError:
                said = {}
            if "progress" in said:
                done, total, stage = said["progress"]
                with self._changed:
                    self._set(job, progress=(int(done), int(total), str(stage)[:200]))
        process.wait()
        return said

    def _died(self, job: Job, code: int) -> bc.BrdfError:
        with contextlib.suppress(OSError):
            tail = (job.folder / "stderr").read_bytes()[-2000:].decode(errors="replace")
            log.warning("the process of job %s ended with %d: %s", job.id, code, tail)
        seconds = self.settings.job_seconds
        if -code in (getattr(signal, "SIGXCPU", 0), signal.SIGKILL):
            return bc.LimitError("job_seconds", f"it took more than {seconds} seconds", limit=seconds)
        if -code == getattr(signal, "SIGXFSZ", 0):
            return bc.LimitError("table_too_large", "the table is larger than a request may make")
        return bc.FileFormatError(
            "job_crashed", "the process that read it ended before it was done: the file is damaged, or too large for it"
        )

    def _set(self, job: Job, **changes: Any) -> None:
        for name, value in changes.items():
            setattr(job, name, value)
        job.version += 1
        self._changed.notify_all()

    def _forget(self) -> None:
        old = time.time() - KEPT_SECONDS
        for id in [id for id, job in self._jobs.items() if job.finished is not None and job.finished < old]:
            del self._jobs[id]


def _failed(job: Job, error: Exception) -> dict[str, Any]:
    """The fields of a job that an error changes."""
    said = {"code": "internal_error", "detail": "an error inside the service; the service's log says more"}
    if isinstance(error, bc.BrdfError):
        said = describe(error)
        said["detail"] = said["detail"].replace(f"{job.folder}/", "")
    return {"state": "failed", "problem": {"status": status_of(error), **said}}


def _time(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def _host() -> str:
    return "".join(c for c in socket.gethostname() if c.isalnum())[:32] or "host"


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
