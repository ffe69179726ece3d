"""Checks and gloss over HTTP: the library's answers, cached, by name and by id."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from brdf_service.schemas.analysis import ChecksAnswer, FitAnswer, GlossAnswer
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, local


def plain(value: object) -> object:
    return json.loads(json.dumps(value))


def test_checks(shared_client: TestClient, original: Path) -> None:
    answer = shared_client.get("/v1/materials/red/checks")
    assert answer.status_code == 200
    content = answer.json()
    ChecksAnswer.model_validate(content, strict=True)
    here = bc.check(local(original, "red"))
    assert content == {**plain(here.to_json()), "id": content["id"]}  # type: ignore[dict-item]
    assert (content["angles"], content["channels"]) == ("deg", ["R", "G", "B"])
    radians = shared_client.get("/v1/materials/red/checks?angles=rad").json()
    assert radians == {**plain(here.to_json("rad")), "id": content["id"]}  # type: ignore[dict-item]


def test_gloss(shared_client: TestClient, original: Path) -> None:
    content = shared_client.get("/v1/materials/mirror/gloss").json()
    GlossAnswer.model_validate(content, strict=True)
    here = bc.gloss(local(original, "mirror"))
    assert content == {**plain(here.to_json()), "id": content["id"]}  # type: ignore[dict-item]
    assert content["gloss"]["20"]["values"][0] > 1000  # silver: 100 is a reflectance of .049
    assert content["haze"]["astm_e430"]["values"] == [0.0]


def test_fit(shared_client: TestClient, original: Path) -> None:
    content = shared_client.get("/v1/materials/red/fit?model=ward").json()
    FitAnswer.model_validate(content, strict=True)
    here = bc.fit(local(original, "red"), "ward", 1)
    assert content == {**plain(here.to_json()), "id": content["id"]}  # type: ignore[dict-item]
    assert shared_client.get("/v1/materials/mirror/fit").json()["remarks"]
    assert_problem(shared_client.get("/v1/materials/red/fit?lobes=7"), 422, "bad_choice")


@pytest.mark.parametrize("what", ["checks", "gloss"])
def test_answers_are_cached(shared_client: TestClient, what: str) -> None:
    answer = shared_client.get(f"/v1/materials/mirror/{what}")
    assert answer.headers["cache-control"] == "no-cache"
    permanent = answer.headers["content-location"]
    assert permanent == f"/v1/tables/{answer.json()['id']}/{what}"
    assert shared_client.get(permanent).json() == answer.json()
    assert "immutable" in shared_client.get(permanent).headers["cache-control"]
    again = shared_client.get(f"/v1/materials/mirror/{what}", headers={"if-none-match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert shared_client.head(f"/v1/materials/mirror/{what}").status_code == 200
    assert shared_client.get("/v1/materials/mirror").json()["links"][what] == f"/v1/materials/mirror/{what}"


def test_a_material_is_analysed_once(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    client, count = serve(), []
    monkeypatch.setattr(bc, "check", lambda b, check=bc.check: (count.append(1), check(b, directions=100))[1])
    for unit in ("deg", "rad", "deg"):
        assert client.get(f"/v1/materials/gold-grid/checks?angles={unit}").json()["angles"] == unit
    assert len(count) == 1


@pytest.mark.parametrize(
    ("path", "status", "code"),
    [
        ("checks?angles=grad", 422, "bad_choice"),
        ("checks?theta_i=3", 422, "unknown_parameter"),
        ("gloss?angles=deg", 422, "unknown_parameter"),
        ("gloss?x", 422, "unknown_parameter"),
    ],
)
def test_parameters_that_are_none(shared_client: TestClient, path: str, status: int, code: str) -> None:
    assert_problem(shared_client.get(f"/v1/materials/mirror/{path}"), status, code)


def test_materials_that_are_none(shared_client: TestClient, serve: Serve, data: Path) -> None:
    for what in ("checks", "gloss"):
        assert shared_client.get(f"/v1/materials/none/{what}").status_code == 404
        assert shared_client.get(f"/v1/tables/{'0' * 64}/{what}").status_code == 404
        assert shared_client.post(f"/v1/materials/mirror/{what}").status_code == 405
    (data / "broken.h5").write_bytes(b"nothing")
    assert serve().get("/v1/materials/broken/checks").status_code == 409


def test_the_document_has_them(shared_client: TestClient) -> None:
    document = shared_client.get("/openapi.json").json()
    for what, schema in (("checks", "ChecksAnswer"), ("gloss", "GlossAnswer")):
        for prefix in ("/v1/materials/{name}", "/v1/tables/{id}"):
            content = document["paths"][f"{prefix}/{what}"]["get"]["responses"]["200"]["content"]
            assert content["application/json"]["schema"]["$ref"].endswith(schema)
        assert schema in document["components"]["schemas"]
