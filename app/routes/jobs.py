"""What became of a long job: asked for again and again, or told as it happens."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from anyio import CancelScope
from anyio.to_thread import run_sync
from brdf_service.http.errors import NotFoundError
from brdf_service.http.json import to_json
from brdf_service.http.openapi import content_of, route
from brdf_service.http.query import NoQuery
from brdf_service.http.security import check_write
from brdf_service.library.writing import Condition
from brdf_service.schemas.work import JobAnswer, JobList
from brdf_service.state import State, state_of
from brdf_service.work.jobs import Job, JobKind
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

#: Seconds between two looks at a job, and between two signs of life to the caller.
_LOOK, _ALIVE = 0.1, 15.0
_ID = {"type": "string", "pattern": "^[0-9a-f]{32}$"}
_PATH: list[dict[str, Any]] = [
    {"name": "id", "in": "path", "required": True, "description": "id of the job", "schema": _ID}
]
_EVENT = {
    "type": "object",
    "description": "one event; data is the job as JSON",
    "properties": {name: {"type": "string"} for name in ("id", "event", "data")},
}
#: The 202 answer of an operation that takes long.
ACCEPTED: dict[int | str, Any] = {
    202: {
        "description": "a job does it; Location says where to ask about it",
        "content": content_of(JobAnswer),
        "headers": {"Location": {"required": True, "schema": {"type": "string"}}},
    }
}

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])


@asynccontextmanager
async def new_job(state: State, kind: JobKind, name: str, condition: Condition) -> AsyncIterator[Job]:
    """A job to submit inside; one that was not submitted for an error is forgotten."""
    job = await run_sync(state.jobs.start, kind, name, condition)
    try:
        yield job
    except BaseException as error:
        with CancelScope(shield=True):
            await run_sync(state.jobs.drop, job, error)
        raise


def accepted(state: State, job: Job) -> Response:
    """The answer to a request that made a job."""
    headers = {"location": f"/v1/jobs/{job.id}", "retry-after": "1"}
    return Response(_told(state, job), 202, headers, media_type="application/json")


@route(
    router,
    "GET ",
    "jobs",
    "all jobs, the newest first",
    "Of this process, and as far as their records tell of others that share the data folder. Kept for an hour.",
    answer=(JobList,),
    says="the jobs",
    refusals=(503,),
)
async def jobs_get(request: Request, _: NoQuery) -> Response:
    told = await run_sync(state_of(request).jobs.newest)
    return Response(to_json({"jobs": told}), 200, media_type="application/json")


@route(
    router,
    "GET /{id}",
    "job",
    "how far a job is",
    "Kept for an hour after its end. `code` is job_lost if nothing is known of it (any more).",
    answer=(JobAnswer,),
    says="state and progress",
    refusals=(404,),
    parameters=_PATH,
)
async def job_get(request: Request, _: NoQuery) -> Response:
    told = await run_sync(state_of(request).jobs.told, request.path_params["id"])
    return Response(to_json(told), 200, media_type="application/json")


@route(
    router,
    "GET /{id}/events",
    "job_events",
    "a job's progress as it happens",
    "Server-sent events, each the job as JSON, until it has ended.",
    answer=({"text/event-stream": {"schema": _EVENT}},),
    says="events",
    refusals=(404,),
    parameters=_PATH,
)
async def job_events(request: Request, _: NoQuery) -> Response:
    state, job = _find(request)
    # a proxy that collects answers would keep the news back
    headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
    return StreamingResponse(_events(state, job), 200, headers, media_type="text/event-stream")


@route(
    router,
    "DELETE /{id}",
    "cancel_job",
    "cancel a job",
    "One that has ended, or whose file is being put into its place, stays as it is.",
    answer=(JobAnswer,),
    says="the job, ended",
    refusals=(401, 403, 404),
    parameters=_PATH,
)
async def job_delete(request: Request, _: NoQuery) -> Response:
    check_write(state_of(request).settings, request.headers)
    state, job = _find(request)
    await run_sync(state.jobs.cancel, job)
    return Response(_told(state, job), 200, media_type="application/json")


@route(
    router,
    "GET /{id}/pareto.png",
    "pareto_picture",
    "the picture of a report",
    "Once its job is done.",
    answer=("image/png",),
    says="PNG",
    refusals=(404,),
    parameters=_PATH,
)
async def picture(request: Request, _: NoQuery) -> Response:
    job = _find(request)[1]
    if job.picture is None:
        said = f"this job ({job.kind}, {job.state}) has no picture; a pareto job has one once it is done"
        expected = "the id of a pareto job that is done"
        raise NotFoundError("no_picture", said, where="id", got=job.state, expected=expected)
    return Response(job.picture, 200, {"cache-control": "private, max-age=3600"}, media_type="image/png")


def _find(request: Request) -> tuple[State, Job]:
    state = state_of(request)
    return state, state.jobs.get(request.path_params["id"])


def _told(state: State, job: Job) -> bytes:
    return to_json(job.to_json(state.jobs.ahead(job)))


async def _events(state: State, job: Job) -> AsyncIterator[bytes]:
    last, quiet = -1, 0.0
    while True:
        if job.version != last:
            last, quiet = job.version, 0.0
            yield b"id: %d\nevent: %b\ndata: %b\n\n" % (last, job.state.encode(), _told(state, job))
        elif quiet >= _ALIVE:
            quiet = 0.0
            yield b": still there\n\n"
        if (job.ended and job.version == last) or state.draining:
            return
        await asyncio.sleep(_LOOK)
        quiet += _LOOK
