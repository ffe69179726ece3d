"""The data folder as the service shows it: lists, changes, damage, memory."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from brdf_service.http.errors import MaterialDamagedError, NotFoundError
from brdf_service.library.folder import Folder
from brdf_service.library.materials import Library
from brdf_service.schemas.materials import MaterialLine, MaterialList
from starlette.testclient import TestClient

import brdfcore as bc
from tests.app.conftest import Serve, assert_problem, expected_values, local

VALUE = "evaluate?theta_i=30&theta_o=30&delta_phi=180"


def test_list(shared_client: TestClient, original: Path) -> None:
    answer = shared_client.get("/v1/materials")
    listed = MaterialList.model_validate_json(answer.content)
    assert [m.name for m in listed.materials] == ["gold", "gold-grid", "mirror", "red"]
    assert (listed.total, listed.offset, listed.limit, listed.next, listed.skipped) == (4, 0, 100, None, [])
    grid = listed.materials[1]
    table = bc.open_table(original / "gold-grid.h5")
    assert (grid.kind, grid.id, grid.nbytes, grid.channels) == ("table", table.id, table.nbytes, ["value"])
    assert answer.json()["materials"][1]["error"] == table.error
    assert grid.error is not None
    assert len(grid.error.by_theta_i) > len(grid.error.between) > 5
    for line in listed.materials:
        for path in line.links.values():
            # a path that needs a query, one that takes a POST
            wanted = {"evaluate": 422, "relight": 405, "sample": 405}.get(path.rpartition("/")[2], 200)
            assert shared_client.get(path).status_code == wanted


def test_paging(shared_client: TestClient) -> None:
    first = shared_client.get("/v1/materials?limit=3").json()
    assert len(first["materials"]) == 3
    assert first["total"] == 4
    rest = shared_client.get(first["next"]).json()
    assert [m["name"] for m in rest["materials"]] == ["red"]
    assert rest["next"] is None
    assert shared_client.get("/v1/materials?offset=99").json()["materials"] == []
    for query in ("limit=0", "limit=1001", "limit=-1", "limit=a", "offset=-1", "offset=1e3", "limit="):
        assert_problem(shared_client.get(f"/v1/materials?{query}"), 422, "bad_number")
    assert_problem(shared_client.get("/v1/materials?page=2"), 422, "unknown_parameter")


def test_metadata_by_name_and_id(shared_client: TestClient) -> None:
    for name in ("gold-grid", "gold"):
        by_name = shared_client.get(f"/v1/materials/{name}")
        MaterialLine.model_validate_json(by_name.content)
        by_id = shared_client.get(f"/v1/tables/{by_name.json()['id']}")
        assert by_id.json() == by_name.json()
        assert by_name.headers["content-location"] == f"/v1/tables/{by_name.json()['id']}"
        value = shared_client.get(f"/v1/materials/{name}/{VALUE}")
        by_name_said = value.json()
        by_name_said.pop("error")  # a fact of the file: not in an answer that is kept for ever
        assert shared_client.get(value.headers["content-location"]).json() == by_name_said
    assert_problem(shared_client.get("/v1/materials/gold?x=1"), 422, "unknown_parameter")


def test_id_of_a_model_follows_what_it_says(data: Path, client: TestClient) -> None:
    first = client.get("/v1/materials/gold").json()["id"]
    content = json.loads((data / "gold.json").read_text())
    (data / "same.json").write_text(json.dumps({**content, "about": "the same again"}))
    content["parameters"]["roughness"] = 0.21
    (data / "other.json").write_text(json.dumps(content))
    assert client.get("/v1/materials/same").json()["id"] == first
    assert client.get("/v1/materials/other").json()["id"] != first


def test_unknown_names_and_ids(shared_client: TestClient) -> None:
    content = assert_problem(shared_client.get("/v1/materials/golt-grid"), 404, "unknown_material")
    assert "gold-grid" in content["detail"]
    for name in (".hidden", "a%00b", "%F0%9F%98%80", "x" * 65, "gold-grid.h5"):
        assert_problem(shared_client.get(f"/v1/materials/{name}/{VALUE}"), 404, "unknown_material")
    for id in ("0" * 64, "0", "g" * 64, "A" * 64):
        assert_problem(shared_client.get(f"/v1/tables/{id}/{VALUE}"), 404, "unknown_table")


def test_traversal_on_the_wire(data: Path) -> None:
    """As the router sees it, whatever a client library would have tidied up before sending."""
    (data.parent / "secret.json").write_text('{"model": "lambert"}')
    library = Library(Folder(data), 10**9)
    for name in ("../secret", "..", "../data/gold", "/etc/passwd", "gold\n", "gold\0", ""):
        with pytest.raises(NotFoundError):
            library.get(name)


def test_new_changed_and_deleted_files(data: Path, client: TestClient) -> None:
    assert_problem(client.get("/v1/materials/white"), 404, "unknown_material")
    (data / "white.json").write_text('{"model": "lambert", "parameters": {"reflectance": 0.8}}')
    first = client.get(f"/v1/materials/white/{VALUE}")
    assert first.status_code == 200
    assert "white" in [m["name"] for m in client.get("/v1/materials").json()["materials"]]
    (data / "white.json").write_text('{"model": "lambert", "parameters": {"reflectance": 0.25}}')
    second = client.get(f"/v1/materials/white/{VALUE}", headers={"if-none-match": first.headers["etag"]})
    assert second.status_code == 200
    assert second.json()["values"] == expected_values(local(data, "white"), 30, 30, 180)
    assert second.json()["id"] != first.json()["id"]
    assert_problem(client.get(f"/v1/tables/{first.json()['id']}"), 404, "unknown_table")
    (data / "white.json").unlink()
    assert_problem(client.get(f"/v1/materials/white/{VALUE}"), 404, "unknown_material")
    assert_problem(client.get(f"/v1/tables/{second.json()['id']}"), 404, "unknown_table")
    assert client.get("/v1/materials").json()["total"] == 4


def test_damaged_files_do_not_break_the_list(data: Path, client: TestClient) -> None:
    (data / "torn.h5").write_bytes((data / "red.h5").read_bytes()[:5000])
    (data / "noise.h5").write_bytes(os.urandom(5000))
    (data / "empty.h5").write_bytes(b"")
    (data / "half.json").write_text('{"model": "lamb')
    (data / "deep.json").write_text("[" * 100_000)
    (data / "typo.json").write_text('{"model": "lambrt"}')
    (data / "clash.json").write_text('{"model": "lambert", "parameters": {"name": 1}}')
    (data / "odd.json").write_text('{"model": "lambert", "parameters": [1]}')
    (data / "extra.json").write_text('{"model": "lambert", "params": {}}')
    bad = {"torn", "noise", "empty", "half", "deep", "typo", "clash", "odd", "extra"}
    for _ in range(2):  # read, and remembered
        listed = MaterialList.model_validate_json(client.get("/v1/materials").content)
        assert {m.name for m in listed.materials if m.problem} == bad
        assert listed.total == 4 + len(bad)
    by_name = {m.name: m for m in listed.materials}
    assert by_name["typo"].problem is not None
    assert "lambert" in by_name["typo"].problem.detail
    for name in bad:
        content = assert_problem(client.get(f"/v1/materials/{name}/{VALUE}"), 409, "material_damaged")
        assert str(data) not in content["detail"]
    assert client.get(f"/v1/materials/red/{VALUE}").status_code == 200
    (data / "torn.h5").write_bytes((data / "red.h5").read_bytes())
    assert client.get(f"/v1/materials/torn/{VALUE}").status_code == 200


def test_file_that_cannot_be_opened(data: Path, client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not remembered: it may be readable at the next try."""

    def refuse(path: Path) -> bc.Table:
        raise bc.StorageError("cannot_open", f"{path}: Permission denied", where=str(path))

    with monkeypatch.context() as patched:
        patched.setattr(bc, "open_table", refuse)
        content = assert_problem(client.get(f"/v1/materials/red/{VALUE}"), 409, "material_damaged")
        assert "Permission denied" in content["detail"]
        assert str(data) not in json.dumps(content)
        assert str(data) not in client.get("/v1/materials").text
    assert client.get(f"/v1/materials/red/{VALUE}").status_code == 200


def test_two_files_of_one_name(data: Path, client: TestClient) -> None:
    (data / "red.json").write_text('{"model": "lambert"}')
    assert_problem(client.get(f"/v1/materials/red/{VALUE}"), 409, "material_ambiguous")
    assert client.get("/v1/materials").json()["total"] == 4


def test_files_that_are_not_materials(data: Path, client: TestClient) -> None:
    (data / ".gold.h5.tmp").write_bytes(b"")
    (data / ".hidden.json").write_text("{}")
    (data / "README.md").write_text("")
    (data / "folder.json").mkdir()
    os.mkfifo(data / "pipe.json")  # opening it would wait for ever
    (data / "my gold.json").write_text("{}")
    listed = client.get("/v1/materials").json()
    assert listed["total"] == 4
    assert listed["skipped"] == ["my gold.json"]
    assert_problem(client.get("/v1/materials/pipe"), 404, "unknown_material")


def test_data_folder_gone(data: Path, client: TestClient) -> None:
    data.rename(data.with_name("elsewhere"))
    content = assert_problem(client.get("/v1/materials"), 503, "data_folder")
    assert str(data) not in json.dumps(content)
    assert client.get("/health/live").status_code == 200


def test_loaded_tables_are_bounded_by_bytes(data: Path, serve: Serve) -> None:
    size = Library(Folder(data), 10**9).get("gold-grid").held_bytes
    for k in range(6):
        (data / f"copy{k}.h5").write_bytes((data / "gold-grid.h5").read_bytes())
    client = serve(cache_bytes=2 * size + size // 2)
    library = client.app.state.brdf.library  # type: ignore[attr-defined]
    for k in (0, 1, 2, 3, 4, 5, 0, 3):
        assert client.get(f"/v1/materials/copy{k}/{VALUE}").status_code == 200
        assert library.loaded_bytes <= 2 * size + size // 2
    assert library.peek("copy3") is not None
    assert library.peek("copy0") is not None
    assert library.peek("copy5") is None


def test_table_larger_than_the_cache_is_served(serve: Serve) -> None:
    client = serve(cache_bytes=1000)
    assert client.get(f"/v1/materials/gold-grid/{VALUE}").status_code == 200
    assert client.app.state.brdf.library.loaded_bytes == 0  # type: ignore[attr-defined]


def test_a_table_is_read_once(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = Library(Folder(data), 10**9)
    opened = []
    real = bc.open_table
    monkeypatch.setattr(bc, "open_table", lambda path: opened.append(path) or real(path))  # type: ignore[func-returns-value]
    for _ in range(3):
        library.get("red")
        library.page(0, 100)
        library.get_id(library.get("red").id)
    assert sorted(p.name for p in opened) == ["gold-grid.h5", "red.h5"]
    (data / "bad.h5").write_bytes(b"no")
    for _ in range(3):
        with pytest.raises(MaterialDamagedError):
            library.get("bad")
    assert [p.name for p in opened].count("bad.h5") == 1
