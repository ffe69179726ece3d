"""Shaders and the file of their nodes: layout, what is refused, and, in Chromium, the table's own answers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.out.shader import shader_text
from tests.support import chromium
from tests.support.exported import MADE, SHADERS, table, vectors
from tests.support.tiers import first_fast

needs_browser = pytest.mark.skipif(chromium.BROWSER is None, reason="no Chromium is installed")
#: Of max(f, 1 % of its mean), by representation.
FAR = {"half_difference": 1e-4, "lobe_grid": 1e-4, "angle_grid": 1e-3}


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize("language", ["glsl", "wgsl"])
@pytest.mark.parametrize("name", SHADERS)
def test_in_chromium(name: str, language: str) -> None:
    """100,000 float32 vectors read back, against `evaluate_vectors` of the same; exactly 0 below the horizon."""
    t, (wi, wo) = table(name), vectors(100_000, 3, np.float32)
    found = chromium.run(language, "gold", shader_text(t, language, "gold", "gold"), bc.array_bytes(t), wi, wo)
    # float32 vectors of any length mean the same
    expected = np.broadcast_to(t.evaluate_vectors(wi.astype(np.float64), wo.astype(np.float64)), found.shape)
    below = (wi[:, 2] <= 0) | (wo[:, 2] <= 0)
    assert (found[below] == 0).all()
    far = np.abs(found - expected) / np.maximum(np.abs(expected), 0.01 * np.abs(expected).mean())
    if "nearest" in name:  # halfway between two nodes either is right
        assert np.mean(far > 1e-6) < 1e-4
    else:
        # a source of both signs is 0 between nodes that are not: their rounding is all that is left there
        assert far.max() <= (FAR[t.name] if t.non_negative else 3e-4)


def held(data: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Metadata and arrays of a safetensors file, as its specification reads."""
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    metadata, end, arrays = header.pop("__metadata__"), 0, {}
    for name, told in header.items():
        first, last = told["data_offsets"]
        assert first == end
        end = last
        kind = {"F32": "<f4", "I32": "<i4"}[told["dtype"]]
        arrays[name] = np.frombuffer(data[8 + size + first : 8 + size + last], kind).reshape(told["shape"])
    assert len(data) == 8 + size + end
    assert (8 + size) % 64 == 0
    assert end % (4 * 2048) == 0
    return metadata, arrays


@pytest.mark.parametrize("name", first_fast("half_difference", *(n for n in MADE if n != "half_difference")))
def test_the_file_of_the_nodes(name: str) -> None:
    t = table(name)
    metadata, arrays = held(bc.array_bytes(t))
    assert metadata["id"] == t.id
    assert metadata["representation"] == t.name
    assert json.loads(metadata["channels"]) == t.channels.to_json()
    nodes = bc.array_function(t).nodes
    assert list(arrays) == [*nodes, "padding"]
    for key, array in nodes.items():
        assert np.array_equal(arrays[key], array.astype(arrays[key].dtype)), key
    if name == "half_difference":
        assert {"lobe": False, "centre": 0, "bilateral": True, "reciprocal": True}.items() <= json.loads(
            metadata["settings"]
        ).items()


def test_other_programs_read_it() -> None:
    safetensors = pytest.importorskip("safetensors.numpy", reason="safetensors is not installed")
    t = table("vndf_warp")
    arrays = safetensors.load(bc.array_bytes(t))
    assert np.array_equal(arrays["spectra"], t.to_arrays()["spectra"])


def test_export_writes_both_files(tmp_path: Path) -> None:
    t = table("angle_grid")
    for name, function in (("gold.glsl", "vec3 gold_f(vec3 wi, vec3 wo) {"), ("2 b.wgsl", "fn brdf_2_b_f(wi: vec3f")):
        files = bc.export(t, tmp_path / name)
        assert [f.name for f in files] == [name, f"{name[:-5]}.safetensors"]
        assert function in files[0].read_text()
        assert t.id in files[0].read_text()
        assert files[1].read_bytes() == bc.array_bytes(t)
    assert bc.export(t, tmp_path / "a.safetensors") == [tmp_path / "a.safetensors"]
    text = bc.export(t, tmp_path / "c.wgsl", name="metal", group=2, binding=3)[0].read_text()
    assert "@group(2) @binding(3) var<storage, read> metal_nodes" in text


def test_names_of_two_materials_do_not_meet() -> None:
    """Everything global carries the material's name."""
    for language in ("glsl", "wgsl"):
        for name in SHADERS:
            text = shader_text(table(name), language, "a", "a")
            for line in text.splitlines():
                word = line.replace("(", " ").replace(":", " ").split()
                if word[:1] and word[0] in ("const", "fn", "uniform", "vec3", "float", "int") and line[0] != " ":
                    assert any(w.startswith("a_") for w in word[1:4]), line


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (lambda: bc.export(bc.model("lambert", reflectance=0.5), "a.glsl"), "not_a_table"),
        (lambda: bc.export(table("angle_grid"), "a.hlsl"), "unknown_shader"),
        (lambda: bc.export(table("angle_grid"), "a.glsl", name="1"), "bad_name"),
        (lambda: bc.export(table("angle_grid"), "a.glsl", name="a__b"), "bad_name"),
        (lambda: bc.export(table("vndf_warp"), "a.glsl"), "no_shader"),
        (
            lambda: bc.export(
                bc.tabulate(bc.model("lambert", reflectance=[0.1, 0.2]), "angle_grid", shape=(3, 3, 3)), "a.glsl"
            ),
            "bad_channels",
        ),
    ],
)
def test_what_is_refused(wrong: Callable[[], object], code: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(bc.InputError) as caught:
        wrong()
    assert caught.value.code == code
    assert not list(tmp_path.iterdir())
