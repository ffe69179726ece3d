"""Materials stored, replaced and deleted over HTTP, on condition that they are what the caller thinks they are."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.schemas.materials import MaterialLine
from brdf_service.schemas.work import JobAnswer
from brdf_service.work.jobs import QUEUED
from starlette.testclient import TestClient

import brdfcore as bc
from brdfcore.formats.rgl.tensor_file import encode
from tests.app.conftest import Serve, assert_problem, local
from tests.support.rgl_synthetic import fields_of

WHITE = {"model": "lambert", "parameters": {"reflectance": 0.8}}
OCTET = {"content-type": "application/octet-stream"}
PAINT = encode(fields_of())
VALUE = "evaluate?theta_i=30&theta_o=30&delta_phi=180"


def ended(client: TestClient, answer: Any, seconds: float = 240) -> dict[str, Any]:
    """The job that a request was answered with, once it has ended: a while, if kernels must be compiled first."""
    assert answer.status_code == 202, answer.text
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        job = client.get(answer.headers["location"])
        assert job.status_code == 200
        content: dict[str, Any] = job.json()
        JobAnswer.model_validate(content, strict=True)
        if content["state"] in ("done", "failed", "cancelled"):
            return content
        time.sleep(0.05)
    raise AssertionError(content)


def leftovers(folder: Path) -> list[str]:
    return [p.name for p in folder.iterdir() if p.name.startswith(".") and p.name not in (".lock", ".jobs")]


def test_put_a_model(client: TestClient, data: Path) -> None:
    made = client.put("/v1/materials/white", json={**WHITE, "about": "a white wall"})
    assert made.status_code == 201
    MaterialLine.model_validate_json(made.content)
    assert made.headers["location"] == "/v1/materials/white"
    again = client.get("/v1/materials/white")
    assert again.headers["etag"] == made.headers["etag"]
    assert again.json() == made.json()
    assert again.json()["metadata"]["about"] == "a white wall"
    assert client.get(f"/v1/materials/white/{VALUE}").json()["values"] == [[0.8 / np.pi]]
    assert bc.read(data / "white.json").evaluate(0.1, 0.2, 0.3)[0] == 0.8 / np.pi
    assert leftovers(data) == []


def test_preconditions(client: TestClient, data: Path) -> None:
    put = {"url": "/v1/materials/white", "json": WHITE}
    assert_problem(client.put(**put, headers={"if-match": "*"}), 412, "changed")
    first = client.put(**put, headers={"if-none-match": "*"}).headers["etag"]
    content = assert_problem(client.put(**put), 409, "exists")
    assert content["errors"][0]["expected"] == first
    assert_problem(client.put(**put, headers={"if-none-match": "*"}), 412, "exists")
    assert_problem(client.put(**put, headers={"if-none-match": first}), 412, "exists")
    assert_problem(client.put(**put, headers={"if-match": '"other"'}), 412, "changed")
    grey = {"model": "lambert", "parameters": {"reflectance": 0.5}}
    second = client.put("/v1/materials/white", json=grey, headers={"if-match": f'"x", {first}'})
    assert second.status_code == 200
    assert_problem(client.put(**put, headers={"if-match": first}), 412, "changed")
    assert_problem(client.delete("/v1/materials/white"), 409, "exists")
    assert_problem(client.delete("/v1/materials/white", headers={"if-match": first}), 412, "changed")
    assert client.delete("/v1/materials/white", headers={"if-match": second.headers["etag"]}).status_code == 204
    assert_problem(client.get("/v1/materials/white"), 404, "unknown_material")
    assert_problem(client.delete("/v1/materials/white"), 404, "unknown_material")
    assert_problem(client.delete("/v1/materials/white", headers={"if-match": "*"}), 412, "changed")
    assert not (data / "white.json").exists()


def test_a_table_replaced_by_a_model_and_back(client: TestClient, data: Path) -> None:
    star = {"if-match": "*"}
    assert client.put("/v1/materials/red", json=WHITE, headers=star).status_code == 200
    assert not (data / "red.h5").exists()
    assert client.get("/v1/materials/red").json()["kind"] == "model"
    answer = client.post("/v1/materials/red/upload", content=PAINT, headers={**OCTET, **star})
    assert ended(client, answer)["state"] == "done"
    assert not (data / "red.json").exists()
    assert client.get("/v1/materials/red").json()["kind"] == "table"
    assert leftovers(data) == []


def test_a_change_of_kind_that_was_cut_off_is_decided(client: TestClient, data: Path) -> None:
    (data / "red.json").write_text(json.dumps(WHITE))
    assert_problem(client.get("/v1/materials/red"), 409, "material_ambiguous")
    (data / ".red.choice").write_text(".json")
    assert client.get("/v1/materials/red").json()["kind"] == "model"
    (data / ".red.choice").write_text(".h5")
    library = client.app.state.brdf.library  # type: ignore[attr-defined]
    library.forget(library.store.names().twice)  # as whoever looks at the folder does every other second
    assert client.get("/v1/materials/red").json()["kind"] == "table"
    assert client.delete("/v1/materials/red", headers={"if-match": "*"}).status_code == 204
    assert not [p for p in data.iterdir() if "red" in p.name]


def test_a_damaged_file_can_be_replaced(client: TestClient, data: Path) -> None:
    (data / "torn.h5").write_bytes(b"\x89HDF")
    assert_problem(client.put("/v1/materials/torn", json=WHITE), 409, "exists")
    assert client.put("/v1/materials/torn", json=WHITE, headers={"if-match": "*"}).status_code == 200
    assert client.get(f"/v1/materials/torn/{VALUE}").status_code == 200


@pytest.mark.parametrize(
    ("body", "status", "code", "where"),
    [
        ({}, 422, "field_missing", "model"),
        ([], 422, "bad_body", "body"),
        ({"model": 3}, 422, "bad_field", "model"),
        ({"model": "lambrt"}, 422, "unknown_model", "model"),
        ({"model": "lambert", "parameters": {"reflectanse": 1}}, 422, "unknown_parameter", "reflectanse"),
        ({"model": "lambert", "parameters": {"reflectance": 2}}, 422, "bad_parameter", "reflectance"),
        ({"model": "lambert", "parameters": {"reflectance": "x" * 5000}}, 422, "bad_parameter", "reflectance"),
        ({"model": "lambert", "parameters": {"reflectance": [[1]]}}, 422, "bad_parameter", "reflectance"),
        ({"model": "lambert", "parameters": {"reflectance": None}}, 422, "bad_parameter", "reflectance"),
        ({"model": "cook_torrance", "parameters": {"ior": {"n": {}}}}, 422, None, None),
        ({"model": "cook_torrance", "parameters": {"ior": [[]]}}, 422, None, None),
        ({"model": "lambert", "parameters": {"name": "x"}}, 422, "unknown_parameter", "name"),
        ({"model": "lambert", "parameters": []}, 422, "bad_field", "parameters"),
        ({"model": "lambert", "colour": 1}, 422, "unknown_field", "colour"),
        ({"model": "lambert", "about": "x" * 1001}, 422, "bad_field", "about"),
        ({**WHITE, "tabulate": {"shape": [2**31, 2**31, 2**31]}}, 413, "table_too_large", "tabulate"),
        ({**WHITE, "tabulate": {"max_bytes": 10**12}}, 413, "table_too_large", "tabulate"),
        ({**WHITE, "tabulate": {"tolerance": 0}}, 422, "bad_field", "tabulate.tolerance"),
        ({**WHITE, "tabulate": {"tolerances": 1}}, 422, "unknown_field", "tabulate.tolerances"),
        ({**WHITE, "tabulate": {"light": [1, 0.5]}}, 422, "bad_field", "tabulate.light"),
        ({**WHITE, "tabulate": {"view": [0, 70]}}, 422, "bad_field", "tabulate.view"),
        ({**WHITE, "tabulate": {"view": ["0", 1]}}, 422, "bad_field", "tabulate.view.0"),
        ({**WHITE, "tabulate": {"view": [0]}}, 422, "bad_field", "tabulate.view"),
    ],
)
def test_models_that_are_refused(
    client: TestClient, data: Path, body: Any, status: int, code: str | None, where: str | None
) -> None:
    answer = client.put("/v1/materials/new", json=body)
    content = assert_problem(answer, status, code or answer.json()["code"])
    assert where is None or content["errors"][0]["where"] == where
    assert len(answer.content) < 3000
    assert not [p for p in data.iterdir() if p.name.startswith("new")]
    assert leftovers(data) == []


@pytest.mark.parametrize(
    "body", ['{"model": "lambert", "parameters": {"reflectance": NaN}}', '{"model": "lambert", "model": "mirror"}', "{"]
)
def test_json_that_is_refused(client: TestClient, body: str) -> None:
    answer = client.put("/v1/materials/new", content=body, headers={"content-type": "application/json"})
    assert answer.status_code in (400, 422), answer.text


@pytest.mark.parametrize(
    "name", ["..%2fnew", "%2e%2e", ".new", "a%00b", "x" * 65, "new%0a", "%F0%9F%98%80", "a%20b", "<svg onload=1>"]
)
def test_names_that_are_refused(client: TestClient, data: Path, name: str) -> None:
    before = sorted(p.name for p in data.parent.rglob("*"))
    for answer in (
        client.put(f"/v1/materials/{name}", json=WHITE),
        client.post(f"/v1/materials/{name}/upload", content=PAINT, headers=OCTET),
        client.delete(f"/v1/materials/{name}", headers={"if-match": "*"}),
    ):
        assert answer.status_code in (404, 405, 422), answer.text
        assert "<svg" not in answer.text or answer.headers["content-type"] == "application/problem+json"
    assert sorted(p.name for p in data.parent.rglob("*")) == before


def test_a_table_for_the_angles_seen(client: TestClient, data: Path) -> None:
    body = {"model": "cook_torrance", "parameters": {"roughness": 0.4, "ior": "gold"}}
    options = {"representation": "half_difference", "shape": [10, 10, 10], "light": [0, 1.2], "view": [0.3, 1.2]}
    assert ended(client, client.put("/v1/materials/floor", json={**body, "tabulate": options}))["state"] == "done"
    path = "/v1/materials/floor/evaluate?angles=rad&delta_phi=1&status=true"
    said = client.get(f"{path}&theta_i=1,1.4&theta_o=1").json()
    assert [said["status_names"][code] for code in said["status"]] == ["interpolated", "extrapolated"]
    local = bc.tabulate(bc.model("cook_torrance", roughness=0.4, ior="gold"), **options)
    assert local.id == said["id"]
    # so narrow that nothing can be said of it: known once it is tried
    narrow = {**options, "view": [0.5, 0.5001]}
    job = ended(client, client.put("/v1/materials/slit", json={**body, "tabulate": narrow}))
    assert (job["state"], job["problem"]["code"]) == ("failed", "range_too_narrow")


def test_put_and_tabulate(client: TestClient, data: Path) -> None:
    body = {"model": "cook_torrance", "parameters": {"roughness": 0.4, "ior": "gold"}}
    answer = client.put("/v1/materials/satin", json={**body, "tabulate": {"shape": [8, 8, 9]}})
    told = JobAnswer.model_validate_json(answer.content)
    assert (told.kind, told.material, told.problem) == ("tabulate", "satin", None)
    job = ended(client, answer)
    assert (job["state"], job["problem"]) == ("done", None)
    wanted = bc.tabulate(bc.model("cook_torrance", roughness=0.4, ior="gold"), shape=(8, 8, 9))
    assert job["result"]["id"] == wanted.id == client.get("/v1/materials/satin").json()["id"]
    assert job["result"]["error"]["l1"] == wanted.error["l1"]
    assert leftovers(data) == []


def test_put_with_an_interpolation(client: TestClient, data: Path) -> None:
    """Any representation's; the description of the interface lists them."""
    body = {"model": "cook_torrance", "parameters": {"roughness": 0.4, "ior": "gold"}}
    options = {"representation": "half_angle_grid", "interpolation": "nearest", "shape": [8, 8, 10]}
    job = ended(client, client.put("/v1/materials/satin", json={**body, "tabulate": options}))
    assert (job["state"], job["problem"]) == ("done", None)
    assert client.get("/v1/materials/satin").json()["attributes"] == {"interpolation": "nearest", "cells": "centre"}
    refused = client.put("/v1/materials/no", json={**body, "tabulate": {**options, "interpolation": "cubic"}})
    assert (refused.status_code, refused.json()["code"]) == (422, "bad_field")
    assert "monotone_cubic" in refused.json()["detail"]
    schema = client.get("/openapi.json").json()["components"]["schemas"]["TabulateOptions"]
    assert schema["properties"]["interpolation"]["enum"] == ["nearest", "linear", "monotone_cubic"]


def test_upload_of_a_text_table(client: TestClient, data: Path) -> None:
    """Columns are named as options; what lacks is said in the reader's words; its doubts stand in the material."""
    rows = [(i, o, d) for i in (10, 40) for o in (20, 50) for d in (0, 90, 180)]
    body = "AOI,Scatter,Azimuth,Value\n" + "".join(f"{i},{o},{d},{30 + d / 10}\n" for i, o, d in rows)
    options = {"theta_i": "AOI", "theta_o": "Scatter", "delta_phi": "Azimuth", "value": "Value", "shape": "[6,6,6]"}
    path = "/v1/materials/scan/upload?options="
    refused = ended(client, client.post(path + json.dumps(options), content=body.encode(), headers=OCTET))
    assert refused["state"] == "failed"
    assert refused["problem"]["code"] == "columns_not_clear"
    assert "angles=deg or angles=rad, mirror=180" in refused["problem"]["detail"]
    assert "Columns: AOI, Scatter, Azimuth, Value" in refused["problem"]["detail"]
    options |= {"angles": "deg", "mirror": "180", "quantity": "f"}
    query = path + json.dumps({**options, "mirror": 180})
    assert ended(client, client.post(query, content=body.encode(), headers=OCTET))["state"] == "done"
    warned = client.get("/v1/materials/scan").json()["warnings"]
    assert any("no passive surface reflects more than it receives" in text for text in warned)
    for page in ("/", "/materials/scan"):
        assert "no passive surface reflects more" in client.get(page).text


def test_upload_of_a_merl_file(client: TestClient, data: Path) -> None:
    numbers = np.random.default_rng(0).uniform(1, 100, (3, 6, 5, 8))
    numbers[:, 5, 4, 0] = -1
    file = np.array([6, 5, 8], "<i4").tobytes() + numbers.astype("<f8").tobytes()
    job = ended(client, client.post("/v1/materials/paint/upload", content=file, headers=OCTET))
    assert job["state"] == "done", job
    table = local(data, "paint")
    assert table.describe()["representation"] == "half_angle_grid"
    assert table.report["found"]["invalid cells"] == 1
    cut = ended(client, client.post("/v1/materials/cut/upload?format=merl", content=file[:-5], headers=OCTET))
    assert cut["state"] == "failed"
    assert "blue plane" in cut["problem"]["detail"]


def test_upload_a_measurement(client: TestClient, data: Path) -> None:
    path = data.parent / "paint.bsdf"
    path.write_bytes(PAINT)
    answer = client.post("/v1/materials/paint/upload", content=PAINT, headers=OCTET)
    assert answer.headers["location"] == answer.json()["links"]["self"]
    job = ended(client, answer)
    assert job["state"] == "done", job
    wanted = bc.read(path)
    assert isinstance(wanted, bc.Table)
    assert job["result"]["id"] == wanted.id
    angles = np.random.default_rng(2).random((3, 50))
    assert np.array_equal(local(data, "paint").evaluate(*angles), wanted.evaluate(*angles))
    tabulated = client.post(
        '/v1/materials/paint2/upload?tabulate={"shape":[5,5,9],"representation":"angle_grid"}&format=rgl'
        '&options={"negatives":"zero"}',
        content=PAINT,
        headers=OCTET,
    )
    assert ended(client, tabulated)["state"] == "done"
    assert client.get("/v1/materials/paint2").json()["representation"] == "angle_grid"
    model = client.post("/v1/materials/white/upload", content=json.dumps(WHITE).encode(), headers=OCTET)
    assert ended(client, model)["state"] == "done"
    assert client.get("/v1/materials/white").json()["kind"] == "model"
    assert leftovers(data) == []


def test_a_condition_that_no_longer_holds_when_the_job_ends(client: TestClient, data: Path) -> None:
    answer = client.post("/v1/materials/paint/upload", content=PAINT, headers=OCTET)
    assert client.put("/v1/materials/paint", json=WHITE).status_code == 201
    job = ended(client, answer)
    assert (job["state"], job["problem"]["code"], job["problem"]["status"]) == ("failed", "exists", 409)
    assert client.get("/v1/materials/paint").json()["kind"] == "model"
    assert_problem(client.post("/v1/materials/paint/upload", content=PAINT, headers=OCTET), 409, "exists")


def test_events_until_the_end(client: TestClient) -> None:
    answer = client.post("/v1/materials/paint/upload", content=PAINT, headers=OCTET)
    with client.stream("GET", f"{answer.headers['location']}/events") as events:
        assert events.headers["content-type"].startswith("text/event-stream")
        lines = list(events.iter_lines())
    told = [json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: ")]
    assert told[-1]["state"] == "done"
    assert "event: done" in lines
    assert [t["material"] for t in told] == ["paint"] * len(told)


def test_jobs_wait_are_refused_and_cancelled(serve: Serve, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    client = serve()
    jobs = client.app.state.brdf.jobs  # type: ignore[attr-defined]
    slow = {"model": "cook_torrance", "parameters": {"roughness": 0.1}, "tabulate": {"shape": [120, 120, 240]}}
    first = client.put("/v1/materials/slow", json=slow)
    until = time.monotonic() + 20
    while client.get(first.headers["location"]).json()["state"] != "running" and time.monotonic() < until:
        time.sleep(0.02)
    waiting = [client.put(f"/v1/materials/wait{k}", json=slow) for k in range(QUEUED)]
    assert [w.status_code for w in waiting] == [202] * QUEUED
    assert [w.json()["ahead"] for w in waiting] == list(range(1, QUEUED + 1))
    refused = client.put("/v1/materials/more", json=slow)
    assert_problem(refused, 503, "queue_full")
    assert int(refused.headers["retry-after"]) > 0
    assert client.get("/v1/materials/gold-grid").status_code == 200
    for answer in (*waiting, first):
        cancelled = client.delete(answer.headers["location"])
        assert cancelled.json()["state"] == "cancelled"
        assert client.delete(answer.headers["location"]).json()["state"] == "cancelled"
    assert client.put("/v1/materials/white", json={**WHITE, "tabulate": {"shape": [3, 3, 3]}}).status_code == 202
    assert_problem(client.get("/v1/materials/slow"), 404, "unknown_material")
    monkeypatch.setattr("brdf_service.work.jobs.KEPT_SECONDS", 0.0)
    time.sleep(0.01)
    assert_problem(client.get(first.headers["location"]), 404, "job_lost")
    assert jobs.counts()["cancelled"] == 0


def test_a_process_that_is_killed(client: TestClient) -> None:
    jobs = client.app.state.brdf.jobs  # type: ignore[attr-defined]
    slow = {"model": "cook_torrance", "parameters": {"roughness": 0.1}, "tabulate": {"shape": [120, 120, 240]}}
    answer = client.put("/v1/materials/slow", json=slow)
    job = jobs.get(answer.json()["id"])
    until = time.monotonic() + 20
    while job.child is None and time.monotonic() < until:
        time.sleep(0.02)
    os.kill(job.child.process.pid, signal.SIGKILL)
    assert ended(client, answer)["problem"]["code"] == "job_killed"
    again = client.put("/v1/materials/small", json={**WHITE, "tabulate": {"shape": [3, 3, 3]}})
    assert ended(client, again)["state"] == "done"


def test_unknown_jobs(shared_client: TestClient) -> None:
    for id in ("0" * 32, "x", "..%2f"):
        assert shared_client.get(f"/v1/jobs/{id}").status_code == 404
    assert_problem(shared_client.get("/v1/jobs/" + "0" * 32), 404, "job_lost")
    assert_problem(shared_client.get("/v1/jobs/" + "0" * 32 + "/events"), 404, "job_lost")
    assert_problem(shared_client.delete("/v1/jobs/" + "0" * 32), 404, "job_lost")


def test_a_folder_that_cannot_be_written(client: TestClient, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(Path, "mkdir", refuse)
    for answer in (
        client.put("/v1/materials/white", json=WHITE),
        client.post("/v1/materials/white/upload", content=PAINT, headers=OCTET),
        client.delete("/v1/materials/gold", headers={"if-match": "*"}),
    ):
        content = assert_problem(answer, 503, "data_folder")
        assert str(data) not in json.dumps(content)


def test_a_sum_of_models(client: TestClient, data: Path) -> None:
    terms = [
        {"model": "lambert", "parameters": {"reflectance": 0.3}},
        {"model": "ggx", "parameters": {"roughness": 0.2}},
    ]
    made = client.put("/v1/materials/both", json={"sum": terms})
    assert made.status_code == 201, made.text
    MaterialLine.model_validate_json(made.content)
    wanted = bc.model("lambert", reflectance=0.3) + bc.model("ggx", roughness=0.2)
    value = float(wanted.evaluate(*np.radians([30.0, 30.0, 180.0]))[0])
    assert client.get(f"/v1/materials/both/{VALUE}").json()["values"] == [[value]]
    assert "lambert" in client.get("/materials/both").text
    other = client.put("/v1/materials/other", json={"sum": [*terms[:1], {"model": "ggx"}]})
    assert other.json()["id"] != made.json()["id"]
    answer = client.put("/v1/materials/table", json={"sum": terms, "tabulate": {"shape": [4, 4, 5]}})
    assert ended(client, answer)["state"] == "done"
    for bad in ({"sum": []}, {"sum": terms, "model": "lambert"}, {"sum": terms * 5}, {"sum": [{"model": "x"}]}):
        assert client.put("/v1/materials/bad", json=bad).status_code == 422, bad
