"""A data folder with one material of each kind, and clients of a service over it in this process."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from brdf_service.main import create_app
from brdf_service.settings import Settings

import brdfcore as bc
from brdfcore.client import Client
from brdfcore.formats.rgl.tensor_file import encode
from tests.support.rgl_synthetic import fields_of

MODELS = {
    "gold": {"model": "cook_torrance", "parameters": {"roughness": 0.2, "ior": "gold"}},
    "paper": {"model": "lambert", "parameters": {"reflectance": [0.8, 0.7, 0.6]}},
    "mirror": {"model": "mirror", "parameters": {"ior": "silver"}},
}
#: gold-grid, gold-half: tables; measured: an RGL file in its own warp; spectral: with wavelengths; the rest: models.
NAMES = ("gold", "gold-grid", "gold-half", "measured", "mirror", "paper", "spectral")


@pytest.fixture(scope="session")
def local(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bc.Brdf]:
    """The materials as the library itself holds them."""
    folder = tmp_path_factory.mktemp("files")
    made: dict[str, bc.Brdf] = {name: bc.model(m["model"], **m["parameters"]) for name, m in MODELS.items()}
    made["gold-grid"] = bc.tabulate(
        bc.model("cook_torrance", roughness=0.3, ior="gold"), "angle_grid", shape=(16, 16, 31)
    )
    made["gold-half"] = bc.tabulate(
        bc.model("cook_torrance", roughness=0.2, ior="gold"), "half_difference", max_bytes=60_000
    )
    for name, wavelengths in (("measured", 0), ("spectral", 7)):
        path = folder / f"{name}.bsdf"
        path.write_bytes(encode(fields_of(wavelengths=wavelengths)))
        made[name] = bc.tabulate(bc.read(path), "vndf_warp")
    return made


@pytest.fixture(scope="session")
def folder(local: dict[str, bc.Brdf], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data folder of the service; nobody writes to it."""
    folder = tmp_path_factory.mktemp("data")
    for name, brdf in local.items():
        if name in MODELS:
            (folder / f"{name}.json").write_text(json.dumps(MODELS[name]))
        else:
            assert isinstance(brdf, bc.Table)
            brdf.save(folder / f"{name}.h5")
    return folder


@pytest.fixture(scope="session")
def client(folder: Path) -> Iterator[Client]:
    """One client for the tests that change nothing."""
    with Client.in_process(create_app(Settings(data=folder), warm=False)) as made:
        yield made
