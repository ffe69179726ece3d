"""The short way of one value and the long one give the same answer; the log in batches loses no line."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.main import create_app
from brdf_service.server.outbox import Outbox
from brdf_service.server.quick import Quick
from brdf_service.server.request_log import AccessLog
from brdf_service.settings import Settings
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, local

NAMES = ["gold-grid", "red", "gold", "mirror"]


@pytest.fixture(scope="module")
def ready(original: Path) -> Any:
    """A service that answers single values in the event loop."""
    app = create_app(Settings(data=original), warm=False)
    with TestClient(app, base_url="http://127.0.0.1:8000", raise_server_exceptions=False) as client:
        for name in NAMES:  # loaded, or every first answer would go the long way
            assert client.get(f"/v1/materials/{name}/evaluate?theta_i=1&theta_o=1&delta_phi=1").status_code == 200
        assert app.state.brdf.ready
        yield client


def said(answer: Any) -> tuple[Any, ...]:
    """All of an answer that is not its own: not its id, not its time."""
    headers = {k: v for k, v in answer.headers.items() if k not in ("x-request-id", "server-timing")}
    content = answer.content
    if answer.status_code >= 400:
        content = {k: v for k, v in answer.json().items() if k != "request_id"}
    return answer.status_code, sorted(headers.items()), content


def at_once(client: Any, path: str, **headers: str) -> Any:
    """What the server's protocol would answer by itself: `said` of it, or None."""
    sent = [(name.lower().encode(), value.encode()) for name, value in {**client.headers, **headers}.items()]
    host = (b"host", b"127.0.0.1:8000")
    answer = Quick(client.app.state.brdf)(path.encode(), [host, *sent], b"date: then\r\n")
    if answer is None:
        return None
    head, _, body = answer.partition(b"\r\n\r\n")
    status, *lines = head.decode("ascii").split("\r\n")
    assert status == "HTTP/1.1 200 OK"
    pairs = [tuple(line.split(": ", 1)) for line in lines]
    found = dict(pairs)
    assert len(found) == len(pairs)
    assert found.pop("date") == "then"
    own = found.pop("x-request-id"), found.pop("server-timing")
    assert all(own)
    return 200, sorted(found.items()), body


def both_ways(client: Any, path: str, **headers: str) -> tuple[Any, Any, bool]:
    """The short answer where there is one, the long answer, and whether there was a short one."""
    short, long = at_once(client, path, **headers), said(client.get(path, headers=headers))
    return (long if short is None else short), long, short is not None


ANGLE = st.one_of(
    st.floats(0, 90).map(repr),
    st.floats(-400, 400).map(repr),
    st.sampled_from(["0", "90", "-0", "+30", "1e1", ".5", "5.", "90.0000001", "1e400", "nan", "1,2", "", "0x1", "1_0"]),
)


@given(st.sampled_from(NAMES), ANGLE, ANGLE, ANGLE, st.sampled_from(["", "&angles=deg", "&angles=rad", "&status=true"]))
def test_same_answer(ready: TestClient, name: str, i: str, o: str, d: str, rest: str) -> None:
    short, long, _ = both_ways(ready, f"/v1/materials/{name}/evaluate?theta_i={i}&theta_o={o}&delta_phi={d}{rest}")
    assert short == long


@pytest.mark.parametrize("name", NAMES)
def test_taken_and_the_library_s_bits(ready: TestClient, original: Path, name: str) -> None:
    brdf = local(original, name)
    for angles in ((30.0, 41.5, 179.0), (0.0, 90.0, -500.0), (89.999, 3.25, 0.1)):
        query = "theta_i={}&theta_o={}&delta_phi={}".format(*angles)
        short, long, taken = both_ways(ready, f"/v1/materials/{name}/evaluate?{query}")
        assert taken
        assert short == long
        assert json.loads(short[2])["values"] == [brdf.evaluate(*np.radians(angles)).tolist()]
    id = ready.get(f"/v1/materials/{name}").json()["id"]
    short, long, taken = both_ways(ready, f"/v1/tables/{id}/evaluate?theta_i=0.5&theta_o=0.25&delta_phi=3&angles=rad")
    assert taken
    assert short == long
    assert json.loads(short[2])["values"] == [brdf.evaluate(0.5, 0.25, 3.0).tolist()]


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5", {"Accept": "application/octet-stream"}),
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5", {"Accept": "text/html"}),
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5", {"If-None-Match": '"x"'}),
        ("/v1/materials/gold/evaluate?theta_i=95&theta_o=4&delta_phi=5", {}),
        ("/v1/materials/golld/evaluate?theta_i=3&theta_o=4&delta_phi=5", {}),
        ("/v1/tables/0/evaluate?theta_i=3&theta_o=4&delta_phi=5", {}),
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5&outside=clip", {}),
        ("/v1/materials/gold/evaluate?theta_o=3&theta_i=4&delta_phi=5", {}),
    ],
)
def test_other_questions_go_the_long_way(ready: TestClient, path: str, headers: dict[str, str]) -> None:
    short, long, taken = both_ways(ready, path, **headers)
    assert not taken
    assert short == long


def test_a_request_with_more_to_it_goes_the_long_way(ready: Any) -> None:
    path = "/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5"
    assert at_once(ready, path) is not None
    for more in (
        {"Content-Length": "3"},
        {"Transfer-Encoding": "chunked"},
        {"Expect": "100-continue"},
        {"Upgrade": "h2c"},
        {"If-None-Match": "*"},
    ):
        assert at_once(ready, path, **more) is None, more
    ask = Quick(ready.app.state.brdf)
    for hosts in ([], [b"evil.example"], [b"127.0.0.1:8000"] * 2):
        assert ask(path.encode(), [(b"host", host) for host in hosts], b"") is None
    assert ask(path.encode() + b"0" * 400, [(b"host", b"127.0.0.1:8000")], b"") is None


def test_the_caller_s_id_is_kept_if_it_is_safe(ready: Any) -> None:
    path = b"/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5"
    for id, kept in ((b"mine-1", True), (b"a b", False), (b"x" * 65, False), (b"\xff", False)):
        answer = Quick(ready.app.state.brdf)(path, [(b"host", b"127.0.0.1:8000"), (b"x-request-id", id)], b"")
        assert answer is not None
        assert (b"x-request-id: %b\r\n" % id in answer) == kept


def test_counted_and_logged(ready: Any) -> None:
    state = ready.app.state.brdf
    lines: list[str] = []
    before = state.metrics.lookups
    state.access_log = lines.append
    try:
        short, _, _ = both_ways(ready, "/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5")
    finally:
        state.access_log = None
    assert state.metrics.lookups == before + 2
    first, second = ({**json.loads(line), "id": 0, "ms": 0, "time": 0} for line in lines)
    assert first == second
    assert first["bytes"] == len(short[2])


def test_what_fails_at_once_goes_the_long_way(
    ready: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("something unforeseen")

    monkeypatch.setattr(ready.app.state.brdf.library, "peek", broken)
    assert at_once(ready, "/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5") is None
    assert "something unforeseen" in caplog.text


def test_outbox() -> None:
    class Transport(asyncio.Transport):
        def __init__(self, closing: bool = False) -> None:
            super().__init__()
            self.closing, self.got = closing, b""

        def is_closing(self) -> bool:
            return self.closing

        def write(self, data: bytes | bytearray | memoryview) -> None:
            self.got += data

    async def work() -> None:
        loop, outbox = asyncio.get_running_loop(), Outbox()
        a, b, gone = Transport(), Transport(), Transport(closing=True)
        order: list[bytes] = []
        for transport, answer in ((a, b"1"), (b, b"2"), (gone, b"3")):
            outbox.put(loop, transport, answer)
        loop.call_soon(lambda: order.append(a.got))  # whatever is scheduled later comes later
        assert (a.got, outbox.holds(a), outbox.holds(Transport())) == (b"", True, False)
        await asyncio.sleep(0)
        assert (a.got, b.got, gone.got, outbox.holds(a), order) == (b"1", b"2", b"", False, [b"1"])
        outbox.put(loop, a, b"4")
        outbox.send()
        assert a.got == b"14"
        await asyncio.sleep(0)
        assert a.got == b"14"

    asyncio.run(work())


def test_unchanged(ready: TestClient) -> None:
    path = "/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5"
    tag = ready.get(path).headers["etag"]
    assert ready.get(path, headers={"If-None-Match": tag}).status_code == 304


def test_limits_hold(serve: Serve) -> None:
    client = serve(max_values=2)
    path = "/v1/materials/red/evaluate?theta_i=3&theta_o=4&delta_phi=5"
    for _ in range(2):
        assert_problem(client.get(path), 413, "too_many_values")


def test_changed_and_deleted_files_are_noticed(data: Path, client: TestClient) -> None:
    path = "/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5"
    first = [client.get(path) for _ in range(3)][-1]
    (data / "gold.json").write_text(json.dumps({"model": "lambert", "parameters": {"reflectance": 1.0}}))
    second = client.get(path)
    assert second.json()["values"] == [[1 / np.pi]] != first.json()["values"]
    (data / "gold.json").unlink()
    assert_problem(client.get(path), 404, "unknown_material")


def test_one_value_of_the_library_is_that_of_a_list() -> None:
    materials = [
        bc.model("cook_torrance", roughness=0.2, ior="gold"),
        bc.tabulate(bc.model("lambert", reflectance=[0.1, 0.2, 0.3]), "angle_grid", shape=(4, 4, 5)),
        bc.model("mirror", ior="silver") + bc.model("lambert"),
    ]
    rng = np.random.default_rng(4)
    for b in materials:
        for i, o, d in zip(*(rng.random((2, 40)) * np.pi / 2), rng.random(40) * 20 - 10, strict=True):
            one = b.evaluate(float(i), float(o), float(d))
            many = b.evaluate(np.array([i]), np.array([o]), np.array([d]))
            assert one.shape == (len(b.channels),)
            assert one.tobytes() == many.tobytes()
        assert b.evaluate(np.float32(0.5), np.float32(0.5), np.float32(1)).dtype == np.float32
        for bad in (-1e-9, 1.6, np.nan, np.inf):
            with pytest.raises(bc.InputError, match="theta_i"):
                b.evaluate(bad, 0.1, 0.1)


def test_log_lines_are_written_together() -> None:
    written: list[str] = []

    async def work() -> None:
        log = AccessLog(written.append)
        for k in range(3):
            log(f"{k}\n")
        assert written == []
        await asyncio.sleep(0.1)
        assert written == ["0\n1\n2\n"]
        for k in range(450):
            log(f"{k}\n")
        assert [w.count("\n") for w in written] == [3, 200, 200]
        log.flush()
        log.flush()
        assert "".join(written) == "0\n1\n2\n" + "".join(f"{k}\n" for k in range(450))

    asyncio.run(work())


def test_a_log_that_nobody_reads() -> None:
    def gone(_: str) -> None:
        raise BrokenPipeError

    async def work() -> None:
        log = AccessLog(gone)
        for k in range(450):
            log(f"{k}\n")
        log.flush()

    asyncio.run(work())


def test_request_ids_differ(ready: TestClient) -> None:
    ids = [ready.get("/health/live").headers["x-request-id"] for _ in range(20)]
    assert len(set(ids)) == 20
    assert all(len(i) == 16 for i in ids)
