"""What a scene needs: chosen by the budget, shared where equal, limited to what is seen, and built as said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.analysis.plan.build import MANIFEST, build
from brdfcore.analysis.plan.plan import MERL_BYTES, Plan, decide
from brdfcore.analysis.plan.scene import Selected, read_scene
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.base.status import Status
from tests.brdfcore.analysis.test_pareto import entry
from tests.brdfcore.conftest import Run
from tests.support.sources import Skewed

FEW: dict[str, Any] = {
    "sizes": (8_000, 32_000),
    "directions": 10_000,
    "representations": ("angle_grid", "half_difference"),
}
SATIN = {"model": "cook_torrance", "parameters": {"roughness": 0.3, "diffuse": [0.5, 0.2, 0.1], "specular": 0.4}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table of three channels, as a measured file would be."""
    place = tmp_path_factory.mktemp("scene")
    source = bc.model("cook_torrance", roughness=0.4, diffuse=[0.5, 0.2, 0.1], specular=0.4, ior="glass")
    bc.tabulate(source, "angle_grid", shape=(46, 46, 91)).save(place / "paint.h5")
    return place


@pytest.fixture(scope="module")
def scene(folder: Path) -> dict[str, Any]:
    file = str(folder / "paint.h5")
    return {
        "budget": {"error": 0.02, "bytes": 5e6},
        "materials": [
            {"name": "wall", "model": "lambert", "parameters": {"reflectance": 0.8}},
            {"name": "satin", **SATIN},
            {"name": "satin-too", **SATIN, "lighting": "environment"},
            {"name": "mirror", "model": "mirror", "parameters": {"ior": "silver"}},
            {"name": "car", "file": file, "light": [0, 60], "view": [0, 70], "channels": ["G"]},
        ],
    }


@pytest.fixture(scope="module")
def planned(scene: dict[str, Any]) -> Plan:
    return bc.plan(scene, **FEW)


@pytest.mark.slow
def test_formulas_stay_formulas_and_equals_are_shared(planned: Plan) -> None:
    by_name = {name: c for c in planned.choices for name in c.names}
    assert [c.names for c in planned.choices] == [["wall"], ["satin", "satin-too"], ["mirror"], ["car"]]
    for name in ("wall", "satin", "mirror"):
        assert by_name[name].entry.kind == "model", name
        assert by_name[name].entry.nbytes == 0
    assert by_name["car"].entry.kind == "table"
    assert planned.problems == []
    assert planned.naive_bytes == 5 * MERL_BYTES
    assert planned.nbytes == by_name["car"].entry.nbytes < 0.05 * planned.naive_bytes
    assert planned.to_json()["total"]["share_of_naive"] == planned.nbytes / planned.naive_bytes


@pytest.mark.slow
def test_a_plan_agrees_with_tabulate(folder: Path) -> None:
    """For one table and no limit of bytes: the same error, in no more bytes (a plan weighs them more than time)."""
    file = folder / "paint.h5"
    scene = {"budget": {"error": 0.02}, "materials": [{"name": "car", "file": str(file)}]}
    found = bc.plan(scene, sizes=(16_000,), directions=5_000).choices[0].entry
    table = bc.tabulate(bc.read(file), tolerance=0.02)
    assert found.representation == table.name
    assert found.error <= 0.02
    assert found.nbytes is not None
    assert found.nbytes <= table.nbytes


def test_only_what_is_seen_is_stored_and_measured(planned: Plan, folder: Path) -> None:
    car = planned.choices[-1]
    assert list(car.source.channels) == ["G"]
    assert isinstance(car.entry.brdf, bc.Table)
    assert list(car.entry.brdf.channels) == ["G"]
    whole = bc.read(folder / "paint.h5")
    seen = bc.compare(Selected(whole, [1]), car.entry.brdf, light=car.light, view=car.view, seed=77, directions=100_000)
    assert seen.l1 <= 1.1 * 0.02


def test_a_table_for_what_is_seen_says_where_it_ends(planned: Plan) -> None:
    table = planned.choices[-1].entry.brdf
    assert isinstance(table, bc.Table)
    if table.name == "half_difference":
        assert table.attributes()["light"] == list(planned.choices[-1].light)
        assert table.status(np.radians(30.0), np.radians(80.0), 0.0) == Status.EXTRAPOLATED
    assert table.error["view"] == list(planned.choices[-1].view)  # what the error speaks of


@pytest.mark.slow
def test_what_can_not_win_is_not_built() -> None:
    """Past the smallest that is right and quick enough, only what could be so much faster as to rule it out."""
    scene = {"budget": {"error": 0.01, "ns": 1000}, "materials": [{"name": "satin", **SATIN}]}
    found = bc.plan(scene, sizes=tuple(2_000 * 2**k for k in range(10)), directions=20_000)
    (choice,) = found.choices
    assert choice.entry.nbytes == 0
    tables = [e for e, _ in choice.alternatives if e.kind == "table"]
    assert tables
    assert all(e.nbytes <= 8_000 for e in tables)


@pytest.mark.slow
def test_the_smallest_is_looked_for_between_sizes(folder: Path) -> None:
    car = {"name": "car", "file": str(folder / "paint.h5"), "error": 0.02}
    found = bc.plan(
        {"materials": [car]}, sizes=(4_000, 64_000), directions=20_000, representations=("half_difference",)
    )
    (choice,) = found.choices
    assert choice.met
    assert choice.entry.nbytes < 64_000 / 2**0.5


def test_every_choice_says_what_it_beat(planned: Plan) -> None:
    for choice in planned.choices:
        assert choice.reason
        assert choice.alternatives
        for other, why in choice.alternatives:
            assert other is not choice.entry
            assert why
            if why == "larger":
                assert other.nbytes > choice.entry.nbytes
            if why == "not right enough":
                assert not other.meets(choice.tolerance)
    json.dumps(planned.to_json(), allow_nan=False)


def test_what_is_built_is_what_was_planned(planned: Plan, tmp_path: Path) -> None:
    (tmp_path / "wall.h5").write_bytes(b"from another plan")
    manifest = build(planned, tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["car.h5", "mirror.json", MANIFEST, "satin.json", "wall.json"]
    assert json.loads((tmp_path / MANIFEST).read_text()) == json.loads(json.dumps(manifest))
    assert manifest["names"]["satin-too"] == "satin.json"
    for told, choice in zip(manifest["materials"], planned.choices):
        b = bc.read(tmp_path / told["file"])
        drawn = np.random.default_rng(5).uniform(0, 1, (3, 2_000))  # radians: within what is seen
        f, g = choice.source.evaluate(*drawn), b.evaluate(*drawn)
        assert np.abs(g - f).sum() <= 0.03 * f.sum() + 1e-12
        assert told["verified"]["error"] <= 1.2 * choice.tolerance
        assert (told["verified"]["l1"] or 0.0) <= told["verified"]["error"] + 1e-9


def test_the_service_takes_the_folder(planned: Plan, tmp_path: Path) -> None:
    from brdf_service.library.folder import Folder
    from brdf_service.library.materials import Library

    build(planned, tmp_path)
    library = Library(Folder(tmp_path), 10**9)
    page = library.page(0, 100)
    assert page.total == 4
    assert all(line.usable for line in page.lines)
    assert page.skipped == []


def test_an_environment_takes_harmonics_and_lamps_do_not() -> None:
    class Found:
        tolerance = 0.01
        source = bc.model("ggx")

    found: Any = Found()
    found.entries = [entry("ggx", 0, 1e-7, 3.0, "model"), entry("harmonic", 9_000, 0.005, 8.0)]
    assert decide(found, None, True)[0].label == "harmonic"
    assert decide(found, None, False)[0].label == "ggx"
    found.source = bc.model("lambert")
    assert decide(found, None, True)[0].label == "ggx"
    found.entries[1] = entry("harmonic", 10_000_000, 0.005, 8.0)
    found.source = bc.model("ggx")
    assert decide(found, None, True)[0].label == "ggx"


def test_time_and_bytes_decide() -> None:
    class Found:
        tolerance = 0.01
        source = bc.model("ggx")

    found: Any = Found()
    found.entries = [
        entry("formula", 0, 0.0, 100.0, "model"),
        entry("small", 8_000, 0.009, 8.0),
        entry("quick", 90_000, 0.009, 4.0),
        entry("wrong", 10, 0.5, 1.0),
    ]
    assert decide(found, None, False)[0].label == "small"  # the formula is more than 4 times slower
    assert decide(found, 5.0, False)[0].label == "quick"
    assert decide(found, 500.0, False)[0].label == "formula"
    assert decide(found, 1.0, False)[::2] == (found.entries[2], False)
    found.tolerance = 1e-9
    found.entries = found.entries[1:]
    assert decide(found, None, False)[::2] == (found.entries[0], False)


def test_a_budget_that_is_not_met_is_said(scene: dict[str, Any]) -> None:
    car = {**scene["materials"][-1], "error": 1e-7}
    found = bc.plan({"budget": {"bytes": 10}, "materials": [car]}, **{**FEW, "sizes": (8_000,)})
    assert not found.choices[0].met or found.choices[0].entry.error <= 1e-7
    assert any("budget is 10" in text for text in found.problems)
    assert found.to_json()["met"] is False


def test_selected_channels() -> None:
    part = Selected(Skewed(), [2, 0])
    angles = np.array([0.3]), np.array([0.4]), np.array([0.5])
    assert part.evaluate(*angles).tolist() == [Skewed().evaluate(*angles)[0, [2, 0]].tolist()]
    assert list(part.channels) == ["B", "R"]


WALL = {"name": "wall", "model": "lambert"}


@pytest.mark.parametrize(
    ("given", "where"),
    [
        ([], "scene"),
        ({"materials": []}, "materials"),
        ({"materials": [WALL], "colour": 1}, "scene.colour"),
        ({"materials": [WALL], "angles": "grad"}, "angles"),
        ({"materials": [WALL], "budget": {"error": 0}}, "budget.error"),
        ({"materials": [WALL], "budget": {"bytes": float("nan")}}, "budget.bytes"),
        ({"materials": [WALL], "budget": {"ns": True}}, "budget.ns"),
        ({"materials": [WALL], "budget": {"speed": 1}}, "budget.speed"),
        ({"materials": [WALL, WALL]}, "materials[1].name"),
        ({"materials": ["wall"]}, "materials[0]"),
        ({"materials": [{"model": "lambert"}]}, "materials[0].name"),
        ({"materials": [{**WALL, "name": "../wall"}]}, "materials[0].name"),
        ({"materials": [{"name": "wall"}]}, "materials[0]"),
        ({"materials": [{**WALL, "file": "x.h5"}]}, "materials[0]"),
        ({"materials": [{**WALL, "view": [60, 30]}]}, "materials[0].view"),
        ({"materials": [{**WALL, "light": [0, 100]}]}, "materials[0].light"),
        ({"materials": [{**WALL, "light": "all"}]}, "materials[0].light"),
        ({"materials": [{**WALL, "light": [0, float("nan")]}]}, "materials[0].light"),
        ({"materials": [{**WALL, "lighting": "sun"}]}, "materials[0].lighting"),
        ({"materials": [{**WALL, "channels": ["R"]}]}, "materials[0].channels"),
        ({"materials": [{**WALL, "channels": []}]}, "materials[0].channels"),
        ({"materials": [{**WALL, "error": -1}]}, "materials[0].error"),
        ({"materials": [{**WALL, "parameters": [1]}]}, "materials[0].parameters"),
        ({"materials": [{**WALL, "parameters": {"name": "x"}}]}, "materials[0].parameters"),
    ],
)  # fmt: skip
def test_scenes_that_cannot_be(given: Any, where: str) -> None:
    with pytest.raises(bc.InputError) as caught:
        read_scene(given)
    assert caught.value.context["where"] == where
    assert where in caught.value.detail
    assert "expected" in caught.value.detail


@pytest.mark.parametrize(
    ("material", "error"),
    [
        ({"name": "a", "model": "lamber"}, bc.UnknownNameError),
        ({"name": "a", "model": "lambert", "parameters": {"reflectance": 2}}, bc.InputError),
        ({"name": "a", "model": "lambert", "parameters": {"gloss": 2}}, bc.UnknownNameError),
        ({"name": "a", "file": "gone.bsdf"}, bc.StorageError),
    ],
)
def test_a_material_that_cannot_be_read_says_which(material: Any, error: type[bc.BrdfError]) -> None:
    with pytest.raises(error) as caught:
        read_scene({"materials": [WALL, material]})
    assert caught.value.detail.startswith("materials[1]: ")
    assert str(caught.value).startswith("materials[1]: ")


def test_angles_in_either_unit() -> None:
    degrees = read_scene({"materials": [{**WALL, "light": [10, 80], "view": [0, 90]}]}).materials[0]
    radians = read_scene(
        {"angles": "rad", "materials": [{**WALL, "light": [np.radians(10), np.radians(80)], "view": [0, np.pi / 2]}]}
    ).materials[0]
    assert degrees.light == pytest.approx(radians.light)
    assert degrees.view == radians.view
    assert degrees.view[1] > np.float64(np.float32(np.pi / 2))


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"materials": [}', "\x00"])
def test_scene_files_that_are_none(text: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(text)
    with pytest.raises(bc.FileFormatError, match="not JSON"):
        read_scene(path)


def test_command_line(run: Run, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(REPRESENTATIONS, "names", lambda: FEW["representations"])
    content = {"materials": [WALL, {"name": "car", "file": "paint.h5", "error": 0.05, "channels": ["R"]}]}
    (folder / "scene.json").write_text(json.dumps(content))
    code, text, err = run("plan", folder / "scene.json", "--build", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "2 materials" in text
    assert "a MERL table each" in text
    assert (tmp_path / "out" / "wall.json").exists()
    code, _, err = run("plan", tmp_path / "none.json", "--json")
    assert (code, json.loads(err)["error"]["code"]) == (1, "cannot_open")
