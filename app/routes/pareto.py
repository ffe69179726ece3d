"""Which representation a stored material needs: weighed by a job, told as JSON and as a picture."""

from __future__ import annotations

from anyio.to_thread import run_sync
from brdf_service.http.bodies import read_json_body
from brdf_service.http.json import model_from_json
from brdf_service.http.openapi import route
from brdf_service.http.query import NoQuery
from brdf_service.http.security import check_write
from brdf_service.library.writing import Condition
from brdf_service.routes.address import BY_NAME
from brdf_service.routes.jobs import ACCEPTED, accepted, new_job
from brdf_service.schemas.work import JobAnswer, ParetoRequest
from brdf_service.state import state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

_MOST_BYTES = 10_000

router = APIRouter(tags=["materials"])


@route(
    router,
    f"POST {BY_NAME.prefix}/pareto",
    "pareto_material",
    "speed against error of every representation of a material",
    "A job builds every table that can hold the material over a range of sizes, measures errors and times, and "
    "says which to use: `result.materials[0].chosen` of the job. Its picture: /v1/jobs/{id}/pareto.png. Times are "
    "those of a machine that also serves.",
    status=202,
    answer=(JobAnswer,),
    refusals=(400, 401, 403, 404, 408, 409, 413, 415, 503),
    parameters=[BY_NAME.parameter],
    body=(ParetoRequest,),
    more=ACCEPTED,
)
async def pareto(request: Request, _: NoQuery) -> Response:
    state, name = state_of(request), request.path_params["name"]
    check_write(state.settings, request.headers)  # minutes of all cores: not for whoever may only read
    body = await read_json_body(request, _MOST_BYTES, state.settings.body_seconds)
    asked = model_from_json(body, ParetoRequest, '{"tolerance": 0.01}')
    await run_sync(state.library.get, name)  # says what there is instead
    async with new_job(state, "pareto", name, Condition()) as job:
        path = await run_sync(state.writer.copy, name, job.folder)  # it may be replaced meanwhile
        await run_sync(
            state.jobs.submit,
            job,
            {"material": name, "input": str(path), "pareto": asked.model_dump(exclude_none=True)},
        )
    return accepted(state, job)
