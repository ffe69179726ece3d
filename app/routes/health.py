"""Is the process there, may it be sent work, and what has it done?"""

from __future__ import annotations

from brdf_service.http.errors import NotReadyError
from brdf_service.http.openapi import route
from brdf_service.http.query import NoQuery
from brdf_service.schemas.service import Live, Ready
from brdf_service.state import state_of
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

import brdfcore as bc

router = APIRouter(tags=["health"])


@route(router, "GET /health/live", "live", "the process answers", answer=(Live,), says="alive")
async def live(request: Request, _: NoQuery) -> Response:
    return JSONResponse({"status": "live", "version": bc.__version__})


@route(
    router,
    "GET /health/ready",
    "ready",
    "the kernels are compiled",
    "503 until no request has to wait for a compiler: send traffic after it.",
    answer=(Ready,),
    says="ready",
    refusals=(503,),
)
async def ready(request: Request, _: NoQuery) -> Response:
    if not state_of(request).ready:
        said = "the kernels are being compiled; it answers already, but slowly"
        raise NotReadyError("warming_up", said, retry_after=1)
    return JSONResponse({"status": "ready", "version": bc.__version__})


@route(router, "GET /metrics", "metrics", "counters for Prometheus", answer=("text/plain",), says="text format 0.0.4")
async def metrics(request: Request, _: NoQuery) -> Response:
    state = state_of(request)
    library, jobs = state.library, state.jobs.counts()
    gauges = {
        "brdf_table_bytes": ("bytes of the tables in memory", library.loaded_bytes),
        "brdf_tables_loaded": ("materials in memory", library.loaded),
        "brdf_body_bytes": ("bytes of request bodies held", state.bodies.held),
        "brdf_jobs_running": ("jobs that run", jobs["running"]),
        "brdf_jobs_waiting": ("jobs that wait", jobs["queued"] + jobs["receiving"]),
        "brdf_ready": ("1 once the kernels are compiled", int(state.ready)),
    }
    counters = {
        "brdf_cache_hits_total": ("requests whose material was in memory", library.hits),
        "brdf_cache_misses_total": ("requests whose material was read from its file", library.misses),
    }
    return Response(state.metrics.text(gauges, counters), 200, media_type="text/plain; version=0.0.4; charset=utf-8")
