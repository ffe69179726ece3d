"""Served values are the library's own, to the last digit; whatever else is asked is refused with its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.schemas.evaluate import EvaluateAnswer
from starlette.testclient import TestClient

from tests.app.conftest import Serve, assert_problem, expected_values, local

NAMES = ("gold-grid", "red", "gold", "mirror")
JSON = {"content-type": "application/json"}


def post(client: TestClient, body: Any, name: str = "gold-grid", **options: Any) -> Any:
    content = body if isinstance(body, (str, bytes)) else json.dumps(body)
    return client.post(f"/v1/materials/{name}/evaluate", content=content, headers=JSON, **options)


@pytest.mark.parametrize("name", NAMES)
def test_get_and_post_equal_local(shared_client: TestClient, original: Path, name: str) -> None:
    rng = np.random.default_rng(3)
    theta_i, theta_o = rng.uniform(0, 90, (2, 50)).tolist()
    delta_phi = rng.uniform(-400, 400, 50).tolist()
    brdf = local(original, name)
    wanted = expected_values(brdf, theta_i, theta_o, delta_phi)
    query = {
        k: ",".join(map(repr, v)) for k, v in zip(("theta_i", "theta_o", "delta_phi"), (theta_i, theta_o, delta_phi))
    }
    got = shared_client.get(f"/v1/materials/{name}/evaluate", params=query)
    sent = post(shared_client, {"theta_i": theta_i, "theta_o": theta_o, "delta_phi": delta_phi}, name)
    for answer in (got, sent):
        assert answer.status_code == 200
        content = EvaluateAnswer.model_validate_json(answer.content).model_dump()
        assert content["values"] == wanted
        assert content["channels"] == list(brdf.channels)
        assert (content["unit"], content["angles"]) == ("1/sr", "deg")
        assert content["has_delta"] == brdf.has_delta
    assert got.json()["id"] == sent.json()["id"]


def test_many_points_off_the_loop_equal_local(shared_client: TestClient, original: Path) -> None:
    rng = np.random.default_rng(4)
    body = {k: rng.uniform(0, 90, 20_000).tolist() for k in ("theta_i", "theta_o", "delta_phi")}
    assert post(shared_client, body, "red").json()["values"] == expected_values(local(original, "red"), *body.values())


@pytest.mark.parametrize("name", ["gold-grid", "gold"])
def test_radians_are_passed_as_they_are(shared_client: TestClient, original: Path, name: str) -> None:
    query = "theta_i=0.7&theta_o=0.1,1.5707963267948966&delta_phi=3.141592653589793&angles=rad"
    answer = shared_client.get(f"/v1/materials/{name}/evaluate?{query}").json()
    assert answer["angles"] == "rad"
    assert answer["values"] == expected_values(
        local(original, name), 0.7, [0.1, 1.5707963267948966], 3.141592653589793, degrees=False
    )
    body = {"theta_i": 0.7, "theta_o": [0.1, 1.5707963267948966], "delta_phi": 3.141592653589793, "angles": "rad"}
    assert post(shared_client, body, name).json()["values"] == answer["values"]


def test_ninety_degrees_is_inside(shared_client: TestClient) -> None:
    assert shared_client.get("/v1/materials/gold-grid/evaluate?theta_i=90&theta_o=90&delta_phi=0").status_code == 200


def test_broadcasting(shared_client: TestClient, original: Path) -> None:
    brdf = local(original, "gold-grid")
    answer = shared_client.get("/v1/materials/gold-grid/evaluate?theta_i=30,45&theta_o=30&delta_phi=180").json()
    assert answer["values"] == expected_values(brdf, [30, 45], 30, 180)
    assert post(shared_client, {"theta_i": [30], "theta_o": [1, 2, 3], "delta_phi": 9}).json()["values"] == (
        expected_values(brdf, [30], [1, 2, 3], 9)
    )
    assert post(shared_client, {"theta_i": [], "theta_o": 1, "delta_phi": 9}).json()["values"] == []


def test_error_of_table_is_in_the_answer(shared_client: TestClient, original: Path) -> None:
    answer = shared_client.get("/v1/materials/red/evaluate?theta_i=1&theta_o=1&delta_phi=1").json()
    table = local(original, "red")
    assert answer["error"]["l1"] == table.error["l1"]  # type: ignore[attr-defined]
    assert answer["error"]["warnings"] == table.error["warnings"]  # type: ignore[attr-defined]
    assert shared_client.get("/v1/materials/gold/evaluate?theta_i=1&theta_o=1&delta_phi=1").json()["error"] == {}


GOOD = {"theta_i": 30, "theta_o": [0, 30, 60], "delta_phi": 180}


@pytest.mark.parametrize(
    ("bad", "status", "code", "where", "index"),
    [
        ({"theta_o": [0, "30"]}, 422, "not_a_number", "theta_o", [1]),
        ({"theta_o": "30"}, 422, "not_a_number", "theta_o", []),
        ({"theta_o": True}, 422, "not_a_number", "theta_o", []),
        ({"theta_o": [1, 2, True]}, 422, "not_a_number", "theta_o", [2]),
        ({"theta_o": None}, 422, "not_a_number", "theta_o", []),
        ({"theta_o": [1, None]}, 422, "not_a_number", "theta_o", [1]),
        ({"theta_o": [[1, 2], [3, 4]]}, 422, "not_a_number", "theta_o", [0]),
        ({"theta_o": {"value": 3}}, 422, "not_a_number", "theta_o", []),
        ({"theta_o": [1, 10**400]}, 422, "not_a_number", "theta_o", [1]),
        ({"theta_o": [1, -(10**400)]}, 422, "not_a_number", "theta_o", [1]),
        ({"theta_o": 10**300}, 422, "angle_outside", "theta_o", []),
        ({"theta_o": [0, 30, 95]}, 422, "angle_outside", "theta_o", [2]),
        ({"theta_o": [0, 30, -1e-9]}, 422, "angle_outside", "theta_o", [2]),
        ({"theta_i": 95}, 422, "angle_outside", "theta_i", []),
        ({"theta_i": [1, 2]}, 422, "shapes_do_not_broadcast", "theta_i, theta_o, delta_phi", None),
        ({"angles": "grad"}, 422, "bad_choice", "angles", None),
        ({"angles": ["deg"]}, 422, "bad_choice", "angles", None),
        ({"theta_0": 3}, 422, "unknown_field", "body", None),
    ],
)  # fmt: skip
def test_bad_bodies(
    shared_client: TestClient, bad: dict[str, Any], status: int, code: str, where: str, index: list[int] | None
) -> None:
    entry = assert_problem(post(shared_client, {**GOOD, **bad}), status, code)["errors"][0]
    assert entry["where"] == where
    assert entry.get("index") == index


@pytest.mark.parametrize(
    ("body", "where", "index", "got"),
    [
        ('{"theta_i": 30, "theta_o": [0, NaN], "delta_phi": 180}', "theta_o", [1], "nan"),
        ('{"theta_i": 30, "theta_o": [0, 1], "delta_phi": Infinity}', "delta_phi", [], "inf"),
        ('{"theta_i": 30, "theta_o": [0, 1], "delta_phi": [0, -Infinity]}', "delta_phi", [1], "-inf"),
        ('{"theta_i": 1e999, "theta_o": [0, 1], "delta_phi": 0}', "theta_i", [], "inf"),
    ],
)
def test_literals_that_are_not_finite(
    shared_client: TestClient, body: str, where: str, index: list[int], got: str
) -> None:
    entry = assert_problem(post(shared_client, body), 422, "angle_outside")["errors"][0]
    assert (entry["where"], entry["index"], entry["got"]) == (where, index, got)


def test_past_the_horizon_is_told_in_the_request_s_own_numbers(shared_client: TestClient) -> None:
    path = "/v1/materials/gold-grid/evaluate"
    content = assert_problem(shared_client.get(f"{path}?theta_i=30&theta_o=0,90.5&delta_phi=180"), 422, "angle_outside")
    assert content["errors"] == [{"where": "theta_o", "index": [1], "got": 90.5, "expected": "[0, 90] degrees"}]
    assert "theta_o[1] = 90.5" in content["detail"]
    content = assert_problem(
        shared_client.get(f"{path}?theta_i=1.6&theta_o=0,1&delta_phi=1&angles=rad"), 422, "angle_outside"
    )
    assert content["errors"][0]["got"] == 1.6
    assert content["errors"][0]["index"] == []


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        ('{"theta_i": 30,', 400, "bad_json"),
        ("", 400, "bad_json"),
        (b"\xff\xfe", 400, "bad_json"),
        ('{"theta_i": ' + "[" * 100_000, 400, "bad_json"),
        ('{"theta_i": ' + "1" * 5000 + "}", 400, "bad_json"),
        ("[1, 2]", 422, "bad_body"),
        ("3", 422, "bad_body"),
        ("null", 422, "bad_body"),
        ('{"theta_i": 1, "theta_i": 2, "theta_o": 3, "delta_phi": 4}', 422, "field_twice"),
        ('{"theta_i": 1, "theta_o": 3}', 422, "field_missing"),
    ],
)
def test_bodies_that_are_no_request(shared_client: TestClient, body: Any, status: int, code: str) -> None:
    assert_problem(post(shared_client, body), status, code)


def test_malformed_json_says_where(shared_client: TestClient) -> None:
    content = assert_problem(post(shared_client, '{"theta_i": 30,\n oops}'), 400, "bad_json")
    assert "line 2, column 2" in content["detail"]


def test_media_type(shared_client: TestClient) -> None:
    path = "/v1/materials/gold-grid/evaluate"
    form = shared_client.post(path, data={"theta_i": "30"})
    assert_problem(form, 415, "unsupported_media_type")
    assert_problem(shared_client.post(path, content=b"{}"), 415, "unsupported_media_type")


@pytest.mark.parametrize(
    ("query", "code", "where"),
    [
        ("theta_i=30&theta_o=30", "parameter_missing", "delta_phi"),
        ("theta_i=30&theta_o=30&delta_phi=", "not_a_number", "delta_phi"),
        ("theta_i=30&theta_o=30,&delta_phi=1", "not_a_number", "theta_o"),
        ("theta_i=nan&theta_o=30&delta_phi=1", "not_a_number", "theta_i"),
        ("theta_i=1_0&theta_o=30&delta_phi=1", "not_a_number", "theta_i"),
        ("theta_i=%D9%A3&theta_o=30&delta_phi=1", "not_a_number", "theta_i"),
        ("theta_i=1e999&theta_o=30&delta_phi=1", "not_a_number", "theta_i"),
        ("theta_i=1&theta_o=30&delta_phi=1&theta_i=2", "parameter_twice", "theta_i"),
        ("theta_i=1&theta_o=30&delta_phi=1&angle=rad", "unknown_parameter", "query"),
        ("theta_i=1&theta_o=30&delta_phi=1&angles=radians", "bad_choice", "angles"),
        ("theta_i=1,2&theta_o=1,2,3&delta_phi=1", "shapes_do_not_broadcast", "theta_i, theta_o, delta_phi"),
    ],
)
def test_bad_queries(shared_client: TestClient, query: str, code: str, where: str) -> None:
    content = assert_problem(shared_client.get(f"/v1/materials/gold-grid/evaluate?{query}"), 422, code)
    assert content["errors"][0]["where"] == where


def test_plus_sign_that_became_a_space(shared_client: TestClient) -> None:
    path = "/v1/materials/gold-grid/evaluate"
    a = shared_client.get(f"{path}?theta_i=3e+1&theta_o=+30&delta_phi=180").json()
    assert a == shared_client.get(f"{path}?theta_i=30&theta_o=30&delta_phi=180").json()


def test_too_many_points(serve: Serve) -> None:
    client = serve(max_points=100)
    body = {"theta_i": [1.0] * 101, "theta_o": 1, "delta_phi": 1}
    content = assert_problem(post(client, body), 413, "too_many_points")
    assert content["errors"][0]["limit"] == 100
    body["theta_i"] = [1.0] * 100
    assert post(client, body).status_code == 200
    query = "theta_i=" + ",".join(["1"] * 101) + "&theta_o=1&delta_phi=1"
    assert_problem(client.get(f"/v1/materials/gold-grid/evaluate?{query}"), 413, "too_many_points")


def test_too_many_values(serve: Serve) -> None:
    client = serve(max_values=10)
    body = {"theta_i": [1.0] * 4, "theta_o": 1, "delta_phi": 1}
    assert post(client, body, "gold-grid").status_code == 200
    assert_problem(post(client, body, "red"), 413, "too_many_values")


def test_body_too_large(serve: Serve) -> None:
    client = serve(max_body_bytes=1000)
    content = assert_problem(post(client, b" " * 1001), 413, "body_too_large")
    assert content["errors"][0]["limit"] == 1000

    def pieces() -> Any:  # no Content-Length: only counting helps
        for _ in range(50):
            yield b" " * 100

    streamed = client.post("/v1/materials/gold-grid/evaluate", content=pieces(), headers=JSON)
    assert_problem(streamed, 413, "body_too_large")


def test_offending_value_is_cut(shared_client: TestClient) -> None:
    long = "x" * 5000
    answer = shared_client.get(f"/v1/materials/gold-grid/evaluate?theta_i={long}&theta_o=1&delta_phi=1")
    assert_problem(answer, 422, "not_a_number")
    assert len(answer.content) < 1000
    assert_problem(post(shared_client, {**GOOD, "theta_o": [long]}), 422, "not_a_number")
    assert len(post(shared_client, {**GOOD, long: 1}).content) < 1000


def test_mirror_says_that_it_has_a_delta(shared_client: TestClient) -> None:
    answer = shared_client.get("/v1/materials/mirror/evaluate?theta_i=30&theta_o=30&delta_phi=180").json()
    assert answer["has_delta"] is True
    assert answer["values"] == [[0.0]]
