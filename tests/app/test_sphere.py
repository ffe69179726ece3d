"""The sphere over HTTP: the library's own picture, its limits, its caching."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from PIL import Image
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import assert_problem, local


@pytest.mark.parametrize("name", ["gold-grid", "red", "mirror", "gold"])
def test_picture(shared_client: TestClient, original: Path, name: str) -> None:
    answer = shared_client.get(f"/v1/materials/{name}/sphere.png?size=230")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "image/png"
    assert answer.headers["cache-control"] == "no-cache"
    assert Image.open(io.BytesIO(answer.content)).size == (230, 250)
    figure = bc.plot.sphere(local(original, name), title=name, size=(4.6, 5.0), dpi=50)
    assert answer.content == bc.plot.render(figure, "png")
    again = {"If-None-Match": answer.headers["etag"]}
    assert shared_client.get(f"/v1/materials/{name}/sphere.png?size=230", headers=again).status_code == 304
    other = shared_client.get(f"/v1/materials/{name}/sphere.png?size=230&light=sky", headers=again)
    assert other.status_code == 200
    permanent = shared_client.get(answer.headers["content-location"])
    assert permanent.status_code == 200
    assert "immutable" in permanent.headers["cache-control"]


@pytest.mark.parametrize(
    ("query", "code", "where"),
    [
        ("size=127", "bad_number", "size"),
        ("size=1025", "bad_number", "size"),
        ("size=1e3", "bad_number", "size"),
        ("light=moon", "bad_choice", "light"),
        ("channel=X", "unknown_channel", "channel"),
        ("theta_i=30", "unknown_parameter", "query"),
    ],
)
def test_refusals(shared_client: TestClient, query: str, code: str, where: str) -> None:
    content = assert_problem(shared_client.get(f"/v1/materials/red/sphere.png?{query}"), 422, code)
    assert content["errors"][0]["where"] == where


def test_link_and_document(shared_client: TestClient) -> None:
    links = shared_client.get("/v1/materials/red").json()["links"]
    assert shared_client.get(links["sphere"]).status_code == 200
    assert links["sphere"] in shared_client.get("/materials/red").text
    paths = shared_client.get("/openapi.json").json()["paths"]
    assert "/v1/materials/{name}/sphere.png" in paths
    assert "/v1/tables/{id}/sphere.png" in paths
