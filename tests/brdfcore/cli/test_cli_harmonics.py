"""`brdf harmonics`: numbers, tables, pictures, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import brdfcore as bc
from tests.brdfcore.conftest import Run

SOURCE = "oren_nayar:sigma=0.4"


def test_text_and_json_say_the_same(run: Run) -> None:
    code, out, err = run("harmonics", SOURCE, "--lmax", 6)
    assert (code, err) == (0, "")
    told = json.loads(run("harmonics", SOURCE, "--lmax", 6, "--json")[1])
    made = bc.project(bc.model("oren_nayar", sigma=0.4), 6)
    assert told["truncation"] == made.report["harmonics"]["truncation"]
    assert told["error_by_degree"] == made.report["harmonics"]["by_degree"]
    assert told["bytes"] == made.nbytes
    assert sum(told["spectrum"]["light"]) == pytest.approx(1, rel=1e-12)
    assert f"{told['truncation']['target']:.4g}" in out
    assert f"{told['truncation']['f']:.4g}" in out
    assert "degree 6 of f_cos_cos" in out


def test_tolerance_finds_the_degree(run: Run) -> None:
    told = json.loads(run("harmonics", SOURCE, "--tolerance", 0.02, "--json")[1])
    assert told["truncation"]["target"] <= 0.02 < told["error_by_degree"][told["lmax"] - 1]
    code, _, err = run("harmonics", SOURCE, "--lmax", 2, "--tolerance", 1e-6)
    assert code == 2
    assert "tolerance" in err


def test_tables_and_pictures(run: Run, tmp_path: Path) -> None:
    table = tmp_path / "on.h5"
    assert run("harmonics", SOURCE, "--lmax", 5, "-o", table)[0] == 0
    opened = bc.open_table(table)
    assert isinstance(opened, bc.HarmonicExpansion)
    assert opened.lmax == 5
    assert (
        bc.harmonic_summary(opened)["error_by_degree"]
        == bc.project(bc.model("oren_nayar", sigma=0.4), 5).report["harmonics"]["by_degree"]
    )
    code, _, err = run("harmonics", SOURCE, "--lmax", 5, "-o", table)
    assert code == 1
    assert "--force" in err
    for name, begins in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml")):
        for _ in range(2):  # a picture is replaced
            code, _, _ = run("harmonics", SOURCE, "--lmax", 5, "--window", "hann", "-o", tmp_path / name)
            assert code == 0
        assert (tmp_path / name).read_bytes().startswith(begins)


def test_equal_pictures_are_equal_bytes_and_say_what_they_show() -> None:
    b = bc.model("cook_torrance", roughness=0.3)
    made = bc.project(b, 8)
    first, second = (bc.plot.render(bc.plot.expansion(b, made, 0.5), "svg") for _ in range(2))
    assert first == second
    figure = bc.plot.expansion(b, made, [0.0, 0.5, 1.0, 1.5])
    said = " ".join(t.get_text() for axes in figure.axes for t in (*axes.texts, axes.title, axes.xaxis.label))
    assert "degree 8" in said
    assert "the least fᵣ is" in said
    legend = [t.get_text() for t in figure.legends[0].get_texts()]
    assert legend == ["difference", "original", "degree 8", "negative: ringing"]


def test_a_mirror_has_a_picture_without_curves(run: Run, tmp_path: Path) -> None:
    assert run("harmonics", "mirror", "--lmax", 3, "-o", tmp_path / "m.png")[0] == 0


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--lmax", "0"], 2, "--lmax"),
        (["--lmax", "1025"], 2, "1024"),
        (["--lmax", "4", "--target", "g"], 2, "f_cos_cos"),
        (["--lmax", "4", "--window", "boxcar"], 2, "lanczos"),
        (["--lmax", "4", "-o", "x.pdf"], 2, ".png"),
        (["--lmax", "4", "--theta-i", "95", "-o", "x.png"], 2, "theta_i"),
        (["--lmax", "4", "--theta-i", "1,2,3,4,5", "-o", "x.png"], 2, "1 to 4"),
        (["--lmax", "4", "--channel", "Q", "-o", "x.png"], 2, "Q"),
        (["--tolerance", "-1"], 2, "tolerance"),
        (["--lmax", "4", "-o", "no/such/x.png"], 1, "no such folder"),
    ],
    ids=lambda v: "_".join(v) if isinstance(v, list) else "",
)
def test_refusals(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], code: int, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    got, out, err = run("harmonics", SOURCE, *options)
    assert (got, out) == (code, "")
    assert said in err
    assert not list(tmp_path.iterdir())
