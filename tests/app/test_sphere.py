"""The sphere over HTTP: the library's own picture, its limits, its caching; one drawing for all who ask at once."""

from __future__ import annotations

import asyncio
import io
import threading
from pathlib import Path
from typing import Any

import pytest
from brdf_service.http.errors import BusyError
from brdf_service.library.lru import ByteLru
from brdf_service.state import State
from brdf_service.work.picture_queue import WAITING, picture
from PIL import Image
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import assert_problem, local


@pytest.mark.parametrize("name", ["gold-grid", "red", "mirror", "gold"])
def test_picture(shared_client: TestClient, original: Path, name: str) -> None:
    answer = shared_client.get(f"/v1/materials/{name}/sphere.png?size=230")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "image/png"
    assert answer.headers["cache-control"] == "no-cache"
    assert Image.open(io.BytesIO(answer.content)).size == (230, 250)
    figure = bc.plot.sphere(local(original, name), title=name, size=(4.6, 5.0), dpi=50)
    assert answer.content == bc.plot.render(figure, "png")
    again = {"If-None-Match": answer.headers["etag"]}
    assert shared_client.get(f"/v1/materials/{name}/sphere.png?size=230", headers=again).status_code == 304
    other = shared_client.get(f"/v1/materials/{name}/sphere.png?size=230&light=sky", headers=again)
    assert other.status_code == 200
    permanent = shared_client.get(answer.headers["content-location"])
    assert permanent.status_code == 200
    assert "immutable" in permanent.headers["cache-control"]


@pytest.mark.parametrize(
    ("query", "code", "where"),
    [
        ("size=127", "bad_number", "size"),
        ("size=1025", "bad_number", "size"),
        ("size=1e3", "bad_number", "size"),
        ("light=moon", "bad_choice", "light"),
        ("channel=X", "unknown_channel", "channel"),
        ("theta_i=30", "unknown_parameter", "query"),
    ],
)
def test_refusals(shared_client: TestClient, query: str, code: str, where: str) -> None:
    content = assert_problem(shared_client.get(f"/v1/materials/red/sphere.png?{query}"), 422, code)
    assert content["errors"][0]["where"] == where


def test_link_and_document(shared_client: TestClient) -> None:
    links = shared_client.get("/v1/materials/red").json()["links"]
    assert shared_client.get(links["sphere"]).status_code == 200
    assert links["sphere"] in shared_client.get("/materials/red").text
    paths = shared_client.get("/openapi.json").json()["paths"]
    assert "/v1/materials/{name}/sphere.png" in paths
    assert "/v1/tables/{id}/sphere.png" in paths


class _Pictures:
    """Of a `State` what drawing needs."""

    def __init__(self) -> None:
        from anyio import CapacityLimiter

        self.pictures: ByteLru[str, bytes] = ByteLru(1000)
        self.drawn: dict[str, Any] = {}
        self.drawing = CapacityLimiter(1)


def drawn_with(work: Any) -> Any:
    made: Any = _Pictures()
    state: State = made
    return asyncio.run(work(state))


def test_equal_requests_are_drawn_once() -> None:
    calls, goes_on = [], threading.Event()

    def draw() -> bytes:
        calls.append(1)
        goes_on.wait(10)
        return b"picture"

    async def work(state: State) -> list[bytes]:
        first = [asyncio.create_task(picture(state, "a", draw)) for _ in range(20)]
        await asyncio.sleep(0.05)
        first[0].cancel()  # its caller went away
        goes_on.set()
        return [*await asyncio.gather(*first[1:]), await picture(state, "a", draw)]

    assert drawn_with(work) == [b"picture"] * 20
    assert len(calls) == 1


def test_a_failure_reaches_all_and_is_not_kept() -> None:
    def fail() -> bytes:
        raise bc.InputError("bad", "no such picture")

    async def work(state: State) -> Any:
        failed = await asyncio.gather(*(picture(state, "a", fail) for _ in range(3)), return_exceptions=True)
        return failed, await picture(state, "a", lambda: b"later"), dict(state.drawn)

    failed, later, left = drawn_with(work)
    assert [type(f) for f in failed] == [bc.InputError] * 3
    assert later == b"later"
    assert left == {}


def test_so_many_may_wait() -> None:
    goes_on = threading.Event()

    def draw() -> bytes:
        goes_on.wait(10)
        return b""

    async def work(state: State) -> int:
        waiting = [asyncio.create_task(picture(state, str(k), draw)) for k in range(WAITING)]
        await asyncio.sleep(0.05)
        with pytest.raises(BusyError) as caught:
            await picture(state, "one more", draw)
        goes_on.set()
        await asyncio.gather(*waiting)
        return int(caught.value.context["retry_after"])

    assert drawn_with(work) > 0
