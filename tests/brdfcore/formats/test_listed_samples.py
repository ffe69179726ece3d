"""pbrt-v2, BiRD and TracePro: lists of samples against what they were made from, their conventions, refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.errors import FileFormatError
from brdfcore.formats import bird, pbrt, tracepro
from tests.shared import FOLDER, needs_shared
from tests.support.format_examples import bird_text, pbrt_text, samples, tracepro_text

CASE = FOLDER / "cases" / "bird.brdf"


def put(folder: Path, text: str, name: str = "made.brdf") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def check_rows(found: Any, factors: tuple[float, ...]) -> None:
    """The geometries and values of `samples`, in any order, a channel a factor."""
    assert len(found) == len(samples())
    by_place = {
        tuple(np.round([a, b, np.cos(c)], 6)): v
        for a, b, c, v in zip(found.theta_i, found.theta_o, found.delta_phi, found.values, strict=True)
    }
    for theta_i, phi_i, theta_o, phi_o, f in samples():
        turn = np.radians(phi_o - phi_i) if theta_o else 0.0
        values = by_place[tuple(np.round([*np.radians([theta_i, theta_o]), np.cos(turn)], 6))]
        assert values == pytest.approx(f * np.array(factors), rel=1e-12)


def test_pbrt_samples(tmp_path: Path) -> None:
    path = put(tmp_path, pbrt_text())
    assert bc.sniff(path) == "pbrt"
    found = pbrt.measurements_of(path)
    check_rows(found, (1.0, 2.0, 3.0))
    assert list(found.channels) == [450.0, 550.0, 650.0]
    b = bc.read(path)
    row = samples()[7]
    got = b.evaluate(*np.radians([row[0], row[2], row[3] - row[1]]))
    assert got == pytest.approx(row[4] * np.array([1, 2, 3]), rel=0.02)


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("radians", [False, True])
def test_bird_points(version: int, radians: bool, tmp_path: Path) -> None:
    path = put(tmp_path, bird_text(version, radians=radians))
    assert bc.sniff(path) == "bird", "a lamp's model makes no model file of it"
    found = bird.measurements_of(path)
    check_rows(found, (1.0, 650 / 450))
    assert list(found.channels) == [450.0, 650.0]
    assert "the uncertainty uBRDF is left out" in found.done


def test_bird_points_that_differ_in_something_else_are_repeats(tmp_path: Path) -> None:
    content = json.loads(bird_text(waves=(550.0,)))
    data = content["data"]
    for name in data:
        data[name]["values"] = data[name]["values"] * 2
    count = len(data["BRDF"]["values"])
    stokes = [[1, 1, 0, 0]] * (count // 2) + [[1, -1, 0, 0]] * (count // 2)
    data["polarization_i"] = {"notation": "inStokes", "values": stokes}
    data["BRDF"]["values"][count // 2 :] = [3 * v for v in data["BRDF"]["values"][count // 2 :]]
    found = bird.measurements_of(put(tmp_path, json.dumps(content)))
    assert any("polarization_i only are averaged" in s for s in found.done)
    b = bc.read(tmp_path / "made.brdf")
    assert b.report["counts"]["repeated geometries"] == len(samples())
    row = samples()[7]
    assert b.evaluate(*np.radians([row[0], row[2], row[3] - row[1]])) == pytest.approx(2 * row[4] * 550 / 450, rel=0.05)


@needs_shared
def test_the_case_is_no_model_file() -> None:
    assert bc.sniff(CASE) == "bird"
    with pytest.raises(FileFormatError, match=r"bird\.brdf: data.values: nothing"):
        bc.read(CASE)


@pytest.mark.parametrize("outwards", [1.0, -1.0])
def test_tracepro_tables(outwards: float, tmp_path: Path) -> None:
    path = put(tmp_path, tracepro_text((0.55, 0.65), outwards), "made.txt")
    assert bc.sniff(path) == "tracepro"
    found = tracepro.measurements_of(path, "horizon" if outwards > 0 else "normal")
    assert list(found.channels) == [550.0, 650.0]
    b = bc.model("ggx", roughness=0.5)
    expected = b.evaluate(found.theta_i, found.theta_o, found.delta_phi)[:, 0]
    away = found.theta_o < np.radians(89)
    assert found.values[away, 0] == pytest.approx(expected[away], rel=1e-5)
    assert found.values[:, 1] == pytest.approx(found.values[:, 0] * 0.65 / 0.55, rel=1e-12)
    assert any("beyond the horizon and are padding" in s for s in found.done)
    mirror = np.isclose(found.theta_i, np.radians(60)) & np.isclose(found.theta_o, found.theta_i)
    assert (np.abs(found.delta_phi[mirror]) > 3.1).any()


PBRT = [("3\n", "3.5\n", "whole number"), ("3\n", "99999\n", "whole number"), ("450.0 ", "450.0 1 ", "a multiple of 7"),
        ("450.0 ", "45000.0 ", "wavelengths"), ("450.0 550.0", "450.0 450.0", "wavelengths"),
        ("650.0\n", "650.0\nx ", "multiple")]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), PBRT)
def test_wrong_pbrt_files(old: str, new: str, said: str, tmp_path: Path) -> None:
    text = pbrt_text()
    assert old in text
    with pytest.raises(FileFormatError, match=said) as caught:
        bc.read(put(tmp_path, text.replace(old, new, 1)), format="pbrt")
    assert "made.brdf" in caught.value.detail


BIRD = [("{", "[", "JSON"), ('"BRDF": {', '"BRDFX": {', "BRDF"), ('"deg"', '"turns"', "unit"),
        ('"nm"', '"miles"', "unit"), ('"sr^-1"', '"percent"', "BRDF.unit"), ("450.0,", "450.0, 1,", "as BRDF has"),
        ('"data"', '"date"', "data")]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), BIRD)
def test_wrong_bird_files(old: str, new: str, said: str, tmp_path: Path) -> None:
    text = bird_text()
    assert old in text
    with pytest.raises(FileFormatError, match=said) as caught:
        bc.read(put(tmp_path, text.replace(old, new, 1)), format="bird")
    assert "made.brdf" in caught.value.detail


TRACEPRO = [("Table_BSDF_Data", "Table_Nothing", "Table_BSDF_Data"), ("IncAngle", "Angle", "IncAngle"),
            ("\t60.0\t0\t", "\t95.0\t0\t", "IncAngle"), ("\t0.1\t", "\t3\t", "beta"), ("\t0.1\t", "\tx\t", "no number"),
            ("\t0.1\t", "\t0.1\t0.1\t", "row"), ("0.55\t30.0", "nan\t30.0", "Wavelength")]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), TRACEPRO)
def test_wrong_tracepro_files(old: str, new: str, said: str, tmp_path: Path) -> None:
    text = tracepro_text()
    assert old in text
    with pytest.raises(FileFormatError, match=said) as caught:
        bc.read(put(tmp_path, text.replace(old, new, 1), "made.txt"), format="tracepro")
    assert "made.txt" in caught.value.detail
    assert "line" in caught.value.context
