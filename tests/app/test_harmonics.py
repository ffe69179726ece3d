"""Expansions and relighting over HTTP: the library's numbers, the limits, and what is refused."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.schemas.harmonics import HarmonicsAnswer, RelightAnswer
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, local
from tests.app.test_slices import assert_harmless

RED = "/v1/materials/red"
UP = {"normals": [[0, 0, 1]], "views": [[0, 0, 1]]}
SUN = {"direction": [1, 0, 1], "irradiance": 3.0}


def npy(array: np.ndarray, **options: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array, **options)
    return file.getvalue()


def test_the_numbers_are_the_librarys(shared_client: TestClient, original: Path) -> None:
    answer = shared_client.get(f"{RED}/harmonics?lmax=5&window=hann")
    told = HarmonicsAnswer.model_validate_json(answer.content)
    made = bc.project(local(original, "red"), 5, window="hann")
    assert answer.json() == {**bc.harmonic_summary(made), "id": told.id}
    assert told.bytes == made.nbytes
    assert len(told.error_by_degree) == 6
    assert told.truncation.target > told.error_by_degree[-1]  # the window's part


def test_it_is_cached_by_etag_and_by_id(shared_client: TestClient) -> None:
    first = shared_client.get(f"{RED}/harmonics?lmax=4")
    assert first.headers["cache-control"] == "no-cache"
    again = shared_client.get(f"{RED}/harmonics?lmax=4", headers={"If-None-Match": first.headers["etag"]})
    assert again.status_code == 304
    lasting = shared_client.get(first.headers["content-location"])
    assert "immutable" in lasting.headers["cache-control"]
    assert lasting.json() == first.json()
    assert shared_client.get(f"{RED}/harmonics?lmax=3").headers["etag"] != first.headers["etag"]


@pytest.mark.parametrize("format", ["png", "svg"])
def test_pictures(shared_client: TestClient, format: str) -> None:
    answer = shared_client.get(f"{RED}/harmonics.{format}?lmax=4&theta_i=0.3,1&angles=rad&channel=R")
    assert answer.status_code == 200
    if format == "png":
        assert answer.content.startswith(b"\x89PNG")
    else:
        assert_harmless(answer.content)
        assert (
            "script-src" in answer.headers["content-security-policy"]
            or "default-src" in answer.headers["content-security-policy"]
        )
        ET.fromstring(answer.content)
    assert shared_client.get(f"{RED}/harmonics.{format}?lmax=4&angles=rad").status_code == 200


@pytest.mark.parametrize(
    ("path", "status", "code"),
    [
        ("harmonics?lmax=65", 413, "lmax_too_large"),
        ("harmonics?lmax=0", 422, "bad_number"),
        ("harmonics?lmax=x", 422, "bad_number"),
        ("harmonics?target=g", 422, "bad_choice"),
        ("harmonics?target=f_cos_o&symmetrise=true&lmax=3", 422, "bad_target"),
        ("harmonics?degree=3", 422, "unknown_parameter"),
        ("harmonics.png?lmax=3&theta_i=95", 422, "angle_outside"),
        ("harmonics.png?lmax=3&theta_i=1,2,3,4,5", 422, "wrong_number"),
        ("harmonics.svg?lmax=3&channel=Q", 422, "unknown_channel"),
        ("harmonics.svg?lmax=65", 413, "lmax_too_large"),
    ],
)
def test_refused_questions(shared_client: TestClient, path: str, status: int, code: str) -> None:
    content = assert_problem(shared_client.get(f"{RED}/{path}"), status, code)
    if code == "angle_outside":
        assert content["errors"][0]["got"] == 95.0


def test_unknown_materials(shared_client: TestClient) -> None:
    assert shared_client.get("/v1/materials/nobody/harmonics?lmax=3").status_code == 404
    assert shared_client.post("/v1/materials/nobody/relight", json={**UP, "lights": [SUN]}).status_code == 404


def test_relight_is_the_librarys(shared_client: TestClient, original: Path) -> None:
    red = local(original, "red")
    rng = np.random.default_rng(4)
    pixels = rng.random((6, 12, 3))
    normals = rng.normal(size=(5, 3))
    views = normals + 0.3 * rng.normal(size=(5, 3))
    body = {"normals": normals.tolist(), "views": views.tolist(), "map": pixels.tolist(), "lights": [SUN]}
    answer = shared_client.post(f"{RED}/relight?lmax=4", json=body)
    assert answer.status_code == 200, answer.text
    assert answer.headers["cache-control"] == "no-store"
    told = RelightAnswer.model_validate_json(answer.content)
    light = bc.Light.from_map(pixels, 4) + bc.Light.directional([1, 0, 1], 3.0)
    expected = bc.relight(red, light, normals, views, expansion=bc.project(red, 4))
    np.testing.assert_allclose(told.radiance, expected, rtol=1e-13)
    assert told.environment is not None
    assert told.environment.error == pytest.approx(float(light.error_by_degree()[-1]), rel=1e-12)
    assert told.expansion is not None
    assert told.expansion["lmax"] == 4

    query = f"lmax=4&normals={','.join(map(repr, normals.reshape(-1).tolist()))}&views=0,0,1"
    for array in (pixels, np.asfortranarray(pixels), pixels.astype(">f8")):
        answer = shared_client.post(
            f"{RED}/relight?{query}", content=npy(array), headers={"content-type": "application/x-npy"}
        )
        assert answer.status_code == 200, answer.text
        only_map = bc.relight(red, bc.Light.from_map(pixels, 4), normals, [0, 0, 1], expansion=bc.project(red, 4))
        np.testing.assert_allclose(answer.json()["radiance"], only_map, rtol=1e-13)


def test_a_directional_light_is_exact_and_needs_no_expansion(shared_client: TestClient, original: Path) -> None:
    answer = shared_client.post("/v1/materials/gold/relight", json={**UP, "lights": [SUN]}).json()
    expected = 3 * np.sqrt(0.5) * local(original, "gold").evaluate(np.pi / 4, 0.0, 0.0)
    assert answer["radiance"][0] == pytest.approx(expected, rel=1e-12)
    assert answer["environment"] is None
    assert answer["expansion"] is None


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"views": [[0, 0, 1]], "lights": [SUN]}, "field_missing"),
        (UP, "field_missing"),
        ({**UP, "lights": []}, "field_missing"),
        ({**UP, "lights": {}}, "bad_field"),
        ({**UP, "lights": [1]}, "bad_body"),
        ({**UP, "lights": [{"direction": [0, 0, 1]}]}, "field_missing"),
        ({**UP, "lights": [{**SUN, "size": 1}]}, "unknown_field"),
        ({**UP, "lights": [{**SUN, "direction": [0, 0, 0]}]}, "not_a_direction"),
        ({**UP, "lights": [{**SUN, "irradiance": [1, 2]}]}, "bad_channels"),
        ({**UP, "lights": [{**SUN, "irradiance": []}]}, "bad_channels"),
        ({**UP, "lights": [{**SUN, "irradiance": 1e300}]}, "too_bright"),
        ({**UP, "lights": [{**SUN, "direction": []}]}, "bad_field"),
        ({**UP, "map": [[1e300]]}, "bad_map"),
        ({**UP, "normals": [], "map": [[1]]}, "bad_field"),
        ({**UP, "map": [[1, True]]}, "bad_field"),
        ({**UP, "map": [[1, 2], [3]]}, "not_a_number"),
        ({**UP, "map": [[1, "2"]]}, "bad_field"),
        ({**UP, "map": 1}, "bad_field"),
        ({**UP, "map": []}, "bad_map"),
        ({**UP, "map": [[]]}, "bad_map"),
        ({**UP, "map": [[[1, 2]]]}, "bad_channels"),
        ({**UP, "map": [[10**400]]}, "bad_field"),
        ({**UP, "map": [[1]], "normals": [[0, 0, 0]]}, "not_a_direction"),
        ({**UP, "map": [[1]], "normals": [[0, 1]]}, "bad_field"),
        ({**UP, "map": [[1]], "normals": [[0, 0, 1]] * 2, "views": [[0, 0, 1]] * 3}, "shapes_do_not_broadcast"),
        ({**UP, "sky": 1}, "unknown_field"),
        ([], "bad_body"),
    ],
)
def test_refused_bodies(shared_client: TestClient, body: Any, code: str) -> None:
    assert_problem(shared_client.post(f"{RED}/relight?lmax=2", json=body), 422, code)


def test_refused_files_and_types(shared_client: TestClient) -> None:
    path = f"{RED}/relight?lmax=2&normals=0,0,1&views=0,0,1"

    def post(content: bytes, kind: str = "application/x-npy", path: str = path) -> Any:
        return shared_client.post(path, content=content, headers={"content-type": kind})

    good = npy(np.ones((2, 4)))
    assert post(good).status_code == 200
    assert_problem(post(good[:-1]), 400, "bad_npy")
    assert_problem(post(b"nonsense"), 400, "bad_npy")
    assert_problem(post(npy(np.ones(3))), 422, "bad_array")
    assert_problem(post(npy(np.ones((2, 2), int))), 422, "bad_array")
    assert_problem(post(npy(np.full((2, 2), np.nan))), 422, "bad_map")
    assert_problem(post(good, path=f"{RED}/relight?normals=0,0,1"), 422, "parameter_missing")
    assert_problem(post(good, path=f"{RED}/relight?normals=0,0&views=0,0,1"), 422, "not_vectors")
    assert_problem(post(b"[]", "application/json"), 422, "given_twice")
    assert_problem(post(b"{", "application/json", f"{RED}/relight"), 400, "bad_json")
    assert_problem(post(b"", "application/octet-stream"), 415, "unsupported_media_type")
    assert_problem(post(b"", "text/plain"), 415, "unsupported_media_type")


def test_limits(serve: Serve) -> None:
    client = serve(max_points=100, max_lmax=8, max_values=40)
    lit = {"lights": [SUN]}
    many = {"normals": [[0, 0, 1]] * 11, "views": [[0, 0, 1]]}
    assert_problem(client.post(f"{RED}/relight", json={**many, **lit}), 413, "lmax_too_large")
    assert_problem(client.post(f"{RED}/relight?lmax=8", json={**many, **lit}), 413, "too_many_points")
    assert_problem(client.post(f"{RED}/relight?lmax=8", json={**UP, "lights": [SUN] * 101}), 413, "too_many_points")
    assert_problem(client.post(f"{RED}/relight?lmax=8", json={**UP, "map": [[1] * 101]}), 413, "too_many_points")
    assert_problem(client.get(f"{RED}/harmonics"), 413, "lmax_too_large")
