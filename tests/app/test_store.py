"""The folder as a store: an index that is kept, changes on condition, faults at each step, measured files put there."""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.http.errors import MaterialDamagedError, NotFoundError, PreconditionError
from brdf_service.library.folder import Folder
from brdf_service.library.materials import Library
from brdf_service.library.store import ChangedError
from brdf_service.library.writing import Condition, Writer
from starlette.testclient import TestClient

import brdfcore as bc
from brdfcore.formats.rgl.tensor_file import encode
from tests.app.conftest import Serve, assert_problem
from tests.app.test_writing import ended
from tests.support.faults import ERRORS, faults
from tests.support.rgl_synthetic import fields_of

WHITE, ANY = bc.model("lambert", reflectance=0.8), Condition(match=frozenset("*"))


@pytest.fixture
def writer(data: Path) -> Writer:
    return Writer(Library(Folder(data), 10**9))


def seen(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.name not in (".lock", ".jobs"))


@pytest.mark.parametrize("name", ["gold", "red", "new"])
def test_a_fault_at_each_call_of_a_put(data: Path, writer: Writer, name: str) -> None:
    """`gold` is a model, `red` a table that a model replaces, `new` there was none of."""
    before = {p.name: p.read_bytes() for p in data.iterdir() if p.is_file()}
    condition = Condition() if name == "new" else ANY

    def restore() -> None:
        for path in data.iterdir():
            if path.is_file() and path.name not in before:
                path.unlink()
        for file, content in before.items():
            (data / file).write_bytes(content)

    with faults(data) as counted:
        writer.put_model(name, WHITE, condition)
    stored = (data / f"{name}.json").read_bytes()
    assert counted.calls.count("fsync") >= 3
    for at in range(len(counted.calls)):
        for error in ERRORS:
            restore()
            with faults(data, at, error), pytest.raises(bc.StorageError) as caught:
                writer.put_model(name, WHITE, condition)
            assert os.strerror(error) in caught.value.detail
            assert str(data) not in caught.value.detail or ".new-" in caught.value.detail
            assert not [p for p in seen(data) if ".tmp" in p]
            material = writer.library.store.find(name)
            if counted.calls[:at].count("replace") > 1:  # the new one is in its place; only its flush failed
                assert (data / f"{name}.json").read_bytes() == stored
                assert material is not None
            else:
                kept = before.get(f"{name}.h5") or before.get(f"{name}.json")
                assert (None if material is None else Path(material.path).read_bytes()) == kept


def test_what_was_refused_has_replaced_nothing(data: Path, client: TestClient) -> None:
    before = (data / "gold.json").read_bytes()
    wide = {"model": "lambert", "parameters": {"reflectance": [0.5] * 130_000}}
    answer = client.put("/v1/materials/gold", json=wide, headers={"if-match": "*"})
    assert_problem(answer, 413, "too_many_channels")
    assert (data / "gold.json").read_bytes() == before
    assert client.get("/v1/materials/gold").status_code == 200


def test_a_put_answers_for_what_it_did_itself(client: TestClient) -> None:
    """Twelve at once on one name: each answer carries the id and the ETag of what that request sent."""
    wrong: list[Any] = []
    tags: list[str] = []

    def put(number: int) -> None:
        for k in range(10):
            value = (number * 10 + k + 1) / 200
            body = {"model": "lambert", "parameters": {"reflectance": value}}
            answer = client.put("/v1/materials/shared", json=body, headers={"if-match": "*"} if k % 3 else {})
            if answer.status_code in (200, 201):
                tags.append(answer.headers["etag"])
                if answer.json()["metadata"]["parameters"]["reflectance"] != value:
                    wrong.append((value, answer.json()["metadata"]["parameters"]))
            elif answer.status_code == 409 and k % 3 == 0:
                continue
            elif answer.status_code != 412:
                wrong.append(answer.text)
            if k % 5 == 4:
                client.delete("/v1/materials/shared", headers={"if-match": "*"})

    threads = [threading.Thread(target=put, args=(n,)) for n in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert len(set(tags)) == len(tags) > 20


def test_changes_on_condition(data: Path, writer: Writer) -> None:
    store = writer.store
    version = store.version("gold")
    writer.put_model("gold", WHITE, ANY)
    with pytest.raises(ChangedError):
        store.delete("gold", version)
    with store.scratch() as folder:
        (folder / "gold.json").write_text("{}")
        with pytest.raises(ChangedError):
            store.put("gold", folder / "gold.json", ".json", version)
    with pytest.raises(PreconditionError):
        writer.delete("gold", Condition(match=frozenset(['"other"'])))
    writer.delete("gold", ANY)
    assert store.version("gold") is None
    with pytest.raises(NotFoundError):
        writer.library.get("gold")


def test_a_rewrite_of_equal_size_and_time_is_noticed(data: Path, writer: Writer) -> None:
    path, old = data / "gold.json", writer.library.get("gold")
    info, text = path.stat(), path.read_text()
    path.write_text(text.replace("0.2", "0.3"))
    os.utime(path, ns=(info.st_atime_ns, info.st_mtime_ns))
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (info.st_size, info.st_mtime_ns)
    assert writer.library.peek("gold") is None
    assert writer.library.get("gold").id != old.id


def test_the_index_is_kept(data: Path, writer: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    scans = []
    real = os.scandir
    monkeypatch.setattr(os, "scandir", lambda path: scans.append(path) or real(path))  # type: ignore[func-returns-value]
    store = writer.store
    assert store.names().all == ["gold", "gold-grid", "mirror", "red"]
    time.sleep(0.1)
    store.names()
    scans.clear()
    for _ in range(5):
        assert len(store.names().all) == 4
    assert scans == []
    writer.put_model("new", WHITE, Condition())
    assert "new" in store.names().all
    (data / "other.json").write_text('{"model": "lambert"}')
    assert "other" in store.names().all
    writer.delete("new", ANY)
    (data / "other.json").unlink()
    assert store.names().all == ["gold", "gold-grid", "mirror", "red"]


def test_names_of_all_kinds(data: Path, client: TestClient) -> None:
    try:
        (Path(os.fsdecode(os.fsencode(data) + b"/b\xff.h5"))).write_bytes(b"x")
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    (data / "circle.json").symlink_to(data / "circle.json")
    (data / "nowhere.h5").symlink_to(data / "gone.h5")
    for path in ("/", "/v1/materials", "/?offset=2"):
        assert client.get(path).status_code == 200
    listed = client.get("/v1/materials").json()
    assert listed["skipped"] == ["b\\xff.h5"]
    problems = {m["name"]: m["problem"]["detail"] for m in listed["materials"] if m.get("problem")}
    assert set(problems) == {"circle", "nowhere"}
    assert "link" in problems["circle"]
    assert_problem(client.get("/v1/materials/circle"), 404, "unknown_material")
    assert_problem(client.get("/v1/materials/unknown"), 404, "unknown_material")


def test_measured_files_put_into_the_folder(data: Path, client: TestClient) -> None:
    """They appear, read by a job; what cannot be read is listed with its reason, and costs nothing again."""
    (data / "paint.bsdf").write_bytes(encode(fields_of()))
    (data / "torn.csv").write_text("this,is\nno,measurement\n")
    (data / "notes.md").write_text("not listed: no format's files end so")
    listed = {m["name"]: m for m in client.get("/v1/materials").json()["materials"]}
    assert listed["torn"]["problem"]["code"] == "not_read_yet"
    until = time.monotonic() + 240
    while time.monotonic() < until:
        listed = {m["name"]: m for m in client.get("/v1/materials").json()["materials"]}
        if "problem" not in listed["paint"] and listed["torn"]["problem"]["code"] != "not_read_yet":
            break
        time.sleep(0.2)
    assert listed["paint"]["kind"] == "table"
    assert np.isfinite(bc.open_table(data / "paint.h5").evaluate(0.1, 0.2, 0.3)).all()
    assert client.get("/v1/materials/paint/report").json()["report"]["file"] == "paint.bsdf"
    assert "torn.csv cannot be read" in listed["torn"]["problem"]["detail"]
    assert "torn.csv cannot be read" in client.get("/").text
    assert_problem(client.get("/v1/materials/torn"), 409, "material_damaged")
    jobs = client.get("/v1/jobs").json()["jobs"]
    assert sorted((job["kind"], job["material"], job["state"]) for job in jobs) == [
        ("import", "paint", "done"),
        ("import", "torn", "failed"),
    ]
    assert "notes" not in client.get("/v1/materials").text


def test_jobs_are_listed_and_outlive_their_process(data: Path, serve: Serve) -> None:
    client = serve()
    body = {"model": "lambert", "parameters": {"reflectance": 0.8}, "tabulate": {"shape": [3, 3, 3]}}
    first = ended(client, client.put("/v1/materials/first", json=body))
    refused = client.post(
        "/v1/materials/second/upload", content=b"?", headers={"content-type": "application/octet-stream"}
    )
    assert refused.status_code == 422
    found = client.get("/v1/jobs").json()["jobs"]
    assert [(job["material"], job["state"]) for job in found] == [("second", "failed"), ("first", "done")]
    assert found[0]["problem"]["code"] == refused.json()["code"]
    other = serve()  # another replica, or the same after a restart
    assert other.get(f"/v1/jobs/{first['id']}").json() == first
    assert [job["id"] for job in other.get("/v1/jobs").json()["jobs"]] == [job["id"] for job in found]
    # of a process that is gone
    record = json.loads((data / ".jobs" / f"{first['id']}.json").read_text())
    gone = {**record, "id": "0" * 32, "state": "running", "finished": None, "owner": [record["owner"][0], 2**22 + 1]}
    (data / ".jobs" / f"{'0' * 32}.json").write_text(json.dumps(gone))
    lost = other.get("/v1/jobs/" + "0" * 32).json()
    assert (lost["state"], lost["problem"]["code"]) == ("failed", "job_lost")


def test_an_id_is_found_in_a_bounded_time(data: Path, writer: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    from brdf_service.http.errors import NotReadyError

    id = writer.library.get("red").id
    again = Library(Folder(data), 10**9)
    monkeypatch.setattr("brdf_service.library.materials._SEARCH_SECONDS", -1.0)
    with pytest.raises(NotReadyError):
        again.get_id(id)
    monkeypatch.setattr("brdf_service.library.materials._SEARCH_SECONDS", 2.0)
    assert again.get_id(id).name == "red"
    with pytest.raises(NotFoundError):
        again.get_id("0" * 64)


def test_what_a_killed_process_left_behind(data: Path, writer: Writer) -> None:
    from brdfcore.base import atomic

    gone = data / f".new-00.{atomic.host()}.{2**22 + 1}.00.tmp"
    other = data / ".new-00.elsewhere.1.00.tmp"
    for folder in (gone, other):
        folder.mkdir()
        (folder / "x.json").touch()
    writer.store.clean()
    assert (gone.exists(), other.exists()) == (False, True)
    os.utime(other, (0, 0))
    writer.store.clean()
    assert not other.exists()


def test_close_names_are_looked_for_in_a_bounded_time(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    for number in rng.integers(0, 10**9, 2000):
        (tmp_path / f"paint-{number:09d}-{'x' * 40}.json").touch()
    (tmp_path / "gold-satin.json").write_text('{"model": "lambert"}')
    library = Library(Folder(tmp_path), 10**9)
    assert "gold-satin" in str(library.unknown("gold-satn")) or library.store.names()
    assert "gold-satin" in library.unknown("gold-satn").detail
    begun = time.perf_counter()
    for _ in range(20):
        library.unknown("paint-5" + "y" * 50)
    assert (time.perf_counter() - begun) / 20 < 0.05  # 5 ms where nothing else runs
    with pytest.raises(MaterialDamagedError):
        library.get(library.store.names().all[5])
