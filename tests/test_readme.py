"""Everything in the README that can be run is run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from brdfcore.formats.rgl.tensor_file import encode
from tests.support.rgl_synthetic import fields_of

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", TEXT, flags=re.MULTILINE | re.DOTALL)
SHELL = [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()]
#: Commands of this environment first, whatever else is on the path.
ENVIRONMENT = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A working folder with a measured file to play with."""
    (tmp_path / "paint.bsdf").write_bytes(encode(fields_of()))
    return tmp_path


def test_python_example(folder: Path) -> None:
    (source,) = [block for kind, block in BLOCKS if kind == "python" and "Client" not in block]
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", source], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (folder / "gold.svg").read_bytes().startswith(b"<?xml")


def test_shell_examples(folder: Path) -> None:
    lines = [line for line in SHELL if line.startswith("brdf ")]
    assert len(lines) >= 7
    for line in lines:
        done = subprocess.run(
            line, shell=True, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    assert (folder / "again.bsdf").read_bytes() == (folder / "paint.bsdf").read_bytes()


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """`brdf serve`, as the first command ends, on an empty data folder and a free port."""
    server = subprocess.Popen(
        ["brdf", "serve", "--port", "0", "--data", str(tmp_path / "data")],
        cwd=tmp_path,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert server.stdout is not None
        said = []
        until = time.monotonic() + 120
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


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_curl_examples(address: str, tmp_path: Path) -> None:
    lines = [line for line in SHELL if line.startswith("curl ")]
    assert len(lines) >= 8
    (tmp_path / "paint.bsdf").write_bytes(encode(fields_of()))
    for line in lines:
        command = line.replace("http://127.0.0.1:8000", address).replace("curl -s", "curl -sS --fail-with-body")
        done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    assert b"<svg" in (tmp_path / "slice.svg").read_bytes()


def test_client_example(address: str, tmp_path: Path) -> None:
    (source,) = [block for kind, block in BLOCKS if kind == "python" and "Client" in block]
    source = source.replace("http://127.0.0.1:8000", address)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", source], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "gold-satin" in done.stdout


def test_two_commands_and_nothing_else_to_set_up() -> None:
    commands = [line for line in SHELL if "-m venv" in line]
    assert len(commands) == 2
    assert commands[0].endswith("brdf serve")
    assert commands[1].endswith("-m pytest")


def test_pictures_and_files_named_here_exist() -> None:
    for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT) + re.findall(r"`(brdfcore/[\w/]+\.py)`", TEXT):
        assert (ROOT / target).exists(), target
