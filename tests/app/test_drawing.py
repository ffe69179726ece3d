"""Drawing: the library's own bytes and errors from a process that may go away, once for all who ask meanwhile."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from brdf_service.http.errors import BusyError
from brdf_service.library.folder import Folder
from brdf_service.library.materials import Library
from brdf_service.work.drawing import FIRST_SECONDS, PATIENCE, Drawing
from brdf_service.work.pictures import Picture, draw

import brdfcore as bc

ASKED: dict[str, Any] = {"theta_i": [0.5], "view": "polar", "scale": "linear", "channel": None, "format": "svg"}
SLICE = Picture("slice", "gold", ASKED)


@pytest.fixture(scope="module")
def shared() -> Iterator[Drawing]:
    made = Drawing(apart=True)
    yield made
    made.stop()


@pytest.fixture
def drawing() -> Iterator[Drawing]:
    made = Drawing(apart=True)
    yield made
    made.stop()


def running_in(drawing: Drawing) -> int:
    child = drawing._workers[0].child
    assert child is not None
    assert child.process.poll() is None
    return child.process.pid


@pytest.mark.parametrize("name", ["gold", "gold-grid", "red"])
@pytest.mark.parametrize(
    "picture",
    [
        SLICE,
        Picture("slice", "<x> & co", {**ASKED, "view": "hemisphere", "scale": "log", "format": "png"}),
        Picture("sphere", "ball", {"light": "sky", "size": 128, "channel": None}),
    ],
)
def test_bytes_of_the_library(shared: Drawing, original: Path, name: str, picture: Picture) -> None:
    material = Library(Folder(original), 2**20).get(name)
    assert shared._drawn_apart(material, picture) == draw(material.brdf, picture)


def test_errors_come_back_as_they_are(shared: Drawing, original: Path) -> None:
    material = Library(Folder(original), 2**20).get("red")
    with pytest.raises(bc.InputError) as here:
        draw(material.brdf, Picture("slice", "", {**ASKED, "theta_i": [0.5, 2.0]}))
    with pytest.raises(bc.InputError) as there:
        shared.draw(material, Picture("slice", "", {**ASKED, "theta_i": [0.5, 2.0]}))
    assert (there.value.code, there.value.detail) == (here.value.code, here.value.detail)
    assert there.value.context == here.value.context


def test_a_mistake_inside_is_one_and_leaves_the_process(shared: Drawing, original: Path) -> None:
    material = Library(Folder(original), 2**20).get("red")
    with pytest.raises(RuntimeError, match="traceback"):
        shared.draw(material, Picture("no such kind", "", {}))
    assert shared.draw(material, SLICE) is not None


def test_a_file_that_changed_is_drawn_here(drawing: Drawing, data: Path) -> None:
    material = Library(Folder(data), 2**20).get("gold-grid")
    (data / "gold-grid.h5").write_bytes((data / "red.h5").read_bytes())
    assert drawing._drawn_apart(material, SLICE) is None
    assert drawing.draw(material, SLICE) == draw(material.brdf, SLICE)
    (data / "gold-grid.h5").unlink()
    assert drawing._drawn_apart(material, SLICE) is None


def test_killed_between_pictures(drawing: Drawing, original: Path) -> None:
    material = Library(Folder(original), 2**20).get("gold")
    first = drawing.draw(material, SLICE)
    os.kill(running_in(drawing), signal.SIGKILL)
    assert drawing.draw(material, SLICE) == first


def test_one_that_takes_too_long_is_ended(drawing: Drawing, original: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    material = Library(Folder(original), 2**20).get("gold")
    drawing.draw(material, SLICE)
    os.kill(running_in(drawing), signal.SIGSTOP)  # as one that never ends
    monkeypatch.setattr("brdf_service.work.drawing.PATIENCE", 0.2)
    with pytest.raises(BusyError) as caught:
        drawing.draw(material, SLICE)
    assert caught.value.code == "drawing_failed"
    assert caught.value.context["retry_after"] > 0
    monkeypatch.undo()
    assert drawing.draw(material, SLICE) is not None


def test_after_the_end_no_other_starts(drawing: Drawing, original: Path) -> None:
    material = Library(Folder(original), 2**20).get("gold")
    drawing.draw(material, SLICE)
    pid = running_in(drawing)
    drawing.stop()
    assert drawing._drawn_apart(material, SLICE) is None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_equal_requests_are_drawn_once() -> None:
    calls, goes_on = [], threading.Event()

    def draw() -> bytes:
        calls.append(1)
        goes_on.wait(10)
        return b"picture"

    async def work(drawing: Drawing) -> list[bytes]:
        first = [asyncio.create_task(drawing.made("a", draw)) for _ in range(20)]
        await asyncio.sleep(0.05)
        first[0].cancel()  # its caller went away
        goes_on.set()
        return [*await asyncio.gather(*first[1:]), await drawing.made("a", draw)]

    assert asyncio.run(work(Drawing(apart=False))) == [b"picture"] * 20
    assert len(calls) == 1


def test_a_failure_reaches_all_and_is_not_kept() -> None:
    def fail() -> bytes:
        raise bc.InputError("bad", "no such picture")

    async def work(drawing: Drawing) -> Any:
        failed = await asyncio.gather(*(drawing.made("a", fail) for _ in range(3)), return_exceptions=True)
        return failed, await drawing.made("a", lambda: b"later"), len(drawing._making)

    failed, later, left = asyncio.run(work(Drawing(apart=False)))
    assert [type(f) for f in failed] == [bc.InputError] * 3
    assert later == b"later"
    assert left == 0


def test_so_many_may_wait() -> None:
    goes_on = threading.Event()

    def draw() -> bytes:
        goes_on.wait(10)
        return b""

    async def work(drawing: Drawing) -> int:
        waiting = [asyncio.create_task(drawing.made(str(k), draw)) for k in range(int(PATIENCE / FIRST_SECONDS))]
        await asyncio.sleep(0.05)
        with pytest.raises(BusyError) as caught:
            await drawing.made("one more", draw)
        goes_on.set()
        await asyncio.gather(*waiting)
        return int(caught.value.context["retry_after"])

    assert asyncio.run(work(Drawing(apart=False))) > 0


def test_nobody_waits_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer or a refusal in time; what was begun is there for who asks again, what was not is not drawn at all."""
    monkeypatch.setattr("brdf_service.work.drawing.PATIENCE", 0.2)
    goes_on, calls = threading.Event(), []

    def draw(name: str) -> bytes:
        calls.append(name)
        goes_on.wait(10)
        return name.encode()

    async def work(drawing: Drawing) -> None:
        asked = [drawing.made(name, partial(draw, name)) for name in ("begun", "waits", "begun")]
        for failed in await asyncio.gather(*asked, return_exceptions=True):
            assert isinstance(failed, BusyError)
            assert failed.context["retry_after"] > 0
        goes_on.set()
        assert await drawing.made("begun", partial(draw, "begun")) == b"begun"

    asyncio.run(work(Drawing(apart=False)))
    assert calls == ["begun"]
