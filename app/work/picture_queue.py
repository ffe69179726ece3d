"""Pictures: kept by ETag, drawn one at a time, and once for all who ask for the same one meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from anyio.to_thread import run_sync
from brdf_service.http.errors import BusyError
from brdf_service.library.materials import Material
from brdf_service.state import State
from brdf_service.work.drawing import Artist
from brdf_service.work.pictures import Picture, draw

#: Pictures that may wait to be drawn; a start page shows 24. Each takes a twentieth of a second, a sphere a quarter.
WAITING = 256
_RETRY = 5


async def picture(state: State, etag: str, draw: Callable[[], bytes]) -> bytes:
    """The picture of that ETag: kept, being drawn already, or what `draw` returns (called in a thread).

    Raises what `draw` raises, `BusyError` if too many wait.
    """
    held = state.pictures.get(etag)
    if held is not None:
        return held
    task = state.drawn.get(etag)
    if task is None:
        if len(state.drawn) >= WAITING:
            raise BusyError(
                "too_many_pictures",
                f"{len(state.drawn)} pictures wait to be drawn already; try again later",
                got=len(state.drawn),
                limit=WAITING,
                retry_after=_RETRY,
            )
        task = state.drawn[etag] = asyncio.create_task(_drawn(state, etag, draw))
        task.add_done_callback(_seen)
    # one who goes away does not take the picture from the others
    return await asyncio.shield(task)


def draw_with(artist: Artist | None, material: Material, wanted: Picture) -> bytes:
    """The picture by the process that draws; here, where there is none or the material's file has changed."""
    made = artist.draw(material, wanted) if artist is not None else None
    return made if made is not None else draw(material.brdf, wanted)


async def _drawn(state: State, etag: str, draw: Callable[[], bytes]) -> bytes:
    try:
        made = await run_sync(draw, limiter=state.drawing)
        state.pictures.put(etag, made, len(made))
        return made
    finally:
        del state.drawn[etag]


def _seen(task: asyncio.Task[bytes]) -> None:
    """An error of which all who waited have gone away is no news for the log."""
    if not task.cancelled():
        task.exception()
