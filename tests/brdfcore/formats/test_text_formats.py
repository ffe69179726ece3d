"""ASTM and CSV files of scattered measurements: read, written, and whatever is not one."""

from __future__ import annotations

import re
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import brdfcore as bc
from brdfcore.base.parameters import resolve
from brdfcore.formats import astm
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.formats.csv import format as csv_file
from tests.benchmarks.holdout import PTFE, SOLAR_ARRAY
from tests.brdfcore.conftest import Run
from tests.support import goniometer
from tests.support.tiers import first_fast

OWN = "theta_i_deg,theta_o_deg,delta_phi_deg,f_r_value\n"
ROWS = "".join(f"{i},{o},{d},0.{i}{o}{d}\n" for i in (10, 40) for o in (20, 50) for d in (0, 90, 180))
ASTM = "LAB_NAME A laboratory\nNUM_POINTS 12\nVARS theta_i,phi_i,theta_s,phi_s,500nm,600nm\n\n" + "".join(
    f"0.{i},0.0,0.{o},{d},0.1{i},0.2{o}\n" for i in (1, 4) for o in (2, 5) for d in (0, 1.5, -3)
)


def rows_of(path: Path, **options: Any) -> Measurements:
    """The rows of a csv file."""
    return csv_file.measurements_of(path, resolve("csv", csv_file.CsvFormat.PARAMETERS, options))


def wrote(tmp_path: Path, text: str | bytes, name: str = "m.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# ---- what is read -----------------------------------------------------------------------------


def test_own_header(tmp_path: Path) -> None:
    """A file of `brdf eval --csv` says everything itself."""
    m = rows_of(wrote(tmp_path, OWN + ROWS))
    assert len(m) == 12
    assert m.channels == ("value",)
    assert float(np.degrees(m.delta_phi[2])) == pytest.approx(180)
    assert m.values[0, 0] == 0.10200
    assert m.conventions["said by"] == "the file's header"
    assert m.lines[0] == 2


def test_each_missing_option_is_named(tmp_path: Path) -> None:
    path = wrote(tmp_path, "ti,to,az,R,G\n" + "10,20,30,1,2\n" * 3)
    given: dict[str, Any] = {}
    for option, value, word in (
        ("theta_i", "ti", "theta_i="), ("theta_o", "to", "theta_o="), ("delta_phi", "az", "delta_phi="),
        ("value", "[R,G]", "value="), ("angles", "deg", "angles="), ("mirror", 180, "mirror="),
        ("quantity", "f", "quantity="),
    ):  # fmt: skip
        with pytest.raises(bc.FileFormatError, match=word) as error:
            rows_of(path, **given)
        assert error.value.code == "columns_not_clear"
        assert "ti, to, az, R, G" in error.value.detail
        given[option] = value
    assert rows_of(path, **given).channels == ("R", "G")


@pytest.mark.parametrize("head", ["ti,to,dp,red", "Angle in;Angle out;Azimuth;BRDF", "a b c d", "a\tb b\tc\td"])
def test_a_table_of_an_instrument_is_told_by_its_rows(head: str, tmp_path: Path) -> None:
    """Any names above as many numbers: then options say what they are, not `--from`."""
    separator = next((s for s in ";,\t" if s in head), " ")
    rows = [separator.join(map(str, row)) for row in ((10, 20, 180, 0.5), (10, 30, 180, 0.4))]
    (tmp_path / "x.txt").write_text("\n".join(["# an instrument", head, *rows]))
    assert bc.sniff(tmp_path / "x.txt") == "csv"
    (tmp_path / "y").write_text("\n".join([head, "some words here too", *rows, ""]))
    assert bc.sniff(tmp_path / "y") == "csv"
    (tmp_path / "z").write_text("\n".join([head, "some words here too", "and 3 numbers: 1 2 3"]))
    with pytest.raises(bc.FileFormatError, match="no known format"):
        bc.sniff(tmp_path / "z")
    (tmp_path / "z").rename(tmp_path / "z.dat")
    assert bc.sniff(tmp_path / "z.dat") == "csv"


def test_columns_by_number_units_and_quantities(tmp_path: Path) -> None:
    path = wrote(tmp_path, "# no header\n 0.5;0.1;0.6;0.4 ; 0.25\n0.5;0.1;0.7;0.4;0.5\n")
    given = {"theta_i": "1", "phi_i": "2", "theta_o": "3", "phi_o": "4", "value": "5", "angles": "rad", "mirror": 0}
    plain = rows_of(path, **given, quantity="f")
    assert plain.theta_o.tolist() == [0.6, 0.7]
    assert plain.delta_phi == pytest.approx(0.3 + np.pi - 2 * np.pi)
    assert plain.values[:, 0].tolist() == [0.25, 0.5]
    cosine = rows_of(path, **given, quantity="f_cos")
    assert cosine.values[:, 0] == pytest.approx([0.25 / np.cos(0.6), 0.5 / np.cos(0.7)])
    assert any("divided by cos(theta_o)" in text for text in cosine.done)
    assert rows_of(path, **given, quantity="pi_f").values[:, 0] == pytest.approx([0.25 / np.pi, 0.5 / np.pi])
    named = rows_of(path, **given, quantity="f", channels="550nm")
    assert (named.channels.kind, named.channels[0]) == ("wavelength", 550.0)


def test_wavelengths_in_rows_are_joined(tmp_path: Path) -> None:
    lines = [f"{w},{10 * k},0,{5 * k},20,{w * k}" for w in (0.5, 0.6) for k in range(1, 5)]
    given = {"theta_i": "i", "phi_i": "p", "theta_o": "o", "phi_o": "q", "value": "f", "wavelength": "w"}
    given |= {"wavelength_unit": "um", "angles": "deg", "quantity": "f"}
    m = rows_of(wrote(tmp_path, "\n".join(["w,i,p,o,q,f", *lines]) + "\n"), **given, mirror=180)
    assert m.channels == (500.0, 600.0)
    assert m.values.tolist() == [[0.5 * k, 0.6 * k] for k in range(1, 5)]
    with pytest.raises(bc.FileFormatError, match=r"line 5, wavelength: .* 1 of 2 wavelengths; 1 such"):
        rows_of(wrote(tmp_path, "\n".join(["w,i,p,o,q,f", *lines[:-1]]) + "\n"), **given, mirror=180)


def test_astm(tmp_path: Path) -> None:
    m = astm.measurements_of(wrote(tmp_path, ASTM, "m.astm"))
    assert m.channels == (500.0, 600.0)
    assert m.found["header"]["LAB_NAME"] == "A laboratory"
    assert m.delta_phi.tolist()[:3] == [0, 1.5, -3]
    assert m.values[0].tolist() == [0.11, 0.22]
    assert bc.sniff(tmp_path / "m.astm") == "astm"
    degrees = ASTM.replace("0.1,", "10,").replace("0.4,", "40,")
    with pytest.raises(bc.FileFormatError, match="angles=deg"):
        astm.measurements_of(wrote(tmp_path, degrees, "m.astm"))


@pytest.mark.parametrize(("format", "suffix"), first_fast(("astm", ".astm"), ("csv", ".csv")))
@pytest.mark.parametrize("two_sided", first_fast(False, True))
def test_written_and_read_to_the_same_bits(format: str, suffix: str, two_sided: bool, tmp_path: Path) -> None:
    made = goniometer.measured(goniometer.paint(), both_sides=two_sided, lights=3, viewers=4, turns=5)
    b = to_brdf(made)
    bc.write(b, tmp_path / f"a{suffix}")
    again = bc.read(tmp_path / f"a{suffix}")
    assert isinstance(again, bc.Table)
    assert (bc.sniff(tmp_path / f"a{suffix}"), again.id) == (format, b.id)
    bc.write(again, tmp_path / f"b{suffix}")
    assert (tmp_path / f"a{suffix}").read_text().split("\n")[3:] == (tmp_path / f"b{suffix}").read_text().split("\n")[
        3:
    ]


@pytest.mark.parametrize("suffix", [".astm", ".csv"])
def test_only_measurements_are_written(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(bc.InputError, match="tabulate it as 'scattered' first"):
        bc.write(bc.model("lambert"), tmp_path / f"m{suffix}")


def test_options_on_the_command_line(run: Run, tmp_path: Path) -> None:
    path = wrote(tmp_path, OWN.replace("_deg", "") + ROWS)
    assert "angles=deg or angles=rad" in run("info", str(path))[2]
    given = "theta_i=theta_i,theta_o=theta_o,delta_phi=delta_phi,value=[f_r_value],angles=deg,mirror=180,quantity=f"
    status, out, err = run("info", f"{path}:{given},holes=nearest,shape=[6,6,6]")
    assert (status, err) == (0, "")
    for text in (
        "nearest",
        "the reader's options",
        "file_bytes",
        "albedo",
        "coverage",
    ):
        assert text in out
    assert run("info", f"{path}:{given},hole=nearest")[0] == 2


# ---- what is refused --------------------------------------------------------------------------

HOSTILE: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "empty"),
    "blank": ("\n\n  \n", "empty"),
    "binary": (OWN.encode() + b"1,2,3,\0\1\2\n", "line 2: a zero byte"),
    "text in a number": (OWN + "10,20,30,abc\n", "line 2, f_r_value: 'abc' is no number"),
    "digit groups": (OWN + "1_0,20,30,1\n", "line 2, theta_i_deg: '1_0' is no number"),
    "nothing in a number": (OWN + "10,,30,1\n", "line 2, theta_o_deg: nothing is no number"),
    "a field too few": (OWN + ROWS + "10,20,30\n", "line 14, row: 3 fields; expected 4"),
    "a field too many": (OWN + "10,20,30,4,5\n", "line 2, row: 5 fields; expected 4"),
    "cut in the last number": (OWN + ROWS[:-2], "line 13: ends within a line"),
    "header only": (OWN, "line 1, rows: no rows after the header"),
    "past the horizon": (OWN + ROWS + "91,0,0,1\n", "line 14, theta_i: got 91"),
    "an infinite angle": (OWN + ROWS + "10,20,inf,1\n", "line 14, phi_o: got inf"),
    "no value": (OWN + "10,20,30,nan\n", "no usable row of 1"),
    "long line": (OWN + "1," * 100_000 + "\n", "line 2: 200001 bytes long"),
    "rows that lack": ("# BRDF measurements\n# rows: 13\n" + OWN + ROWS, "13 announced, 12 found"),
    "many columns": (",".join(f"c{k}" for k in range(9_000)) + "\n", "9000 columns"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_csv(name: str, tmp_path: Path) -> None:
    text, words = HOSTILE[name]
    path = wrote(tmp_path, text)
    with pytest.raises(bc.FileFormatError, match=re.escape(words)) as error:
        bc.read(path, "csv")
    assert path.name in error.value.detail


HOSTILE_ASTM = {
    "no VARS": ("LAB_NAME x\nNUM_POINTS 3\n", "no line VARS"),
    "no header": ("1,2,3\n", "line 1, header: '1,2,3'"),
    "too many announced": (ASTM.replace("12", "4294967296", 1), "more than"),
    "a wrong count": (ASTM.replace("12", "11", 1), "line 16, NUM_POINTS: more rows than the 11 announced"),
    "fewer than announced": (ASTM.rsplit("0.4", 1)[0], "12 announced, 11 rows found"),
    "no count": (ASTM.replace("12", "many", 1), "line 2, NUM_POINTS: 'many'"),
    "twice": ("LAB_NAME x\n" + ASTM, "line 2, LAB_NAME: given twice"),
    "no angles": (ASTM.replace("theta_s", "theta"), "no column theta_s"),
    "a column twice": (ASTM.replace("600nm", "500nm"), "without a name or twice"),
    "no values": ("VARS theta_i,phi_i,theta_s,phi_s\n0,0,0,0\n", "no column of values"),
    "no rows": (ASTM.split("\n\n")[0].replace("12", "0", 1) + "\n\n", "no rows after VARS"),
    "a wavelength of 0": (ASTM.replace("500nm", "0nm"), "line 3, VARS"),
    "a name of strange bytes": (ASTM.replace("500nm", "\x1b[31m"), "line 3"),
}


@pytest.mark.parametrize("name", HOSTILE_ASTM)
def test_hostile_astm(name: str, tmp_path: Path) -> None:
    text, words = HOSTILE_ASTM[name]
    if name == "a name of strange bytes":  # names need not be wavelengths
        assert len(astm.measurements_of(wrote(tmp_path, text, "m.astm"))) == 12
        return
    with pytest.raises(bc.FileFormatError, match=re.escape(words)) as error:
        astm.measurements_of(wrote(tmp_path, text, "m.astm"))
    assert "m.astm" in error.value.detail


@pytest.mark.parametrize("kind", ["csv", "astm"])
def test_cut_at_every_byte(kind: str, tmp_path: Path) -> None:
    """A file that says how many rows it has is never read in part."""
    text = ASTM if kind == "astm" else "# BRDF measurements\n# rows: 12\n" + OWN + ROWS
    for cut in range(len(text) - 1):
        path = wrote(tmp_path, text[:cut], f"cut.{kind}")
        with pytest.raises(bc.FileFormatError, match="cut"):
            rows_of(path) if kind == "csv" else astm.measurements_of(path)


@pytest.mark.parametrize("kind", ["csv", "astm"])
def test_memory_and_time_of_the_worst(kind: str, tmp_path: Path) -> None:
    """Millions of numbers on few lines, or lines of nothing: refused within a second and 200 MB."""
    for text in (b"1,2,3,4\n" * 2_000_000, b"\n" * 4_000_000 + b"x", b"1,1\n" + b"9" * 8_000_000):
        head = b"" if kind == "csv" else b"VARS theta_i,phi_i,theta_s,500nm\n"
        path = wrote(tmp_path, head + text, f"big.{kind}")
        before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
        with pytest.raises(bc.BrdfError):
            rows_of(path) if kind == "csv" else astm.measurements_of(path)
        assert time.process_time() - start < 2  # of one core, beside other work
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


def read_or_refused(path: Path, kind: str) -> Measurements | None:
    """The rows; None if the file is refused with an error that names it and prints on any terminal."""
    refused: bc.FileFormatError | None = None
    try:
        return rows_of(path) if kind == "csv" else astm.measurements_of(path)
    except bc.FileFormatError as error:
        refused = error
    assert path.name in refused.detail
    assert refused.detail.isprintable(), refused.detail
    return None


ANY_TEXT = st.lists(
    st.lists(
        st.one_of(
            st.sampled_from(["theta_i_deg", "theta_o_deg", "delta_phi_deg", "f_r_x", "VARS", "NUM_POINTS", "#", "nan"]),
            st.floats().map(repr), st.integers(-400, 400).map(str), st.text(max_size=4),
        ),
        max_size=6,
    ).map(lambda cells: ",".join(cells)),
    max_size=8,
).map("\n".join)  # fmt: skip


@pytest.mark.parametrize("kind", ["csv", "astm"])
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=ANY_TEXT, own=st.booleans(), breaks=st.sampled_from(["\n", "\r\n", ""]))
def test_any_text_is_read_or_refused(kind: str, text: str, own: bool, breaks: str, tmp_path: Path) -> None:
    head = (OWN if kind == "csv" else "VARS theta_i,phi_i,theta_s,phi_s,500nm\n") if own else ""
    path = wrote(tmp_path, (head + text + breaks).encode("utf-8", "surrogatepass"), f"any.{kind}")
    m = read_or_refused(path, kind)
    if m is None:
        return
    assert np.isfinite(m.values).all()
    assert ((m.theta_i >= 0) & (m.theta_i <= np.pi / 2) & (m.theta_o <= np.pi / 2)).all()


@pytest.mark.parametrize("kind", ["csv", "astm"])
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(places=st.lists(st.tuples(st.integers(0, 10_000), st.binary(max_size=3)), min_size=1, max_size=4))
def test_changed_bytes_are_read_or_refused(kind: str, places: list[tuple[int, bytes]], tmp_path: Path) -> None:
    data = bytearray((ASTM if kind == "astm" else OWN + ROWS).encode())
    for place, new in places:
        at = place % len(data)
        data[at : at + 1] = new
    read_or_refused(wrote(tmp_path, bytes(data), f"any.{kind}"), kind)


def test_the_options_of_the_real_files_are_complete() -> None:
    for options in (PTFE, SOLAR_ARRAY):
        resolve("csv", csv_file.CsvFormat.PARAMETERS, options)
