"""The shell: the commands that make something: tabulate, convert, plot, serve."""

from __future__ import annotations

import json
import socket
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import brdfcore as bc
from brdfcore.cli import arguments as words
from tests.brdfcore.conftest import GOLD, Run, shell

# ---- tabulate, convert ---------------------------------------------------------------------------


def test_tabulate_says_how_good_the_table_is(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "gold.h5"
    code, text, err = run("tabulate", GOLD, "-o", out, "--representation", "angle_grid", "--shape", "31,31,61")
    table = bc.open_table(out)
    assert code == 0
    assert table.id in text
    assert str(table.nbytes) in text
    for phrase in ("of the reflected energy is misplaced", "±", "albedo bias", "p99 log ratio"):
        assert phrase in text
    assert all(f"warning: {w}" in err for w in table.error["warnings"])


def test_tabulate_warns_of_a_bad_table(run: Run, tmp_path: Path) -> None:
    sharp = "cook_torrance:roughness=0.01,ior=gold"
    code, text, err = run("tabulate", sharp, "-o", tmp_path / "bad.h5", "--shape", "10,10,19")
    assert code == 0
    assert "misplaces" in err
    assert "try representation lobe_grid" in err
    assert "vndf_warp" not in err  # it holds measured files only
    assert "misplaced" in text


def test_tabulate_json(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "white.h5"
    code, text, _ = run(
        "tabulate", "lambert:reflectance=[1,0.5,0.2]", "-o", out, "--max-bytes", "100kB",
        "--representation", "angle_grid", "--negatives", "zero", "--fold", "bilateral,reciprocal", "--json",
    )  # fmt: skip
    found = json.loads(text)
    assert code == 0
    assert found["id"] == bc.open_table(out).id
    assert found["nbytes"] <= 100_000
    assert found["error"]["l1"] < 1e-6


def test_tabulate_for_the_angles_seen(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "seen.h5"
    asked = ("tabulate", GOLD, "-o", out, "--representation", "half_difference", "--max-bytes", "8kB")
    code, text, _ = run(*asked, "--light", "0,60", "--view", "20,70", "--json")
    assert code == 0
    assert json.loads(text)["error"]["view"] == list(np.radians([20.0, 70.0]))
    assert bc.open_table(out).attributes()["light"] == list(np.radians([0.0, 60.0]))
    for bad in ("70,20", "20", "0,91", "a,b", "nan,3"):
        code, _, err = run(*asked, "--force", "--view", bad)
        assert code == 2
        assert "--view" in err


def test_tabulate_replaces_only_when_forced(run: Run, gold_table: Path, tmp_path: Path) -> None:
    out = tmp_path / "copy.h5"
    out.write_bytes(b"old")
    command = ("tabulate", "lambert", "-o", out, "--representation", "angle_grid", "--shape", "4,4,5")
    code, _, err = run(*command)
    assert code == 1
    assert "--force" in err
    assert out.read_bytes() == b"old"
    assert run(*command, "--force")[0] == 0
    assert bc.open_table(out).channels == ("value",)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--shape", "4,4,5", "--tolerance", "0.1"),
        ("--shape", "4.5,4,5"),
        ("--shape", "x"),
        ("--shape", "1000000,1000000,1000000"),
        ("--tolerance", "-1"),
        ("--tolerance", "x"),
        ("--max-bytes", "1"),
        ("--representation", "nosuch"),
        ("--negatives", "drop"),
        ("--fold", "sideways"),
        ("--representation", "angle_grid", "--interpolation", "quintic", "--shape", "4,4,5"),
    ],
)
def test_bad_options_of_tabulate(run: Run, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    code, out, err = run("tabulate", "lambert", "-o", tmp_path / "x.h5", *arguments)
    assert (code, out) == (2, "")
    assert "rror: " in err
    assert "internal" not in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("interpolation", ["nearest", "monotone_cubic"])
def test_tabulate_with_an_interpolation(run: Run, tmp_path: Path, interpolation: str) -> None:
    for representation in ("angle_grid", "half_angle_grid"):
        out = tmp_path / f"{representation}.h5"
        code, _, err = run(
            "tabulate", GOLD, "-o", out, "--representation", representation, "--shape", "12,12,24",
            "--interpolation", interpolation,
        )  # fmt: skip
        assert code == 0, err
        assert bc.open_table(out).attributes()["interpolation"] == interpolation
    code, listed, _ = run("models", "--all", "half_angle_grid")
    assert code == 0
    for phrase in ("nearest", "linear", "monotone_cubic", "MERL"):
        assert phrase in listed


def test_convert_says_what_is_lost(run: Run, tmp_path: Path) -> None:
    assert (
        run("tabulate", GOLD, "-o", tmp_path / "g.h5", "--representation", "half_angle_grid", "--shape", "9,8,10")[0]
        == 0
    )
    code, text, err = run("convert", tmp_path / "g.h5", tmp_path / "g.binary")
    assert code == 0
    assert "warning: one channel, written three times" in err
    assert "9 x 8 x 10 cells" in err
    assert "round trip" in text
    code, text, _ = run("convert", tmp_path / "g.h5", tmp_path / "g.binary", "--force", "--json")
    found = json.loads(text)
    assert len(found["losses"]) == 2
    assert found["round_trip"]["l1"] < 1e-6
    code, text, _ = run("info", tmp_path / "g.binary")
    assert code == 0
    assert "merl" in text
    assert "invalid cells" in text


def test_convert_reports_the_round_trip(run: Run, gold_table: Path, tmp_path: Path) -> None:
    out = tmp_path / "copy.h5"
    code, text, _ = run("convert", gold_table, out)
    assert code == 0
    assert "is the same" in text
    assert run("convert", gold_table, out)[0] == 1
    found = json.loads(run("convert", gold_table, out, "--force", "--json")[1])
    assert found["round_trip"]["l1"] == 0
    code, _, err = run("convert", "lambert", tmp_path / "x.h5")
    assert code == 2
    assert "tabulate" in err


# ---- plot ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", ["polar", "hemisphere"])
def test_plot_png_and_svg(run: Run, gold_table: Path, tmp_path: Path, view: str) -> None:
    file = tmp_path / "gold.png"
    code, out, err = run("plot", gold_table, "-o", file, "--view", view, "--scale", "log", "--dpi", "100")
    assert (code, out, err) == (0, f"{file}\n", "")
    with Image.open(file) as image:
        assert image.size == ((640, 460) if view == "polar" else (600, 490))
    file = tmp_path / "gold.svg"
    assert run("plot", gold_table, "-o", file, "--view", view, "--theta-i", "45", "--title", "$ <x>")[0] == 0
    assert b"</svg>" in file.read_bytes()


def test_plot_several_and_data(run: Run, gold_table: Path, tmp_path: Path) -> None:
    assert run("plot", gold_table, GOLD, "-o", tmp_path / "both.png", "--channel", "value")[0] == 0
    assert run("plot", GOLD, "-o", tmp_path / "gold.json", "--angles", "rad", "--theta-i", "0.5")[0] == 0
    data = json.loads((tmp_path / "gold.json").read_text())
    assert data["theta_i"] == [0.5]
    assert data["values"] == bc.slice(words.load(GOLD), 0.5).values.tolist()


@pytest.mark.parametrize(
    "arguments",
    [
        ("lambert", "-o", "x.pdf"),
        ("lambert", "-o", "x.png", "--channel", "Q"),
        ("lambert", "-o", "x.png", "--theta-i", "91"),
        ("lambert", "-o", "x.png", "--theta-i", "0,1,2,3,4,5,6,7,8,9,10,11,12"),
        ("lambert", "-o", "x.png", "--view", "hemisphere", "--theta-i", "1,2"),
        ("lambert", "-o", "x.png", "--scale", "cubic"),
        ("lambert", "-o", "x.png", "--dpi", "1e9"),
        ("lambert", "lambert:reflectance=1", "-o", "x.csv"),
    ],
)
def test_bad_options_of_plot(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run("plot", *arguments)
    assert (code, out) == (2, "")
    assert "rror: " in err
    assert "internal" not in err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there(run: Run, tmp_path: Path) -> None:
    for command in (("plot", "lambert", "-o"), ("tabulate", "lambert", "-o"), ("convert", "lambert")):
        code, _, err = run(*command, tmp_path / "no" / "x.png")
        assert code == 1
        assert err.startswith("error: ")


# ---- serve ---------------------------------------------------------------------------------------


def test_serve_hands_over_its_settings(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    got: dict[str, Any] = {}

    class Service:
        @staticmethod
        def serve(**settings: Any) -> int:
            got.update(settings)
            return 3

    monkeypatch.setitem(sys.modules, "brdf_service.main", Service)
    assert run("serve", "--port", "0", "--data", "x", "--no-starter", "--cache-bytes", "1MiB")[0] == 3
    assert {k: v for k, v in got.items() if v is not None} == {
        "port": 0,
        "data": Path("x"),
        "starter": False,
        "cache_bytes": 2**20,
    }


def test_serve_without_its_extra(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [n for n in sys.modules if n.partition(".")[0] == "brdf_service"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "fastapi", None)
    code, _, err = run("serve")
    assert code == 1
    assert "brdf-tables[service]" in err


def test_serve_on_a_taken_port(tmp_path: Path) -> None:
    pytest.importorskip("fastapi")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = shell("serve", "--port", str(port), "--data", str(tmp_path), "--no-starter", timeout=30)
    assert done.returncode == 1
    assert str(port) in done.stderr
    assert "Traceback" not in done.stderr
