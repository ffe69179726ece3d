"""The application, and `serve`, which `brdf serve` calls."""

from __future__ import annotations

import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from brdf_service.http import openapi
from brdf_service.http.errors import problem
from brdf_service.http.metrics import Metrics
from brdf_service.library.folder import Folder
from brdf_service.library.materials import Library
from brdf_service.library.writing import Writer
from brdf_service.routes import evaluate, health, jobs, materials, pages, pareto, relight, sample, writing
from brdf_service.server import process, start, warmup
from brdf_service.server.middleware import RequestMiddleware, Service
from brdf_service.server.request_log import RequestLog
from brdf_service.settings import Settings
from brdf_service.state import State
from brdf_service.work.drawing import Drawing
from brdf_service.work.imports import Imports
from brdf_service.work.jobs import Jobs
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

_ROUTED = (evaluate, relight, sample, materials, writing, pareto, jobs, health, pages)


def create_app(
    settings: Settings | None = None, *, warm: bool = True, request_log: RequestLog | None = None
) -> Service:
    """The application over a data folder.

    settings     default: BRDF_* variables and defaults.
    warm         compile the kernels and start a process that draws, in the background, as soon as it starts;
                 /health/ready tells when it is done. Without it pictures are drawn in a thread.
    request_log  gets a line for each request.
    """
    settings = settings or Settings.load()
    library = Library(Folder(settings.data), settings.cache_bytes)
    writer = Writer(library)
    state = State(settings, library, writer, Jobs(settings, writer), Metrics(), Drawing(apart=warm))
    imports = Imports(library, state.jobs)

    @asynccontextmanager
    async def lifespan(_: Service) -> AsyncIterator[None]:
        library.store.clean()
        imports.start()
        warmup.start(state, warm=warm)
        yield
        imports.stop()
        state.jobs.stop()
        state.drawing.stop()

    # the framework's page of documents loads scripts from a server on the internet; pages.py has one of its own. And
    # its telemetry asks with each request whether anybody has set it up, for a fifth of a look-up
    off: Any = {"telemetry": {"tracing": False, "metrics": False, "logs": False}}
    app = Service(docs_url=None, redoc_url=None, redirect_slashes=False, lifespan=lifespan, **off)
    app.state.brdf = state
    app.layers = RequestMiddleware(evaluate.EvaluateShortCut(app.framework), state, request_log)
    app.add_middleware(ProxyHeadersMiddleware, os.environ.get("FORWARDED_ALLOW_IPS", "127.0.0.1,::1"))
    app.add_exception_handler(HTTPException, _refused_by_router)
    for module in _ROUTED:
        app.include_router(module.router)
    openapi.install(app, keyed=settings.api_key is not None)
    return app


async def _refused_by_router(request: Request, error: Exception) -> Response:
    """The router's 404 and 405, which the framework would answer before they reach the middleware."""
    answer = problem(error, request.scope["brdf.request_id"])
    if answer.status_code == 405:
        answer.headers["allow"] = ", ".join(openapi.allowed_methods(request.app.openapi(), request.scope["path"]))
    return answer


def serve(**flags: Any) -> int:
    """Serve a data folder until SIGINT or SIGTERM, and return the exit code 0.

    flags  of `Settings`, which lists them all (None: not given), before the BRDF_* variables and the defaults.

    An empty folder is filled with the starter library first. Raises `InputError` for a bad setting, `ListenError` if
    the port is in use, `StorageError` for a bad data folder.
    """
    settings = Settings.load(**flags)
    process.start_logging(settings.log_level)
    with process.bind(settings) as listener:
        start.fill(settings)
        request_log = RequestLog(sys.stderr.write)
        app = create_app(settings, request_log=request_log if settings.log_level in ("debug", "info") else None)
        try:
            process.run(app, app.state.brdf, listener)
        finally:
            request_log.flush()
    warmup.leave()
    return 0
