"""A data folder with a table, an RGB table and a model, and a service over a copy of it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brdf_service.main import create_app
from brdf_service.settings import Settings
from starlette.testclient import TestClient

import brdfcore as bc

MODEL = {"model": "cook_torrance", "parameters": {"roughness": 0.2, "ior": "gold"}}


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files, made once: measuring a table's error takes a second."""
    folder = tmp_path_factory.mktemp("materials")
    gold = bc.model("cook_torrance", roughness=0.3, ior="gold")
    red = bc.model("cook_torrance", diffuse=[0.5, 0.1, 0.05], specular=0.4, roughness=0.3, ior="glass")
    bc.tabulate(gold, "angle_grid", shape=(19, 19, 37)).save(folder / "gold-grid.h5")
    bc.tabulate(red, "angle_grid", shape=(10, 10, 19)).save(folder / "red.h5")
    (folder / "gold.json").write_text(json.dumps(MODEL))
    (folder / "mirror.json").write_text(json.dumps({"model": "mirror", "parameters": {"ior": "silver"}}))
    return folder


@pytest.fixture
def data(original: Path, tmp_path: Path) -> Path:
    """A copy to change."""
    return Path(shutil.copytree(original, tmp_path / "data"))


Serve = Callable[..., TestClient]


@pytest.fixture
def serve(data: Path) -> Iterator[Serve]:
    """Make a service over `data` with some settings changed."""
    open_clients: list[TestClient] = []

    def make(**settings: Any) -> TestClient:
        app = create_app(Settings(**{"data": data, **settings}), warm=False)
        client = TestClient(app, base_url="http://127.0.0.1:8000", raise_server_exceptions=False)
        client.__enter__()
        open_clients.append(client)
        return client

    yield make
    for client in open_clients:
        client.__exit__(None, None, None)


@pytest.fixture
def client(serve: Serve) -> TestClient:
    """A service over a copy of the files."""
    return serve()


@pytest.fixture(scope="session")
def shared_client(original: Path) -> Iterator[TestClient]:
    """One service for the tests that change nothing."""
    app = create_app(Settings(data=original), warm=False)
    with TestClient(app, base_url="http://127.0.0.1:8000", raise_server_exceptions=False) as client:
        yield client


def local(folder: Path, name: str) -> bc.Brdf:
    """The material as the library itself opens it."""
    path = folder / f"{name}.h5"
    if path.exists():
        return bc.open_table(path)
    content = json.loads((folder / f"{name}.json").read_text())
    return bc.model(content["model"], **content["parameters"])


def expected_values(brdf: bc.Brdf, theta_i: Any, theta_o: Any, delta_phi: Any, *, degrees: bool = True) -> list[Any]:
    """What the answer must hold, to the last digit, by the library alone."""
    angles = [np.asarray(a, dtype=np.float64) for a in (theta_i, theta_o, delta_phi)]
    if degrees:
        angles = [np.radians(a) for a in angles]
    values = brdf.evaluate(*angles)
    listed: list[Any] = values.reshape(-1, values.shape[-1]).tolist()
    return listed


def assert_problem(answer: Any, status: int, code: str) -> dict[str, Any]:
    """The answer is a problem of this status and code, complete; its content."""
    from brdf_service.schemas.service import Problem

    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["cache-control"] == "no-store"
    content: dict[str, Any] = answer.json()
    Problem.model_validate(content, strict=True)
    assert content["code"] == code
    assert content["status"] == status
    assert content["request_id"] == answer.headers["x-request-id"]
    return content
