"""Is the process there, and may it be sent work?"""

from __future__ import annotations

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

import brdfcore as bc
from app.errors import NotReadyError
from app.openapi import answers, ref
from app.query import parse_query
from app.schemas import Live, Ready
from app.state import state_of

router = APIRouter(prefix="/health", tags=["health"])


@router.get(
    "/live",
    summary="the process answers",
    operation_id="live",
    responses=answers({"application/json": {"schema": ref(Live)}}, "alive", (), cached=False),
)
async def live(request: Request) -> Response:
    parse_query(request.scope["query_string"], ())
    return JSONResponse({"status": "live", "version": bc.__version__})


@router.get(
    "/ready",
    summary="the kernels are compiled",
    description="503 until no request has to wait for a compiler: send traffic after it.",
    operation_id="ready",
    responses=answers({"application/json": {"schema": ref(Ready)}}, "ready", (503,), cached=False),
)
async def ready(request: Request) -> Response:
    parse_query(request.scope["query_string"], ())
    if not state_of(request).ready:
        raise NotReadyError(
            "warming_up", "the kernels are being compiled; it answers already, but slowly", retry_after=1
        )
    return JSONResponse({"status": "ready", "version": bc.__version__})
