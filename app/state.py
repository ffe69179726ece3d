"""What every request handler shares: settings, library, readiness, and the one seat at the drawing table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

from anyio import CapacityLimiter
from starlette.requests import Request

from app.library import Library
from app.settings import Settings


@dataclass
class State:
    """One per application."""

    settings: Settings
    library: Library
    #: True once the kernels are compiled and one figure was drawn.
    ready: bool = False
    #: matplotlib shares font caches between figures and holds the interpreter's lock: drawing two at once
    #: is neither safe nor faster, and must not take the threads that evaluate needs.
    drawing: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))


def state_of(request: Request) -> State:
    """The state of the application that a request belongs to."""
    return cast(State, request.app.state.brdf)
