"""Checks and gloss from a service, and the library's own on a remote material."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest
from brdf_service.main import create_app
from brdf_service.settings import Settings

import brdfcore as bc
from brdfcore.client import AsyncClient, Client, ServiceError
from tests.client.scripted import FACTS, Said, in_turn, say_json


def test_the_service_answers_as_the_library(client: Client, local: dict[str, bc.Brdf]) -> None:
    mirror = client.material("mirror")
    checks = json.loads(json.dumps(bc.check(local["mirror"]).to_json("rad")))
    assert mirror.checks() == {**checks, "id": mirror.id}
    gloss = json.loads(json.dumps(bc.gloss(local["mirror"]).to_json()))
    assert mirror.gloss() == {**gloss, "id": mirror.id}
    fitted = json.loads(json.dumps(bc.fit(local["paper"], "ward", 1).to_json()))
    paper = client.material("paper")
    assert paper.fit("ward") == {**fitted, "id": paper.id}
    grid = client.material("gold-grid")
    told = bc.harmonic_summary(bc.project(local["gold-grid"], 3, window="hann"))
    assert grid.harmonics(3, window="hann") == {**json.loads(json.dumps(told)), "id": grid.id}


SKY = np.random.default_rng(3).random((8, 16))
LIGHTS = [([0.3, 0.2, 1.0], 3.0), ([-1.0, 0.0, 0.5], 0.5)]
NORMALS = [[0.0, 0.0, 1.0], [0.2, -0.1, 1.0]]


def test_relight(client: Client, local: dict[str, bc.Brdf]) -> None:
    gold, here = client.material("gold-grid"), local["gold-grid"]
    found = gold.relight(NORMALS, [0.5, 0.0, 1.0], map=SKY, lights=LIGHTS, lmax=6)
    light = bc.Light.from_map(SKY, 6)
    for direction, irradiance in LIGHTS:
        light = light + bc.Light.directional(direction, irradiance)
    expected = bc.relight(here, light, NORMALS, [0.5, 0.0, 1.0], expansion=bc.project(here, 6))
    assert found.shape == (2, 1)
    assert np.array_equal(found, expected)
    one = gold.relight([0, 0, 1], [0, 0, 1], lights=LIGHTS[:1])
    assert one.shape == (1,)
    with pytest.raises(bc.InputError, match="nothing shines"):
        gold.relight([0, 0, 1], [0, 0, 1])
    with pytest.raises(bc.InputError):
        gold.relight([0, 0, np.nan], [0, 0, 1], lights=LIGHTS)


def test_pictures_and_reports(client: Client, local: dict[str, bc.Brdf]) -> None:
    measured = client.material("measured")
    assert measured.sphere("sky", size=128).startswith(b"\x89PNG")
    assert measured.import_report() == json.loads(json.dumps(local["measured"].report))
    with pytest.raises(bc.InputError, match="light"):
        measured.sphere("moon")


def test_which_representation() -> None:
    """The job's way; that a real service says such things is tested with the service."""
    job = {"id": "1" * 32, "material": "grey", "progress": {"done": 1, "total": 3, "stage": "timing"}, "result": None}
    running, done = {**job, "state": "running"}, {**job, "state": "done", "result": {"materials": [{"met": True}]}}
    png = Said(200, b"\x89PNG", {"content-type": "image/png"})
    app = in_turn(say_json(running, 202), say_json(running), say_json(done), png)
    with Client.in_process(app, progress=False) as c:
        asked = c.pareto("grey", tolerance=0.02, max_bytes=np.int64(10**6))
        assert asked.progress == (1, 3, "timing")
        assert asked.wait() == {"met": True}
        assert asked.picture() == png.body
    assert [a.path for a in app.asked] == ["/v1/materials/grey/pareto", *[f"/v1/jobs/{'1' * 32}"] * 2,
                                           f"/v1/jobs/{'1' * 32}/pareto.png"]  # fmt: skip
    assert json.loads(app.asked[0].body) == {"tolerance": 0.02, "max_bytes": 10**6}

    async def work() -> None:
        app = in_turn(say_json(running, 202), say_json(done), png)
        async with AsyncClient.in_process(app, progress=False) as c:
            asked = await c.pareto("grey", seconds=5)
            assert await asked.wait() == {"met": True}
            assert await asked.picture() == png.body
        assert json.loads(app.asked[0].body) == {"seconds": 5}

    asyncio.run(work())
    for empty in ({**done, "result": None}, {**done, "result": {"id": "0", "nbytes": 3}}):
        with Client.in_process(in_turn(say_json(empty, 202))) as c, pytest.raises(ServiceError, match="no report"):
            c.pareto("grey").wait()
    with Client.in_process(in_turn()) as c, pytest.raises(bc.InputError, match="name"):
        c.pareto("../grey")


def test_asyncio(folder: Path, client: Client) -> None:
    async def work() -> None:
        async with AsyncClient.in_process(create_app(Settings(data=folder), warm=False)) as c:
            mirror = await c.material("mirror")
            assert await mirror.checks() == client.material("mirror").checks()
            assert await mirror.gloss() == client.material("mirror").gloss()
            assert await mirror.harmonics(2) == client.material("mirror").harmonics(2)
            assert await mirror.sphere(size=128) == client.material("mirror").sphere(size=128)
            assert await mirror.import_report() == client.material("mirror").import_report()
            lit = await mirror.relight(NORMALS, [0.5, 0.0, 1.0], map=SKY, lmax=3)
            assert np.array_equal(lit, client.material("mirror").relight(NORMALS, [0.5, 0.0, 1.0], map=SKY, lmax=3))

    asyncio.run(work())


def test_a_remote_material_is_checked_like_a_local_one(client: Client, local: dict[str, bc.Brdf]) -> None:
    """Every value comes over the wire; the report is the same to the last bit."""
    here = bc.check(local["gold-grid"], directions=2_000)
    there = bc.check(client.material("gold-grid"), directions=2_000)
    assert there.to_json() == here.to_json()
    assert bc.repair(client.material("gold-grid"), "negatives", directions=500).report["repairs"][0]["l1"] == 0.0


def test_an_answer_of_another_form(client: Client) -> None:
    with Client.in_process(in_turn(say_json(FACTS), say_json([1]))) as c, pytest.raises(ServiceError, match="checks"):
        c.material("grey").checks()
