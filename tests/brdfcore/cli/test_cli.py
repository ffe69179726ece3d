"""The shell: looking at materials, exit codes, pipes, help; no traceback for anyone's mistake."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import cli
from brdfcore.cli import arguments as words
from brdfcore.cli import output
from tests.brdfcore.conftest import GOLD, Run, shell

# ---- the SOURCE grammar and other arguments ------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "name", "parameters"),
    [
        ("lambert", "lambert", {}),
        ("lambert:", "lambert", {}),
        ("lambert:reflectance=0.25", "lambert", {"reflectance": 0.25}),
        ("lambert: reflectance = [0.1, 2e-1,.3]", "lambert", {"reflectance": [0.1, 0.2, 0.3]}),
        ("cook_torrance:alpha=0.3,ior=gold", "cook_torrance", {"roughness": 0.3, "ior": "gold"}),
        ("cook_torrance:ior=(0.37,2.82)", "cook_torrance", {"ior": (0.37, 2.82)}),
        ("cook_torrance:ior=0.37+2.82i", "cook_torrance", {"ior": 0.37 + 2.82j}),
        ("cook_torrance:ior=[gold,(1.5,0),1.5],masking=smith", "cook_torrance", None),
    ],
)
def test_source_is_the_model(source: str, name: str, parameters: dict[str, Any] | None) -> None:
    b = words.load(source)
    assert b.metadata["model"] == name
    if parameters is not None:
        assert b.describe() == bc.model(name, **parameters).describe()


@pytest.mark.parametrize(
    ("source", "code", "words"),
    [
        ("cook_torance", "unknown_model", "cook_torrance"),
        ("nosuch:roughness=1", "unknown_model", "Known"),
        ("lambert:rho=1", "unknown_parameter", "reflectance"),
        ("lambert:reflectance=3", "bad_parameter", "[0, 1]"),
        ("lambert:reflectance", "bad_source", "parameter=value"),
        ("lambert:reflectance=", "bad_source", "no value"),
        ("lambert:=1", "bad_source", "parameter=value"),
        ("lambert:reflectance=1,reflectance=1", "bad_source", "twice"),
        ("lambert:reflectance=[0.1,0.2", "bad_source", "brackets"),
        ("lambert:reflectance=" + "[" * 5000 + "]" * 5000, "bad_source", "brackets"),
        ("lambert:reflectance=)(", "bad_source", "brackets"),
        ("no/such/file.bsdf", "cannot_open", "no such file"),
        ("missing.h5", "cannot_open", "no such file"),
        (".", "cannot_open", "folder"),
    ],
)
def test_bad_sources_explain_themselves(run: Run, source: str, code: str, words: str) -> None:
    status, out, err = run("info", source, "--json")
    error = json.loads(err)["error"]
    assert (error["code"], out) == (code, "")
    assert words in error["detail"]
    assert status == (1 if code == "cannot_open" else 2)
    status, out, err = run("info", source)
    assert err.startswith("error: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "count"),
    [("4500000", 4_500_000), ("4.5MB", 4_500_000), ("4.5 mb", 4_500_000), ("1KiB", 1024), ("2G", 2e9)],
)
def test_byte_counts(text: str, count: int) -> None:
    assert words.byte_count("--max-bytes", text) == count


@pytest.mark.parametrize("text", ["", "MB", "4zB", "-1", "1.2.3MB"])
def test_bad_byte_counts(text: str) -> None:
    with pytest.raises(bc.InputError, match="expected bytes"):
        words.byte_count("--max-bytes", text)


# ---- models, info --------------------------------------------------------------------------------


def test_models_reads_the_registry(run: Run) -> None:
    code, out, _ = run("models")
    assert code == 0
    for name, parameters in bc.models().items():
        assert name in out
        assert all(p.name in out and p.meaning in out for p in parameters)
    code, out, _ = run("models", "lambert")
    assert "cook_torrance" not in out
    listed = json.loads(run("models", "--json")[1])["models"]
    assert [m["name"] for m in listed] == list(bc.models())
    assert {p["name"] for p in listed[0]["parameters"]} == {p.name for p in bc.models()[listed[0]["name"]]}


def test_models_all_lists_representations_and_formats(run: Run) -> None:
    found = json.loads(run("models", "--all", "--json")[1])
    assert [r["name"] for r in found["representations"]] == list(bc.representations())
    assert [f["name"] for f in found["formats"]] == list(bc.formats())
    assert "angle_grid" in run("models", "--all")[1]


def test_info_of_a_table(run: Run, gold_table: Path) -> None:
    table = bc.open_table(gold_table)
    code, out, _ = run("info", gold_table, "--json")
    found = json.loads(out)
    assert code == 0
    assert found["id"] == table.id
    assert found["nbytes"] == table.nbytes
    assert found["error"]["l1"] == table.error["l1"]
    assert found["file_bytes"] == gold_table.stat().st_size
    text = run("info", gold_table)[1]
    assert table.id in text
    assert "of the reflected energy is misplaced" in text


def test_info_of_a_model(run: Run) -> None:
    code, out, _ = run("info", "lambert:reflectance=0.25")
    assert code == 0
    assert "0.25" in out
    assert json.loads(run("info", "mirror:reflectance=1", "--json")[1])["has_delta"] is True


# ---- eval ----------------------------------------------------------------------------------------


def test_eval_prints_what_python_computes(run: Run) -> None:
    b = bc.model("cook_torrance", roughness=0.3, ior="gold")
    expected = b.evaluate(np.radians([30.0, 45.0]), np.radians(30.0), np.radians(180.0))
    typed = ("eval", GOLD, "--theta-i", "30,45", "--theta-o", "30", "--delta-phi", "180")
    code, out, err = run(*typed, "--json")
    found = json.loads(out)
    assert (code, err) == (0, "")
    assert found["values"] == expected.tolist()
    assert (found["unit"], found["angles"], found["theta_o"]) == ("1/sr", "deg", [30.0, 30.0])
    rows = [line.split() for line in run(*typed)[1].splitlines()]
    assert rows[0] == ["theta_i_deg", "theta_o_deg", "delta_phi_deg", "f_r_value"]
    assert [float(r[3]) for r in rows[1:]] == expected[:, 0].tolist()
    rows = [line.split(",") for line in run(*typed, "--csv", "--status")[1].splitlines()]
    assert [float(r[3]) for r in rows[1:]] == expected[:, 0].tolist()
    assert [r[4] for r in rows] == ["status", "measured", "measured"]
    rows = [line.split(",") for line in run(*typed, "--csv", "--uncertainty")[1].splitlines()]
    assert [r[4] for r in rows] == ["u_value", "0.0", "0.0"]  # a formula


def test_eval_in_radians(run: Run) -> None:
    b = bc.model("cook_torrance", roughness=0.3, ior="gold")
    typed = ("--theta-i", "0.5", "--theta-o", "0.25,1.5", "--delta-phi=-3", "--angles", "rad", "--json")
    found = json.loads(run("eval", GOLD, *typed)[1])
    assert found["values"] == b.evaluate(0.5, [0.25, 1.5], -3.0).tolist()


def test_eval_of_a_table_and_negative_angles(run: Run, gold_table: Path) -> None:
    table = bc.open_table(gold_table)
    found = json.loads(run("eval", gold_table, "--theta-i", "90", "--theta-o", "0", "--delta-phi", "-30", "--json")[1])
    assert found["values"] == table.evaluate([np.pi / 2], 0.0, np.radians(-30.0)).tolist()


@pytest.mark.parametrize(
    "text",
    [
        "10,20,30\n40,50,60\n",
        "# a comment\n10 20 30  # another\n\n40\t50  60\n",
        "theta_i_deg;theta_o_deg;delta_phi_deg\n10;20;30\n40;50;60\n",
        "\ufefffile,delta_phi,theta_o,theta_i\n1,30,20,10\n2,60,50,40\n",
    ],
)
def test_eval_from_a_file(run: Run, tmp_path: Path, text: str) -> None:
    file = tmp_path / "directions.csv"
    file.write_text(text, encoding="utf-8")
    found = json.loads(run("eval", GOLD, "--input", file, "--json")[1])
    b = bc.model("cook_torrance", roughness=0.3, ior="gold")
    assert found["values"] == b.evaluate(*np.radians([[10.0, 40.0], [20.0, 50.0], [30.0, 60.0]])).tolist()


def test_eval_of_a_slice_file(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "slice.csv"
    assert run("plot", GOLD, "-o", file, "--theta-i", "40")[0] == 0
    code, out, _ = run("eval", GOLD, "--input", file, "--csv")
    written = [x for x in file.read_text().splitlines() if not x.startswith("#")]
    assert code == 0
    assert [x.split(",")[-1] for x in out.splitlines()] == [x.split(",")[-1] for x in written]


def test_eval_from_stdin(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("10 20 30\n"))
    assert run("eval", "lambert", "--input", "-")[0] == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no directions"),
        ("1,2\n", "line 1: expected 3 numbers"),
        ("1,2,3\n1,2,x\n", "line 2"),
        ("a,b,c\n1,2,3\n", "theta_i"),
        ("theta_i_rad,theta_o_rad,delta_phi_rad\n1,1,1\n", "--angles rad"),
        ("1,2,3\nnan,2,3\n", "theta_i[1] = nan"),
    ],
)
def test_bad_files_of_directions(run: Run, tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "directions.csv"
    file.write_text(text)
    code, out, err = run("eval", "lambert", "--input", file)
    assert code in (1, 2)
    assert out == ""
    assert words in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--theta-i", "30,95", "--theta-o", "1", "--delta-phi", "1"), "theta_i[1] = 95.0 is outside 0 to 90"),
        (("--theta-i", "nan", "--theta-o", "1", "--delta-phi", "1"), "theta_i[0] = nan"),
        (("--theta-i", "1", "--theta-o", "1", "--delta-phi", "inf"), "delta_phi[0] = inf"),
        (("--theta-i", "30", "--theta-o", "1", "--delta-phi", "1", "--angles", "rad"), "0 to pi/2"),
        (("--theta-i", "1,2", "--theta-o", "1,2,3", "--delta-phi", "1"), "do not broadcast"),
        (("--theta-i", "a", "--theta-o", "1", "--delta-phi", "1"), "--theta-i = 'a'"),
        (("--theta-i", "1"), "missing --theta-o, --delta-phi"),
        (("--theta-i", "1", "--input", "x.csv"), "leave them out"),
        (("--input", "missing.csv"), "No such file"),
    ],
)
def test_bad_directions(run: Run, arguments: tuple[str, ...], words: str) -> None:
    code, out, err = run("eval", "lambert", *arguments)
    assert code == (1 if "missing.csv" in arguments else 2)
    assert out == ""
    assert words in err


# ---- the process: exit codes, pipes, help --------------------------------------------------------


def test_usage_errors(run: Run) -> None:
    code, out, err = run("evl")
    assert (code, out) == (2, "")
    assert "eval" in err
    assert run("eval", "lambert", "--bogus")[0] == 2
    assert run("tabulate", "lambert")[0] == 2
    code, _, err = run("eval", "lambert", "--bogus", "--json")
    assert json.loads(err)["error"]["code"] == "usage"
    assert code == 2


def test_version(run: Run) -> None:
    assert run("--version") == (0, f"brdf {bc.__version__}\n", "")


@pytest.mark.parametrize(
    "command", ["models", "info", "tabulate", "eval", "plot", "convert", "serve", "report", "plan"]
)
def test_help_teaches_by_example(run: Run, command: str) -> None:
    code, out, err = run(command, "--help")
    assert (code, err) == (0, "")
    examples = [line for line in out.splitlines() if line.strip().startswith(f"brdf {command}")]
    assert len(examples) >= 2
    assert "\x1b" not in out
    root = run("--help")[1]
    assert command in root
    assert "cook_torrance:roughness=0.1,ior=gold" in root


def test_an_unexpected_error_is_a_line_and_a_traceback_on_request(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr(words, "load", broken)
    assert cli.main(["info", "lambert"]) == 1
    err = capsys.readouterr().err
    assert "boom" in err
    assert "Traceback" not in err
    assert cli.main(["info", "lambert", "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_interrupted(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(words, "load", stopped)
    code, out, _ = run("info", "lambert")
    assert (code, out) == (130, "")


def test_without_typer_the_extra_is_named() -> None:
    code = "import sys; sys.modules['typer'] = None; from brdfcore.cli import main; sys.exit(main(['models']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert "brdf-tables[core]" in done.stderr
    assert done.stderr.count("\n") == 1


def test_as_a_process() -> None:
    done = shell("eval", "lambert:reflectance=0.7", "--theta-i", "1", "--theta-o", "2", "--delta-phi", "3")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[1].split()[-1] == repr(
        bc.model("lambert", reflectance=0.7).evaluate(0, 0, 0)[0].item()
    )


@pytest.mark.skipif(os.name != "posix", reason="pipes of the shell")
def test_a_closed_pipe_is_quiet() -> None:
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed:
        done = subprocess.run(
            [sys.executable, "-m", "brdfcore.cli", "models"],
            stdout=closed,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode in (1, 141)
    assert done.stderr == ""


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_leaves_no_traceback_and_no_file(tmp_path: Path) -> None:
    code = (
        "import signal, sys, brdfcore.build.tabulate as build\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # ignored where a shell started us by `&`
        "def tabulate(*a, **k):\n"
        "    print('started', flush=True)\n"
        "    import time; time.sleep(20)\n"
        "build.tabulate = tabulate\n"
        f"from brdfcore.cli import main; sys.exit(main(['tabulate', 'lambert', '-o', {str(tmp_path / 'x.h5')!r}]))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        start = time.monotonic()
        process.send_signal(signal.SIGINT)
        try:
            _, err = process.communicate(timeout=15)
        finally:
            process.kill()
    assert time.monotonic() - start < 10
    assert process.returncode == 130
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


# ---- words ---------------------------------------------------------------------------------------


def test_errors_in_plain_words() -> None:
    error = {
        "l1": 0.3,
        "l1_stderr": 0.004,
        "albedo_bias": {"theta_i": [0.0, np.pi / 3], "bias": [0.01, -0.2]},
        "log_ratio": {"p99": np.log(2), "max": 5000.0},
        "nan": 2,
        "values": 10,
        "directions": 200_000,
        "seed": 1,
    }
    text = "\n".join(output.error_lines(error))
    for phrase in ("30 % ± 0.4 %", "-20 % at its worst angle, theta_i = 60 degrees", "factor 2;", "2 of 10", "> 1e130"):
        assert phrase in text
    assert "mirror part" not in text
    assert "mirror part      0.02 of the light" in "\n".join(output.error_lines({**error, "delta": 0.02}))
    assert "mirror part      0 of the light" in "\n".join(output.error_lines({**error, "delta": 0.0}, has_delta=True))
    no_light, not_finite = ({"l1": None, "regular": regular} for regular in (False, True))
    assert "no regular part" in "\n".join(output.error_lines(no_light))
    assert "not finite" in "\n".join(output.error_lines(not_finite))
    assert "none recorded" in next(output.error_lines({}))
    assert "no regular part" in "\n".join(output.error_lines({"l1": None, "directions": 1, "seed": 1}))
