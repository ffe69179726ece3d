"""The asynchronous client gives what the synchronous one gives."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.main import create_app
from brdf_service.settings import Settings

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.errors import InputError, UnknownNameError
from brdfcore.client import AsyncClient, Client, DeadlineError, ServiceError
from tests.client.conftest import NAMES
from tests.client.scripted import FACTS, Said, grey_service, in_turn, say_json


def run(work: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(work)


def test_same_bits_and_errors(folder: Path, local: dict[str, bc.Brdf], client: Client) -> None:
    i, o, d = testing.sample_angles(300)
    wi, wo = np.random.default_rng(2).normal(size=(2, 50, 3))
    theta = np.radians([0.0, 50.0])

    async def work() -> None:
        async with AsyncClient.in_process(create_app(Settings(data=folder), warm=False)) as c:
            assert await c.materials() == client.materials()
            for name in NAMES:
                there, sync, here = await c.material(name), client.material(name), local[name]
                for dtype in (np.float32, np.float64):
                    angles = [x.astype(dtype) for x in (i, o, d)]
                    values = await there.evaluate(*angles)
                    assert values.dtype == dtype
                    assert np.array_equal(values, here.evaluate(*angles))
                    codes = await there.status(*angles)
                    assert np.array_equal(codes, here.status(*angles))
                out = np.empty((i.size, len(here.channels)))
                assert await there.evaluate(i, o, d, out=out) is out
                assert np.array_equal(out, here.evaluate(i, o, d))
                marked = await there.evaluate(2.0, 0.1, [0.1, 0.2], outside="nan")
                assert np.isnan(marked).all()
                found = await there.evaluate_vectors(wi, wo)
                assert np.array_equal(found, sync.evaluate_vectors(wi, wo))
                single = await there.evaluate_vectors(wi.astype(np.float32), wo[0].astype(np.float32))
                expected = here.evaluate_vectors(wi.astype(np.float32), wo[0].astype(np.float32))
                assert single.dtype == np.float32
                assert single.tobytes() == expected.tobytes()
                assert np.array_equal(await there.albedo(theta), here.albedo(theta))
                assert np.array_equal(await there.delta_reflectance(theta), here.delta_reflectance(theta))
                assert there.describe() == sync.describe()
                assert there.id == (await c.table(there.id)).id
            assert await there.slice(0.5) == sync.slice(0.5)
            with pytest.raises(InputError) as caught:
                await there.evaluate([0.1, 2.0], 0.1, 0.1)
            assert caught.value.context["index"] == [1]
            with pytest.raises(UnknownNameError):
                await c.material("nothing")
            # many at once over one client
            many = await asyncio.gather(*(there.evaluate(x, 0.2, 0.3) for x in i[:50]))
            assert np.array_equal(np.stack(many), local[NAMES[-1]].evaluate(i[:50], 0.2, 0.3))

    run(work())


def test_pieces_and_retries() -> None:
    async def work() -> None:
        app = grey_service(bad_point=250)
        async with AsyncClient.in_process(app, chunk_points=30, progress=False) as c:
            grey = await c.material("grey")
            x = np.linspace(0, 1.5, 100)
            assert np.array_equal((await grey.evaluate(x, x, x))[:, 0], x + 2 * x)
            with pytest.raises(InputError) as caught:
                await grey.evaluate(np.zeros((10, 20)), 0.0, 0.0)
            assert caught.value.context["index"] == [7, 10]
        async with AsyncClient.in_process(in_turn(Said(503), Said(502), say_json(FACTS))) as c:
            assert (await c.material("grey")).name == "grey"
        async with AsyncClient.in_process(in_turn(Said(503)), deadline=0.2) as c:
            with pytest.raises(DeadlineError):
                await c.materials()
        async with AsyncClient("http://127.0.0.1:9", deadline=0) as c:
            with pytest.raises(ServiceError):
                await c.materials()

    run(work())
