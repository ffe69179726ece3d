"""The nodes of a table over HTTP: the bytes of the library, kept for ever by id; what has none is refused."""

from __future__ import annotations

from pathlib import Path

from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import assert_problem, local


def test_arrays(shared_client: TestClient, original: Path) -> None:
    answer = shared_client.get("/v1/materials/red/arrays")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.content == bc.array_bytes(local(original, "red"))
    permanent = answer.headers["content-location"]
    assert permanent.startswith("/v1/tables/")
    assert permanent.endswith("/arrays")
    by_id = shared_client.get(permanent)
    assert by_id.content == answer.content
    assert "immutable" in by_id.headers["cache-control"]
    again = shared_client.get(permanent, headers={"if-none-match": by_id.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_a_model_has_none(shared_client: TestClient) -> None:
    assert_problem(shared_client.get("/v1/materials/gold/arrays"), 422, "not_a_table")
    assert_problem(shared_client.get("/v1/materials/none/arrays"), 404, "unknown_material")
    assert_problem(shared_client.get("/v1/materials/red/arrays?dtype=f4"), 422, "unknown_parameter")
