"""Checks and gloss from a service, and the library's own on a remote material."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

import brdfcore as bc
from app.main import create_app
from app.settings import Settings
from brdfcore.client import AsyncClient, Client, ServiceError
from tests.client.scripted import FACTS, in_turn, say_json


def test_the_service_answers_as_the_library(client: Client, local: dict[str, bc.Brdf]) -> None:
    mirror = client.material("mirror")
    checks = json.loads(json.dumps(bc.check(local["mirror"]).to_json("rad")))
    assert mirror.checks() == {**checks, "id": mirror.id}
    gloss = json.loads(json.dumps(bc.gloss(local["mirror"]).to_json()))
    assert mirror.gloss() == {**gloss, "id": mirror.id}
    grid = client.material("gold-grid")
    told = bc.harmonic_summary(bc.project(local["gold-grid"], 3, window="hann"))
    assert grid.harmonics(3, window="hann") == {**json.loads(json.dumps(told)), "id": grid.id}


def test_asyncio(folder: Path, client: Client) -> None:
    async def work() -> None:
        async with AsyncClient.in_process(create_app(Settings(data=folder), warm=False)) as c:
            mirror = await c.material("mirror")
            assert await mirror.checks() == client.material("mirror").checks()
            assert await mirror.gloss() == client.material("mirror").gloss()
            assert await mirror.harmonics(2) == client.material("mirror").harmonics(2)

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
