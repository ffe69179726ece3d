"""The shell: `brdf export`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import brdfcore as bc
from tests.brdfcore.conftest import Run


@pytest.fixture
def white(tmp_path: Path) -> Path:
    path = tmp_path / "white.h5"
    bc.tabulate(bc.model("lambert", reflectance=0.5), "angle_grid", shape=(3, 3, 3)).save(path)
    return path


def test_export_writes_a_shader_and_its_nodes(run: Run, white: Path, tmp_path: Path) -> None:
    code, text, _ = run("export", white, tmp_path / "white.glsl", "--name", "paper")
    assert code == 0
    assert "white.glsl" in text
    assert "white.safetensors" in text
    assert "vec3 paper_f(vec3 wi, vec3 wo)" in (tmp_path / "white.glsl").read_text()
    assert (tmp_path / "white.safetensors").read_bytes() == bc.array_bytes(bc.open_table(white))
    code, text, _ = run("export", white, tmp_path / "white.wgsl", "--group", "1", "--json")  # the same nodes
    assert code == 0
    assert [Path(f["file"]).name for f in json.loads(text)["files"]] == ["white.wgsl", "white.safetensors"]


def test_export_replaces_nothing_unasked(run: Run, white: Path, tmp_path: Path) -> None:
    kept = tmp_path / "a.safetensors"
    kept.write_bytes(b"kept")
    code, _, err = run("export", white, tmp_path / "a.glsl")
    assert code == 1
    assert "--force" in err
    assert kept.read_bytes() == b"kept"
    assert not (tmp_path / "a.glsl").exists()
    assert run("export", white, tmp_path / "a.glsl", "--force")[0] == 0
    assert kept.read_bytes() != b"kept"


def test_export_says_what_is_wrong(run: Run, white: Path, tmp_path: Path) -> None:
    code, _, err = run("export", white, tmp_path / "a.hlsl")
    assert code == 2
    assert ".glsl, .wgsl, .safetensors" in err
    code, _, err = run("export", "lambert", tmp_path / "a.glsl")
    assert code == 2
    assert "tabulate" in err
