"""Text tables laid out otherwise than a row a geometry: blocks, matrices, half and difference angles, vectors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.parameters import resolve
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.csv import format as csv_file
from tests.support.plain_alta import coordinates

LIGHTS, VIEWS = (10.0, 30.0, 60.0), tuple(float(x) for x in range(-80, 81, 20))
SCAN = [(i, o, 0.1 + i / 1e3 + (o + 80) / 1e4) for i in LIGHTS for o in VIEWS]


def wrote(folder: Path, text: str, name: str = "m.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def rows_of(path: Path, **options: Any) -> Measurements:
    return csv_file.measurements_of(path, resolve("csv", csv_file.CsvFormat.PARAMETERS, options))


def check_scan(m: Measurements, factor: float = 1.0) -> None:
    """The rows of `SCAN`, in any order."""
    assert len(m) == len(SCAN)
    signed = np.where(np.cos(m.delta_phi) < 0, 1, -1) * np.degrees(m.theta_o)
    found = {(round(np.degrees(i), 6), round(abs(o) if abs(o) < 1e-9 else o, 6)): v[0]
             for i, o, v in zip(m.theta_i, signed, m.values, strict=True)}  # fmt: skip
    for i, o, f in SCAN:
        assert found[i, o] == pytest.approx(f * factor, rel=1e-14), (i, o)


def blocks(line: str, head: str = "", separator: str = ",") -> str:
    text = ""
    for i in LIGHTS:
        text += line.format(i) + "\n" + (head + "\n" if head else "")
        text += "".join(f"{o:g}{separator}{f!r}\n" for light, o, f in SCAN if light == i) + "\n"
    return text


@pytest.mark.parametrize("line", ["theta_i = {:g}", "# theta_i = {:g}", "Incident angle: {:g} deg", "AOI {:g}",
                                  "theta_i,{:g}", '"theta_i";{:g}', "Angle of incidence = {:g}°"])  # fmt: skip
def test_the_incidence_of_a_block_stands_above_it(line: str, tmp_path: Path) -> None:
    path = wrote(tmp_path, blocks(line, "theta_o,BRDF"))
    m = rows_of(path, angles="deg")
    check_scan(m)
    assert "theta_i = a line above the rows" in m.conventions["columns"]
    once = wrote(tmp_path, "theta_o,BRDF\n" + blocks(line), "once.csv")
    check_scan(rows_of(once, angles="deg"))


def test_blocks_without_a_header_and_with_blanks(tmp_path: Path) -> None:
    path = wrote(tmp_path, blocks("theta_i = {:g}", separator=" "), "m.dat")
    with pytest.raises(bc.FileFormatError, match="theta_o=COLUMN"):
        rows_of(path)
    check_scan(rows_of(path, theta_o="1", value="2", angles="deg", quantity="f"))


def test_a_unit_above_a_block_is_the_unit_of_all(tmp_path: Path) -> None:
    check_scan(rows_of(wrote(tmp_path, blocks("theta_i = {:g} deg", "theta_o,BRDF"))))


def test_blocks_of_azimuths_and_wavelengths(tmp_path: Path) -> None:
    text = ""
    for wave in (450, 650):
        for phi in (0, 90, 180):
            rows = "".join(f"{i},{o},{0.1 + wave / 1e4 + phi / 1e4 + i / 1e4}\n" for i in (10, 50) for o in (0, 40))
            text += f"wavelength = {wave} nm, delta_phi = {phi}\n{rows}"
    m = rows_of(wrote(tmp_path, "theta_i_deg,theta_o_deg,BRDF\n" + text), mirror=180)
    assert list(m.channels) == [450.0, 650.0]
    assert len(m) == 12
    at = (np.abs(m.theta_i - np.radians(50)) < 1e-9) & (np.abs(m.delta_phi - np.radians(90)) < 1e-9)
    assert m.values[at] == pytest.approx(np.array([[0.1 + 0.045 + 0.009 + 0.005, 0.1 + 0.065 + 0.009 + 0.005]]))


def test_a_line_above_the_rows_does_not_overrule_a_column(tmp_path: Path) -> None:
    rows = "".join(f"{i:g},{o:g},{f!r}\n" for i, o, f in SCAN)
    check_scan(rows_of(wrote(tmp_path, "theta_i: 77\n\ntheta_i,theta_o,BRDF\n" + rows), angles="deg"))


def transposed(corner: str, separator: str = ",", comma: bool = False, across: bool = True) -> str:
    values = {(i, o): f for i, o, f in SCAN}
    head, side = (LIGHTS, VIEWS) if across else (VIEWS, LIGHTS)
    lines = [separator.join([corner, *(f"{a:g}" for a in head)])]
    for b in side:
        cells = [f"{b:g}", *(repr(values[(a, b) if across else (b, a)]) for a in head)]
        lines.append(separator.join(c.replace(".", ",") if comma else c for c in cells))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("corner", "across", "options"),
    [
        ("theta_o", True, {}),
        ("theta_i", False, {}),
        ("theta_o\\theta_i", True, {}),
        ("theta_i/theta_o", False, {}),
        ("theta_o (deg)", True, {}),
        ("theta_i", True, {}),  # the name of the header's numbers: only viewers have angles of both signs
        ("angles", True, {"matrix": "theta_i"}),
        ("", False, {"matrix": "theta_o"}),
    ],
)
def test_matrices(corner: str, across: bool, options: dict[str, Any], tmp_path: Path) -> None:
    given = {"angles": "deg", "quantity": "f", **options}
    check_scan(rows_of(wrote(tmp_path, "made by hand\n\n" + transposed(corner, across=across)), **given))
    check_scan(rows_of(wrote(tmp_path, transposed(corner, ";", True, across), "sheet.csv"), **given))


@pytest.mark.parametrize("named", ["AOI {}", "theta_i={}", "BRDF@{}", "f(AOI={} deg)"])
def test_a_matrix_whose_columns_are_named(named: str, tmp_path: Path) -> None:
    lines = transposed("theta_o").splitlines()
    lines[0] = ",".join(["theta_o", *(named.format(f"{i:g}") for i in LIGHTS)])
    check_scan(rows_of(wrote(tmp_path, "\n".join([*lines, ""])), angles="deg", quantity="f"))
    lines[0] = "theta_o,sample 1,sample 2,sample 3"
    with pytest.raises(bc.FileFormatError, match="theta_i=COLUMN"):
        rows_of(wrote(tmp_path, "\n".join([*lines, ""])), angles="deg", quantity="f")


def test_wavelengths_without_a_unit_are_columns(tmp_path: Path) -> None:
    text = "theta_i,theta_o,450,650\n10,-20,0.1,0.2\n10,20,0.3,0.4\n"
    m = rows_of(wrote(tmp_path, text), angles="deg", quantity="f")
    assert list(m.channels) == [450.0, 650.0]
    assert m.values.tolist() == [[0.1, 0.2], [0.3, 0.4]]
    block = "theta_i = 10\ntheta_o,450,650\n-20,0.1,0.2\n20,0.3,0.4\n"
    assert rows_of(wrote(tmp_path, block), angles="deg", quantity="f").values.tolist() == m.values.tolist()


def test_a_matrix_says_what_lacks_and_what_is_wrong(tmp_path: Path) -> None:
    path = wrote(tmp_path, transposed("theta_o"))
    with pytest.raises(bc.FileFormatError, match="quantity=f, f_cos or pi_f"):
        rows_of(path, angles="deg")
    with pytest.raises(bc.FileFormatError, match="a matrix is read with matrix=theta_i"):
        rows_of(wrote(tmp_path, transposed("angles"), "unnamed.csv"))
    blank = transposed("theta_o").replace(repr(SCAN[4][2]), "--")
    m = rows_of(wrote(tmp_path, blank), angles="deg", quantity="f")
    assert (len(m), m.found["invalid"]) == (len(SCAN) - 1, {"values": 1})
    with pytest.raises(bc.FileFormatError, match="matrix=theta_o, and no header"):
        rows_of(wrote(tmp_path, "theta_i,theta_o,BRDF\n10,20,1\n10,-20,1\n"), matrix="theta_o", angles="deg")


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-16"])
def test_signs_in_headers(encoding: str, tmp_path: Path) -> None:
    greek = encoding != "latin-1"
    head = "θi [°];θo [°];Δφ [°];BRDF [sr⁻¹]" if greek else "theta_i [°];theta_o [°];delta_phi [°];BRDF [1/sr]"
    minus = "−" if greek else "-"
    path = tmp_path / "m.csv"
    path.write_bytes(f"{head}\n10;20;180;0,25\n10;{minus}20;180;0,5\n".encode(encoding))
    m = rows_of(path, mirror=180)  # of another's azimuth nobody says where the mirror is
    assert np.degrees(m.delta_phi) == pytest.approx([180, 0])
    assert m.values[:, 0].tolist() == [0.25, 0.5]


def directions() -> Any:
    rng = np.random.default_rng(8)
    return rng.uniform(0.05, 1.4, 40), rng.uniform(0.05, 1.4, 40), rng.uniform(-3, 3, 40)


@pytest.mark.parametrize("degrees", [True, False])
def test_half_and_difference_angles(degrees: bool, tmp_path: Path) -> None:
    """Against the half vector of vectors; a row below the horizon is counted."""
    theta_i, theta_o, turn = directions()
    # that parametrisation's difference vector is the view's: light and view change places
    columns = coordinates("RUSIN_TH_TD_PD", theta_o, theta_i, -turn)
    f = np.arange(1, 41) / 40
    table = np.column_stack([np.degrees(columns) if degrees else columns, f])
    names = ["theta_h", "theta_d", "phi_d"]
    text = ",".join([*(n + ("_deg" if degrees else "_rad") for n in names), "BRDF"]) + "\n"
    text += "".join(",".join(map(repr, row)) + "\n" for row in table.tolist())
    low = ("80,80,0,9" if degrees else "1.4,1.4,0,9") + "\n"
    m = rows_of(wrote(tmp_path, text + low))
    assert m.theta_i == pytest.approx(theta_i, abs=1e-7)
    assert m.theta_o == pytest.approx(theta_o, abs=1e-7)
    assert np.cos(m.delta_phi - turn) == pytest.approx(np.ones(40), abs=1e-9)
    assert m.values[:, 0].tolist() == f.tolist()
    assert any("1 rows with a direction below the horizon left out; the first: line 42" in s for s in m.done)
    with pytest.raises(bc.FileFormatError, match="phi_d=COLUMN"):
        rows_of(wrote(tmp_path, text.replace("phi_d", "turn")))


@pytest.mark.parametrize(
    ("names", "travel"), [("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z", 1), ("Lx,Ly,Lz,Vx,Vy,Vz", 1), ("a,b,c,d,e,g", -1)]
)
def test_vectors(names: str, travel: int, tmp_path: Path) -> None:
    theta_i, theta_o, turn = directions()
    columns = coordinates("CARTESIAN", theta_i, theta_o, turn)
    light, view = columns[:, 3:] * travel, columns[:, :3]
    f = np.arange(1, 41) / 40
    body = "".join(",".join(map(repr, row)) + "\n" for row in np.column_stack([light, view, f]).tolist())
    options = {} if travel > 0 else {"wi": "[a,b,c]", "wo": "[d,e,g]"}
    m = rows_of(wrote(tmp_path, f"{names},BRDF\n{body}"), **options)
    assert m.theta_i == pytest.approx(theta_i, abs=1e-12)
    assert m.theta_o == pytest.approx(theta_o, abs=1e-12)
    assert np.cos(m.delta_phi - turn) == pytest.approx(np.ones(40), abs=1e-12)
    assert any("in which light travels" in s for s in m.done) == (travel < 0)
    with pytest.raises(bc.FileFormatError, match="a vector of length 2"):
        rows_of(wrote(tmp_path, f"{names},BRDF\n{body}0,0,{2 * travel},0,0,1,1\n"), **options)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("TIS = 0.5", ""),
        ("# total reflectance: 50 % at 10 deg", ""),
        ("TIS = 0.25", "line 1 states a total of 0.25, and the table integrates to 0.5"),
        ("Hemispherical reflectance (8/d): 80", "line 1 states a total of 0.8"),
    ],
)
def test_a_total_that_the_file_states(line: str, said: str, tmp_path: Path) -> None:
    rows = [f"{i},{o},{d},{0.5 / np.pi!r}" for i in (0, 30, 60) for o in (0, 30, 60, 80) for d in (0, 90, 180)]
    path = wrote(tmp_path, "\n".join([line, "theta_i,theta_o,delta_phi,f_r", *rows, ""]))
    warned = bc.read(path, angles="deg", shape="[8,6,6]").report["warnings"]
    assert (
        [text for text in warned if "states a total" in text and said in text]
        if said
        else not any("total" in text for text in warned)
    )


def test_a_total_of_each_block(tmp_path: Path) -> None:
    text = "theta_o,delta_phi,f_r\n"
    for i, stated in ((10, 0.5), (50, 0.3)):
        text += f"theta_i = {i}\nTIS = {stated}\n"
        text += "".join(f"{o},{d},{0.5 / np.pi!r}\n" for o in (0, 30, 60, 80) for d in (0, 90, 180))
    warned = bc.read(wrote(tmp_path, text), angles="deg", shape="[8,6,6]").report["warnings"]
    assert any("line 17 states a total of 0.3, and the table integrates to 0.5 at 50 degrees:" in t for t in warned)


@pytest.mark.parametrize(
    ("head", "lacking"),
    [
        ("Incidence angle (deg),Scatter angle (deg),BSDF (1/sr)", ""),
        ("AOI [deg],AOR [deg],BRDF [1/sr]", ""),
        ("Motor 1,Motor 2,BRDF", "theta_i=COLUMN,theta_o=COLUMN,angles=deg"),
        ("theta_i_deg,Motor 2,BRDF", "theta_o=COLUMN"),
    ],
)
def test_names_of_scans_in_one_plane(head: str, lacking: str, tmp_path: Path) -> None:
    """What is signed needs no azimuth, and none is asked for before that can be seen."""
    path = wrote(tmp_path, head + "\n" + "".join(f"{i:g},{o:g},{f!r}\n" for i, o, f in SCAN))
    if not lacking:
        check_scan(rows_of(path))
        return
    with pytest.raises(bc.FileFormatError) as caught:
        rows_of(path)
    assert caught.value.context["options"] == lacking


def test_names_of_zeniths_azimuths_and_colours(tmp_path: Path) -> None:
    rows = "".join(f"{i},0,{o},{p},0.1,0.2,0.3\n" for i in (0, 30) for o in (0, 40) for p in (0, 90))
    path = wrote(tmp_path, "Zenith_in,Azimuth_in,Zenith_out,Azimuth_out,R,G,B\n" + rows)
    m = rows_of(path, angles="deg", mirror=180, quantity="f")
    assert list(m.channels) == ["R", "G", "B"]
    with pytest.raises(bc.FileFormatError, match="mirror=180"):  # light's azimuth may be that in which it travels
        rows_of(path, angles="deg", quantity="f")
