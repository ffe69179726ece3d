"""The outermost layer answers, counts and logs whatever happens inside; the log in batches loses no line."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest
from brdf_service.main import create_app
from brdf_service.server.request_log import RequestLog
from brdf_service.settings import Settings
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.testclient import TestClient

from tests.app.conftest import assert_problem

PATH = "/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5"


class Seen:
    """A service, its log of requests, and routes of the framework that fail."""

    def __init__(self, original: Path) -> None:
        self.written: list[str] = []
        self.log = RequestLog(self.written.append)
        app = create_app(Settings(data=original), warm=False, request_log=self.log)
        app.add_api_route("/broken", self.broken)
        app.add_api_route("/half", self.half)
        self.state = app.state.brdf
        self.client = TestClient(app, "http://127.0.0.1:8000", raise_server_exceptions=False)

    async def broken(self) -> None:
        raise RuntimeError("secret of the house")

    async def half(self, request: Request) -> Response:
        async def pieces() -> AsyncIterator[bytes]:
            yield b"half"
            raise RuntimeError("secret of the house")

        return StreamingResponse(pieces())

    def lines(self) -> list[dict[str, Any]]:
        """The lines that were logged since this was last asked."""
        self.log.flush()
        found = [json.loads(line) for line in "".join(self.written).splitlines()]
        self.written.clear()
        return found


@pytest.fixture(scope="module")
def seen(original: Path) -> Iterator[Seen]:
    made = Seen(original)
    with made.client:
        yield made


def test_the_caller_s_id_is_kept_if_it_is_safe(seen: Seen) -> None:
    for id, kept in ((b"mine-1", True), (b"a b", False), (b"x" * 65, False), (b"\xff", False)):
        answer = seen.client.get(PATH, headers={"x-request-id": id})
        assert (answer.headers["x-request-id"].encode() == id) == kept


def test_request_ids_differ(seen: Seen) -> None:
    ids = [seen.client.get("/health/live").headers["x-request-id"] for _ in range(20)]
    assert len(set(ids)) == 20
    assert all(len(i) == 16 for i in ids)


def test_counted_and_logged(seen: Seen) -> None:
    before, _ = seen.state.metrics.lookups, seen.lines()
    answer = seen.client.get(PATH)
    assert seen.state.metrics.lookups == before + 1
    (line,) = seen.lines()
    assert line["id"] == answer.headers["x-request-id"]
    assert (line["method"], line["route"], line["status"]) == ("GET", "/v1/materials/{name}/evaluate", 200)
    assert line["bytes"] == len(answer.content)
    assert seen.state.metrics.running == 0


def test_an_error_in_a_route(seen: Seen, caplog: pytest.LogCaptureFixture) -> None:
    seen.lines()
    answer = seen.client.get("/broken")
    content = assert_problem(answer, 500, "internal_error")
    assert "secret" not in answer.text
    assert "secret of the house" in caplog.text
    assert content["request_id"] in caplog.text
    (line,) = seen.lines()
    assert (line["route"], line["status"]) == ("/broken", 500)


def test_an_error_in_half_an_answer(seen: Seen, caplog: pytest.LogCaptureFixture) -> None:
    """The server has to see it: a connection that breaks is all that can still be said."""
    seen.lines()
    with pytest.raises(RuntimeError, match="secret"):
        TestClient(seen.client.app, "http://127.0.0.1:8000").get("/half")
    assert "secret of the house" in caplog.text
    (line,) = seen.lines()
    assert (line["route"], line["status"], line["bytes"]) == ("/half", 200, 4)
    assert seen.state.metrics.running == 0


def test_log_lines_are_written_together() -> None:
    written: list[str] = []

    async def work() -> None:
        log = RequestLog(written.append)
        for _ in range(3):
            log.request("id", "GET", "/", 200, 0.001, 5)
        assert written == []
        await asyncio.sleep(0.1)
        assert [w.count("\n") for w in written] == [3]
        for k in range(450):
            log.request(str(k), "GET", "/", 200, 0.001, 5)
        assert [w.count("\n") for w in written] == [3, 200, 200]
        log.flush()
        log.flush()
        assert [w.count("\n") for w in written] == [3, 200, 200, 50]
        lines = [json.loads(line) for line in "".join(written[1:]).splitlines()]
        assert [line["id"] for line in lines] == [str(k) for k in range(450)]

    asyncio.run(work())


def test_a_log_that_nobody_reads() -> None:
    def gone(_: str) -> None:
        raise BrokenPipeError

    async def work() -> None:
        log = RequestLog(gone)
        for _ in range(450):
            log.request("id", "GET", "/", 200, 0.001, 5)
        log.flush()

    asyncio.run(work())
