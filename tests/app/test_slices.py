"""Slices: four formats of the same numbers, and pictures that can do nothing in a browser."""

from __future__ import annotations

import csv
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from brdf_service.schemas.analysis import SliceAnswer
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, local

TYPES = {"svg": "image/svg+xml", "png": "image/png", "json": "application/json", "csv": "text/csv; charset=utf-8"}
SVG = "{http://www.w3.org/2000/svg}"


def assert_harmless(svg: bytes) -> None:
    """No script, no handler, no link: what a Content-Security-Policy would have to stop is not there."""
    for element in ET.fromstring(svg).iter():
        assert element.tag.removeprefix(SVG) not in ("script", "foreignObject", "a", "iframe")
        for name, value in element.attrib.items():
            assert not name.lower().startswith("on")
            assert "javascript:" not in value
            if name.endswith("href"):
                assert value.startswith(("#", "data:image/png"))


@pytest.mark.parametrize("view", ["polar", "hemisphere"])
@pytest.mark.parametrize("format", TYPES)
def test_formats(shared_client: TestClient, format: str, view: str) -> None:
    theta_i = "30,60" if view == "polar" else "30"
    answer = shared_client.get(f"/v1/materials/red/slice.{format}?theta_i={theta_i}&view={view}&channel=R")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == TYPES[format]
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["cache-control"] == "no-cache"
    if format == "png":
        assert answer.content.startswith(b"\x89PNG\r\n")
    if format == "svg":
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "script-src" not in policy
        assert_harmless(answer.content)


def test_numbers_are_the_library_s_own(shared_client: TestClient, original: Path) -> None:
    data = bc.slice(local(original, "red"), np.radians([30.0, 60.0]))
    answer = shared_client.get("/v1/materials/red/slice.json?theta_i=30,60")
    SliceAnswer.model_validate_json(answer.content)
    assert answer.json() == data.to_json("deg")
    assert shared_client.get("/v1/materials/red/slice.csv?theta_i=30,60").text == data.to_csv("deg")
    radians = bc.slice(local(original, "red"), [0.5], channel="B")
    answer = shared_client.get("/v1/materials/red/slice.json?theta_i=0.5&angles=rad&channel=B")
    assert answer.json() == radians.to_json("rad")


def test_csv_rows_are_values_of_evaluate(shared_client: TestClient) -> None:
    text = shared_client.get("/v1/materials/gold-grid/slice.csv?theta_i=30").text
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    row = rows[len(rows) // 3]
    query = "&".join(f"{k}={row[f'{k}_deg']}" for k in ("theta_i", "theta_o", "delta_phi"))
    answer = shared_client.get(f"/v1/materials/gold-grid/evaluate?{query}").json()
    assert answer["values"] == [[float(row["f_r_value"])]]


def test_same_picture_same_bytes(shared_client: TestClient) -> None:
    for format in ("svg", "png"):
        a, b = (shared_client.get(f"/v1/materials/gold/slice.{format}?theta_i=10&scale=log").content for _ in range(2))
        assert a == b


@pytest.mark.parametrize(
    ("query", "status", "code", "where"),
    [
        ("", 422, "parameter_missing", "theta_i"),
        ("theta_i=95", 422, "angle_outside", "theta_i"),
        ("theta_i=30,x", 422, "not_a_number", "theta_i"),
        ("theta_i=30&view=sphere", 422, "bad_choice", "view"),
        ("theta_i=30&scale=log10", 422, "bad_choice", "scale"),
        ("theta_i=30&channel=X", 422, "unknown_channel", "channel"),
        ("theta_i=30&channel=", 422, "bad_text", "channel"),
        ("theta_i=30,40&view=hemisphere", 422, "wrong_number", "theta_i"),
        ("theta_i=30&veiw=polar", 422, "unknown_parameter", "query"),
        ("theta_i=" + ",".join(["1"] * 17), 413, "too_many_slices", "theta_i"),
    ],
)
@pytest.mark.parametrize("format", ["svg", "json"])
def test_refusals(shared_client: TestClient, format: str, query: str, status: int, code: str, where: str) -> None:
    if format == "json" and "scale=" in query:
        code, where = "unknown_parameter", "query"  # numbers have no scale
    content = assert_problem(shared_client.get(f"/v1/materials/red/slice.{format}?{query}"), status, code)
    assert content["errors"][0]["where"] == where


def test_angle_past_the_horizon_in_degrees(shared_client: TestClient) -> None:
    content = assert_problem(shared_client.get("/v1/materials/red/slice.png?theta_i=30,95"), 422, "angle_outside")
    assert content["errors"][0] == {"where": "theta_i", "index": [1], "got": 95.0, "expected": "[0, 90] degrees"}


def test_unknown_format(shared_client: TestClient) -> None:
    assert_problem(shared_client.get("/v1/materials/red/slice.gif?theta_i=30"), 404, "unknown_path")


def test_too_many_values(serve: Serve) -> None:
    client = serve(max_values=10_000)
    path = "/v1/materials/red/slice.csv?view=hemisphere&theta_i=30"
    assert_problem(client.get(path), 413, "too_many_values")


def test_hostile_texts_stay_text(data: Path, client: TestClient) -> None:
    """Names are checked, but what a table says of itself may hold anything."""
    hostile = '"><script>alert(1)</script>$\\frac'
    table = bc.tabulate(bc.model("lambert", reflectance=[0.1, 0.2, 0.3]), "angle_grid", shape=(3, 3, 5))
    table.channels = bc.Channels([hostile, "on<b>", "&amp;"])
    table.metadata = {"about": hostile, "name": hostile}
    table.error["warnings"] = [hostile]
    table.save(data / "hostile.h5")
    (data / "<img src=x onerror=alert(1)>.json").write_text("{}")
    for query in ("theta_i=30", "theta_i=30&view=hemisphere", "theta_i=10,20&scale=log&channel=0"):
        answer = client.get(f"/v1/materials/hostile/slice.svg?{query}")
        assert answer.status_code == 200
        assert_harmless(answer.content)
    for path in ("/", "/materials/hostile"):
        page = client.get(path)
        assert page.status_code == 200
        assert "<script>alert" not in page.text
        assert "<img src=x" not in page.text
