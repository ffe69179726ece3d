"""Text tables as people keep them: spreadsheets, named columns, marks for missing values, scans in one plane."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.parameters import resolve
from brdfcore.base.quadrature import hemisphere_rule
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.csv import format as csv_file
from brdfcore.formats.csv import sentinels
from tests.brdfcore.conftest import Run
from tests.shared import FOLDER
from tests.support import plain_csv
from tests.support.tiers import first_fast

CASES = FOLDER / "cases"
needs_cases = pytest.mark.skipif(not CASES.exists(), reason=f"the small files are not at {CASES}")
needs_scan = pytest.mark.skipif(not (FOLDER / "data/inplane").exists(), reason=f"the real scan is not at {FOLDER}")
GIVEN: dict[str, Any] = {"angles": "deg", "mirror": 180, "quantity": "f"}
NAMED = {"theta_i": "AOI", "theta_o": "Scatter", "delta_phi": "Azimuth", "value": "BRDF"}
LIGHTS, VIEWERS, TURNS = (10, 40), (20, 50), (0, 90, 180)
TABLE = [(i, o, d, 0.1 + i / 1000 + o / 100 + d / 1e4) for i in LIGHTS for o in VIEWERS for d in TURNS]


def wrote(tmp_path: Path, data: str | bytes, name: str = "m.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def rows_of(path: Path, **options: Any) -> Measurements:
    return csv_file.measurements_of(path, resolve("csv", csv_file.CsvFormat.PARAMETERS, options))


def text_of(separator: str = ",", comma: bool = False, head: str = "theta_i,theta_o,dphi,BRDF", end: str = "") -> str:
    lines = [separator.join(head.split(","))]
    for row in TABLE:
        cells = [f"{x:.6g}" for x in row]
        lines.append(separator.join(c.replace(".", ",") if comma else c for c in cells) + end)
    return "\n".join(lines) + "\n"


def same(m: Measurements, factor: float = 1.0) -> bool:
    found = np.stack([np.degrees(m.theta_i), np.degrees(m.theta_o), np.degrees(m.delta_phi), m.values[:, 0]], axis=1)
    expected = np.array(TABLE)
    return np.allclose(found[:, :3], expected[:, :3]) and np.allclose(found[:, 3], expected[:, 3] * factor, rtol=1e-14)


SHEETS: dict[str, str | bytes] = {
    "lines before": "Instrument: x\nDate; 2024\n\n" + text_of(),
    "decimal comma": text_of(";", comma=True),
    "tabs and decimal comma": text_of("\t", comma=True),
    "blanks and decimal comma": text_of(" ", comma=True),
    "quotes": '"theta_i","theta_o","dphi","BRDF, 1/sr"\n'
    + "".join(",".join(f'"{x:.6g}"' for x in row) + "\n" for row in TABLE),
    "trailing separators": text_of(end=",,"),
    "trailing and lines of nothing": text_of(";", end=";") + ";;;;\n\n",
    "a row of units": text_of().replace("BRDF\n", "BRDF\ndeg,deg,deg,1/sr\n"),
    "windows": text_of().replace("\n", "\r\n").encode("utf-8-sig"),
    "utf-16": text_of("\t").encode("utf-16"),
    "utf-16 without a mark": text_of("\t").encode("utf-16-le"),
    "utf-16 big-endian": b"\xfe\xff" + text_of().encode("utf-16-be"),
}


@pytest.mark.parametrize("name", SHEETS)
def test_spreadsheets(name: str, tmp_path: Path) -> None:
    """Every way a spreadsheet saves one table gives that table, told by its content and by its name."""
    path = wrote(tmp_path, SHEETS[name])
    assert bc.sniff(path) == bc.sniff(wrote(tmp_path, SHEETS[name], "no-extension")) == "csv"
    m = rows_of(path, **GIVEN)
    assert same(m)
    assert m.channels == ("BRDF",)


def test_the_incidence_of_a_block_stands_once(tmp_path: Path) -> None:
    lines, last = ["theta_i;theta_o;dphi;BRDF"], None
    for i, o, d, f in TABLE:
        lines.append(f"{'' if i == last else i};{o};{d};{f:.6g}")
        last = i
    assert same(rows_of(wrote(tmp_path, "\n".join(lines) + "\n"), **GIVEN))
    with pytest.raises(bc.FileFormatError, match="line 2, theta_i: nothing is no number"):
        rows_of(wrote(tmp_path, "\n".join([lines[0], lines[2]]) + "\n"), **GIVEN)


def test_percent_scale_and_names_that_say_the_quantity(tmp_path: Path) -> None:
    path = wrote(tmp_path, text_of(head="theta_i,theta_o,dphi,percent"))
    options = {**GIVEN, "value": "percent"}
    assert same(rows_of(path, **options, unit="percent"), 0.01)
    assert same(rows_of(path, **{**options, "quantity": "pi_f"}, unit="percent"), 0.01 / np.pi)
    assert same(rows_of(path, **options, scale=2.5), 2.5)
    cosine = rows_of(wrote(tmp_path, text_of(head="theta_i (deg),theta_o (deg),dphi (deg),fcos")), mirror=180)
    assert np.allclose(cosine.values[:, 0] * np.cos(cosine.theta_o), [row[3] for row in TABLE])


@pytest.mark.parametrize(
    ("head", "options"),
    [("theta_i,phi_i,theta_o,phi_o,value", {"angles": "deg"}), ("theta_i,theta_o,delta_phi,f_r", {"angles": "deg"})],
)
def test_usual_names_say_enough(head: str, options: dict[str, Any], tmp_path: Path) -> None:
    body = "".join(
        ",".join(map(str, (i, 0, o, d, f) if "phi_i" in head else (i, o, d, f))) + "\n" for i, o, d, f in TABLE
    )
    assert same(rows_of(wrote(tmp_path, head + "\n" + body), **options))


def test_what_is_not_clear_is_listed(run: Run, tmp_path: Path) -> None:
    """The same sentence in Python and at the shell; named, the columns are read in both."""
    path = wrote(tmp_path, text_of(head="AOI,Scatter,Azimuth,BRDF"), "scan.dat")
    with pytest.raises(bc.FileFormatError) as error:
        bc.read(path)
    assert error.value.code == "columns_not_clear"
    assert "Columns: AOI, Scatter, Azimuth, BRDF" in error.value.detail
    assert "theta_o=COLUMN" in error.value.detail
    status, _, err = run("info", str(path))
    assert (status, " ".join(err.split()).count(" ".join(error.value.detail.split()))) == (1, 1)
    assert "'scan.dat:theta_o=COLUMN,phi_o=COLUMN,angles=deg,mirror=180'" in err
    given = ",".join(f"{k}={v}" for k, v in {**NAMED, **GIVEN, "shape": "[6,6,6]"}.items())
    status, out, _ = run("info", "--json", f"{path}:{given}")
    assert status == 0
    assert json.loads(out)["report"]["counts"]["geometries"] == len(TABLE)


def test_options_tell_a_file_that_nothing_else_does(tmp_path: Path) -> None:
    path = wrote(tmp_path, "one line\n" + text_of(head="AOI,Scatter,Azimuth,BRDF"), "upload")
    assert bc.sniff(path, NAMED) == "csv"
    assert same(rows_of(path, **NAMED, **GIVEN))


@pytest.mark.parametrize(
    ("values", "asked", "marks"),
    [
        ([0.1, 0.2, -9999, -9999], "auto", {-9999: 2}),
        ([0.1, 0.2, -1, -0.01], "auto", {-1: 1}),
        ([0.1, 0.2, -1, -0.8], "auto", {}),
        ([0.1, 0.2, 999], "auto", {999: 1}),
        ([900, 999, 850], "auto", {}),
        ([0.1, -9999], "none", {}),
        ([0.1, 7, 7], "[7,8]", {7: 2}),
    ],
)
def test_sentinels_stand_apart(values: list[float], asked: str, marks: dict[float, int]) -> None:
    assert sentinels.find(np.array(values, float), asked) == marks


def test_zeros_that_stand_apart_are_named_and_kept(tmp_path: Path) -> None:
    lines = text_of().split("\n")
    for k in (3, 7):
        lines[k] = lines[k].rsplit(",", 1)[0] + ",0"
    path = wrote(tmp_path, "\n".join(lines))
    m = rows_of(path, **GIVEN)
    assert len(m) == len(TABLE)
    assert any("2 of 12 rows are exactly 0" in text and "sentinel=0" in text for text in m.warnings)
    assert len(rows_of(path, **GIVEN, sentinel="0")) == len(TABLE) - 2
    lines[8] = lines[8].rsplit(",", 1)[0] + ",0.001"  # a small value beside them: what the instrument resolves
    assert not rows_of(wrote(tmp_path, "\n".join(lines)), **GIVEN).warnings


@pytest.mark.parametrize("mark", ["-9999", "-1", "999", "--", "", "n/a", "NaN"])
def test_missing_values_are_left_out_and_counted(mark: str, tmp_path: Path) -> None:
    lines = text_of().split("\n")
    for k in (3, 7):
        lines[k] = lines[k].rsplit(",", 1)[0] + "," + mark
    m = rows_of(wrote(tmp_path, "\n".join(lines)), **GIVEN)
    assert len(m) == len(TABLE) - 2
    assert m.found["invalid"] == {"BRDF": 2}
    assert m.values.min() > 0
    assert m.values.max() < 1
    if mark[-1:].isdigit():
        assert m.found["sentinels"] == {mark: 2}
        assert any(f"2 of 12 values are {mark}" in text for text in m.warnings)


def test_f_cos_at_the_horizon_is_left_out(tmp_path: Path) -> None:
    path = wrote(tmp_path, text_of(head="theta_i,theta_o,dphi,fcos") + "10,90,180,0\n10,90,0,1e-9\n")
    m = rows_of(path, angles="deg", mirror=180)
    assert len(m) == len(TABLE)
    assert m.found["rows at the horizon"] == 2
    assert any("2 rows at theta_o = 90 degrees left out" in text for text in m.done)


@pytest.mark.parametrize(("head", "waves"), [("w", (0.55, 0.65)), ("wavelength", (550, 650)), ("lambda_um", (31, 40))])
def test_micrometres(head: str, waves: tuple[float, float], tmp_path: Path) -> None:
    lines = [f"{w},{i},{o},{d},{f}" for w in waves for i, o, d, f in TABLE]
    options = {**GIVEN, "wavelength": head} if head == "w" else GIVEN
    m = rows_of(wrote(tmp_path, "\n".join([f"{head},theta_i,theta_o,dphi,BRDF", *lines, ""])), **options)
    factor = 1 if waves[0] >= 100 else 1000
    assert m.channels.kind == "wavelength"
    assert list(m.channels) == pytest.approx([w * factor for w in waves])


def test_degrees_and_radians_taken_for_each_other(tmp_path: Path) -> None:
    path = wrote(tmp_path, text_of())
    with pytest.raises(bc.FileFormatError, match="degrees are read with angles=deg"):
        rows_of(path, **{**GIVEN, "angles": "rad"})
    lines = ["theta_i,theta_o,dphi,BRDF", *(f"{i / 90},{o / 90},{d / 90},{f}" for i, o, d, f in TABLE), ""]
    radians = wrote(tmp_path, "\n".join(lines))
    assert any("are they radians" in text for text in rows_of(radians, **GIVEN).warnings)
    assert not rows_of(radians, **{**GIVEN, "angles": "rad"}).warnings


def test_wavelengths_as_columns_and_the_sign_of_theta_o(tmp_path: Path) -> None:
    """No azimuth: a positive theta_o is the mirror side."""
    lines = [f"{i},{o},{0.1 + (o + i) / 1e3},{0.2 + i / 1e3}" for i in (0, 30) for o in (-60, -30, 0, 30, 60)]
    path = wrote(tmp_path, "\n".join(["Incident angle, Measure_angle, 450nm , 650 nm", *lines, ""]))
    m = rows_of(path, angles="deg", quantity="f")
    assert m.channels == (450.0, 650.0)
    assert np.degrees(m.delta_phi[5:]).tolist() == pytest.approx([0, 0, 0, 180, 180])
    assert "negative theta_o lies on the light's side" in m.conventions["azimuth"]
    unsigned = wrote(tmp_path, "Incident angle,Measure_angle,450nm\n" + "10,20,1\n10,30,1\n")
    with pytest.raises(bc.FileFormatError, match="phi_o=COLUMN"):
        rows_of(unsigned, angles="deg", quantity="f")


# ---- what cannot be ---------------------------------------------------------------------------------


GONIO = [(i, o, d) for i in (0, 20, 40, 60) for o in (0, 20, 40, 60, 75) for d in (0, 60, 120, 180)]
GLOSSY = bc.model("cook_torrance", roughness=0.3, ior="gold")


def measured(tmp_path: Path, factor: float = 1.0, turn: float = 0.0, **options: Any) -> list[str]:
    """Warnings about a file of a metal, its values times `factor`, its azimuths turned by `turn` degrees."""
    angles = np.radians(GONIO)
    f = GLOSSY.evaluate(*angles.T)[:, 0] * factor
    lines = [f"{i},{o},{d + turn},{v:.17g}" for (i, o, d), v in zip(GONIO, f, strict=True)]
    path = wrote(tmp_path, "\n".join(["theta_i,theta_o,dphi,BRDF", *lines, ""]))
    found: list[str] = bc.read(path, **{**GIVEN, "shape": "[12,8,8]", **options}).report["warnings"]
    return found


def test_a_right_file_is_not_doubted(tmp_path: Path) -> None:
    assert not [text for text in measured(tmp_path) if "albedo" in text or "side" in text]


@pytest.mark.parametrize(
    ("factor", "turn", "words"),
    [
        (100.0, 0.0, "no passive surface reflects more than it receives"),
        (1e-4, 0.0, "darker than any known surface"),
        (1.0, 180.0, "brightest on the light's side"),
        (-1.0, 0.0, "below 0"),
    ],
)
def test_what_cannot_be_is_said(factor: float, turn: float, words: str, tmp_path: Path) -> None:
    assert any(words in text for text in measured(tmp_path, factor, turn)), words


def test_the_shell_says_what_cannot_be(run: Run, tmp_path: Path) -> None:
    measured(tmp_path, 100.0)
    given = "angles=deg,mirror=180,quantity=f,shape=[6,6,6]"
    status, out, err = run("albedo", f"{tmp_path / 'm.csv'}:{given}", "--theta-i", "30")
    assert status == 0
    assert "no passive surface" in " ".join(err.split())
    assert "no passive surface" not in out


def test_the_azimuth_at_normal_incidence(tmp_path: Path) -> None:
    lines = [
        f"{i},{o},{d},{0.3 if i or d % 180 else 0.05}" for i in (0, 30) for o in (20, 40, 60) for d in (0, 90, 180)
    ]
    path = wrote(tmp_path, "\n".join(["theta_i,theta_o,dphi,BRDF", *lines, ""]))
    warned = bc.read(path, **GIVEN, shape="[6,6,6]").report["warnings"]
    assert any("anisotropic" in text and "normal incidence" in text for text in warned)


def test_nothing_is_relative_to_a_negative_reference(tmp_path: Path) -> None:
    """An error, not an L1 of minus some percent."""
    measured(tmp_path, -1.0)
    dark = bc.read(tmp_path / "m.csv", **GIVEN, shape="[6,6,6]")
    with pytest.raises(bc.InputError, match="reflects less than nothing"):
        bc.compare(dark, bc.model("lambert", reflectance=0.5))


# ---- the plane of incidence only --------------------------------------------------------------------


def scanned(tmp_path: Path, b: bc.Brdf, step: float = 2.0) -> Path:
    lights, views = np.arange(0, 81, 10.0), np.arange(-86, 87, step)
    grid = np.array([(i, o) for i in lights for o in views])
    turn = np.where(grid[:, 1] >= 0, np.pi, 0)
    f = b.evaluate(np.radians(grid[:, 0]), np.radians(np.abs(grid[:, 1])), turn)[:, 0]
    lines = [f"{i},{o},{v:.9g}" for (i, o), v in zip(grid.tolist(), f, strict=True)]
    return wrote(tmp_path, "\n".join(["theta_i,theta_o,BRDF", *lines, ""]))


@pytest.mark.parametrize(("roughness", "step"), first_fast((0.15, 4.0), (0.05, 1.0), (0.4, 4.0)))
def test_albedo_of_a_scan_in_the_plane(roughness: float, step: float, tmp_path: Path) -> None:
    """Truth known: the albedo lies within what the report states; what is out of the plane is marked."""
    metal = bc.model("ggx", roughness=roughness, ior=(1.2, 7.0))
    b = bc.read(scanned(tmp_path, metal, step), angles="deg", shape="[40,16,12]")
    plane = b.report["albedo"]["in plane"]
    true = metal.albedo(np.radians(plane["theta_i"]))[:, 0]
    low, high = (np.array(plane[k]) for k in ("lowest", "highest"))
    upto = np.array(plane["theta_i"]) <= 75
    assert ((low - 1e-3 <= true) & (true <= high + 1e-3))[upto].all(), (low, true, high)
    assert (np.abs(np.array(plane["albedo"]) - true) < 0.05)[np.array(plane["theta_i"]) <= 60].all()
    assert plane["assumed"]["name"] in ("power", "f_cos_cos")
    above = np.array(plane["albedo"])[upto].max() > 1
    assert above == any("no passive surface" in text for text in b.report["warnings"])
    assert any("only the plane of incidence was measured" in text for text in b.report["warnings"])
    codes = b.status(np.radians(40.0), np.radians([40.0, 40.0]), np.radians([60.0, 120.0]))
    assert set(codes.tolist()) <= {bc.Status.EXTRAPOLATED, bc.Status.FILLED}


@pytest.mark.slow
def test_what_may_be_assumed_is_part_of_the_uncertainty(tmp_path: Path) -> None:
    """Truth known: the albedo's error lies within the integral of the half-widths, which grow out of the plane."""
    metal = bc.model("ggx", roughness=0.15, ior=(1.2, 7.0))
    b = bc.read(scanned(tmp_path, metal, 4.0), angles="deg", shape="[40,16,12]")
    for theta_i in np.radians([0.0, 30.0, 60.0, 75.0]):
        theta_o, turn, weight = hemisphere_rule(float(theta_i), bilateral=True)
        weight = weight * np.cos(theta_o)
        f, true, u = (g(theta_i, theta_o, turn)[:, 0] for g in (b.evaluate, metal.evaluate, b.uncertainty))
        assert abs(weight @ (f - true)) <= weight @ u
        # of the reflected light; without what may be assumed .53 at 60 degrees
        assert (weight * true) @ (np.abs(f - true) <= u) >= 0.75 * (weight @ true)
    at = np.radians(60.0), np.radians(60.0)
    there = b.uncertainty(*at, np.radians([180.0, 120.0]))[:, 0] / b.evaluate(*at, np.radians([180.0, 120.0]))[:, 0]
    assert there[1] > 2 * there[0]


def test_a_diffuse_scan_keeps_its_value(tmp_path: Path) -> None:
    white = bc.model("lambert", reflectance=0.5)
    b = bc.read(scanned(tmp_path, white, 10.0), angles="deg", shape="[8,8,8]")
    plane = b.report["albedo"]["in plane"]
    assert plane["assumed"] == {"name": "f", "power": 0.0}
    assert np.array(plane["albedo"]) == pytest.approx(0.5, rel=1e-3)
    asked = bc.read(tmp_path / "m.csv", angles="deg", shape="[8,8,8]", in_plane="f_cos_cos")
    assert asked.albedo(np.radians(60.0))[0] < 0.45


# ---- the small files of each kind, and a real scan ------------------------------------------------


KINDS: dict[str, tuple[dict[str, Any], Any]] = {
    "named_columns": ({**NAMED, **GIVEN}, lambda f, o: f),
    "preamble": (GIVEN, lambda f, o: f),
    "quoted": (GIVEN, lambda f, o: f),
    "sentinel": (GIVEN, lambda f, o: f),
    "percent": ({**GIVEN, "value": "percent", "quantity": "pi_f", "unit": "percent"}, lambda f, o: f / 100 / np.pi),
    "fcos_to_90": ({"angles": "deg", "mirror": 180}, lambda f, o: f / np.cos(np.radians(o))),
    "grazing": ({}, lambda f, o: f),
    "retro": ({}, lambda f, o: f),
    "inplane_metal": ({}, lambda f, o: f),
}


@needs_cases
@pytest.mark.parametrize("name", KINDS)
def test_values_of_the_small_files(name: str) -> None:
    """Each row that can be used, as an independent parser reads it; the others counted."""
    options, undone = KINDS[name]
    path = CASES / f"{name}.csv"
    m = rows_of(path, **options)
    table = plain_csv.rows(path)
    used = (table[:, 3] != -9999) & ((name != "fcos_to_90") | (table[:, 1] < 90))
    assert len(table) - int(used.sum()) == (2 if name in ("sentinel", "fcos_to_90") else 0)
    table = table[used]
    assert np.array_equal(np.degrees(m.theta_i).round(9), table[:, 0])
    assert np.array_equal(np.degrees(m.theta_o).round(9), table[:, 1])
    turned = np.where(table[:, :2].min(axis=1) == 0, 0, table[:, 2])  # no azimuth at the normal
    assert np.allclose(np.degrees(m.delta_phi), turned, atol=1e-9)
    assert np.allclose(m.values[:, 0], undone(table[:, 3], table[:, 1]), rtol=1e-14, atol=0)


@needs_scan
@pytest.mark.parametrize("name", ["cases/inplane_signed.csv", "data/inplane/scan_2d.csv"])
def test_values_of_scans_in_the_plane(name: str) -> None:
    path = FOLDER / name
    scan = path.name == "scan_2d.csv"
    m = rows_of(path, angles="deg", quantity="pi_f" if scan else "f")
    expected = plain_csv.in_project(plain_csv.rows(path))
    assert len(m) == len(expected)
    assert len(m.channels) == (35 if scan else 1)
    for k, (theta_i, theta_o, delta_phi, values) in enumerate(expected):
        assert np.degrees([m.theta_i[k], m.theta_o[k]]) == pytest.approx([theta_i, theta_o])
        assert theta_o == 0 or np.degrees(m.delta_phi[k]) == pytest.approx(delta_phi)
        assert m.values[k] == pytest.approx(np.array(values) / (np.pi if scan else 1), rel=1e-14)
