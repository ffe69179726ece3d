"""`brdf check`, `brdf gloss`, `brdf albedo`, `brdf repair`, `brdf fit`: pages, JSON, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import brdfcore as bc
from tests.brdfcore.conftest import Run

PUBLISHED = "phong:exponent=10,convention=published"


def test_check_prints_a_page(run: Run) -> None:
    status, out, err = run("check", "lambert:reflectance=0.5", "--directions", "2000")
    assert (status, err) == (0, "")
    assert out.splitlines()[1].startswith("6 pass")
    status, out, err = run("check", PUBLISHED, "--directions", "2000")
    assert (status, err) == (3, "")
    assert "energy       fail" in out
    assert "(89.9) value: albedo 37." in out


def test_check_as_json(run: Run) -> None:
    status, out, err = run("check", PUBLISHED, "--directions", "2000", "--seed", "5", "--json")
    found = json.loads(out)
    assert (status, err, found["input"], found["seed"]) == (3, "", PUBLISHED, 5)
    here = bc.check(bc.model("phong", exponent=10, convention="published"), directions=2000, seed=5)
    assert {k: v for k, v in found.items() if k != "input"} == json.loads(json.dumps(here.to_json()))


def test_gloss_prints_a_page(run: Run) -> None:
    status, out, err = run("gloss", "mirror:ior=1.5168")
    assert (status, err) == (0, "")
    for row in ("gloss 20 deg", "86.47", "91.91", "99.27", "haze D4039", "haze E430", "ISO 2813"):
        assert row in out
    status, out, err = run("gloss", "lambert:reflectance=[1,0.5,0]", "--collimated", "--tolerance", "0.001")
    row = next(line for line in out.splitlines() if line.startswith("gloss 60"))
    assert row.split()[3:7] == ["2.485", "1.242", "0", "1.417"]


def test_gloss_as_json(run: Run) -> None:
    status, out, _ = run(
        "gloss", "mirror:ior=1.5168", "--geometry", "45:0.75,2.5:2,4", "--geometry", "60:0,0:4,4", "--json"
    )
    found = json.loads(out)
    assert status == 0
    assert list(found["gloss"]) == ["45", "60"]
    assert found["gloss"]["45"]["geometry"]["receptor"] == [2, 4]
    assert found["haze"] == {}
    assert found["gloss"]["60"]["values"][0] == pytest.approx(91.91, abs=0.01)


def test_albedo_prints_the_digits_that_are_known(run: Run, gold_table: Path) -> None:
    status, out, err = run("albedo", "lambert:reflectance=[0.5,0.25,0.125]", "--theta-i", "0")
    assert (status, err) == (0, "")
    assert out.splitlines()[2].split()[:5] == ["theta_i,", "deg", "R", "G", "B"]
    assert [float(x) for x in out.splitlines()[3].split()[:4]] == [0, 0.5, 0.25, 0.125]
    status, out, err = run("albedo", gold_table, "--theta-i", "0.5", "--angles", "rad")
    _, text, _, error = (line := out.splitlines()[-1]).split()
    value, off = (x[0, 0] for x in bc.open_table(gold_table).albedo_error([0.5], tolerance=None))
    assert (status, err) == (0, "")
    assert off > 1e-9, line
    # rounding costs less than the error, and no digit says more than a tenth of it
    assert abs(float(text) - value) <= off
    assert 10.0 ** -len(text.partition(".")[2]) > off / 10
    assert float(error) == pytest.approx(off, rel=0.5)


def test_albedo_counts_the_mirror_part(run: Run) -> None:
    status, out, _ = run("albedo", "mirror:ior=1.5", "--theta-i", "0,60", "--json")
    found = json.loads(out)
    here = bc.model("mirror", ior=1.5)
    theta = bc.to_radians([0.0, 60.0])
    assert status == 0
    assert found["values"] == here.albedo(theta).tolist() == found["delta_reflectance"]
    assert (found["theta_i"], found["angles"], found["channels"], found["has_delta"]) == (
        [0, 60],
        "deg",
        ["value"],
        True,
    )
    assert found["values"][0][0] == pytest.approx(0.04)
    assert len(found["error"]) == 2
    status, out, _ = run("albedo", "mirror:ior=1.5", "--theta-i", "0")
    assert out.splitlines()[-1].split() == ["0", "0.040000000"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("albedo", "lambert", "--theta-i", "95"),
        ("albedo", "lambert", "--theta-i", "nan"),
        ("albedo", "lambert", "--theta-i", "x"),
        ("albedo", "lambert", "--theta-i", ",".join(["1"] * 1001)),
        ("albedo", "lambert", "--angles", "gon"),
        ("gloss", "lambert", "--geometry", "45"),
        ("gloss", "lambert", "--geometry", "45:1,2:3,x"),
        ("gloss", "lambert", "--geometry", "4,5:1,2:3,4"),
        ("gloss", "lambert", "--geometry", "45:1:3,4"),
        ("gloss", "lambert", "--geometry", "95:1,1:3,4"),
        ("gloss", "lambert", "--geometry", "45:1,1:nan,4"),
        ("gloss", "lambert", "--tolerance", "-1"),
        ("gloss", "lambert", "--reference-ior", "nan"),
        ("check", "lambert", "--directions", "0"),
        ("check", "lambert", "--seed", "-1"),
        ("check", "lambertt"),
        ("repair", "lambert", "-o", "x.h5", "--do", "everything"),
        ("repair", "lambert", "-o", "x.h5", "--do", ""),
        ("repair", "lambert", "-o", "x.h5"),
    ],
    ids=lambda words: " ".join(words)[:60],
)
def test_mistakes_are_told(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_repair_makes_a_table(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "phong.h5"
    small = ("--representation", "angle_grid", "--tolerance", "0.05")
    status, text, _ = run("repair", PUBLISHED, "-o", out, "--do", "reciprocity, energy", *small)
    assert status == 0
    assert "reciprocity: average f(i,o) and f(o,i)" in text
    assert "largest albedo   18.732 before" in text
    table = bc.open_table(out)
    assert [e["name"] for e in table.report["repairs"]] == ["reciprocity", "energy"]
    assert table.reciprocal
    status, text, err = run("repair", PUBLISHED, "-o", out, "--do", "energy")
    assert (status, text) == (1, "")
    assert "--force" in err
    status, text, _ = run("repair", PUBLISHED, "-o", out, "--do", "negatives", "--force", "--json", *small)
    found = json.loads(text)
    assert [e["name"] for e in found["repairs"]] == ["negatives"]
    assert found["id"] == bc.open_table(out).id != table.id


def test_fit_writes_a_model(run: Run, tmp_path: Path) -> None:
    source, out_file = "ggx:roughness=0.2,diffuse=0.1,specular=0.5,ior=1.5", tmp_path / "fit.json"
    status, out, err = run("fit", source, "--model", "ggx", "--lobes", "1", "-o", str(out_file))
    assert (status, err) == (0, "")
    assert "roughness" in out
    assert bc.read(out_file).metadata["parameters"]["ior"] == pytest.approx(1.5)
    status, out, err = run("fit", source, "--model", "ggx", "--lobes", "1", "--json")
    assert json.loads(out)["terms"][0]["model"] == "ggx"
    status, out, err = run("fit", source, "--lobes", "many")
    assert status == 2
    assert "expected auto, or 0 to 3" in err
