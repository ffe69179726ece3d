"""Which representation a stored material needs: weighed by a job, told as JSON and as a picture."""

from __future__ import annotations

import shutil
from pathlib import Path

from anyio.to_thread import run_sync
from brdf_service.evaluate.json_codec import load
from brdf_service.http.bodies import read_json_body
from brdf_service.http.errors import NotFoundError
from brdf_service.http.openapi import answers, parameters, ref
from brdf_service.http.query import parse_query
from brdf_service.http.security import check_write
from brdf_service.library.materials import SUFFIXES
from brdf_service.library.writing import Condition
from brdf_service.routes.addressing import BY_NAME_ADDRESS
from brdf_service.routes.jobs import ACCEPTED, JOB_PARAMETER, accepted
from brdf_service.routes.writing import explained
from brdf_service.schemas import ParetoRequest
from brdf_service.state import State, state_of
from brdf_service.work.jobs import PICTURE, Job
from fastapi import APIRouter
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

_MOST_BYTES = 10_000
_EXAMPLE = '{"tolerance": 0.01}'
_REFUSALS = (400, 401, 403, 404, 408, 409, 413, 415, 503)

router = APIRouter(tags=["materials"])


@router.post(
    f"{BY_NAME_ADDRESS.prefix}/pareto",
    summary="speed against error of every representation of a material",
    description="A job builds every table that can hold the material over a range of sizes, measures errors and times, "
    "and says which to use: `result.materials[0].chosen` of the job. Its picture: /v1/jobs/{id}/pareto.png. Times are "
    "those of a machine that also serves.",
    operation_id="pareto_material",
    responses={202: ACCEPTED[202], **{k: v for k, v in answers({}, "", _REFUSALS, cached=False).items() if k != 200}},
    openapi_extra={
        **parameters((), [BY_NAME_ADDRESS.parameter]),
        "requestBody": {"required": True, "content": {"application/json": {"schema": ref(ParetoRequest)}}},
    },
)
async def pareto(request: Request) -> Response:
    state, name = state_of(request), request.path_params["name"]
    check_write(state.settings, request.headers)  # minutes of all cores: not for whoever may only read
    parse_query(request.scope["query_string"], ())
    body = await read_json_body(request, _MOST_BYTES, state.settings.body_seconds)
    try:
        asked = ParetoRequest.model_validate(load(body, _EXAMPLE), strict=True)
    except ValidationError as error:
        raise explained(error) from error
    await run_sync(state.library.get, name)  # says what there is instead
    job = await run_sync(state.jobs.start, "pareto", name, Condition())
    try:
        path = await run_sync(_copied, state, job)
        state.jobs.submit(
            job,
            {"material": name, "input": str(path), "picture": PICTURE, "pareto": asked.model_dump(exclude_none=True)},
        )
    except BaseException:
        state.jobs.drop(job)
        raise
    return accepted(state, job)


@router.get(
    "/v1/jobs/{id}/pareto.png",
    summary="the picture of a report",
    description="Once its job is done.",
    operation_id="pareto_picture",
    responses=answers({"image/png": {"schema": {"type": "string", "format": "binary"}}}, "PNG", (404,), cached=False),
    openapi_extra=parameters((), [JOB_PARAMETER]),
)
async def picture(request: Request) -> Response:
    parse_query(request.scope["query_string"], ())
    job = state_of(request).jobs.get(request.path_params["id"])
    if job.picture is None:
        raise NotFoundError(
            "no_picture",
            f"this job ({job.kind}, {job.state}) has no picture; a pareto job has one once it is done",
            where="id",
            got=job.state,
            expected="the id of a pareto job that is done",
        )
    return Response(job.picture, 200, {"cache-control": "private, max-age=3600"}, media_type="image/png")


def _copied(state: State, job: Job) -> Path:
    """The material's file as it is now, in the job's folder: it may be replaced meanwhile."""
    for suffix in SUFFIXES:
        source = state.store.folder / f"{job.material}{suffix}"
        target = job.folder / f"{job.material}{suffix}"
        try:
            shutil.copyfile(source, target)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise bc.StorageError(
                "data_folder", f"the data folder cannot be written ({error.strerror})", where="data"
            ) from error
        return target
    raise NotFoundError("unknown_material", f"{job.material}: was deleted a moment ago", where="name", got=job.material)
