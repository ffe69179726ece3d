"""The clients know all that the service offers, have one signature, and type checkers see it."""

from __future__ import annotations

import asyncio
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.main import create_app
from brdf_service.settings import Settings

import brdfcore as bc
from brdfcore.client import AsyncClient, AsyncMaterial, Client, RemoteBrdf
from brdfcore.client.jobs import AsyncJob, AsyncReportJob, Job, ReportJob

#: Methods of a material that are not called as their path is.
NAMED = {"report": "import_report", "harmonics.png": "harmonics_picture", "harmonics.svg": "harmonics_picture"}
#: Of the path of a job, and of one without an id; None: nothing that a client of this kind needs.
ELSEWHERE: dict[str, tuple[type, str] | None] = {
    "GET /v1/materials": (Client, "materials"),
    "GET /v1/materials/{name}": (Client, "material"),
    "PUT /v1/materials/{name}": (Client, "put"),
    "DELETE /v1/materials/{name}": (Client, "delete"),
    "POST /v1/materials/{name}/upload": (Client, "upload"),
    "POST /v1/materials/{name}/pareto": (Client, "pareto"),
    "GET /v1/tables/{id}": (Client, "table"),
    "GET /v1/jobs": (Client, "jobs"),
    "GET /v1/jobs/{id}": (Client, "job"),
    "DELETE /v1/jobs/{id}": (Job, "cancel"),
    "GET /v1/jobs/{id}/pareto.png": (ReportJob, "picture"),
    "GET /v1/jobs/{id}/events": None,  # for browsers: `Job.wait` asks again
    "GET /health/live": None,
    "GET /health/ready": None,
    "GET /metrics": None,
}
#: Of the service's query, what is the client's own business: it sends radians in the form that suits it.
UNSEEN = {"angles", "dtype", "input", "status", "uncertainty", "normals", "views"}


@pytest.fixture(scope="module")
def operations(folder: Path) -> dict[str, dict[str, Any]]:
    paths = create_app(Settings(data=folder), warm=False).openapi()["paths"]
    return {f"{method.upper()} {path}": told for path, methods in paths.items() for method, told in methods.items()}


def test_everything_offered_has_a_method(operations: dict[str, dict[str, Any]]) -> None:
    seen = 0
    for operation, told in operations.items():
        method, path = operation.split()
        address, _, name = path.rpartition("/")
        if operation in ELSEWHERE:
            holder = ELSEWHERE[operation]
            assert holder is None or callable(getattr(*holder)), operation
            continue
        if address == "/v1/materials/{name}":  # the same by name
            assert f"{method} /v1/tables/{{id}}/{name}" in operations, operation
            continue
        assert address == "/v1/tables/{id}", operation
        called = NAMED.get(name, name.partition(".")[0])
        for kind in (RemoteBrdf, AsyncMaterial):
            given = set(inspect.signature(getattr(kind, called)).parameters)
            asked = {p["name"] for p in told.get("parameters", []) if p["in"] == "query"}
            assert asked - UNSEEN <= given, (operation, kind)
            assert "." not in name or name.count(".") == 1
            seen += 1
    assert seen >= 30


@pytest.mark.parametrize(
    ("sync", "awaited"),
    [(Client, AsyncClient), (RemoteBrdf, AsyncMaterial), (Job, AsyncJob), (ReportJob, AsyncReportJob)],
)
def test_one_signature(sync: type, awaited: type) -> None:
    names = [n for n in dir(awaited) if not n.startswith("_") and inspect.iscoroutinefunction(getattr(awaited, n))]
    assert names
    for name in names:
        one, other = getattr(sync, name), getattr(awaited, name)
        assert one.__doc__
        assert not inspect.iscoroutinefunction(one)
        if name not in ("albedo", "status", "delta_reflectance"):  # `Brdf`'s own
            assert list(inspect.signature(one).parameters.values()) == list(
                inspect.signature(other).parameters.values()
            )


def test_results_are_named() -> None:
    assert inspect.signature(RemoteBrdf.gloss).return_annotation == "dict[str, Any]"
    assert inspect.signature(Client.material).return_annotation == "RemoteBrdf"
    assert inspect.signature(AsyncClient.material).return_annotation == "AsyncMaterial"


def test_pictures(folder: Path, client: Client, local: dict[str, bc.Brdf]) -> None:
    measured = client.material("measured")
    drawn = bc.plot.render(bc.plot.coverage(local["measured"], np.radians([20.0]), title=measured.id[:12]), "png")
    assert measured.coverage(np.radians(20.0)) == drawn
    assert measured.coverage(format="svg").startswith(b"<?xml")
    expansion = measured.harmonics_picture(3, theta_i=[0.2, 0.7], format="svg")
    assert expansion.startswith(b"<?xml")
    assert measured.harmonics_picture(3).startswith(b"\x89PNG")

    async def work() -> None:
        async with AsyncClient.in_process(create_app(Settings(data=folder), warm=False)) as c:
            there = await c.material("measured")
            assert await there.coverage(np.radians(20.0)) == drawn
            assert await there.harmonics_picture(3, theta_i=[0.2, 0.7], format="svg") == expansion

    asyncio.run(work())


def test_symmetrise(client: Client, local: dict[str, bc.Brdf]) -> None:
    told = client.material("measured").harmonics(3, symmetrise=True)
    assert told["reciprocal"] is True
    assert client.material("measured").harmonics(3)["reciprocal"] is False
    assert told["truncation"] == bc.harmonic_summary(bc.project(local["measured"], 3, symmetrise=True))["truncation"]


TYPED = """
from typing import Any, assert_type
import numpy as np
from brdfcore.client import AsyncClient, AsyncJob, AsyncMaterial, Client, Job, RemoteBrdf

def sync(c: Client) -> None:
    b = c.material("x")
    assert_type(b, RemoteBrdf)
    assert_type(b.gloss(), dict[str, Any])
    assert_type(b.coverage(0.5, format="svg"), bytes)
    assert_type(b.slice(0.5), dict[str, Any])
    assert_type(b.slice(0.5, format="csv"), bytes)
    assert_type(c.put("x", "lambert"), Job)
    assert_type(c.put("x", "lambert").refresh().wait(), RemoteBrdf)

async def awaited(c: AsyncClient) -> None:
    b = await c.material("x")
    assert_type(b, AsyncMaterial)
    assert_type(await b.gloss(), dict[str, Any])
    assert_type(await b.coverage(0.5, format="svg"), bytes)
    assert_type(await b.slice(0.5), dict[str, Any])
    assert_type(await b.slice(0.5, format="csv"), bytes)
    assert_type(await c.put("x", "lambert"), AsyncJob)
    assert_type(await (await (await c.put("x", "lambert")).refresh()).wait(), AsyncMaterial)
"""
MISTAKES = """
def mistakes(b: RemoteBrdf) -> None:
    b.harmonics(target="g")
    b.coverage(depth=3)
    b.sphere(3)
"""


def test_type_checkers_see_it(tmp_path: Path) -> None:
    def checked(program: str) -> list[str]:
        (tmp_path / "program.py").write_text(program)
        done = subprocess.run(
            [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "program.py"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            env={"MYPYPATH": str(Path(bc.__file__).parents[1]), "PATH": ""},
        )
        return [line for line in done.stdout.splitlines() if "error:" in line] + done.stderr.splitlines()

    assert checked(TYPED) == []
    lines = len(TYPED.splitlines())
    assert [line.split(":")[1] for line in checked(TYPED + MISTAKES)] == [str(lines + k) for k in (3, 4, 5)]
