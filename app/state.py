"""What every request handler shares: settings, library, jobs, counters, readiness, and who may work at once."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import cast

from anyio import CapacityLimiter
from brdf_service.http.bodies import Room
from brdf_service.http.metrics import Metrics
from brdf_service.library.materials import Library
from brdf_service.library.writing import Writer
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
    writer: Writer
    jobs: Jobs
    metrics: Metrics
    drawing: Drawing
    #: Expansions in spherical harmonics that were asked for.
    expansions: Expansions = field(default_factory=Expansions)
    bodies: Room = field(init=False)
    #: True once the kernels are compiled and one figure was drawn.
    ready: bool = False
    #: True once the process was told to end: what could go on for ever ends then.
    draining: bool = False

    # Threads that may work at once, of each kind: who waits for one kind must not take the seats of the others.
    #: A projection takes all cores, and seconds.
    projecting: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))
    #: Parse, evaluate and encode: more than a few a core only take the interpreter's lock from each other.
    working: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2 * (os.cpu_count() or 1)))
    #: Make lists of whole slices: mostly Python, tens of milliseconds each.
    listing: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))
    #: Answers of millions of values: each takes all cores and up to some hundred megabytes.
    large: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))

    def __post_init__(self) -> None:
        self.bodies = Room(self.settings.max_held_bytes)


def state_of(request: Request) -> State:
    """The state of the application that a request belongs to."""
    return cast(State, request.scope["brdf"])
