"""What holds for every path: caching, request ids, the Host rule, problems, health, and no 500 whatever is sent."""

from __future__ import annotations

import json
from typing import Any
from urllib.parse import quote

import pytest
from brdf_service.main import create_app
from brdf_service.schemas.service import Problem
from brdf_service.settings import Settings
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem

VALUE = "evaluate?theta_i=30&theta_o=30&delta_phi=180"
GETS = (
    "/",
    "/docs",
    "/static/style.css",
    "/materials/gold",
    "/v1/materials",
    "/v1/materials/gold",
    f"/v1/materials/gold/{VALUE}",
    "/v1/materials/gold/slice.csv?theta_i=30",
)


@pytest.mark.parametrize("path", GETS)
def test_etag_and_304(shared_client: TestClient, path: str) -> None:
    first = shared_client.get(path)
    etag = first.headers["etag"]
    assert first.headers["cache-control"] == "no-cache"
    for held in (etag, f"W/{etag}", f'"other", {etag}'):
        again = shared_client.get(path, headers={"if-none-match": held})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["etag"] == etag
        assert again.headers["cache-control"] == "no-cache"
    for other in ('"other"', "*", ""):
        assert shared_client.get(path, headers={"if-none-match": other}).status_code == 200


def test_etags_differ_with_the_question(shared_client: TestClient) -> None:
    id = shared_client.get("/v1/materials/gold").json()["id"]
    paths = [
        f"/v1/materials/gold/{VALUE}",
        f"/v1/materials/gold-grid/{VALUE}",
        f"/v1/materials/gold/{VALUE}&angles=deg",
        f"/v1/tables/{id}/{VALUE}",
        "/v1/materials/gold/slice.csv?theta_i=30",
        "/v1/materials/gold/slice.json?theta_i=30",
    ]
    assert len({shared_client.get(p).headers["etag"] for p in paths}) == len(paths)


def test_etag_comes_before_the_work(shared_client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    etag = shared_client.get(f"/v1/materials/gold/{VALUE}").headers["etag"]
    monkeypatch.setattr("brdf_service.routes.evaluate.answer", None)
    held = {"if-none-match": etag}
    assert shared_client.get(f"/v1/materials/gold/{VALUE}", headers=held).status_code == 304


def test_answers_by_id_are_immutable(shared_client: TestClient) -> None:
    for name in ("gold", "gold-grid"):
        id = shared_client.get(f"/v1/materials/{name}").json()["id"]
        for rest in ("", f"/{VALUE}", "/slice.svg?theta_i=30"):
            answer = shared_client.get(f"/v1/tables/{id}{rest}")
            # metadata holds the file's name and its measured error, which the id says nothing of
            lasts = "public, max-age=31536000, immutable" if rest else "no-cache"
            assert answer.headers["cache-control"] == lasts
            assert "content-location" not in answer.headers
        assert_problem(shared_client.get(f"/v1/tables/{id}/evaluate"), 422, "parameter_missing")


@pytest.mark.parametrize("path", [*GETS, "/health/live", "/v1/materials/gold/slice.png?theta_i=30"])
def test_head_is_get_without_its_body(shared_client: TestClient, path: str) -> None:
    head, get = shared_client.head(path), shared_client.get(path)
    assert head.status_code == get.status_code == 200
    assert head.content == b""
    for name in ("content-type", "content-length", "etag", "cache-control"):
        assert head.headers.get(name) == get.headers.get(name)


def test_request_id(shared_client: TestClient) -> None:
    ids = {shared_client.get("/health/live").headers["x-request-id"] for _ in range(3)}
    assert len(ids) == 3
    kept = shared_client.get("/health/live", headers={"x-request-id": "trace-1.2_3"})
    assert kept.headers["x-request-id"] == "trace-1.2_3"
    for bad in ("a b", "x" * 65, "<script>", ""):
        assert shared_client.get("/health/live", headers={"x-request-id": bad}).headers["x-request-id"] != bad


def test_paths_and_methods_that_are_not_there(shared_client: TestClient) -> None:
    for path in ("/nothing", "/v1", "/v1/materials/", "/static/other.js", "/docs/"):
        assert_problem(shared_client.get(path), 404, "unknown_path")
    for method, path, allowed in (
        ("PATCH", "/v1/materials/gold", "DELETE, GET, HEAD, PUT"),
        ("PUT", "/v1/materials/gold/evaluate", "GET, HEAD, POST"),
        ("GET", "/v1/materials/gold/upload", "POST"),
        ("PUT", "/v1/materials", "GET, HEAD"),
        ("POST", "/", "GET, HEAD"),
        ("TRACE", "/docs", "GET, HEAD"),
    ):
        answer = shared_client.request(method, path)
        assert_problem(answer, 405, "method_not_allowed")
        assert answer.headers["allow"] == allowed


@pytest.mark.parametrize(
    ("host", "good"),
    [
        ("127.0.0.1:8000", True),
        ("localhost", True),
        ("LOCALHOST:1", True),
        ("[::1]:8000", True),
        ("127.8.9.1", True),
        ("evil.example", False),
        ("127.0.0.1.evil.example", False),
        ("localhost.evil.example", False),
        ("192.168.0.7:8000", False),
        ("[::2]", False),
        ("", False),
    ],
)
def test_loopback_answers_to_loopback_names(shared_client: TestClient, host: str, good: bool) -> None:
    answer = shared_client.get("/v1/materials", headers={"host": host})
    if good:
        assert answer.status_code == 200
    else:
        assert_problem(answer, 421, "foreign_host")


def test_host_elsewhere(serve: Serve) -> None:
    open_to_all = serve(host="0.0.0.0")
    assert open_to_all.get("/health/live", headers={"host": "brdf.example"}).status_code == 200
    narrowed = serve(host="0.0.0.0", allowed_hosts="brdf.example, other.example")
    assert narrowed.get("/health/live", headers={"host": "brdf.example:80"}).status_code == 200
    assert_problem(narrowed.get("/health/live", headers={"host": "localhost"}), 421, "foreign_host")


def test_health(serve: Serve) -> None:
    client = serve()
    assert client.get("/health/live").json() == {"status": "live", "version": bc.__version__}
    client.app.state.brdf.ready = False  # type: ignore[attr-defined]
    not_yet = client.get("/health/ready")
    assert_problem(not_yet, 503, "warming_up")
    assert not_yet.headers["retry-after"] == "1"
    client.app.state.brdf.ready = True  # type: ignore[attr-defined]
    assert client.get("/health/ready").json()["status"] == "ready"
    assert client.get("/health/ready").headers["cache-control"] == "no-store"


def test_ready_after_a_real_warm_up(data: Any) -> None:
    (data / "bad.h5").write_bytes(b"damaged files are no reason not to start")
    with TestClient(create_app(Settings(data=data)), base_url="http://localhost") as client:
        for _ in range(600):
            if client.get("/health/ready").status_code == 200:
                break
            client.portal.call(_sleep)  # type: ignore[union-attr]
        assert client.get("/health/ready").status_code == 200


async def _sleep() -> None:
    import anyio

    await anyio.sleep(0.05)


def test_an_error_inside_says_nothing_of_the_inside(
    shared_client: TestClient, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object, **__: object) -> bytes:
        raise RuntimeError("secret of the house")

    monkeypatch.setattr("brdf_service.routes.evaluate.evaluate", broken)
    answer = shared_client.get(f"/v1/materials/gold/{VALUE}")
    content = assert_problem(answer, 500, "internal_error")
    assert "secret" not in answer.text
    assert content["request_id"] in caplog.text
    assert "secret of the house" in caplog.text


def test_openapi_is_true(shared_client: TestClient) -> None:
    document = shared_client.get("/openapi.json").json()
    operations = [o for path in document["paths"].values() for o in path.values()]
    assert len({o["operationId"] for o in operations}) == len(operations) > 30
    refs = {r.rpartition("/")[2] for r in _refs(document)}
    assert refs <= set(document["components"]["schemas"])
    for path, methods in document["paths"].items():
        for operation in methods.values():
            for status, response in operation["responses"].items():
                if int(status) >= 400:
                    assert list(response["content"]) == ["application/problem+json"]
            in_path = {p["name"] for p in operation.get("parameters", []) if p["in"] == "path"}
            assert all(f"{{{name}}}" in path for name in in_path)
            assert path.count("{") == len(in_path)


def _refs(node: Any) -> Any:
    if isinstance(node, dict):
        for key, value in node.items():
            if key == "$ref":
                yield value
            else:
                yield from _refs(value)
    elif isinstance(node, list):
        for value in node:
            yield from _refs(value)


# ---- anything at all ---------------------------------------------------------------------------------------

NUMBERS = st.one_of(st.integers(), st.floats(), st.floats(0, 90), st.sampled_from([90.0, -0.0, 10**400, 1e308]))
JUNK = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, st.text(max_size=8)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=6,
)
ANGLE = st.one_of(NUMBERS, st.lists(NUMBERS, max_size=4), JUNK)
BODIES = st.one_of(
    st.fixed_dictionaries(
        {"theta_i": ANGLE, "theta_o": ANGLE, "delta_phi": ANGLE},
        optional={"angles": st.sampled_from(["deg", "rad", 1])},
    ).map(json.dumps),
    JUNK.map(json.dumps),
    st.text(max_size=30),
)
KEYS = st.sampled_from(["theta_i", "theta_o", "delta_phi", "angles", "view", "scale", "channel", "limit", "offset", ""])
TEXTS = st.one_of(
    st.lists(NUMBERS.map(repr), max_size=4).map(",".join),
    st.sampled_from(["deg", "rad", "polar", "hemisphere", "log", "value", "R", "0", "30", "30,60"]),
    st.text(max_size=8),
)
PATHS = st.sampled_from(["evaluate", "slice.json", "slice.csv", ""])
EXPECTED = {200, 400, 404, 409, 413, 415, 421, 422}
FUZZ = settings(
    max_examples=200, deadline=None, database=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)


def _sound(answer: Any) -> None:
    assert answer.status_code in EXPECTED, answer.text
    if answer.status_code >= 400:
        assert answer.headers["content-type"] == "application/problem+json"
        Problem.model_validate_json(answer.content, strict=True)


@FUZZ
@given(body=BODIES)
def test_no_body_gives_a_500(shared_client: TestClient, body: str) -> None:
    content = body.encode("utf-8", "surrogatepass")
    headers = {"content-type": "application/json"}
    for name in ("gold-grid", "gold"):
        _sound(shared_client.post(f"/v1/materials/{name}/evaluate", content=content, headers=headers))


@FUZZ
@given(path=PATHS, pairs=st.lists(st.tuples(KEYS, TEXTS), max_size=5))
def test_no_query_gives_a_500(shared_client: TestClient, path: str, pairs: list[tuple[str, str]]) -> None:
    query = "&".join(f"{k}={quote(v, safe='', errors='replace')}" for k, v in pairs)
    _sound(shared_client.get(f"/v1/materials/red/{path}?{query}".replace("/?", "?")))


@FUZZ
@given(name=st.text(min_size=1, max_size=70), query=st.binary(max_size=30))
def test_no_name_gives_a_500(shared_client: TestClient, name: str, query: bytes) -> None:
    _sound(shared_client.get(f"/v1/materials/{quote(name, safe='', errors='replace')}?{quote(query)}"))
    _sound(shared_client.get(f"/v1/tables/{quote(name, safe='', errors='replace')}/evaluate"))
