"""The Dockerfile without an engine: what it copies, installs and starts exists, and starts as it says."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
import tomllib
import venv
from pathlib import Path

import pytest

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
    image = re.fullmatch(r"python:(\d+)\.(\d+)-slim@sha256:[0-9a-f]{64}", of("FROM")[0])
    assert image, of("FROM")  # the tag for people, the digest for the engine
    version = tuple(map(int, image.groups()))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lowest = tuple(map(int, re.findall(r"\d+", project["requires-python"])))
    assert version >= lowest


def test_what_is_copied_is_all_that_is_built_from() -> None:
    copied = [part for line in of("COPY") for part in line.split()[:-1]]
    assert all((ROOT / name).exists() for name in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    for name in (project["project"]["readme"], *project["project"]["license-files"], "pyproject.toml"):
        assert name in copied
    setup = project["tool"]["setuptools"]
    for package in setup["packages"]:
        assert setup["package-dir"].get(package, package).partition(".")[0] in (*copied, "brdf_service")
    assert set(setup["package-dir"].values()) <= set(copied)
    (install,) = [line for line in of("RUN") if "pip install" in line]
    extras = re.findall(r"\[(\w+)\]", install)
    assert extras
    assert set(extras) <= set(project["project"]["optional-dependencies"])


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel that its COPY and install steps make, beside the dependencies of this one."""
    place = tmp_path_factory.mktemp("image")
    source, environment = place / "source", place / "environment"
    source.mkdir()
    for name in (part for line in of("COPY") for part in line.split()[:-1]):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, source)
    venv.create(environment, with_pip=False, symlinks=True)
    (site,) = environment.glob("lib/python*/site-packages")
    # paths alone: how an editable install of the checkout finds it is not among them
    (site / "dependencies.pth").write_text("\n".join(p for p in sys.path if Path(p).name.endswith("-packages")))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    make = ["wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(place), str(source)]
    subprocess.run([*pip, *make], check=True)
    (wheel,) = place.glob("*.whl")
    install = [
        "--python",
        str(environment / "bin" / "python"),
        "install",
        "--no-deps",
        "--ignore-installed",
        str(wheel),
    ]
    subprocess.run([*pip, *install], check=True)
    return environment


def test_installed_from_what_is_copied(installed: Path, tmp_path: Path) -> None:
    """Packages and package data, and the service over them."""
    program = "import brdf_service.main as m; c = m.create_app(warm=False); c.openapi(); print(m.__file__)"
    python = str(installed / "bin" / "python")
    done = subprocess.run([python, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    main = Path(done.stdout.strip())
    assert main.is_relative_to(installed)
    pages = {page.name for page in (ROOT / "app" / "web").iterdir()}
    assert {page.name for page in (main.parent / "web").iterdir()} == pages
    assert not (main.parents[1] / "tests").exists()


def test_files_of_a_stranger_where_it_is_started(installed: Path, tmp_path: Path) -> None:
    """`brdf serve` and its child processes import nothing from the current folder: pictures are drawn, jobs done."""
    for name in ("app/__init__.py", "brdf_service.py", "brdfcore.py", "numpy.py", "starlette.py", "json.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(f"raise SystemExit('a stranger is imported: {name}')")
    (tmp_path / "brdf-data").mkdir()
    (tmp_path / "brdf-data" / "white.json").write_text('{"model": "lambert"}')
    brdf = (str(installed / "bin" / "brdf"),)
    service = Running(Path("brdf-data"), "--no-starter", program=brdf, folder=tmp_path, PYTHONPATH="")
    try:
        for _ in range(600):
            if service.ask("/health/ready").status == 200:
                break
            time.sleep(0.1)
        picture = service.ask("/v1/materials/white/slice.svg?theta_i=31", timeout=90)
        assert (picture.status, picture.body[:5]) == (200, b"<?xml")
        model = b'{"model": "lambert", "parameters": {"reflectance": 0.5}}'
        job = service.ask("/v1/materials/grey/upload", "POST", model, Content_Type="application/octet-stream")
        assert job.status == 202
        for _ in range(600):
            told = json.loads(service.ask(job.headers["location"]).body)
            if told["state"] in ("done", "failed"):
                break
            time.sleep(0.1)
        assert (told["state"], told["problem"]) == ("done", None)
        assert service.ask("/v1/materials/grey").status == 200
    finally:
        code, errors = service.stop()
    assert code == 0
    assert "stranger" not in errors
    assert "rror" not in errors


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
