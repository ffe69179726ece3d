"""What became of a long job: asked for again and again, or told as it happens."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

from brdf_service.evaluate.json_codec import to_json
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import parse_query
from brdf_service.http.security import check_write
from brdf_service.schemas import JobAnswer
from brdf_service.state import State, state_of
from brdf_service.work.jobs import Job
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

#: Seconds between two looks at a job, and between two signs of life to the caller.
_LOOK, _ALIVE = 0.1, 15.0
JOB_PARAMETER: dict[str, Any] = {
    "name": "id",
    "in": "path",
    "required": True,
    "description": "id of the job",
    "schema": {"type": "string", "pattern": "^[0-9a-f]{32}$"},
}
_JOB = {"application/json": {"schema": ref(JobAnswer)}}
_EVENTS: dict[str, Any] = {
    "text/event-stream": {
        "schema": {
            "type": "object",
            "description": "one event; data is the job as JSON",
            "properties": {name: {"type": "string"} for name in ("id", "event", "data")},
        }
    }
}
#: The 202 answer of an operation that takes long.
ACCEPTED: dict[int | str, Any] = {
    202: {
        "description": "a job does it; Location says where to ask about it",
        "content": _JOB,
        "headers": {"Location": {"required": True, "schema": {"type": "string"}}},
    }
}

router = APIRouter(prefix="/v1/jobs/{id}", tags=["jobs"])


def accepted(state: State, job: Job) -> Response:
    """The answer to a request that made a job."""
    headers = {"location": f"/v1/jobs/{job.id}", "retry-after": "1"}
    return Response(_told(state, job), 202, headers, media_type="application/json")


@router.get(
    "",
    summary="how far a job is",
    description="Kept for an hour after its end. `code` is job_lost if this process does not know it (any more).",
    operation_id="job",
    responses=answers(_JOB, "state and progress", (404,), cached=False),
    openapi_extra=parameters((), [JOB_PARAMETER]),
)
async def job_get(request: Request) -> Response:
    state, job = _find(request)
    return Response(_told(state, job), 200, media_type="application/json")


@router.get(
    "/events",
    summary="a job's progress as it happens",
    description="Server-sent events, each the job as JSON, until it has ended.",
    operation_id="job_events",
    responses=answers(_EVENTS, "events", (404,), cached=False),
    openapi_extra=parameters((), [JOB_PARAMETER]),
)
async def job_events(request: Request) -> Response:
    state, job = _find(request)
    # a proxy that collects answers would keep the news back
    headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
    return StreamingResponse(_events(state, job), 200, headers, media_type="text/event-stream")


@router.delete(
    "",
    summary="cancel a job",
    description="One that has ended stays as it is.",
    operation_id="cancel_job",
    responses=answers(_JOB, "the job, ended", (401, 403, 404), cached=False),
    openapi_extra=parameters((), [JOB_PARAMETER]),
)
async def job_delete(request: Request) -> Response:
    check_write(state_of(request).settings, request.headers)
    state, job = _find(request)
    state.jobs.cancel(job)
    return Response(_told(state, job), 200, media_type="application/json")


def _find(request: Request) -> tuple[State, Job]:
    parse_query(request.scope["query_string"], ())
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
