"""Lists, metadata and slices; storing, replacing and deleting; jobs."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.main import create_app
from brdf_service.settings import Settings

import brdfcore as bc
from brdfcore.base.errors import FileFormatError, InputError, LimitError, StorageError, UnknownNameError
from brdfcore.client import AccessError, AsyncClient, Client, DeadlineError, JobError
from brdfcore.formats.rgl.tensor_file import encode
from tests.client.conftest import NAMES
from tests.client.scripted import FACTS, Said, Scripted, in_turn, say_json
from tests.support.rgl_synthetic import fields_of


def test_the_list(client: Client, local: dict[str, bc.Brdf]) -> None:
    lines = client.materials()
    assert [line["name"] for line in lines] == sorted(NAMES)
    for line in lines:
        remote = client.material(line["name"])
        assert remote.id == line["id"]
        assert client.table(remote.id).name == remote.name
        here = local[remote.name]
        if isinstance(here, bc.Table):
            assert (remote.nbytes, remote.id, remote.error, remote.source) == (
                here.nbytes,
                here.id,
                here.error,
                here.source,
            )
        assert remote.name in repr(remote)
        json.dumps(remote.describe(), allow_nan=False)


def test_pages_are_put_together() -> None:
    pages = [
        say_json({"materials": [{"name": "a"}, {"name": "b"}], "next": "/v1/materials?limit=2&offset=2"}),
        say_json({"materials": [{"name": "c"}], "next": None}),
    ]
    app = in_turn(*pages)
    with Client.in_process(app) as client:
        assert [m["name"] for m in client.materials()] == ["a", "b", "c"]
    assert app.asked[1].query == "limit=2&offset=2"
    elsewhere = in_turn(say_json({"materials": [], "next": "http://elsewhere/v1/materials"}))
    with Client.in_process(elsewhere, key="secret-key") as client, pytest.raises(bc.BrdfError, match="next page"):
        client.materials()


def test_slices(client: Client, local: dict[str, bc.Brdf]) -> None:
    gold = client.material("gold-grid")
    here = bc.slice(local["gold-grid"], np.array([0.3, 1.0]))
    found = gold.slice([0.3, 1.0])
    assert found["angles"] == "rad"
    assert np.array_equal(np.array(found["values"]), here.values)
    assert gold.slice(0.3, format="svg").startswith(b"<?xml")
    assert gold.slice(0.3, format="png", scale="log", view="hemisphere").startswith(b"\x89PNG")
    assert b"theta_o" in gold.slice([0.3], format="csv", channel=0)


@pytest.fixture
def data(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / "data"))


@pytest.fixture
def writer(data: Path) -> Iterator[Client]:
    with Client.in_process(create_app(Settings(data=data), warm=False), progress=False) as made:
        yield made


def test_models_are_stored_replaced_and_deleted(writer: Client) -> None:
    job = writer.put("mine", "cook_torrance", {"roughness": np.float64(0.3), "ior": 1.5 + 0.2j}, about="a test")
    assert job.ended
    mine = job.wait()
    here = bc.model("cook_torrance", roughness=0.3, ior=1.5 + 0.2j)
    assert np.array_equal(mine.evaluate(0.3, 0.4, 3.0), here.evaluate(0.3, 0.4, 3.0))
    with pytest.raises(StorageError, match="exists"):
        writer.put("mine", "lambert")
    other = writer.put("mine", "lambert", {"reflectance": [0.1, 0.2, 0.3]}, replace=True).wait()
    assert list(other.channels) == ["R", "G", "B"]
    with pytest.raises(UnknownNameError):  # the one before is gone, and does not become the new one
        mine.evaluate(0.3, 0.4, 3.0)
    assert writer.put("fresh", "lambert", replace=True).wait().name == "fresh"
    writer.delete("mine")
    with pytest.raises(UnknownNameError):
        writer.material("mine")
    with pytest.raises(bc.BrdfError):
        writer.delete("mine")
    with pytest.raises(UnknownNameError, match="lambert"):
        writer.put("odd", "lambertt")
    with pytest.raises(InputError, match="JSON"):
        writer.put("odd", "lambert", {"reflectance": object()})


def test_tables_are_made_by_jobs(writer: Client) -> None:
    options = {"representation": "angle_grid", "shape": (8, 8, 9)}
    job = writer.put("small", "cook_torrance", {"roughness": 0.5, "ior": "gold"}, tabulate=options)
    assert job.id is not None
    assert writer.job(job.id).material == "small"
    small = job.wait(timeout=60)
    assert (job.state, job.progress[2]) == ("done", "done")
    here = bc.tabulate(bc.model("cook_torrance", roughness=0.5, ior="gold"), "angle_grid", shape=(8, 8, 9))
    assert isinstance(here, bc.Table)
    assert small.id == here.id
    assert job.refresh().wait().id == here.id


def test_files_are_uploaded(writer: Client, local: dict[str, bc.Brdf], tmp_path: Path) -> None:
    file = tmp_path / "paint.bsdf"
    file.write_bytes(encode(fields_of()))
    paint = writer.upload("paint", file, tabulate={"representation": "vndf_warp"}).wait(timeout=60)
    assert np.array_equal(paint.evaluate(0.3, 0.4, 3.0), local["measured"].evaluate(0.3, 0.4, 3.0))
    with pytest.raises(StorageError, match="exists"):
        writer.upload("paint", file)
    failing = writer.upload("broken", file.read_bytes()[:-50])
    with pytest.raises(FileFormatError) as caught:
        failing.wait(timeout=60)
    assert caught.value.context["job"] == failing.id
    assert failing.refresh().state == "failed"
    with pytest.raises(StorageError, match="cannot be read"):
        writer.upload("absent", tmp_path / "absent.bsdf")
    with pytest.raises(JobError, match="no job"):
        writer.job("0" * 32)


def test_writing_for_asyncio(data: Path, tmp_path: Path) -> None:
    async def work() -> None:
        async with AsyncClient.in_process(create_app(Settings(data=data), warm=False)) as c:
            assert (await (await c.put("new", "lambert")).wait()).name == "new"
            await c.delete("new")
            with pytest.raises(UnknownNameError):
                await c.material("new")
            with pytest.raises(StorageError, match="exists"):
                await c.upload("gold", b"anything")
            with pytest.raises(StorageError, match="cannot be read"):
                await c.upload("fresh", tmp_path / "absent")
            with pytest.raises(JobError, match="no job"):
                await c.job("0" * 32)

    asyncio.run(work())


def test_who_may_write(data: Path) -> None:
    app = create_app(Settings(data=data, api_key="a-long-secret"), warm=False)
    with Client.in_process(app, key="") as client, pytest.raises(AccessError, match="key"):
        client.delete("gold")
    app = create_app(Settings(data=data, api_key="a-long-secret"), warm=False)
    with Client.in_process(app, key="wrong-secret") as client, pytest.raises(AccessError, match="not the service's"):
        client.delete("gold")
    app = create_app(Settings(data=data, api_key="a-long-secret"), warm=False)
    with Client.in_process(app, key="a-long-secret") as client:
        client.delete("gold")


def jobs_app(*states: dict[str, Any]) -> Scripted:
    """A job that goes through these states, the last for ever; its material is there."""
    left = [{"id": "j1", "material": "grey", "progress": {"done": 0, "total": 4, "stage": ""}, **s} for s in states]

    def answer(asked: Any) -> Said:
        if asked.path.startswith("/v1/jobs/"):
            if asked.method == "DELETE":
                left[:] = [{**left[0], "state": "cancelled"}]
            return say_json(left.pop(0) if len(left) > 1 else left[0])
        return say_json(left.pop(0), 202) if asked.method == "PUT" else say_json(FACTS)

    return Scripted(answer)


def test_waiting_for_a_job() -> None:
    told: list[tuple[int, int, str]] = []
    running = {"state": "running", "progress": {"done": 2, "total": 4, "stage": "sampling"}}
    done = {"state": "done", "progress": {"done": 4, "total": 4, "stage": "done"}}
    app = jobs_app({"state": "queued"}, running, done)
    with Client.in_process(app, progress=lambda *a: told.append(a)) as client:
        assert client.put("grey", "lambert").wait().name == "grey"
    assert told == [(2, 4, "sampling"), (4, 4, "done")]
    with Client.in_process(jobs_app({"state": "queued"}, running)) as client:
        job = client.put("grey", "lambert")
        with pytest.raises(DeadlineError, match="still running"):
            job.wait(timeout=0.2)
        job.cancel()
        assert job.ended
        with pytest.raises(JobError, match="cancelled"):
            job.wait()
    problem = {"status": 413, "code": "job_seconds", "detail": "it took more than 3 seconds"}
    with Client.in_process(jobs_app({"state": "queued"}, {"state": "failed", "problem": problem})) as client:
        with pytest.raises(LimitError, match="more than 3 seconds") as caught:
            client.put("grey", "lambert").wait()
        assert caught.value.context["job"] == "j1"

    async def work() -> None:
        async with AsyncClient.in_process(jobs_app({"state": "queued"}, running, done), progress=False) as c:
            job = await c.put("grey", "lambert")
            assert (await job.refresh()).progress == (2, 4, "sampling")
            assert (await job.wait()).name == "grey"
        async with AsyncClient.in_process(jobs_app({"state": "queued"}, running), progress=False) as c:
            job = await c.put("grey", "lambert")
            await job.cancel()
            with pytest.raises(JobError):
                await job.wait()

    asyncio.run(work())
