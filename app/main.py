"""The application, and `serve`, which `brdf serve` calls."""

from __future__ import annotations

import gc
import logging
import os
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractContextManager, asynccontextmanager, contextmanager, nullcontext
from os import PathLike
from pathlib import Path
from typing import Any

from brdf_service.http import openapi
from brdf_service.http.errors import problem
from brdf_service.http.metrics import Metrics
from brdf_service.library.materials import Library
from brdf_service.library.writing import Store
from brdf_service.routes import evaluate, health, jobs, materials, pages, pareto, relight, writing
from brdf_service.server import process
from brdf_service.server.middleware import Boundary
from brdf_service.server.request_log import AccessLog
from brdf_service.server.warmup import warm_up
from brdf_service.settings import Settings
from brdf_service.state import State
from brdf_service.work.drawing import Drawing
from brdf_service.work.jobs import Jobs
from fastapi import FastAPI
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

import brdfcore as bc

#: Name of the thread that compiles the kernels.
WARM_UP = "warm-up"


def create_app(settings: Settings | None = None, *, warm: bool = True) -> FastAPI:
    """The application over a data folder.

    settings  default: BRDF_* variables and defaults.
    warm      compile the kernels and start a process that draws, in the background, as soon as it starts;
              /health/ready tells when it is done. Without it pictures are drawn in a thread.
    """
    settings = settings or Settings.load()
    library = Library(settings.data, settings.cache_bytes)
    store = Store(library)
    state = State(settings, library, store, Jobs(settings, store), Metrics(), Drawing(apart=warm))

    def warm_then_ready() -> None:
        if warm:
            warm_up(state.library, state.drawing)
            # what is loaded by now stays: the collector need not look through it again and again
            gc.collect()
            gc.freeze()
        state.ready = True

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        state.jobs.clean()
        # a daemon: a service that is told to stop does not wait for the compiler
        threading.Thread(target=warm_then_ready, name=WARM_UP, daemon=True).start()
        yield
        state.jobs.stop()
        state.drawing.stop()

    app = Service(
        docs_url=None,  # the framework's page loads scripts from a server on the internet; pages.py has one of its own
        redoc_url=None,
        redirect_slashes=False,
        lifespan=lifespan,
    )
    app.wrap(state)
    app.state.brdf = state
    for kind in (HTTPException, bc.BrdfError):
        app.add_exception_handler(kind, _problem)
    app.add_exception_handler(Exception, _failure)
    for router in (
        evaluate.router,
        relight.router,
        materials.router,
        writing.router,
        pareto.router,
        jobs.router,
        health.router,
        pages.router,
    ):
        app.include_router(router)
    openapi.install(app, keyed=settings.api_key is not None)
    return app


class Service(FastAPI):
    """The framework's application inside our own layers, which each request passes first."""

    _layers: ASGIApp | None = None

    def wrap(self, state: State) -> None:
        """Put the layers around it."""
        self._layers = Boundary(evaluate.EvaluateShortCut(super().__call__), state)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and self._layers is not None:
            await self._layers(scope, receive, send)
        else:
            await super().__call__(scope, receive, send)


async def _failure(request: Request, error: Exception) -> Response:
    """What went wrong inside; the framework raises it again afterwards, and the boundary puts it into the log."""
    request.scope["brdf.failed"] = True
    return problem(error, request.scope["brdf.request_id"])


async def _problem(request: Request, error: Exception) -> Response:
    answer = problem(error, request.scope["brdf.request_id"])
    if answer.status_code == 405:
        answer.headers["allow"] = ", ".join(openapi.allowed_methods(request.app.openapi(), request.scope["path"]))
    return answer


def serve(
    host: str | None = None,
    port: int | None = None,
    data: str | PathLike[str] | None = None,
    starter: bool | None = None,
    log_level: str | None = None,
    **flags: Any,
) -> int:
    """Serve a data folder until SIGINT or SIGTERM, and return the exit code 0.

    Arguments left None come from the BRDF_* variables, then from the defaults of `Settings`, which lists them all.
    An empty folder is filled with the starter library first.

    Raises `InputError` for a bad setting, `ListenError` if the port is in use, `StorageError` for a bad data folder.
    """
    settings = Settings.load(host=host, port=port, data=data, starter=starter, log_level=log_level, **flags)
    process.start_logging(settings.log_level)
    with process.bind(settings) as listener:
        _fill(settings)
        app = create_app(settings)
        access_log = AccessLog(sys.stderr.write)
        if settings.log_level in ("debug", "info"):
            app.state.brdf.access_log = access_log
        try:
            process.run(app, app.state.brdf, listener)
        finally:
            access_log.flush()
    _leave_the_compiler()
    return 0


def _leave_the_compiler() -> None:
    """Wait a little for a warm-up that is still compiling, then end the process without it.

    The interpreter ends a daemon thread wherever it is; inside the compiler's C++ frames that aborts the process.
    """
    warming = [t for t in threading.enumerate() if t.name == WARM_UP]
    for thread in warming:
        thread.join(3)
    if any(t.is_alive() for t in warming):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _fill(settings: Settings) -> None:
    """Make the data folder, and the starter library if it holds no material and that is wanted.

    A hidden file marks a library that is being built, so that a start that was interrupted is finished by the next.
    """
    unfinished = settings.data / ".starter-unfinished"
    try:
        settings.data.mkdir(parents=True, exist_ok=True)
        empty = not any(p.suffix in (".h5", ".json") for p in settings.data.iterdir())
        wanted = settings.starter and (empty or unfinished.exists())
        if wanted:
            unfinished.touch()
    except OSError as error:
        raise bc.StorageError(
            "data_folder",
            f"{settings.data}: cannot be used as the data folder ({error.strerror}); choose another with --data",
            where="data",
        ) from error
    if not wanted:
        return
    with _progress(settings.data) as progress:
        bc.starter_library(settings.data, progress=progress)
    unfinished.unlink(missing_ok=True)


def _progress(folder: Path) -> AbstractContextManager[Callable[[int, int, str], None] | None]:
    """A progress bar on a terminal; elsewhere a line, so that a log is not full of bars."""
    print(f"building the starter library in {folder}", file=sys.stderr, flush=True)
    return _bar() if sys.stderr.isatty() else nullcontext(None)


@contextmanager
def _bar() -> Iterator[Callable[[int, int, str], None]]:
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def progress(done: int, total: int, stage: str) -> None:
            bar.update(task, completed=done, total=total, description=stage)

        yield progress
