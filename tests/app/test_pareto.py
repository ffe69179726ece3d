"""Representations weighed by a job: its JSON, its picture, and who may ask."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from starlette.testclient import TestClient

from brdfcore.client.jobs import report_of
from tests.app.conftest import Serve, assert_problem
from tests.app.test_writing import ended, leftovers

WHITE = {"model": "lambert", "parameters": {"reflectance": 0.8}}


def test_a_report_over_http(client: TestClient, data: Path) -> None:
    assert client.put("/v1/materials/white", json=WHITE).status_code == 201
    answer = client.post("/v1/materials/white/pareto", json={"tolerance": 0.02, "seconds": 1})
    early = client.get(f"{answer.headers['location']}/pareto.png")
    assert_problem(early, 404, "no_picture")
    job = ended(client, answer)
    assert (job["state"], job["kind"], job["problem"]) == ("done", "pareto", None)
    (told,) = job["result"]["materials"]
    assert report_of(job) == told  # as the client reads it
    assert (told["material"], told["tolerance"], told["table_path"]) == ("white", 0.02, None)
    assert told["chosen"]["representation"] == "lambert"
    assert told["advice"].startswith("Use the formula itself (lambert")
    assert isinstance(told["alternatives"], list)
    assert {"representation", "nbytes", "l1", "ns"} <= set(told["front"][0])
    picture = client.get(job["links"]["picture"])
    assert picture.headers["content-type"] == "image/png"
    assert Image.open(io.BytesIO(picture.content)).size[0] > 1000
    assert str(data) not in client.get(answer.headers["location"]).text
    assert leftovers(data) == []


@pytest.mark.parametrize(
    ("name", "body", "status", "code"),
    [
        ("nothing", {}, 404, "unknown_material"),
        ("gold", {"tolerance": 0}, 422, "bad_field"),
        ("gold", {"tolerance": "fine"}, 422, "bad_field"),
        ("gold", {"seconds": 10_000}, 422, "bad_field"),
        ("gold", {"max_bytes": 1.5}, 422, "bad_field"),
        ("gold", {"sizes": [1]}, 422, "unknown_field"),
        ("gold", [1], 422, "bad_body"),
    ],
)
def test_what_is_refused(client: TestClient, data: Path, name: str, body: Any, status: int, code: str) -> None:
    assert_problem(client.post(f"/v1/materials/{name}/pareto", json=body), status, code)
    assert leftovers(data) == []


def test_who_may_only_read_may_not_keep_the_machine_busy(serve: Serve) -> None:
    client = serve(host="0.0.0.0", allowed_hosts="127.0.0.1")
    assert client.post("/v1/materials/gold/pareto", json={}).status_code == 403


def test_other_jobs_have_no_picture(client: TestClient) -> None:
    job = ended(client, client.put("/v1/materials/white", json={**WHITE, "tabulate": {"shape": [3, 3, 3]}}))
    assert "picture" not in job["links"]
    assert_problem(client.get(f"/v1/jobs/{job['id']}/pareto.png"), 404, "no_picture")
