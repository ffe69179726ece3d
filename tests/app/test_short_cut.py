"""Look-ups answered in front of the framework are those of its own routes, and the library's to the last bit."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from brdf_service import main
from brdf_service.main import create_app
from brdf_service.server.middleware import RequestMiddleware
from brdf_service.server.request_log import RequestLog
from brdf_service.settings import Settings
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, local

NAMES = ["gold-grid", "red", "gold", "mirror"]
Both = tuple[TestClient, TestClient]


@pytest.fixture(scope="module")
def both(original: Path) -> Iterator[Both]:
    """A service, and one whose framework answers all."""
    short, long = (create_app(Settings(data=original), warm=False) for _ in range(2))
    long.layers = RequestMiddleware(long.framework, long.state.brdf, None)
    url = "http://127.0.0.1:8000"
    with TestClient(short, url, False) as one, TestClient(long, url, False) as other:
        yield one, other


def said(answer: Any) -> tuple[Any, ...]:
    """All of an answer that is not its own: not its id, not its time."""
    headers = {k: v for k, v in answer.headers.items() if k not in ("x-request-id", "server-timing")}
    content = answer.content
    if answer.status_code >= 400:
        content = {k: v for k, v in answer.json().items() if k != "request_id"}
    return answer.status_code, sorted(headers.items()), content


ANGLE = st.one_of(
    st.floats(0, 90).map(repr),
    st.floats(-400, 400).map(repr),
    st.sampled_from(["0", "90", "-0", "+30", "1e1", ".5", "5.", "90.0000001", "1e400", "nan", "1,2", "", "0x1", "1_0"]),
)


@given(st.sampled_from(NAMES), ANGLE, ANGLE, ANGLE, st.sampled_from(["", "&angles=deg", "&angles=rad", "&status=true"]))
def test_same_answer(both: Both, name: str, i: str, o: str, d: str, rest: str) -> None:
    path = f"/v1/materials/{name}/evaluate?theta_i={i}&theta_o={o}&delta_phi={d}{rest}"
    short, long = (said(client.get(path)) for client in both)
    assert short == long


@pytest.mark.parametrize("name", NAMES)
def test_the_library_s_bits(both: Both, original: Path, name: str) -> None:
    brdf = local(original, name)
    for angles in ((30.0, 41.5, 179.0), (0.0, 90.0, -500.0), (89.999, 3.25, 0.1)):
        query = "theta_i={}&theta_o={}&delta_phi={}".format(*angles)
        short, long = (said(client.get(f"/v1/materials/{name}/evaluate?{query}")) for client in both)
        assert short == long
        assert json.loads(short[2])["values"] == [brdf.evaluate(*np.radians(angles)).tolist()]
    id = both[0].get(f"/v1/materials/{name}").json()["id"]
    path = f"/v1/tables/{id}/evaluate?theta_i=0.5&theta_o=0.25&delta_phi=3&angles=rad"
    short, long = (said(client.get(path)) for client in both)
    assert short == long
    assert json.loads(short[2])["values"] == [brdf.evaluate(0.5, 0.25, 3.0).tolist()]


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5", {"Accept": "application/octet-stream"}),
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5", {"Accept": "text/html"}),
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5", {"If-None-Match": '"x"'}),
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5", {"Host": "evil.example"}),
        ("/v1/materials/gold/evaluate?theta_i=95&theta_o=4&delta_phi=5", {}),
        ("/v1/materials/golld/evaluate?theta_i=3&theta_o=4&delta_phi=5", {}),
        ("/v1/materials//evaluate?theta_i=3&theta_o=4&delta_phi=5", {}),
        ("/v1/tables/0/evaluate?theta_i=3&theta_o=4&delta_phi=5", {}),
        ("/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5&outside=clip", {}),
        ("/v1/materials/gold/evaluate?theta_o=3&theta_i=4&delta_phi=5", {}),
    ],
)
def test_same_refusal_and_kind(both: Both, path: str, headers: dict[str, str]) -> None:
    short, long = (said(client.get(path, headers=headers)) for client in both)
    assert short == long


def test_same_body(both: Both) -> None:
    body = {"theta_i": [30, 40], "theta_o": 3, "delta_phi": 170}
    for method in ("POST", "PUT"):
        short, long = (said(client.request(method, "/v1/materials/red/evaluate", json=body)) for client in both)
        assert short == long


def test_unchanged(both: Both) -> None:
    path = "/v1/materials/gold/evaluate?theta_i=3&theta_o=4&delta_phi=5"
    tag = both[1].get(path).headers["etag"]
    assert both[0].get(path, headers={"If-None-Match": tag}).status_code == 304


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


def test_the_way_of_a_look_up_is_short(original: Path) -> None:
    """Who reads how a GET with a list is answered opens twelve files, and three of them twice, at most."""
    app = create_app(Settings(data=original), warm=False, request_log=RequestLog(lambda _: None))
    root, entered, answers = str(Path(main.__file__).parent), [], []
    query = b"theta_i=30,45&theta_o=30&delta_phi=180"
    path = "/v1/materials/gold-grid/evaluate"
    head = {"type": "http", "method": "GET", "path": path, "query_string": query, "headers": [(b"host", b"localhost")]}

    def note(frame: FrameType, event: str, _: Any) -> None:
        file = frame.f_code.co_filename
        if event == "call" and file.startswith(root) and (not entered or entered[-1] != file):
            entered.append(file)

    async def receive() -> Any:
        raise AssertionError("a GET has no body")

    async def send(message: Any) -> None:
        answers.append(message.get("status"))

    async def ask() -> None:
        async with app.router.lifespan_context(app):
            while not app.state.brdf.ready:
                await asyncio.sleep(0.01)
            for _ in range(2):  # loaded, and what answers share is made
                await app({**head}, receive, send)
            sys.setprofile(note)
            try:
                await app({**head}, receive, send)
            finally:
                sys.setprofile(None)

    asyncio.run(ask())
    assert answers == [200, None] * 3
    returns = sum(file in entered[:k] for k, file in enumerate(entered))
    assert len(set(entered)) <= 12, entered
    assert returns <= 3, entered
