"""The import report and the covered angles over HTTP."""

from __future__ import annotations

import pytest
from starlette.testclient import TestClient

import brdfcore as bc
from brdfcore.formats.base.regrid import to_brdf
from tests.app.conftest import Serve, assert_problem
from tests.support import goniometer


@pytest.fixture
def listed(serve: Serve, data: object) -> TestClient:
    b = to_brdf(goniometer.measured(bc.model("lambert"), lights=3, viewers=4, turns=4), shape="[6,6,6]")
    b.save(f"{data}/listed.h5")  # type: ignore[attr-defined]
    return serve()


def test_report(listed: TestClient) -> None:
    answer = listed.get("/v1/materials/listed/report")
    assert answer.status_code == 200
    content = answer.json()
    report = content["report"]
    assert report["counts"]["geometries"] == 4 + 2 + 2 * 3 * 4
    assert {"conventions", "policies", "coverage", "albedo", "reciprocity", "bilateral", "done"} <= set(report)
    assert listed.get(f"/v1/tables/{content['id']}/report").json() == content
    assert (
        listed.get("/v1/materials/listed/report", headers={"if-none-match": answer.headers["etag"]}).status_code == 304
    )
    assert listed.get("/v1/materials/gold/report").json()["report"]["format"] == "model"
    links = listed.get("/v1/materials/listed").json()["links"]
    assert all(listed.get(links[name]).status_code == 200 for name in ("report", "coverage"))


def test_coverage(listed: TestClient) -> None:
    answer = listed.get("/v1/materials/listed/coverage.png")
    assert (answer.status_code, answer.content[:4]) == (200, b"\x89PNG")
    svg = listed.get("/v1/materials/listed/coverage.svg?theta_i=0,30")
    assert "default-src" in svg.headers["content-security-policy"]
    assert b"<svg" in svg.content


def test_by_id_nothing_stays_that_belongs_to_the_file(listed: TestClient) -> None:
    """Two files may hold one table: its permanent address names neither of them for ever."""
    id = listed.get("/v1/materials/listed").json()["id"]
    by_name, by_id = (listed.get(f"/v1/{place}/coverage.svg") for place in ("materials/listed", f"tables/{id}"))
    assert "immutable" in by_id.headers["cache-control"]
    assert b"<!-- listed" in by_name.content
    assert b"listed" not in by_id.content
    assert "immutable" not in listed.get(f"/v1/tables/{id}/report").headers["cache-control"]


@pytest.mark.parametrize(
    ("query", "status", "code"),
    [("theta_i=91", 422, "angle_outside"), ("theta_i=" + ",".join("1" * 13), 422, "wrong_number"), ("x=1", 422, None)],
)
def test_bad_requests(listed: TestClient, query: str, status: int, code: str | None) -> None:
    answer = listed.get(f"/v1/materials/listed/coverage.png?{query}")
    assert_problem(answer, status, code or answer.json()["code"])
    assert_problem(listed.get("/v1/materials/none/report"), 404, "unknown_material")
