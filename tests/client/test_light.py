"""The client installs and works without anything of the library that evaluates."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import uvicorn

from tests.client.scripted import grey_service
from tests.client.serving import in_thread

ROOT = Path(__file__).parents[2]
HEAVY = ("numba", "scipy", "h5py", "matplotlib", "fastapi", "starlette", "pydantic", "uvicorn", "typer", "rich")

BLOCK = f"""
import sys
for name in {HEAVY!r}:
    sys.modules[name] = None  # importing it is an error now
"""

USE = """
import asyncio, sys
import numpy as np
import brdfcore.client
assert not {"httpx2", "brdfcore.client.service"} & set(sys.modules), "importing the client imports httpx2"
from brdfcore.client import AsyncClient, Client

def check(values):
    assert values.dtype == np.float64 and values.tolist() == [[0.5], [0.7]], values

with Client(sys.argv[1]) as c:
    grey = c.material("grey")
    check(grey.evaluate([0.1, 0.3], 0.2, 3.0))
    assert (2 * grey).evaluate_vectors([0, 0, 1], [0, 0, 1]).shape == (1,)

async def main():
    async with AsyncClient(sys.argv[1]) as c:
        check(await (await c.material("grey")).evaluate([0.1, 0.3], 0.2, 3.0))

asyncio.run(main())
loaded = {m.split(".")[0] for m, module in sys.modules.items() if module is not None}
print(*sorted(loaded & set(HEAVY)))
""".replace("HEAVY", repr(HEAVY))


def run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", program, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ},
    )


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with in_thread(uvicorn.Config(grey_service(), log_level="error")) as url:
        yield url


def test_in_a_bare_environment(address: str) -> None:
    done = run(BLOCK + USE, address)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""


def test_loads_nothing_heavy_where_it_could(address: str) -> None:
    done = run(USE, address)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("name", ["Client", "AsyncClient", "RemoteBrdf"])
def test_without_httpx2_the_extra_is_named(name: str) -> None:
    program = f"""
import sys
sys.modules["httpx2"] = None
import brdfcore.client
try:
    from brdfcore.client import {name}
except ImportError as error:
    assert error.code == "missing_extra" and error.context["extra"] == "client", error
    print(error)
"""
    done = run(program)
    assert done.returncode == 0, done.stderr
    if name != "RemoteBrdf":
        assert "pip install 'brdf-tables[client]'" in done.stdout


def test_a_misspelt_name_is_no_missing_extra() -> None:
    done = run("from brdfcore.client import Klient")
    assert "cannot import name 'Klient'" in done.stderr
