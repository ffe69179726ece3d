"""POST .../sample: the library's own directions, and what is refused."""

from __future__ import annotations

import numpy as np
from fastapi.testclient import TestClient

import brdfcore as bc


def test_directions_of_a_material(client: TestClient) -> None:
    facts = client.get("/v1/materials/gold").json()
    wi, u = [0.6, 0.0, 0.8], [[0.1, 0.2], [0.7, 0.9]]
    answer = client.post("/v1/materials/gold/sample", json={"wi": wi, "u": u})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert found["id"] == facts["id"]
    assert np.shape(found["wo"]) == (2, 3)
    assert np.shape(found["weight"]) == (2, len(facts["channels"]))
    assert found["delta"] == [False, False]
    f = client.post("/v1/materials/gold/evaluate", json={"wi": wi, "wo": found["wo"]}).json()["values"]
    expected = np.array(f) * np.array(found["wo"])[:, 2:] / np.array(found["pdf"])[:, None]
    assert np.allclose(found["weight"], expected, rtol=1e-9)
    by_id = client.post(f"/v1/tables/{facts['id']}/sample", json={"wi": wi, "u": u}).json()
    assert by_id["wo"] == found["wo"]


def test_a_mirror_has_no_density(client: TestClient) -> None:
    found = client.post("/v1/materials/mirror/sample", json={"wi": [0.6, 0, 0.8], "u": [0.5, 0.5]}).json()
    assert found["pdf"] == [None]
    assert found["delta"] == [True]
    assert np.allclose(found["wo"], [[-0.6, 0, 0.8]])
    reflectance = bc.model("mirror", ior="gold").delta_reflectance(np.arccos(0.8))
    assert np.shape(found["weight"]) == (1, reflectance.size)


def test_what_is_refused(client: TestClient) -> None:
    path = "/v1/materials/gold/sample"
    for body in ({}, {"wi": [0, 0, 1]}, {"wi": [0, 0, 1], "u": [0.5, 1.0]}, {"wi": [0, 0], "u": [0.5, 0.5]}, [], "x"):
        assert client.post(path, json=body).status_code == 422, body
    assert client.post(path, json={"wi": [0, 0, 0], "u": [0.5, 0.5]}).status_code == 422
    assert client.post(path, json={"wi": [[0, 0, 1]] * 2, "u": [[0.5, 0.5]] * 3}).status_code == 422
    assert (
        client.post(path, content=b"\x00" * 16, headers={"content-type": "application/octet-stream"}).status_code == 415
    )
    assert client.post("/v1/materials/none/sample", json={"wi": [0, 0, 1], "u": [0.5, 0.5]}).status_code == 404
    assert client.get(path).status_code == 405
