"""ALTA text: the real retro-reflector against a plain parser, every parametrisation, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.errors import FileFormatError
from brdfcore.formats.alta import PARAMETRISATIONS, SLICES, measurements_of
from tests.shared import FOLDER, needs_shared
from tests.support.format_examples import alta_text
from tests.support.plain_alta import coordinates, plain_alta

RETRO = FOLDER / "data" / "alta" / "retro-3M-jaune.dat"
CASE = FOLDER / "cases" / "alta.dat"


def put(folder: Path, text: str) -> Path:
    path = folder / "made.dat"
    path.write_text(text)
    return path


@needs_shared
@pytest.mark.parametrize("path", [RETRO, CASE], ids=lambda p: p.stem)
def test_the_real_files_row_by_row(path: Path) -> None:
    found = measurements_of(path)
    expected = np.array(plain_alta(path))
    assert len(found) == len(expected)
    pole = (found.theta_i < 1e-4) | (found.theta_o < 1e-4)
    assert np.abs(found.theta_i - expected[:, 0]).max() == 0
    assert np.abs(found.theta_o - expected[:, 1]).max() <= 1e-15
    assert np.abs(np.cos(found.delta_phi) - np.cos(expected[:, 2]))[~pole].max() <= 1e-12
    assert np.abs(found.values[:, 0] - expected[:, 3]).max() <= 1e-12 * expected[:, 3].max()


@needs_shared
def test_the_retro_reflector_has_its_two_lobes() -> None:
    """Broad about the light, at delta_phi 0; narrow, of its clear coat, about the mirror direction."""
    found = measurements_of(RETRO)
    assert "86 rows at theta_o = 90 degrees left out" in found.done[0]
    assert len(found) == 7_397 - 86
    at = np.abs(found.theta_i - np.radians(60)) < 1e-6
    off = np.degrees(found.theta_o[at]) - 60
    for side, peak, aside in ((1, 10.0, 3.0), (-1, 25.0, 0.0)):
        there = np.cos(found.delta_phi[at]) * side > 0.999
        values = found.values[at, 0]
        assert values[there & (np.abs(off) < 1.2)].max() > peak
        shoulder = values[there & (off > 3.5) & (off < 5.5)]
        assert shoulder.min() > aside
        assert side > 0 or shoulder.max() < 1


@needs_shared
def test_the_case_is_read_by_its_own_header() -> None:
    assert bc.sniff(CASE) == "alta"
    b = bc.read(CASE)
    rows = np.array(plain_alta(CASE))
    keys, group = np.unique(np.round(rows[:, :3], 9), axis=0, return_inverse=True)
    means = np.bincount(group.reshape(-1), rows[:, 3]) / np.bincount(group.reshape(-1))
    assert b.evaluate(*keys.T)[:, 0] == pytest.approx(means, rel=2e-3)


@pytest.mark.parametrize("name", PARAMETRISATIONS)
def test_every_parametrisation(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    theta_i, theta_o, delta_phi = rng.uniform(0.05, 1.4, 40), rng.uniform(0.05, 1.4, 40), rng.uniform(-3, 3, 40)
    f = bc.model("ggx", roughness=0.5).evaluate(theta_i, theta_o, delta_phi)[:, 0]
    rows = np.column_stack([coordinates(name, theta_i, theta_o, delta_phi), f])
    text = f"#DIM {rows.shape[1] - 1} 1\n#PARAM_IN {name}\n#PARAM_OUT INV_STERADIAN\n"
    found = measurements_of(put(tmp_path, text + "\n".join(" ".join(map(repr, r)) for r in rows.tolist()) + "\n"))
    assert found.theta_i == pytest.approx(theta_i, abs=1e-7)
    assert found.theta_o == pytest.approx(theta_o, abs=1e-7)
    assert np.cos(found.delta_phi - delta_phi) == pytest.approx(np.ones(40), abs=1e-9)
    assert (found.values[:, 0] == f).all()


def test_confidence_intervals_colours_and_missing_quantities(tmp_path: Path) -> None:
    text = "#DIM 3 1\n#VS 2\n#PARAM_IN ISOTROPIC_TV_TL_DPHI\n#PARAM_OUT INV_STERADIAN\n0.2 0.3 0.4 0.5 0.4 0.6\n"
    found = measurements_of(put(tmp_path, text))
    assert found.values.tolist() == [[0.5]]
    assert "2 number(s) a row of confidence intervals (#VS) left out" in found.done
    assert (found.theta_o[0], found.theta_i[0]) == (0.2, 0.3), "the view first"
    colours = text.replace("#DIM 3 1\n#VS 2", "#DIM 3 3").replace("INV_STERADIAN", "RGB_COLOR")
    assert list(measurements_of(put(tmp_path, colours)).channels) == ["R", "G", "B"]
    silent = text.replace("#PARAM_OUT INV_STERADIAN\n", "")
    assert any("PARAM_OUT is not stated" in s for s in measurements_of(put(tmp_path, silent)).warnings)


@pytest.mark.parametrize("name", SLICES)
def test_slices_are_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=f"{name} is a slice") as caught:
        bc.read(put(tmp_path, f"#DIM 1 1\n#PARAM_IN {name}\n0.5 0.1\n"))
    assert caught.value.code == "slice_only"


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("#DIM 3 1", "#DIM 2 1", "DIM"),
        ("#DIM 3 1", "#DIM 3 99999", "DIM"),
        ("#DIM 3 1", "#DIM three 1", "DIM"),
        ("#DIM 3 1\n", "", "DIM"),
        ("ISOTROPIC_TL_TV_PROJ_DPHI", "STARK_3D", "data2data"),
        ("INV_STERADIAN_COSINE_FACTOR", "ENERGY", "PARAM_OUT"),
        ("#VS 0", "#FORMAT binary", "FORMAT"),
        ("0.3 ", "0.3 0.1 ", "row"),
        ("0.3 ", "nothing ", "no number"),
        ("0.3 ", "2.3 ", "theta_i"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, old: str, new: str, field: str) -> None:
    text = alta_text()
    assert old in text
    with pytest.raises(FileFormatError, match=field) as caught:
        bc.read(put(tmp_path, text.replace(old, new, 1)))
    assert "made.dat" in caught.value.detail
    assert "line" in caught.value.context
