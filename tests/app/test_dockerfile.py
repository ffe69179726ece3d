"""The Dockerfile without an engine: what it copies, installs and starts exists, and starts as it says."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

from tests.app.running import Running

ROOT = Path(__file__).parents[2]


def instructions() -> list[tuple[str, str]]:
    """(instruction, arguments) in order, continued lines joined."""
    text = re.sub(r"\\\n", " ", (ROOT / "Dockerfile").read_text(encoding="utf-8"))
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [(kind, rest.strip()) for kind, _, rest in (line.partition(" ") for line in lines)]


def of(kind: str) -> list[str]:
    return [rest for k, rest in instructions() if k == kind]


def variables() -> dict[str, str]:
    return dict(pair.split("=", 1) for line in of("ENV") for pair in line.split())


def test_every_instruction_is_known_and_in_order() -> None:
    kinds = [kind for kind, _ in instructions()]
    assert kinds[0] == "FROM"
    known = {"FROM", "ENV", "COPY", "RUN", "USER", "WORKDIR", "VOLUME", "EXPOSE", "HEALTHCHECK", "STOPSIGNAL", "CMD"}
    assert set(kinds) <= known
    assert kinds.index("USER") > max(k for k, kind in enumerate(kinds) if kind == "RUN")
    assert of("USER") not in ([], ["root"], ["0"])
    assert of("VOLUME") == ["/data"]
    assert of("FROM")[0].endswith("-slim")
    version = tuple(map(int, re.findall(r"\d+", of("FROM")[0])[:2]))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lowest = tuple(map(int, re.findall(r"\d+", project["requires-python"])))
    assert version >= lowest


def test_what_is_copied_is_all_that_is_built_from() -> None:
    copied = [part for line in of("COPY") for part in line.split()[:-1]]
    assert all((ROOT / name).exists() for name in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    for name in (project["project"]["readme"], *project["project"]["license-files"], "pyproject.toml"):
        assert name in copied
    for pattern in project["tool"]["setuptools"]["packages"]["find"]["include"]:
        assert pattern.rstrip("*") in copied
    (install,) = [line for line in of("RUN") if "pip install" in line]
    extras = re.findall(r"\[(\w+)\]", install)
    assert extras
    assert set(extras) <= set(project["project"]["optional-dependencies"])


def test_installed_from_what_is_copied(tmp_path: Path) -> None:
    """Its COPY and install steps as far as they go without the network: packages and package data, nothing else."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    copied = [part for line in of("COPY") for part in line.split()[:-1]]
    data = [
        str(path) for name, globs in project["package-data"].items() for g in globs for path in (ROOT / name).glob(g)
    ]
    for name in (n for n in copied if (ROOT / n).is_dir()):
        for path in (ROOT / name).rglob("*"):
            if path.suffix == ".py" or str(path) in data:
                place = tmp_path / "installed" / path.relative_to(ROOT)
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(path, place)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "installed")}
    program = "import brdf_service.main as m; c = m.create_app(warm=False); c.openapi(); print(m.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip().startswith(str(tmp_path / "installed"))
    for page in (ROOT / "app" / "web").iterdir():
        assert (tmp_path / "installed" / "brdf_service" / "web" / page.name).exists()
    worker = subprocess.run(
        [sys.executable, "-m", "brdf_service.work.job_process"],
        cwd=tmp_path,
        env=environment,
        input=b"",
        capture_output=True,
        check=False,
    )
    assert b"JSONDecodeError" in worker.stderr  # it is there, and was given no task


def test_started_as_it_says(tmp_path: Path) -> None:
    """Its CMD with its variables: read-only, healthy by its own check, ready once the kernels are warm."""
    command = json.loads(of("CMD")[0])
    assert command[:2] == ["brdf", "serve"]
    (tmp_path / "materials").mkdir()
    (tmp_path / "materials" / "white.json").write_text('{"model": "lambert"}')
    inside = {k: v.replace("/data", str(tmp_path)) for k, v in variables().items() if not k.startswith("P")}
    made = Running(tmp_path / "materials", "--host", command[command.index("--host") + 1], **inside)
    try:
        assert "read-only" in made.line
        check = json.loads(of("HEALTHCHECK")[0].partition(" CMD ")[2])
        assert check[0] == "python"
        port = command[command.index("--port") + 1]
        program = [part.replace(f":{port}/", f":{made.port}/") for part in check[1:]]
        assert subprocess.run([sys.executable, *program], check=False).returncode == 0
        assert made.ask("/v1/materials/white", "PUT", '{"model": "lambert"}').status == 403
        for _ in range(200):
            ready = made.ask("/health/ready")
            if ready.status == 200:
                break
            time.sleep(0.1)
        assert ready.status == 200
    finally:
        code, _ = made.stop()
    assert code == 0
    assert (tmp_path / "cache").is_dir()
    assert of("STOPSIGNAL") == ["SIGTERM"]
    assert of("EXPOSE") == [port]
