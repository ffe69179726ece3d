"""Directions as vectors over HTTP: the bits of the library's own `evaluate_vectors`, in every kind of body."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.evaluate import json_body
from brdf_service.schemas.evaluate import EvaluateAnswer
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from tests.app.conftest import Serve, assert_problem, local

NAMES = ["gold-grid", "red", "gold", "mirror"]
OCTETS = {"Content-Type": "application/octet-stream"}
NPY = {"Content-Type": "application/x-npy"}


def vectors(count: int, dtype: Any = np.float64) -> Any:
    """Directions of any length, some below the horizon, some around the mirror direction."""
    wi, wo = np.random.default_rng(3).normal(size=(2, count, 3))
    wo[::3] = wi[::3] * [-1, -1, 1] + 0.05 * wo[::3]
    return np.stack([wi, wo]).astype(dtype)


def npy(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


@pytest.mark.parametrize("name", NAMES)
def test_json(shared_client: TestClient, original: Path, name: str) -> None:
    wi, wo = vectors(60)
    path = f"/v1/materials/{name}/evaluate"
    answer = shared_client.post(path, json={"wi": wi.tolist(), "wo": wo.tolist()})
    assert answer.status_code == 200
    EvaluateAnswer.model_validate_json(answer.content)
    content = answer.json()
    expected = local(original, name).evaluate_vectors(wi, wo)
    assert content["values"] == expected.tolist()
    assert (expected == 0).any()
    assert "angles" not in content
    one = shared_client.post(f"{path}?input=vectors", json={"wi": wi[0].tolist(), "wo": wo.tolist()}).json()
    assert one["values"] == local(original, name).evaluate_vectors(wi[0], wo).tolist()
    single = shared_client.post(path, json={"wi": [0, 0, 1], "wo": [0, 0, 2]}).json()
    assert single["values"] == [local(original, name).evaluate_vectors([0, 0, 1], [0, 0, 2]).tolist()]


@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("count", [1, 700, 9000])
@pytest.mark.parametrize("name", ["gold-grid", "red", "gold"])
def test_plain_numbers(shared_client: TestClient, original: Path, name: str, dtype: str, count: int) -> None:
    both = vectors(count, dtype)
    expected = local(original, name).evaluate_vectors(*both)
    path = f"/v1/materials/{name}/evaluate?input=vectors&dtype={dtype}"
    answer = shared_client.post(path, content=both.tobytes(), headers=OCTETS)
    assert answer.status_code == 200
    assert answer.content == expected.astype(f"<{dtype}").tobytes()
    assert answer.headers["x-brdf-shape"] == f"{count},{expected.shape[1]}"
    assert answer.headers["x-brdf-dtype"] == dtype
    assert "x-brdf-angles" not in answer.headers
    for body in (both, np.asfortranarray(both)):
        answer = shared_client.post(path, content=npy(body), headers=NPY)
        got = np.load(io.BytesIO(answer.content))
        assert got.dtype == expected.dtype
        assert got.tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("body", "code", "where"),
    [
        ({"wi": [0, 0, 1]}, "field_missing", "wo"),
        ({"wo": [0, 0, 1]}, "field_missing", "wi"),
        ({"wi": [0, 0, 1], "wo": [0, 0, 1], "theta_i": 3}, "unknown_field", "body"),
        ({"wi": 1, "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [0, 0], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [[0, 0, 1], [0, 0, 1, 0]], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [[0, 0, 1], 3], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [0, 0, True], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [0, 0, "1"], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [0, 0, None], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [0, 0, 10**400], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [0, 0, [1]], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [0, 0, 0], "wo": [0, 0, 1]}, "not_a_direction", "wi"),
        ({"wi": [[0, 0, 1]] * 2, "wo": [[0, 0, 1]] * 3}, "shapes_do_not_broadcast", "wi, wo"),
        ({"wi": {}, "wo": [0, 0, 1]}, "not_a_direction", "wi"),
    ],
)
def test_json_refusals(shared_client: TestClient, body: Any, code: str, where: str) -> None:
    content = assert_problem(shared_client.post("/v1/materials/gold/evaluate", json=body), 422, code)
    assert content["errors"][0]["where"] == where


def test_index_of_a_bad_vector(shared_client: TestClient) -> None:
    body = {"wi": [[0, 0, 1], [0, 0, 1], [0, "x", 1]], "wo": [0, 0, 1]}
    content = assert_problem(shared_client.post("/v1/materials/gold/evaluate", json=body), 422, "not_a_direction")
    assert content["errors"][0]["index"] == [2, 1]
    numbers = vectors(5)
    numbers[1, 3, 1] = np.nan
    answer = shared_client.post("/v1/materials/gold/evaluate?input=vectors", content=numbers.tobytes(), headers=OCTETS)
    content = assert_problem(answer, 422, "not_a_direction")
    assert (content["errors"][0]["where"], content["errors"][0]["index"]) == ("wo", [3])


@pytest.mark.parametrize("option", ["angles=deg", "outside=nan", "status=true"])
def test_options_of_angles_are_refused(shared_client: TestClient, option: str) -> None:
    body = {"wi": [0, 0, 1], "wo": [0, 0, 1]}
    answer = shared_client.post(f"/v1/materials/gold/evaluate?{option}", json=body)
    content = assert_problem(answer, 422, "options_exclude")
    assert content["errors"][0]["where"] == option.partition("=")[0]


def test_form_and_body_must_agree(shared_client: TestClient) -> None:
    path = "/v1/materials/gold/evaluate?input="
    angles = {"theta_i": 3, "theta_o": 4, "delta_phi": 5}
    assert shared_client.post(f"{path}angles", json=angles).status_code == 200
    assert_problem(shared_client.post(f"{path}vectors", json=angles), 422, "unknown_field")
    vector = {"wi": [0, 0, 1], "wo": [0, 0, 1]}
    assert_problem(shared_client.post(f"{path}angles", json=vector), 422, "unknown_field")
    assert_problem(shared_client.post(f"{path}vectors", json=[1]), 422, "bad_body")
    assert_problem(shared_client.post(f"{path}both", json=vector), 422, "bad_choice")


def test_sizes(serve: Serve) -> None:
    client = serve(max_points=10)
    path = "/v1/materials/red/evaluate?input=vectors"
    assert client.post(path, content=vectors(10).tobytes(), headers=OCTETS).status_code == 200
    assert_problem(client.post(path, content=vectors(11).tobytes(), headers=OCTETS), 413, "too_many_points")
    assert_problem(client.post(path, content=npy(vectors(11)), headers=NPY), 413, "too_many_points")
    assert_problem(client.post(path, content=vectors(3).tobytes()[:-8], headers=OCTETS), 422, "bad_length")
    assert_problem(client.post(path, content=npy(np.zeros((3, 4))), headers=NPY), 422, "bad_array")
    many = {"wi": [0, 0, 1], "wo": vectors(11)[0].tolist()}
    assert_problem(client.post(path, json=many), 413, "too_many_points")


@pytest.mark.parametrize("count", [8001, 16_000, 23_999])
def test_blocks_in_the_event_loop(serve: Serve, original: Path, count: int) -> None:
    """Some thousand points are evaluated a few at a time: the same bits, the same complaints."""
    client = serve()
    brdf = local(original, "gold-grid")
    angles = np.random.default_rng(5).random((3, count)) * 1.5
    path = "/v1/materials/gold-grid/evaluate?angles=rad"
    answer = client.post(path, content=angles.tobytes(), headers=OCTETS)
    assert answer.content == brdf.evaluate(*angles).tobytes()
    both = vectors(count, "f4")
    answer = client.post(
        "/v1/materials/gold-grid/evaluate?input=vectors&dtype=f4", content=both.tobytes(), headers=OCTETS
    )
    assert answer.content == brdf.evaluate_vectors(*both).tobytes()
    lists = {"theta_i": 30, "theta_o": [20.0] * count, "delta_phi": (90 * angles[0]).tolist()}
    expected = brdf.evaluate(*(np.radians(x) for x in lists.values()))
    assert client.post("/v1/materials/gold-grid/evaluate", json=lists).json()["values"] == expected.tolist()
    angles[1, count - 1] = 2.0
    content = assert_problem(client.post(path, content=angles.tobytes(), headers=OCTETS), 422, "angle_outside")
    assert content["errors"][0]["index"] == [count - 1]
    both[0, count - 1] = 0
    answer = client.post(
        "/v1/materials/gold-grid/evaluate?input=vectors&dtype=f4", content=both.tobytes(), headers=OCTETS
    )
    assert assert_problem(answer, 422, "not_a_direction")["errors"][0]["index"] == [count - 1]


def test_lists_that_do_not_broadcast_do_not_in_parts_either(client: TestClient) -> None:
    """The last part of 8,001 is one point, which would go with any number of others."""
    lists = {"theta_i": [1.0] * 8001, "theta_o": [1.0] * 16_000, "delta_phi": 0}
    answer = client.post("/v1/materials/gold-grid/evaluate", json=lists)
    assert_problem(answer, 422, "shapes_do_not_broadcast")
    both = {"wi": [[0, 0, 1]] * 8001, "wo": [[0, 0, 1]] * 16_000}
    assert_problem(client.post("/v1/materials/gold-grid/evaluate", json=both), 422, "shapes_do_not_broadcast")


def test_none(shared_client: TestClient) -> None:
    answer = shared_client.post("/v1/materials/red/evaluate", json={"wi": [], "wo": [0, 0, 1]})
    assert answer.json()["values"] == []
    answer = shared_client.post("/v1/materials/red/evaluate?input=vectors", content=b"", headers=OCTETS)
    assert (answer.status_code, answer.content) == (200, b"")


# ---- JSON numbers are read the same way by both readers ----------------------------------------------------------


def test_json_has_a_limit_of_its_own(serve: Serve) -> None:
    client = serve(max_json_bytes=1000, max_body_bytes=50_000)
    body = {"theta_i": [30.0] * 200, "theta_o": 30, "delta_phi": 180}
    content = assert_problem(client.post("/v1/materials/gold/evaluate", json=body), 413, "body_too_large")
    assert "application/octet-stream" in content["detail"]
    assert content["errors"][0]["limit"] == 1000
    numbers = np.zeros((3, 200)).tobytes()
    assert client.post("/v1/materials/gold/evaluate", content=numbers, headers=OCTETS).status_code == 200
    small = serve(max_body_bytes=1000)
    content = assert_problem(small.post("/v1/materials/gold/evaluate", json=body), 413, "body_too_large")
    assert "octet-stream" not in content["detail"]  # there the limit is the same


NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(2**70), 2**70).map(str),
    st.sampled_from(["-0", "-0.0", "1e400", "1E5", "5e-324", "2.2250738585072011e-308", "9007199254740993", "1e-400"]),
    st.sampled_from(["true", "null", '"1"', "[1]", "{}", "NaN", "01", "1.", ".5", "+1", ""]),
)


@given(st.lists(NUMBERS, max_size=6), st.sampled_from(["", " ", "\n"]), st.sampled_from(["theta_o", "theta_i", "x"]))
def test_two_readers_agree(texts: list[str], space: str, second: str) -> None:
    """What simdjson takes, orjson and the standard library take with the same bits."""
    if json_body.simdjson is None:
        pytest.skip("pysimdjson is not installed")
    listed = f",{space}".join(texts)
    body = f'{space}{{"theta_i":{space}[{listed}],"{second}": [1, 2.5], "delta_phi":[]}}'.encode()
    fast = json_body._flat_lists(body)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(json_body, "simdjson", None)
        try:
            slow = json_body.directions_from_json(body, None, None, "raise")
        except Exception:
            assert fast is None
            return
    if fast is not None:
        assert [a.tobytes() for a in fast] == [a.tobytes() for a in slow[:3]]


def test_simdjson_is_used_where_it_can_be() -> None:
    pytest.importorskip("simdjson")
    assert json_body._flat_lists(b'{"delta_phi":[1],"theta_i":[0.1],"theta_o":[2]}') is not None
    for other in (
        b'{"delta_phi":[1],"theta_i":[0.1],"theta_o":[2],"theta_o":[2]}',
        b'{"delta_phi":[1],"theta_i":[[0.1]],"theta_o":2}',
        b'{"delta_phi":[1],"theta_i":[0.1],"theta_o":2}',
        b"[[1],[2]]",
        b"{",
    ):
        assert json_body._flat_lists(other) is None
