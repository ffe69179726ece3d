"""Plain numbers and .npy both ways: the library's own bits, and a clear refusal of everything else."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.evaluate.binary_body import npy_head
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, local

OCTET, NPY, JSON = "application/octet-stream", "application/x-npy", "application/json"
NAMES = ("gold-grid", "red", "gold")


def angles(n: int, dtype: str) -> np.ndarray[Any, Any]:
    rng = np.random.default_rng(8)
    top = np.array([[np.pi / 2], [np.pi / 2], [9.0]])
    return (rng.random((3, n)) * top).astype(dtype)


def npy(array: np.ndarray[Any, Any]) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def post(
    client: TestClient, body: bytes, kind: str = OCTET, name: str = "gold-grid", query: str = "", **headers: str
) -> Any:
    path = f"/v1/materials/{name}/evaluate?{query}"
    return client.post(path, content=body, headers={"content-type": kind, **headers})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("n", [1, 7, 20_000])
def test_the_same_bits_as_the_library(shared_client: TestClient, original: Path, name: str, dtype: str, n: int) -> None:
    given = angles(n, dtype)
    wanted = local(original, name).evaluate(*given)
    raw = post(shared_client, given.tobytes(), name=name, query=f"dtype={dtype}&angles=rad")
    assert raw.status_code == 200
    assert raw.content == wanted.tobytes()
    assert raw.headers["content-type"] == OCTET
    assert raw.headers["x-brdf-angles"] == "rad"
    assert raw.headers["x-brdf-dtype"] == dtype
    assert raw.headers["x-brdf-shape"] == f"{n},{wanted.shape[1]}"
    assert json.loads(raw.headers["x-brdf-channels"]) == list(local(original, name).channels)
    assert raw.headers["x-brdf-has-delta"] == "false"
    assert raw.headers["x-brdf-id"] == shared_client.get(f"/v1/materials/{name}").json()["id"]
    assert "l1" in json.loads(raw.headers["x-brdf-error"]) or name == "gold"
    for body in (npy(given), npy(np.asfortranarray(given)), npy(given.astype(f">{dtype}"))):
        file = post(shared_client, body, NPY, name, "angles=rad")
        assert file.headers["content-type"] == NPY
        found = np.load(io.BytesIO(file.content))
        assert found.dtype == dtype
        assert np.array_equal(found, wanted)
    by_id = shared_client.post(
        f"/v1/tables/{raw.headers['x-brdf-id']}/evaluate?dtype={dtype}&angles=rad",
        content=given.tobytes(),
        headers={"content-type": OCTET},
    )
    assert by_id.content == raw.content


def test_degrees_are_converted_by_the_library(shared_client: TestClient, original: Path) -> None:
    for dtype in ("f4", "f8"):
        given = np.degrees(angles(100, dtype)) * 0.99
        wanted = local(original, "red").evaluate(*(bc.to_radians(a) for a in given))
        answer = post(shared_client, given.tobytes(), name="red", query=f"dtype={dtype}")
        assert answer.content == wanted.tobytes()
        assert answer.headers["x-brdf-angles"] == "deg"


@pytest.mark.parametrize("sent", ["json", "octet", "npy"])
@pytest.mark.parametrize("accept", ["application/json", OCTET, NPY])
def test_every_kind_of_body_and_answer(shared_client: TestClient, original: Path, sent: str, accept: str) -> None:
    given = angles(5, "f8")
    wanted = local(original, "red").evaluate(*given)
    listed = dict(zip(("theta_i", "theta_o", "delta_phi"), given.tolist()))
    bodies = {
        "json": (json.dumps(listed).encode(), "application/json"),
        "octet": (given.tobytes(), OCTET),
        "npy": (npy(given), NPY),
    }
    answer = post(shared_client, *bodies[sent], "red", "angles=rad", accept=accept)
    assert answer.headers["content-type"] == accept
    if accept == OCTET:
        found = np.frombuffer(answer.content).reshape(5, 3)
    else:
        found = np.load(io.BytesIO(answer.content)) if accept == NPY else np.array(answer.json()["values"])
    assert np.array_equal(found, wanted)


def test_float32_as_json_reads_back_to_the_same_bits(shared_client: TestClient, original: Path) -> None:
    given = angles(50, "f4")
    wanted = local(original, "red").evaluate(*given)
    answer = post(shared_client, given.tobytes(), name="red", query="dtype=f4&angles=rad", accept="application/json")
    assert answer.json()["values"] == wanted.astype(np.float64).tolist()


def test_get_by_accept(shared_client: TestClient, original: Path) -> None:
    path = "/v1/materials/red/evaluate?theta_i=0.5&theta_o=0.1,0.2&delta_phi=3&angles=rad"
    wanted = local(original, "red").evaluate(0.5, [0.1, 0.2], 3.0)
    raw = shared_client.get(path, headers={"accept": OCTET})
    assert raw.content == wanted.tobytes()
    one = shared_client.get(path.replace("0.1,0.2", "0.1"), headers={"accept": OCTET})
    assert one.content == wanted[0].tobytes()
    assert one.headers["x-brdf-shape"] == "1,3"
    file = shared_client.get(path, headers={"accept": f"{NPY}, application/json;q=0.5"})
    assert np.array_equal(np.load(io.BytesIO(file.content)), wanted)
    plain = shared_client.get(path)
    assert plain.headers["content-type"] == "application/json"
    assert len({a.headers["etag"] for a in (raw, file, plain)}) == 3
    assert all(a.headers["vary"] == "Accept" for a in (raw, file, plain))
    assert_problem(shared_client.get(path, headers={"accept": "text/html"}), 406, "not_acceptable")
    assert_problem(shared_client.get(path, headers={"accept": "*/*;q=0"}), 406, "not_acceptable")
    for accept in ("text/html, */*;q=0.1", "application/*", "", "application/json;q=x"):
        assert shared_client.get(path, headers={"accept": accept}).headers["content-type"] == "application/json"


def test_status_of_each_point(shared_client: TestClient, original: Path) -> None:
    given = angles(4, "f8")
    given[1, 2] = 2.0  # past the horizon
    brdf = local(original, "red")
    codes = brdf.status(*given).tolist()
    assert codes[2] == bc.Status.OUTSIDE
    wanted = brdf.evaluate(*given, outside="nan")
    query = "angles=rad&outside=nan&status=true"
    raw = post(shared_client, given.tobytes(), name="red", query=query).content
    assert raw == wanted.tobytes() + bytes(codes)
    file = io.BytesIO(post(shared_client, npy(given), NPY, "red", query).content)
    assert np.array_equal(np.load(file), wanted, equal_nan=True)
    assert np.load(file).tolist() == codes
    answer = post(shared_client, given.tobytes(), name="red", query=query, accept="application/json").json()
    assert answer["status"] == codes
    assert answer["status_names"][codes[2]] == "outside"
    assert answer["values"][2] == [None, None, None]
    listed = shared_client.get(
        "/v1/materials/red/evaluate?theta_i=30&theta_o=30,95&delta_phi=0&outside=nan&status=true"
    ).json()
    assert listed["status"][1] == bc.Status.OUTSIDE
    clipped = shared_client.get("/v1/materials/red/evaluate?theta_i=30&theta_o=95,90&delta_phi=0&outside=clip").json()
    assert clipped["values"][0] == clipped["values"][1]


def test_no_points(shared_client: TestClient) -> None:
    assert post(shared_client, b"").content == b""
    assert post(shared_client, b"").headers["x-brdf-shape"] == "0,1"
    assert np.load(io.BytesIO(post(shared_client, npy(np.empty((3, 0))), NPY).content)).shape == (0, 1)


@pytest.mark.parametrize(("bad", "index"), [(np.nan, 3), (np.inf, 0), (-1e-9, 4), (1.6, 2)])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_values_outside_are_told_with_their_place(
    shared_client: TestClient, bad: float, index: int, dtype: str
) -> None:
    given = angles(5, dtype)
    given[1, index] = bad
    for body, kind in ((given.tobytes(), OCTET), (npy(given), NPY)):
        query = "angles=rad" + (f"&dtype={dtype}" if kind == OCTET else "")
        content = assert_problem(post(shared_client, body, kind, query=query), 422, "angle_outside")
        assert (content["errors"][0]["where"], content["errors"][0]["index"]) == ("theta_o", [index])


@pytest.mark.parametrize(
    ("body", "kind", "query", "status", "code"),
    [
        (b"x" * 25, OCTET, "", 422, "bad_length"),
        (b"x" * 36, OCTET, "dtype=f8", 422, "bad_length"),
        (b"x" * 24, OCTET, "dtype=f2", 422, "bad_choice"),
        (b"", NPY, "", 400, "bad_npy"),
        (b"\x93NUMPY", NPY, "", 400, "bad_npy"),
        (b"\x93NUMPY\x01\x00\xff\xff{", NPY, "", 400, "bad_npy"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{", NPY, "", 400, "bad_npy"),
        (npy(np.zeros((3, 2)))[:-1], NPY, "", 400, "bad_npy"),
        (npy(np.zeros((3, 2))) + b"x", NPY, "", 400, "bad_npy"),
        (npy(np.zeros((2, 3))), NPY, "", 422, "bad_array"),
        (npy(np.zeros(3)), NPY, "", 422, "bad_array"),
        (npy(np.zeros((3, 2), "i4")), NPY, "", 422, "bad_array"),
        (npy(np.zeros((3, 2), "c16")), NPY, "", 422, "bad_array"),
        (npy(np.zeros((3, 2), "f4")), NPY, "dtype=f8", 422, "given_twice"),
        (npy_head((3, 10**17), "<f8"), NPY, "", 413, "too_many_points"),
        (npy_head((3, 2**31), "<f4"), NPY, "", 413, "too_many_points"),
        (npy(np.zeros((3, 2))).replace(b"'<f8'", b"__im_"), NPY, "", 400, "bad_npy"),
        (b"{}", "text/plain", "", 415, "unsupported_media_type"),
        (b'{"theta_i":1,"theta_o":1,"delta_phi":1,"angles":"deg"}', JSON, "angles=rad", 422, "given_twice"),
    ],
)  # fmt: skip
def test_bodies_that_are_refused(
    shared_client: TestClient, body: bytes, kind: str, query: str, status: int, code: str
) -> None:
    assert_problem(post(shared_client, body, kind, query=query), status, code)


def test_pickles_are_never_read(shared_client: TestClient) -> None:
    file = io.BytesIO()
    np.save(file, np.array([[{}], [1], [2]], dtype=object), allow_pickle=True)
    assert_problem(post(shared_client, file.getvalue(), NPY), 422, "bad_array")


def test_limits(serve: Serve) -> None:
    client = serve(max_points=10, max_body_bytes=1000, max_values=12)
    assert post(client, bytes(24 * 10)).status_code == 200
    assert_problem(post(client, bytes(24 * 11)), 413, "too_many_points")
    assert_problem(post(client, bytes(24 * 10), name="red"), 413, "too_many_values")
    content = assert_problem(post(client, bytes(2400)), 413, "body_too_large")
    assert content["errors"][0]["limit"] == 1000

    def endless() -> Any:
        for _ in range(50):
            yield bytes(100)

    streamed = client.post("/v1/materials/red/evaluate", content=endless(), headers={"content-type": OCTET})
    assert_problem(streamed, 413, "body_too_large")
    assert streamed.headers["connection"] == "close"


def test_bodies_without_a_length(shared_client: TestClient, original: Path) -> None:
    given = angles(1000, "f8")

    def pieces() -> Any:
        body = given.tobytes()
        for k in range(0, len(body), 1001):
            yield body[k : k + 1001]

    path = "/v1/materials/red/evaluate?angles=rad"
    answer = shared_client.post(path, content=pieces(), headers={"content-type": OCTET})
    assert answer.content == local(original, "red").evaluate(*given).tobytes()
