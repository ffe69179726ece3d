"""What every request handler shares: settings, library, jobs, counters, readiness, and who may work at once."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

from anyio import CapacityLimiter
from brdf_service.http.metrics import Metrics
from brdf_service.library.materials import Library
from brdf_service.library.writing import Store
from brdf_service.server.request import Hosts
from brdf_service.settings import Settings
from brdf_service.work.drawing import Drawing
from brdf_service.work.expansions import Expansions
from brdf_service.work.jobs import Jobs
from starlette.requests import Request


@dataclass
class State:
    """One per application."""

    settings: Settings
    library: Library
    store: Store
    jobs: Jobs
    metrics: Metrics
    drawing: Drawing
    #: Takes the line that each request leaves in the log; None: no such log.
    access_log: Callable[[str], object] | None = None
    #: Expansions in spherical harmonics that were asked for.
    expansions: Expansions = field(default_factory=Expansions)
    #: True once the kernels are compiled and one figure was drawn.
    ready: bool = False
    #: True once the process was told to end: what could go on for ever ends then.
    draining: bool = False
    #: A projection takes all cores, and seconds: those who wait for one must not take the seats of the others.
    projecting: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))
    #: Threads that parse, evaluate and encode: many more than there are cores only take the interpreter's lock from
    #: each other and from the event loop.
    working: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2 * (os.cpu_count() or 1)))
    #: Threads that make lists of whole slices: mostly Python, tens of milliseconds each, and they must not keep the
    #: seats of those that evaluate.
    listing: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))
    #: Answers of millions of values at once: each takes all cores and up to some hundred megabytes, and must not
    #: take the seats of the others.
    large: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))

    #: Host headers that were found good.
    hosts: Hosts = field(init=False)

    def __post_init__(self) -> None:
        self.hosts = Hosts(self.settings)

    def drain(self) -> None:
        """The process was told to end."""
        self.draining = True


def state_of(request: Request) -> State:
    """The state of the application that a request belongs to."""
    return cast(State, request.scope["brdf.state"])
