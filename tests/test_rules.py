"""Rules of the house that no type checker sees: who imports what, and what importing costs."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from brdfcore.base.registry import FORMATS, MODELS, REPRESENTATIONS

ROOT = Path(__file__).parents[1]
HEAVY = ("numba", "scipy", "h5py", "matplotlib", "fastapi", "starlette", "pydantic", "typer", "rich", "brdf_service")
SOURCES = sorted(p for folder in ("brdfcore", "app", "tests") for p in (ROOT / folder).rglob("*.py"))


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after `statement`."""
    program = f"import sys\n{statement}\nprint(*{{m.split('.')[0] for m in sys.modules}})"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True, env={**os.environ}
    )
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "statement",
    [
        "import brdfcore",
        "import brdfcore.client",
        "import brdfcore as bc; bc.model('cook_torrance').evaluate(0.1, 0.2, 3.0)",
        "import brdfcore as bc; bc.models(); bc.representations(); bc.formats()",
    ],
)
def test_light_imports(statement: str) -> None:
    assert not loaded_by(statement) & set(HEAVY)


def test_layers() -> None:
    """The contracts of pyproject.toml, by import-linter."""
    program = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_service_uses_public_names_only() -> None:
    """app imports `brdfcore` itself, no module below it."""
    for path in (ROOT / "app").rglob("*.py"):
        for line in path.read_text().splitlines():
            assert not re.match(r"\s*(from brdfcore\.\S+ import|import brdfcore\.)", line), f"{path.name}: {line}"


@pytest.mark.parametrize("registry", [MODELS, REPRESENTATIONS, FORMATS], ids=lambda r: r.kind)
def test_registered_under_its_own_name(registry: object) -> None:
    """Each file of a plug-in folder is registered, shared modules aside, and each entry carries its name."""
    assert isinstance(registry, type(MODELS))
    for name in registry.entries:
        assert registry.load(name).name == name


def test_every_folder_is_installed() -> None:
    """pyproject.toml lists the packages, as setuptools does not find them through the rename of app/."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        listed = tomllib.load(file)["tool"]["setuptools"]["packages"]
    folders = [
        p.parent.relative_to(ROOT).parts for top in ("brdfcore", "app") for p in (ROOT / top).rglob("__init__.py")
    ]
    found = sorted(".".join(("brdf_service" if top == "app" else top, *rest)) for top, *rest in folders)
    assert listed == found, "write the folder's dotted name into [tool.setuptools] packages"


def test_files_stay_small() -> None:
    """A file holds one thing: at most about 400 lines."""
    long = {p.name: n for p in SOURCES if (n := len(p.read_text().splitlines())) > 420}
    assert not long


def test_no_catch_all_modules() -> None:
    assert not [p for p in SOURCES if p.stem in ("utils", "util", "helpers", "misc", "common")]


def test_the_service_forks_nothing() -> None:
    """A fork of a process that has run OpenMP threads hangs at its first parallel loop: children are started anew."""
    forks = re.compile(r"\bos\.fork|\bforkserver\b|import multiprocessing|from multiprocessing|ProcessPoolExecutor")
    places = [p for folder in ("brdfcore", "app") for p in (ROOT / folder).rglob("*.py")]
    assert not [p.name for p in places if forks.search(p.read_text())]


def test_constraints_name_what_the_tests_need() -> None:
    """Each direct requirement has one version there, and one that it allows."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = (ROOT / ".ci" / "constraints.txt").read_text().splitlines()
    versions = dict(line.split("==") for line in lines if "==" in line)
    waiting, extras = ["brdf-tables[test]"], project["optional-dependencies"]
    while waiting:
        wanted = Requirement(waiting.pop())
        if wanted.name == project["name"]:
            waiting += [*project["dependencies"], *(line for extra in wanted.extras for line in extras[extra])]
        else:
            assert wanted.specifier.contains(versions[canonicalize_name(wanted.name)]), wanted
