"""The process that draws: the library's own bytes, its errors, and what happens when it or the file goes away."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import brdf_service.work.drawing
import pytest
from brdf_service.http.errors import BusyError
from brdf_service.library.materials import Library
from brdf_service.work.drawing import Artist
from brdf_service.work.picture_queue import draw_with
from brdf_service.work.pictures import Picture, draw

import brdfcore as bc

ASKED: dict[str, Any] = {"theta_i": [0.5], "view": "polar", "scale": "linear", "channel": None, "format": "svg"}
SLICE = Picture("slice", "gold", ASKED)


@pytest.fixture(scope="module")
def shared_artist() -> Iterator[Artist]:
    made = Artist()
    yield made
    made.stop()


@pytest.fixture
def artist() -> Iterator[Artist]:
    made = Artist()
    yield made
    made.stop()


def running_in(artist: Artist) -> int:
    process = artist._process
    assert process is not None
    assert process.poll() is None
    return process.pid


@pytest.mark.parametrize("name", ["gold", "gold-grid", "red"])
@pytest.mark.parametrize(
    "picture",
    [
        SLICE,
        Picture("slice", "<x> & co", {**ASKED, "view": "hemisphere", "scale": "log", "format": "png"}),
        Picture("sphere", "ball", {"light": "sky", "size": 128, "channel": None}),
    ],
)
def test_bytes_of_the_library(shared_artist: Artist, original: Path, name: str, picture: Picture) -> None:
    material = Library(original, 2**20).get(name)
    assert shared_artist.draw(material, picture) == draw(material.brdf, picture)


def test_errors_come_back_as_they_are(shared_artist: Artist, original: Path) -> None:
    material = Library(original, 2**20).get("red")
    with pytest.raises(bc.InputError) as here:
        draw(material.brdf, Picture("slice", "", {**ASKED, "theta_i": [0.5, 2.0]}))
    with pytest.raises(bc.InputError) as there:
        shared_artist.draw(material, Picture("slice", "", {**ASKED, "theta_i": [0.5, 2.0]}))
    assert (there.value.code, there.value.detail) == (here.value.code, here.value.detail)
    assert there.value.context == here.value.context


def test_a_mistake_inside_is_one_and_leaves_the_process(shared_artist: Artist, original: Path) -> None:
    material = Library(original, 2**20).get("red")
    with pytest.raises(RuntimeError, match="traceback"):
        shared_artist.draw(material, Picture("no such kind", "", {}))
    assert shared_artist.draw(material, SLICE) is not None


def test_a_file_that_changed_is_drawn_here(artist: Artist, data: Path) -> None:
    material = Library(data, 2**20).get("gold-grid")
    (data / "gold-grid.h5").write_bytes((data / "red.h5").read_bytes())
    assert artist.draw(material, SLICE) is None
    assert draw_with(artist, material, SLICE) == draw(material.brdf, SLICE)
    (data / "gold-grid.h5").unlink()
    assert artist.draw(material, SLICE) is None


def test_killed_between_pictures(artist: Artist, original: Path) -> None:
    material = Library(original, 2**20).get("gold")
    first = artist.draw(material, SLICE)
    os.kill(running_in(artist), signal.SIGKILL)
    assert artist.draw(material, SLICE) == first


def test_one_that_takes_too_long_is_ended(artist: Artist, original: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    material = Library(original, 2**20).get("gold")
    artist.draw(material, SLICE)
    os.kill(running_in(artist), signal.SIGSTOP)  # as one that never ends
    monkeypatch.setattr(brdf_service.work.drawing, "PATIENCE", 0.2)
    with pytest.raises(BusyError) as caught:
        artist.draw(material, SLICE)
    assert caught.value.code == "drawing_failed"
    assert caught.value.context["retry_after"] > 0
    monkeypatch.undo()
    assert artist.draw(material, SLICE) is not None


def test_after_the_end_no_other_starts(artist: Artist, original: Path) -> None:
    material = Library(original, 2**20).get("gold")
    artist.draw(material, SLICE)
    pid = running_in(artist)
    artist.stop()
    assert artist.draw(material, SLICE) is None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
