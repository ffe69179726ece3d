"""Everything in the README and in docs/ that can be run is run, in order; what it names exists."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from brdfcore.base.registry import FORMATS
from tests.benchmarks import headline, licences
from tests.benchmarks.pages import held
from tests.support.pages import ROOT, blocks, environment, follow

README = ROOT / "README.md"
DOCS = sorted((ROOT / "docs").glob("*.md"))
PAGES = [README, ROOT / "CONTRIBUTING.md", *DOCS]
#: Pages of docs/ with something to run.
RUN = [p for p in DOCS if {"sh", "python"} & {kind for kind, _ in blocks(p)}]

needs_curl = pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("project")


@pytest.fixture(scope="module")
def address(project: Path) -> Iterator[str]:
    """`brdf serve`, as the first command ends, in an empty folder; a free port is all that it is told."""
    server = subprocess.Popen(
        ["brdf", "serve", "--port", "0"],
        cwd=project,
        env=environment(project),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert server.stdout is not None
        said, until = [], time.monotonic() + 120
        for line in server.stdout:
            said.append(line)
            if found := re.search(r"http://127\.0\.0\.1:\d+", line):
                yield found[0]
                return
            assert time.monotonic() < until, said
        pytest.fail("the service ended: " + "".join(said))
    finally:
        server.terminate()
        server.communicate(timeout=20)


@needs_curl
@pytest.mark.slow
def test_readme_from_an_empty_folder(address: str, project: Path) -> None:
    follow(README, project, address)
    assert (project / "again.bsdf").read_bytes() == (project / "paint.bsdf").read_bytes()
    for name in ("paint.png", "sphere.png", "harmonics.png"):
        assert (project / name).read_bytes().startswith(b"\x89PNG"), name
    for name in ("gold.svg", "slice.svg"):
        assert b"<svg" in (project / name).read_bytes(), name


@pytest.mark.slow
@needs_curl
@pytest.mark.slow
@pytest.mark.parametrize("page", RUN, ids=lambda p: p.stem)
def test_page_from_an_empty_folder(page: Path, address: str, tmp_path: Path) -> None:
    follow(page, tmp_path, address)


def test_two_commands_and_nothing_else_to_set_up() -> None:
    commands = [
        line for kind, block in blocks(README) if kind == "sh" for line in block.splitlines() if "venv " in line
    ]
    assert len(commands) == 2
    assert commands[0].endswith("brdf serve")
    assert commands[1].endswith("-m pytest")
    assert commands[0] in (ROOT / "docs" / "start.md").read_text(encoding="utf-8")


def test_readme_stays_short() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 160


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_files_and_links_named_here_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(((?!https?:|#|<)[^)#]+)", text):
        assert (page.parent / target).exists(), target
    for target in re.findall(r"`((?:brdfcore|app|docs|tests)/[\w/]+\.(?:py|md))`", text):
        assert "NAME" in target or (ROOT / target).exists(), target
    for module in re.findall(r"python -m (tests\.[\w.]+)", text):
        assert (ROOT / (module.replace(".", "/") + ".py")).exists(), module


def test_every_picture_is_shown() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert [p.name for p in (ROOT / "docs" / "pictures").iterdir() if f"pictures/{p.name})" not in text] == []
    assert not list((ROOT / "app").rglob("*.png"))  # what the service draws is drawn when it is asked for


def test_readme_has_the_figures_of_the_pages() -> None:
    command = "python -m tests.benchmarks.pages headline"
    assert held("README.md", "headline") == headline.text(), f"README.md differs from docs/; write it with: {command}"


def test_every_format_has_its_row() -> None:
    rows = re.findall(r"^\| `(\w+)` \|", (ROOT / "docs" / "formats.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(rows) == sorted(FORMATS.entries)


def test_licences_are_those_of_the_dependencies() -> None:
    """Each package that pyproject.toml names, with its extras, and a licence of the family that is installed."""
    command = "python -m tests.benchmarks.pages licences"
    text, declared = held("docs/licences.md", "licences"), licences.declared()
    rows = re.findall(r"^\| ([\w.-]+) \| ([^|]+) \| ([^|]+) \|$", text.split("\n\nWhat")[0], re.MULTILINE)
    extras = {name: [e.strip("`") if e != "always" else "" for e in said.split(", ")] for name, _, said in rows[2:]}
    assert extras == declared, f"docs/licences.md does not name what pyproject.toml does; write it with: {command}"
    for name, said in licences.listed().items():
        if (found := licences.licence(name)) is not None:
            assert licences.family(said) == licences.family(found), f"{name}: {said}, now {found}; {command}"
        # nothing that obliges who serves or ships this; a benchmark or a test may compare with anything
        if set(declared.get(name, [""])) & set(licences.SHIPPED):
            assert "GPL" not in said.replace("LGPL", ""), name


def test_documented_extras_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for page in PAGES:
        for extra in re.findall(r"'\.\[(\w+)\]'", page.read_text(encoding="utf-8")):
            assert extra in project["optional-dependencies"], (page.name, extra)
