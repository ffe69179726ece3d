"""Measured files that somebody put into the data folder: each is read by a job, and stored as a table beside it."""

from __future__ import annotations

import logging
import threading

from brdf_service.http.errors import BusyError
from brdf_service.library.materials import Library
from brdf_service.library.writing import IF_NEW
from brdf_service.work.jobs import Job, Jobs

import brdfcore as bc

log = logging.getLogger("brdf.jobs")

#: Seconds between two looks at the folder.
PERIOD = 2.0


class Imports:
    """Looks at the folder in a thread, from `start` to `stop`. `library.waiting` says of each file what keeps it."""

    def __init__(self, library: Library, jobs: Jobs) -> None:
        self.library, self.jobs = library, jobs
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="imports", daemon=True)
        #: Size and times of a file when it was last seen, and its job once it has one, by name.
        self._seen: dict[str, tuple[str, tuple[int, ...], Job | None]] = {}

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def stop(self) -> None:
        """End it."""
        self._stop.set()
        self._thread.join(timeout=5)

    def _watch(self) -> None:
        while not self._stop.is_set():
            try:
                self.look()
            except bc.BrdfError as error:
                log.warning("the data folder cannot be looked at: %s", error)
            except Exception:
                log.exception("looking at the data folder failed")
            self._stop.wait(PERIOD)

    def look(self) -> None:
        """Read what is new and has not changed since the last look: a file that grows is not finished."""
        names = self.library.store.names()
        self.library.forget(names.twice)
        for gone in self._seen.keys() - names.measured.keys():
            del self._seen[gone]
            self.library.waiting.pop(gone, None)
        for name, file in names.measured.items():
            stamp = self.library.store.stamp(file)
            before = self._seen.get(name)
            if before is None or before[:2] != (file, stamp):
                self._seen[name] = file, stamp, None
                self.library.waiting.pop(name, None)
            elif before[2] is None:
                try:
                    self._seen[name] = file, stamp, self._read(name, file)
                except BusyError:
                    return  # at the next look
                except bc.BrdfError as error:
                    self._tell(name, file, error.code, error.detail)
            elif before[2].state == "failed" and name not in self.library.waiting:
                problem = before[2].problem or {}
                self._tell(name, file, str(problem.get("code")), str(problem.get("detail")))

    def _read(self, name: str, file: str) -> Job:
        job = self.jobs.start("import", name, IF_NEW)
        try:
            path = self.library.store.fetch(name, job.folder)
            if path is None:
                raise bc.StorageError("cannot_open", f"{file}: is gone")
            self.jobs.submit(job, {"input": str(path), "format": None, "options": {}, "tabulate": None})
        except BaseException as error:
            self.jobs.drop(job, error)
            raise
        return job

    def _tell(self, name: str, file: str, code: str, detail: str) -> None:
        self.library.waiting[name] = bc.FileFormatError(code, f"{file} cannot be read: {detail}", where=file)
