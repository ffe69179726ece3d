"""What is said to store, replace and delete materials, and to follow the jobs that this takes; as in `exchanges`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from brdfcore.base.errors import BrdfError, StorageError, UnknownNameError
from brdfcore.client import calls, exchanges
from brdfcore.client.calls import Answer, Call, Pause, Read
from brdfcore.client.connection import Connection
from brdfcore.client.errors import DeadlineError, JobError, error_of
from brdfcore.client.exchanges import Exchange, checked_name
from brdfcore.client.progress import reporting

ENDED = ("done", "failed", "cancelled")
#: Seconds between two looks at a job: the first, and the longest.
_FIRST_LOOK, _LONGEST_LOOK = 0.05, 1.0


def put(
    name: str,
    model: str,
    parameters: Mapping[str, Any],
    about: str,
    tabulate: Mapping[str, Any] | None,
    replace: bool,
) -> Exchange[dict[str, Any]]:
    """Store a model, or a table of it; the facts of the job, one that has ended if there was nothing to wait for."""
    checked_name(name)
    headers = yield from _condition(name, replace)
    body = {"model": model, "parameters": exchanges.plain(parameters)}
    if about:
        body["about"] = about
    if tabulate is not None:
        body["tabulate"] = exchanges.plain(tabulate)
    answer: Answer = yield calls.send_json("PUT", "materials", name, body=body, headers=headers)
    return _job_of(answer, name)


def upload(
    name: str,
    file: bytes | str | PathLike[str],
    format: str | None,
    options: Mapping[str, Any] | None,
    tabulate: Mapping[str, Any] | None,
    replace: bool,
) -> Exchange[dict[str, Any]]:
    """Store a file, given by its path or as its bytes; the facts of the job."""
    checked_name(name)
    content = file if isinstance(file, bytes) else (yield Read(file))
    headers = yield from _condition(name, replace)
    query = {
        "format": format,
        "options": None if options is None else json.dumps(exchanges.plain(options)),
        "tabulate": None if tabulate is None else json.dumps(exchanges.plain(tabulate)),
    }
    answer: Answer = yield Call(
        "POST",
        calls.path_of("materials", name, "upload", query=query),
        {"accept": calls.JSON, "content-type": calls.BINARY, **headers},
        content,
        repeat="undone",
    )
    return _job_of(answer, name)


def pareto(
    name: str, tolerance: float | None, max_bytes: int | None, seconds: float | None
) -> Exchange[dict[str, Any]]:
    """Have the representations of a material weighed; the facts of the job."""
    given = {"tolerance": tolerance, "max_bytes": max_bytes, "seconds": seconds}
    body = exchanges.plain({k: v for k, v in given.items() if v is not None})
    answer: Answer = yield calls.send_json("POST", "materials", checked_name(name), "pareto", body=body)
    return checked_job(answer)


def delete(name: str) -> Exchange[None]:
    """Delete a material, in whatever state it is."""
    path = calls.path_of("materials", checked_name(name))
    yield Call("DELETE", path, {"accept": calls.JSON, "if-match": "*"}, repeat="undone")


def _condition(name: str, replace: bool) -> Exchange[dict[str, str]]:
    """Headers that let a request replace the material as it is now, or nothing if it must not exist yet."""
    if not replace:
        return {}
    try:
        answer: Answer = yield calls.get("materials", name)
    except UnknownNameError:
        return {}
    except StorageError:  # its file is damaged: nobody knows its state
        return {"if-match": "*"}
    return {"if-match": answer.headers.get("etag", "*")}


def _job_of(answer: Answer, name: str) -> dict[str, Any]:
    if answer.status != 202:
        return {"id": None, "material": name, "state": "done", "progress": {"done": 1, "total": 1, "stage": "done"}}
    return checked_job(answer)


def checked_job(answer: Answer) -> dict[str, Any]:
    """The facts of a job, as an answer gives them."""
    found = answer.json()
    usable = isinstance(found, dict) and all(isinstance(found.get(k), str) for k in ("id", "material", "state"))
    if not usable or not isinstance(found.get("progress"), dict):
        raise calls.unexpected(answer, "the state of a job")
    return dict(found)


def look(id: str) -> Exchange[dict[str, Any]]:
    """The facts of a job as they are now."""
    try:
        answer: Answer = yield calls.get("jobs", id)
    except UnknownNameError as error:
        raise JobError(error.code, error.detail, **{**error.context, "job": id}) from error
    return checked_job(answer)


def cancel(id: str) -> Exchange[None]:
    """End a job; one that has ended stays as it is."""
    yield Call("DELETE", calls.path_of("jobs", id), {"accept": calls.JSON})


def follow(job: dict[str, Any], timeout: float | None, connection: Connection) -> Exchange[dict[str, Any]]:
    """The facts of a job that is done. Raises what it failed with, `JobError` or, after `timeout`, `DeadlineError`."""
    waited, pause = 0.0, _FIRST_LOOK
    with reporting(connection.progress) as report:
        while job["state"] not in ENDED:
            if timeout is not None and waited >= timeout:
                raise DeadlineError(
                    "job_not_ended",
                    f"the job of {job['material']} is still {job['state']} after {waited:.1f} s; it goes on, and "
                    "can be waited for again",
                    job=job["id"],
                    seconds=waited,
                    attempts=1,
                    got=job["state"],
                )
            pause = pause if timeout is None else min(pause, max(timeout - waited, 0.01))
            yield Pause(pause)
            waited, pause = waited + pause, min(pause * 1.5, _LONGEST_LOOK)
            job = yield from look(job["id"])
            state = job["progress"]
            report(int(state.get("done", 0)), int(state.get("total", 1)), str(state.get("stage", job["state"])))
    if job["state"] == "done":
        return job
    raise failure_of(job, connection.base)


def failure_of(job: Mapping[str, Any], base: str) -> BrdfError:
    """Why a job ended without a material."""
    problem = job.get("problem")
    if job["state"] == "failed" and isinstance(problem, dict):
        error = error_of(int(problem.get("status", 500)), json.dumps(problem).encode(), base)
        return type(error)(error.code, error.detail, **{**error.context, "job": job["id"]})
    return JobError(
        f"job_{job['state']}", f"the job of {job['material']} was {job['state']}", job=job["id"], got=job["state"]
    )


def content_of(file: str | PathLike[str]) -> bytes:
    """The bytes of a file to send; `StorageError` if it cannot be read."""
    try:
        return Path(file).read_bytes()
    except OSError as error:
        raise StorageError("cannot_open", f"{file}: cannot be read ({error.strerror})", where=str(file)) from error
