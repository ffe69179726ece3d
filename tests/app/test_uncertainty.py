"""Half-widths over HTTP: the library's own bits, in every kind of answer."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.schemas.evaluate import EvaluateAnswer
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, local

ANGLES = np.radians([[10.0, 30.0, 80.0], [5.0, 31.0, 60.0], [0.0, 180.0, 77.0]])


def post(client: TestClient, name: str, accept: str, dtype: Any, query: str) -> Any:
    code = {np.float32: "f4", np.float64: "f8"}[dtype]
    headers = {"content-type": "application/octet-stream", "accept": accept}
    url = f"/v1/materials/{name}/evaluate?angles=rad&dtype={code}&{query}"
    return client.post(url, content=ANGLES.astype(dtype).tobytes(), headers=headers)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", ["gold-grid", "red", "gold"])
@pytest.mark.parametrize("status", [False, True])
def test_binary_answers(shared_client: TestClient, original: Path, name: str, dtype: Any, status: bool) -> None:
    brdf, angles = local(original, name), ANGLES.astype(dtype)
    values, widths, codes = brdf.evaluate(*angles), brdf.uncertainty(*angles), brdf.status(*angles)
    assert widths.any() == (name != "gold")
    query = f"uncertainty=true&status={str(status).lower()}"
    octets = post(shared_client, name, "application/octet-stream", dtype, query).content
    assert octets == values.tobytes() + (codes.tobytes() if status else b"") + widths.tobytes()
    file = io.BytesIO(post(shared_client, name, "application/x-npy", dtype, query).content)
    assert np.array_equal(np.load(file), values)
    if status:
        assert np.array_equal(np.load(file), codes)
    assert np.array_equal(np.load(file), widths)
    assert not file.read()


def test_json_answers(shared_client: TestClient, original: Path) -> None:
    query = "theta_i=10,30,80&theta_o=5,31,60&delta_phi=0,180,77"
    url = f"/v1/materials/red/evaluate?{query}"
    answer = shared_client.get(f"{url}&uncertainty=true&status=true").json()
    degrees = np.radians([[10.0, 30.0, 80.0], [5.0, 31.0, 60.0], [0.0, 180.0, 77.0]])
    assert answer["uncertainty"] == local(original, "red").uncertainty(*degrees).tolist()
    assert answer["status_names"][5] == "smoothed"
    EvaluateAnswer.model_validate(answer, strict=True)
    assert "uncertainty" not in shared_client.get(url).json()


def test_what_has_none_is_refused(serve: Serve, data: Path) -> None:
    table = bc.open_table(data / "red.h5")
    table.local_error = None  # as a table of an earlier version
    table.save(data / "old.h5")
    answer = serve().get("/v1/materials/old/evaluate?theta_i=1&theta_o=1&delta_phi=1&uncertainty=true")
    problem = assert_problem(answer, 422, "missing_uncertainty")
    assert "brdf tabulate" in problem["detail"]
    assert serve().get("/v1/materials/old/evaluate?theta_i=1&theta_o=1&delta_phi=1").status_code == 200


def test_vectors_have_none(shared_client: TestClient) -> None:
    answer = shared_client.post("/v1/materials/red/evaluate?uncertainty=true", json={"wi": [0, 0, 1], "wo": [0, 0, 1]})
    assert "uncertainty is given for angles only" in assert_problem(answer, 422, "options_exclude")["detail"]


def test_an_angle_outside_is_named(shared_client: TestClient) -> None:
    url = "/v1/materials/red/evaluate?theta_i=1,95&theta_o=1&delta_phi=1&uncertainty=true"
    assert assert_problem(shared_client.get(url), 422, "angle_outside")["errors"][0]["index"] == [1]
    marked = shared_client.get(f"{url}&outside=nan").json()
    assert marked["uncertainty"][1] == [None] * 3
