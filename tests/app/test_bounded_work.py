"""Work is estimated before it begins, stops when its client is gone, and does not keep a process that is to end."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from anyio import CapacityLimiter
from brdf_service.http import bodies
from brdf_service.work.stoppable import run_stoppable
from starlette.requests import ClientDisconnect, Request
from starlette.testclient import TestClient

from tests.app.conftest import Serve, assert_problem
from tests.app.running import running

WIDE = {"model": "lambert", "parameters": {"reflectance": [0.1 + 0.8 * k / 10_000 for k in range(10_000)]}}


@pytest.mark.parametrize("number", ["1e309", "-1e309", "30,1e309", "1" + "0" * 400])
@pytest.mark.parametrize("kind", ["slice.svg", "slice.png", "slice.json", "coverage.svg", "albedo", "harmonics.png"])
def test_numbers_beyond_float64(shared_client: TestClient, kind: str, number: str) -> None:
    id = shared_client.get("/v1/materials/gold").json()["id"]
    for path in ("/v1/materials/gold", f"/v1/tables/{id}"):
        assert_problem(shared_client.get(f"{path}/{kind}", params={"theta_i": number}), 422, "not_a_number")


@pytest.mark.parametrize(
    "path",
    [
        "checks",
        "gloss",
        "fit",
        "harmonics?lmax=8",
        "harmonics.svg",
        "albedo?theta_i=0,30",
        "sphere.png",
        "slice.svg?theta_i=0",
    ],
)
def test_analyses_of_many_channels_are_refused(client: TestClient, data: Path, path: str) -> None:
    (data / "wide.json").write_text(json.dumps(WIDE))
    client.get("/v1/materials/wide")
    begun = time.perf_counter()
    content = assert_problem(client.get(f"/v1/materials/wide/{path}"), 413, "too_much_work")
    assert time.perf_counter() - begun < 2
    assert 0 < content["errors"][0]["limit"] < 10_000
    assert client.get("/v1/materials/wide/evaluate?theta_i=30&theta_o=30&delta_phi=180").status_code == 200


def _request(gone: asyncio.Event) -> Request:
    async def receive() -> dict[str, Any]:
        await gone.wait()
        return {"type": "http.disconnect"}

    return Request({"type": "http", "method": "GET", "path": "/", "headers": []}, receive)


def test_work_stops_when_its_client_is_gone() -> None:
    state = {"steps": 0, "ended": False}

    def work() -> None:
        try:
            for _ in range(10_000):
                state["steps"] += 1
                time.sleep(0.01)
        finally:
            state["ended"] = True

    async def main() -> None:
        gone, seats = asyncio.Event(), CapacityLimiter(1)
        running = asyncio.create_task(run_stoppable(_request(gone), work, seats))
        await asyncio.sleep(0.1)
        assert seats.borrowed_tokens == 1
        gone.set()
        with pytest.raises(ClientDisconnect):
            await running
        for _ in range(100):
            await asyncio.sleep(0.02)
            if not seats.borrowed_tokens:
                break
        assert seats.borrowed_tokens == 0
        assert await run_stoppable(_request(asyncio.Event()), lambda: 7, seats) == 7
        with pytest.raises(ZeroDivisionError):
            await run_stoppable(_request(asyncio.Event()), lambda: 1 // 0, seats)
        assert seats.borrowed_tokens == 0

    asyncio.run(main())
    assert state["ended"]
    assert state["steps"] < 500
    for thread in threading.enumerate():
        if thread.name == "analysis":  # the last one has told its end, and is about to end
            thread.join(5)
            assert not thread.is_alive()


def test_bodies_have_one_bound_together(serve: Serve) -> None:
    client = serve(max_held_bytes=100_000)
    room = client.app.state.brdf.bodies  # type: ignore[attr-defined]
    path, octet = "/v1/materials/gold/evaluate", {"content-type": "application/octet-stream"}
    assert client.post(path, content=np.zeros(900).tobytes(), headers=octet).status_code == 200
    assert room.held == 0
    room.held = 99_000  # as others' that still arrive
    refused = client.post(path, content=np.zeros(900).tobytes(), headers=octet)
    assert_problem(refused, 503, "bodies_full")
    assert int(refused.headers["retry-after"]) > 0
    assert room.held == 99_000
    room.held = 0
    assert client.post(path, content=np.zeros(900).tobytes(), headers=octet).status_code == 200


def test_memory_of_many_bodies_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once, after the last of them, and not after each small one."""
    given_back: list[int] = []
    monkeypatch.setattr(bodies, "_give_back", lambda: given_back.append(1))
    monkeypatch.setattr(bodies, "_AFTER", 0.0)

    async def main() -> None:
        room = bodies.Room(200 * 2**20)
        scopes: list[dict[str, Any]] = [{} for _ in range(40)]
        for scope in scopes:
            room.take(scope, 2**20)
        for scope in scopes[:-1]:
            room.release(scope)
        await asyncio.sleep(0.05)
        assert not given_back
        room.release(scopes[-1])
        room.take(scopes[0], 1000)
        room.release(scopes[0])
        await asyncio.sleep(0.05)
        assert room.held == 0

    asyncio.run(main())
    assert given_back == [1]


@pytest.mark.parametrize("encoding", ["gzip", "deflate, gzip", "br"])
def test_compressed_bodies_are_refused(shared_client: TestClient, encoding: str) -> None:
    """Taken for angles they would be answered with nonsense."""
    body = gzip.compress(np.full(3000, 0.5).tobytes())
    headers = {"content-type": "application/octet-stream", "content-encoding": encoding}
    answer = shared_client.post("/v1/materials/gold/evaluate?angles=rad", content=body, headers=headers)
    assert_problem(answer, 415, "encoding_refused")


def test_models_count_for_what_they_weigh(data: Path, serve: Serve) -> None:
    client = serve(cache_bytes=200_000)
    for k in range(40):
        (data / f"m{k}.json").write_text(json.dumps({"model": "lambert", "parameters": {"reflectance": 1 / (k + 1)}}))
        assert client.get(f"/v1/materials/m{k}").status_code == 200
    library = client.app.state.brdf.library  # type: ignore[attr-defined]
    assert library.loaded < 25
    assert library.loaded_bytes <= 200_000


@pytest.mark.slow
def test_a_process_that_is_to_end_ends(tmp_path: Path) -> None:
    """Within its drain and a second, though a projection of many channels runs; and before, that stops without its
    client."""
    values = [0.1 + 0.8 * k / 240 for k in range(240)]
    (tmp_path / "busy.json").write_text(json.dumps({"model": "lambert", "parameters": {"reflectance": values}}))
    (tmp_path / "white.json").write_text('{"model": "lambert"}')
    with running(tmp_path, "--no-starter", "--log-level", "warning", BRDF_DRAIN_SECONDS="1") as service:
        while service.ask("/health/ready").status != 200:
            time.sleep(0.2)

        def ask(seconds: float) -> None:
            with socket.create_connection(("127.0.0.1", service.port), seconds) as connection:
                connection.sendall(b"GET /v1/materials/busy/harmonics?lmax=32 HTTP/1.1\r\nhost: 127.0.0.1\r\n\r\n")
                with contextlib.suppress(OSError):
                    connection.recv(100)

        ask(1.0)  # and gone
        begun = time.monotonic()
        assert service.ask("/v1/materials/white/harmonics?lmax=2").status == 200  # it waits for that seat
        assert time.monotonic() - begun < 15
        threading.Thread(target=ask, args=(60.0,), daemon=True).start()
        time.sleep(1)
        begun = time.monotonic()
        assert service.stop()[0] == 0
        assert time.monotonic() - begun < 6
