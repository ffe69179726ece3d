"""Klems matrices and tensor trees: the real one and made ones against plain look-ups, pyradiance, refusals, safety."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.formats.base.format import LossWarning
from brdfcore.tables.patch_grid import disk, square
from tests.shared import FOLDER, needs_shared
from tests.support.hostile import BOMB
from tests.support.plain_klems import FULL, HALF, QUARTER, Matrix, blocks, looked_up, tree
from tests.support.radiance import asked, needs_radiance
from tests.support.tiers import first_fast

REAL = FOLDER / "data" / "klems" / "2011-SA1.XML"
BASES = {"full": FULL, "half": HALF, "quarter": QUARTER}


def written(b: bc.Brdf, path: Path, **options: Any) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LossWarning)
        bc.write(b, path, **options)
    return path


def check_own_patches(b: bc.Brdf, matrices: list[Matrix]) -> None:
    """At the centres of every pair of patches, with every difference of azimuth, the mean of the pairs that have it."""
    for c, matrix in enumerate(matrices):
        own = matrix.own_geometries()
        angles = np.radians(np.array(list(own)))
        means = np.array([np.mean(v) for v in own.values()])
        found = b.evaluate(*angles.T)[:, c]
        assert np.abs(found - means).max() <= 1e-14 * means.max() * 10


@needs_shared
@pytest.mark.parametrize("side", ["back", "front"])
def test_the_real_matrix(side: str) -> None:
    b = bc.read(REAL, side=side)
    found = blocks(REAL.read_text())
    assert list(b.channels) == ["Visible", "Solar"]
    matrices = [Matrix(found[wave, f"Reflection {side.title()}"], FULL) for wave in b.channels]
    check_own_patches(b, matrices)
    for patch in (0, 3, 60, 140):
        theta = np.radians(matrices[0].centre(patch)[0])
        assert b.albedo(theta) == pytest.approx([m.reflectance(patch) for m in matrices], rel=2e-4)
    said = " ".join(b.report["warnings"])
    assert "Transmission Front and Transmission Back left out" in said
    assert "averages over patches" in said
    assert b.report["found"]["side"] == f"Reflection {side.title()}"


@pytest.mark.parametrize("basis", first_fast("quarter", "half", "full"))
def test_written_matrices_hold_the_averages_over_patches(basis: str, tmp_path: Path) -> None:
    source = bc.model("ggx", roughness=0.35, diffuse=0.3, specular=0.5)
    with pytest.warns(LossWarning, match="misplaces"):
        bc.write(source, tmp_path / "m.xml", basis=basis)
    found = blocks((tmp_path / "m.xml").read_text())
    assert set(found) == {("Visible", "Reflection Front"), ("Visible", "Reflection Back")}
    assert found["Visible", "Reflection Front"] == found["Visible", "Reflection Back"]
    matrix = Matrix(found["Visible", "Reflection Back"], BASES[basis])
    check_own_patches(bc.read(tmp_path / "m.xml"), [matrix])
    rng = np.random.default_rng(2)
    count = len(matrix.patches)
    for i, o in ((0, 0), (1, 3), (count // 2, count // 2), (count // 2, count - 2), (count - 1, count - 1)):
        assert matrix.rows[o][i] == pytest.approx(_averaged(source, matrix, i, o, rng), rel=5e-3)
    bc.write(bc.read(tmp_path / "m.xml"), tmp_path / "again.xml", basis=basis)
    assert bc.read(tmp_path / "again.xml").id == bc.read(tmp_path / "m.xml").id  # type: ignore[attr-defined]


def _averaged(b: bc.Brdf, matrix: Matrix, i: int, o: int, rng: np.random.Generator) -> float:
    """f over two patches, each drawn evenly in projected solid angle: 400,000 stratified pairs."""
    n = 632
    strata = (np.arange(n)[:, None] + rng.random((n, n))) / n, (np.arange(n)[None, :] + rng.random((n, n))) / n
    angles = []
    shuffled = tuple(rng.permutation(x.reshape(-1)) for x in strata)
    for patch, u in ((i, strata), (o, shuffled)):
        ring, k = matrix.patches[patch]
        (low, count), (high, _) = matrix.basis[ring], matrix.basis[ring + 1]
        a, c = np.sin(np.radians(low)) ** 2, np.sin(np.radians(high)) ** 2
        u0, u1 = (np.asarray(x).reshape(-1) for x in u)
        angles.append((np.arcsin(np.sqrt(a + (c - a) * u0)), 2 * np.pi * (k + u1 - 0.5) / count))
    (ti, pi), (to, po) = angles
    return float(b.evaluate(ti, to, po - pi + np.pi)[:, 0].mean())


def test_a_written_tree_holds_the_averages_over_its_cells(tmp_path: Path) -> None:
    source = bc.model("ggx", roughness=0.35, diffuse=0.3, specular=0.5)
    path = written(source, tmp_path / "t.xml", basis="tree", resolution=16)
    root = tree(blocks(path.read_text())["Visible", "Reflection Back"])
    b = bc.read(path)
    theta_i, theta_o, delta_phi = testing.sample_angles(500)
    inside = (theta_i < 1.5) & (theta_o < 1.5) & (theta_i > 0) & (theta_o > 0) & (np.abs(delta_phi) < 4)
    asked = np.stack([theta_i, theta_o, delta_phi], axis=1)[inside]
    plain = np.array([looked_up(root, *row) for row in asked.tolist()])
    off = np.abs(b.evaluate(*asked.T)[:, 0] - plain) > 1e-12
    assert off.mean() <= 0.01, "but for directions on an edge of a cell"
    # one cell by hand: rho from 3/8 to 4/8, the cell of x in [12, 13)/16, y in [8, 9)/16
    rng = np.random.default_rng(3)
    u = rng.random((3, 200_000))
    rho, turn = disk((12 + u[0]) / 16, (8 + u[1]) / 16)
    a = np.sqrt((9 + 7 * u[2]) / 64)
    mean = source.evaluate(np.arcsin(a), np.arcsin(rho), turn).mean()
    assert b.evaluate(np.arcsin(0.45), np.arcsin(0.55), np.pi + 0.01)[0] == pytest.approx(mean, rel=5e-3)
    assert b.values.shape == (8, 16, 16, 1)  # type: ignore[attr-defined]


@needs_radiance
@pytest.mark.parametrize("basis", first_fast("quarter", "half", "full", "tree"))
def test_radiance_sees_what_was_written(basis: str, tmp_path: Path) -> None:
    """From above (the file's Reflection Back) and below: directional-hemispherical reflectance within .5 %."""
    source = bc.model("ggx", roughness=0.3, diffuse=0.2, specular=0.6)
    path = written(source, tmp_path / f"radiance_{basis}.xml", basis=basis)
    b = bc.read(path)
    edges = np.degrees(np.arcsin(np.arange(17) / 16)) if basis == "tree" else np.array([x for x, _ in BASES[basis]])
    middle = 0.5 * (edges[:-1] + edges[1:])
    pairs = [(20.0, 0.0, 40.0, 90.0), (50.0, 0.0, 50.0, 180.0), (70.0, 0.0, 30.0, 90.0), (0.5, 0.0, 60.0, 0.0)]
    if basis == "tree":  # any azimuth will do, but for the edges of cells
        pairs = [(20.0, 5.0, 40.0, 95.7), (50.0, 5.0, 50.9, 187.0), (70.0, 5.0, 33.0, 95.2), (1.5, 5.0, 60.0, 9.0)]
    found = asked(path, [*middle, *(180 - middle)], pairs)
    u = (np.arange(64) + 0.5) / 64
    for k, (low, high) in enumerate(zip(np.radians(edges[:-1]), np.radians(edges[1:]), strict=True)):
        s2 = np.sin(low) ** 2 + u * (np.sin(high) ** 2 - np.sin(low) ** 2)
        true = source.albedo(np.arcsin(np.sqrt(s2))).mean()
        for seen in (found["hemi"][k], found["hemi"][k + middle.size]):
            assert seen == pytest.approx(true, rel=5e-3)
            assert seen == pytest.approx(b.albedo(np.radians(middle[k]))[0], rel=1e-3)
    # at centres of patches, of azimuth too; Radiance adds a perturbation of 3e-4 to a matrix
    for (theta_i, phi_i, theta_o, phi_o), value in zip(pairs, found["pairs"], strict=True):
        assert value == pytest.approx(b.evaluate(*np.radians([theta_i, theta_o, phi_o - phi_i]))[0], rel=1.5e-3)


@needs_shared
@needs_radiance
def test_radiance_calls_back_what_faces_up() -> None:
    theta = np.array([0.5, 40.0, 80.0])
    found = asked(REAL, [*theta, *(180 - theta)])["hemi"]
    for side, seen in (("back", found[:3]), ("front", found[3:])):
        assert seen == pytest.approx(bc.read(REAL, side=side).albedo(np.radians(theta))[:, 0], rel=1e-3)


def test_colours_are_written_as_xyz(tmp_path: Path) -> None:
    b = bc.model("lambert", reflectance=[0.5, 0.3, 0.1])
    path = written(b, tmp_path / "c.xml", basis="quarter")
    again = bc.read(path)
    assert list(again.channels) == ["X", "Y", "Z"]
    srgb = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    expected = srgb @ [0.5, 0.3, 0.1]
    assert again.albedo(0.3) == pytest.approx(expected, rel=1e-4)
    assert again.report["found"]["blocks"]["Reflection Back"] == ["CIE-X", "Visible", "CIE-Z"]
    with pytest.raises(InputError, match="channel="):
        bc.write(bc.model("lambert", reflectance=[0.1, 0.2]), tmp_path / "no.xml")
    with pytest.raises(InputError, match="mirror part"):
        bc.write(bc.model("mirror"), tmp_path / "no.xml")
    with pytest.raises(InputError, match="power of two"):
        bc.write(b, tmp_path / "no.xml", basis="tree", resolution=24)


def test_an_anisotropic_matrix_is_refused_and_averaged_on_request(tmp_path: Path) -> None:
    path = written(bc.model("lambert", reflectance=0.5), tmp_path / "a.xml", basis="quarter")
    text = path.read_text()
    data = blocks(text)["Visible", "Reflection Back"]
    matrix = Matrix(data, QUARTER)
    for row in matrix.rows:
        for i in range(1, len(row)):  # bright where light comes along one axis of the sample
            row[i] *= 1 + 0.8 * math.cos(math.radians(2 * matrix.centre(i)[1]))
    changed = ",\n".join(", ".join(map(repr, row)) for row in matrix.rows)
    path.write_text(text.replace(data, changed))
    with pytest.raises(FileFormatError, match="isotropic='mean'") as caught:
        bc.read(path)
    assert caught.value.code == "anisotropic"
    b = bc.read(path, isotropic="mean")
    check_own_patches(b, [matrix])
    assert any("averaged over rotation, as asked" in s for s in b.report["done"])


def rank_4(folder: Path) -> tuple[Path, Any]:
    """A tensor tree of one grid of 4 x 4 x 4 x 4 values, and they."""
    path = written(bc.model("lambert", reflectance=0.5), folder / "four.xml", basis="tree", resolution=4)
    values = np.random.default_rng(6).uniform(0.02, 0.5, (4, 4, 4, 4)).round(4)
    text = path.read_text().replace("TensorTree3", "TensorTree4")
    grid = "{ " + " ".join(map(repr, values.reshape(-1).tolist())) + " }"
    for data in set(blocks(text).values()):
        text = text.replace(data, grid)
    path.write_text(text)
    return path, values


def plain_square(length: float, azimuth: float) -> tuple[float, float]:
    """Shirley and Chiu's map of a point of the disk, one at a time."""
    turn = (azimuth + math.pi / 4) % (2 * math.pi) - math.pi / 4
    quarter = int((turn + math.pi / 4) / (math.pi / 2))
    across = length * (turn - quarter * math.pi / 2) * 4 / math.pi
    a, b = [(length, across), (-across, length), (-length, -across), (across, -length)][quarter % 4]
    return 0.5 * (a + 1), 0.5 * (b + 1)


def test_a_tree_of_rank_4_is_refused_and_averaged_on_request(tmp_path: Path) -> None:
    path, values = rank_4(tmp_path)
    with pytest.raises(FileFormatError, match="rank 4") as caught:
        bc.read(path)
    assert caught.value.code == "anisotropic"
    b = bc.read(path, isotropic="mean")
    assert b.values.shape == (2, 4, 4, 1)  # type: ignore[attr-defined]
    said = next(s for s in b.report["done"] if "averaged over rotation, as asked" in s)
    assert 0.1 < float(said.split("misplaces ")[1].split()[0]) < 1
    for k, rho in enumerate((0.25, 0.75)):
        for x, y in ((0.4, 0.6), (0.1, 0.9), (0.9, 0.4)):
            cell = (int(4 * x), int(4 * y))
            length, turn = (float(v) for v in disk(np.array((cell[0] + 0.5) / 4), np.array((cell[1] + 0.5) / 4)))
            seen = []
            for step in range(32):
                phi = (step + 0.5) * math.pi / 16
                place = [*plain_square(rho, phi), *plain_square(length, turn - math.pi + phi)]
                seen.append(values[tuple(int(4 * p) for p in place)])
            assert b.values[(k, *cell, 0)] == pytest.approx(np.mean(seen), rel=1e-12)  # type: ignore[attr-defined]


@needs_radiance
def test_radiance_sees_a_tree_of_rank_4_at_the_same_places(tmp_path: Path) -> None:
    path, _ = rank_4(tmp_path)
    b = bc.read(path, isotropic="mean")
    theta_o = math.degrees(math.asin(0.75))
    for theta_i, turn in ((math.degrees(math.asin(0.25)), 180.0), (math.degrees(math.asin(0.75)), 90.0)):
        turns = (np.arange(32) + 0.5) * 11.25
        # a cell is evaluated at its centre, this pair lies elsewhere in it
        centre = disk(*(np.floor(4 * p) / 4 + 0.125 for p in square(np.array(0.75), np.radians(turn))))
        pairs = [(theta_i, t, math.degrees(math.asin(float(centre[0]))), t + math.degrees(float(centre[1])))
                 for t in turns]  # fmt: skip
        seen = np.mean(asked(path, pairs=pairs)["pairs"])
        assert b.evaluate(*np.radians([theta_i, theta_o, turn]))[0] == pytest.approx(seen, rel=2e-3)


def test_a_basis_that_the_file_defines_is_believed(tmp_path: Path) -> None:
    path = written(bc.model("lambert", reflectance=0.5), tmp_path / "b.xml", basis="quarter")
    old = path.read_text().replace("45<", "46<").replace("63<", "66<")
    path.write_text(old)
    b = bc.read(path)
    assert np.degrees(b.theta_i) == pytest.approx([0, 9, 27, 46, 66, 90])  # type: ignore[attr-defined]


def test_patch_grids_keep_what_tables_promise(tmp_path: Path) -> None:
    source = bc.model("ggx", roughness=0.4, diffuse=0.2, specular=0.7)
    for basis in ("quarter", "tree"):
        b = bc.read(written(source, tmp_path / f"{basis}.xml", basis=basis, resolution=8))
        testing.check_brdf(b, steps=True)
        testing.check_table(b, tmp_path)  # type: ignore[arg-type]


def test_square_and_disk_are_inverse_and_keep_areas() -> None:
    rng = np.random.default_rng(4)
    x, y = rng.random((2, 200_000))
    rho, turn = disk(x, y)
    again = square(rho, turn)
    assert np.abs(again[0] - x).max() <= 1e-12
    assert np.abs(again[1] - y).max() <= 1e-12
    assert (rho**2).mean() == pytest.approx(0.5, abs=3e-3)
    assert np.abs(np.exp(1j * turn).mean()) < 5e-3


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("<IncidentDataStructure>Columns", "<IncidentDataStructure>Sideways", "IncidentDataStructure"),
        ("<IncidentDataStructure>Columns", "<IncidentDataStructure>TensorTree4", "rank 4"),
        ("<IncidentDataStructure>Columns", "<IncidentDataStructure>TensorTree3", "ScatteringData"),
        ("Reflection Front", "Sideways", "WavelengthDataDirection"),
        ("Reflection Front", "Reflection Back", "a second time"),
        ("<ColumnAngleBasis>LBNL", "<ColumnAngleBasis>NLBL", "ColumnAngleBasis"),
        ("<ScatteringData>\n", "<ScatteringData>\n0.1, ", "1682 numbers"),
        ("<ScatteringData>\n", "<ScatteringData>\nx", "no number"),
        ("<ScatteringData>\n0.", "<ScatteringData>\nnan 0.", "numbers"),
        ("<nPhis>12", "<nPhis>12000000", "AngleBasisBlock"),
        ("<UpperTheta>27", "<UpperTheta>7", "AngleBasisBlock"),
        ("</Layer>", "", "XML"),
        ('encoding="UTF-8"', 'encoding="nonsense"', "XML"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, old: str, new: str, field: str) -> None:
    path = written(bc.model("lambert", reflectance=0.5), tmp_path / "wrong.xml", basis="quarter")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 2 if "Basis>LBNL" in old or "Data>" in old else 1))
    with pytest.raises(FileFormatError, match=field) as caught:
        bc.read(path, format="bsdf_xml")
    assert "line" in caught.value.context
    assert "wrong.xml" in caught.value.detail


@pytest.mark.parametrize(
    "data",
    [
        BOMB,
        b'<?xml version="1.0"?><!DOCTYPE WindowElement SYSTEM "http://127.0.0.1:9/x.dtd"><WindowElement/>',
        b'<!DOCTYPE WindowElement [<!ENTITY x SYSTEM "file:///etc/passwd">]><WindowElement>&x;</WindowElement>',
        b"<WindowElement>" * 1_000,
        b"<WindowElement>" + b"<a/>" * 30_000 + b"</WindowElement>",
    ],
    ids=["bomb", "dtd", "entity", "deep", "many"],
)
def test_documents_that_expand_are_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "bad.xml"
    path.write_bytes(data)
    with pytest.raises(FileFormatError):
        bc.read(path, format="bsdf_xml")


def test_transmission_alone_is_refused(tmp_path: Path) -> None:
    path = written(bc.model("lambert", reflectance=0.5), tmp_path / "t.xml", basis="quarter")
    text = path.read_text()
    path.write_text(text.replace("Reflection", "Transmission"))
    with pytest.raises(FileFormatError) as caught:
        bc.read(path)
    assert caught.value.code == "transmission_only"
    path.write_text(text.replace("Reflection Back", "Transmission Back"))
    b = bc.read(path)
    assert "there is no Reflection Back: Reflection Front is read" in b.report["done"]
