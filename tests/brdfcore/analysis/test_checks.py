"""Checks against defects of known size, and the page."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.analysis.check.checks import FAILS_ABOVE, check
from brdfcore.analysis.check.findings import CheckReport
from brdfcore.base.channels import Channels
from brdfcore.base.errors import InputError
from tests.brdfcore.analysis.test_gloss import Of
from tests.shared import needs_shared, rgl_path
from tests.support.sources import Skewed

NAMES = ["energy", "reciprocity", "positivity", "bilateral", "normal", "horizon"]
FREE = {"bilateral": False, "reciprocal": False, "energy_conserving": False, "non_negative": False}


def verdicts(report: CheckReport) -> dict[str, str]:
    return {f.name: f.verdict for f in report.findings}


def test_a_lambertian_passes_everything() -> None:
    report = check(bc.model("lambert", reflectance=[0.5, 0.25, 0.125]), directions=2_000)
    assert verdicts(report) == dict.fromkeys(NAMES, "pass")
    assert report.passed
    assert report["energy"].value == pytest.approx(-0.5, abs=1e-6)
    assert report["energy"].by_channel == pytest.approx([-0.5, -0.75, -0.875], abs=1e-6)
    assert report.albedo == pytest.approx((0.5 + 0.25 + 0.125) / 3, rel=1e-6)
    for name in ("reciprocity", "positivity", "bilateral", "normal"):
        assert (report[name].value, report[name].error) == (0.0, 0.0)
    # what a Lambertian sends between 89 and 90 degrees, rho cos^2(89 degrees)
    assert report["horizon"].value == pytest.approx(0.5 * np.cos(np.radians(89)) ** 2, rel=1e-6)


@pytest.mark.parametrize("name", ["cook_torrance", "ggx", "ward", "blinn_phong", "phong", "oren_nayar", "mirror"])
def test_models_keep_their_word(name: str) -> None:
    report = check(bc.model(name), directions=4_000)
    assert report.verdict == "pass", str(report)


# ---- defects of known size -----------------------------------------------------------------------

A, E = 0.5, 0.9
KNOWN = {
    # f(i,o) - f(o,i) = A E (c_i - c_o)/pi; int int |x - y| x y dx dy = 1/15 over the unit square, times 4
    "reciprocity": (lambda i, o, d: A / np.pi * (1 + E * np.cos(i)), 4 * A * E / 15),
    # -A/pi beyond 60 degrees: cos^2(60) of a Lambertian's light
    "positivity": (lambda i, o, d: A / np.pi * np.where(o > np.pi / 3, -1.0, 1.0), A / 4),
    # 2 A E/pi |sin d| s_i s_o: (2 pi/3)^2 from both sines, 2/pi from the azimuth
    "bilateral": (lambda i, o, d: A / np.pi * (1 + E * np.sin(d) * np.sin(i) * np.sin(o)), 16 * A * E / (9 * np.pi)),
    # the mean of |cos| is 2/pi
    "normal": (lambda i, o, d: A / np.pi * (1 + E * np.cos(d)), A * E * 2 / np.pi),
}


@pytest.mark.parametrize("name", KNOWN)
def test_defects_of_known_size(name: str) -> None:
    f, exact = KNOWN[name]
    report = check(Of(f, **FREE))
    found = report[name]
    if name == "normal":  # 32 azimuths
        assert found.value == pytest.approx(exact, rel=5e-3)
    else:
        assert 0 < found.error < 0.02 * exact
        assert abs(found.value - exact) < 4 * found.error
    assert found.verdict == "fail"
    assert found.found is False
    assert found.worst
    for other in ("energy", "horizon"):
        assert report[other].verdict == "pass"


def test_the_standard_error_is_one() -> None:
    """Over seeds the estimates scatter as their standard errors say, and about the truth."""
    f, exact = KNOWN["bilateral"]
    found = [check(Of(f, **FREE), directions=500, seed=s)["bilateral"] for s in range(14)]
    pulls = np.array([(x.value - exact) / x.error for x in found])
    assert 0.6 < pulls.std() < 1.6
    assert abs(pulls.mean()) < 0.8
    more = check(Of(f, **FREE), directions=50_000)["bilateral"]
    assert more.error == pytest.approx(np.mean([x.error for x in found]) / 10, rel=0.3)


@pytest.mark.parametrize(
    ("albedo", "declared", "verdict"),
    [(0.99, True, "pass"), (1.0, True, "pass"), (1.005, False, "note"), (1.005, True, "fail"), (1.3, False, "fail")],
)
def test_energy(albedo: float, declared: bool, verdict: str) -> None:
    b = Of(lambda i, o, d: np.full_like(i, albedo / np.pi), **{**FREE, "energy_conserving": declared})
    found = check(b, directions=100)["energy"]
    assert (found.verdict, found.declared) == (verdict, declared)
    assert found.value == pytest.approx(albedo - 1, abs=1e-6)
    assert found.found is (albedo <= 1)


def test_energy_counts_the_mirror_part() -> None:
    both = bc.model("mirror", reflectance=0.5) + bc.model("lambert", reflectance=0.6)
    found = check(both, directions=100)["energy"]
    assert found.value == pytest.approx(0.1, abs=1e-6)
    assert found.verdict == "fail"
    dark = Of(lambda i, o, d: np.zeros_like(i))
    dark.has_delta = True
    dark._delta_reflectance = lambda theta: np.full((theta.size, 1), -0.1)  # type: ignore[method-assign]
    assert check(dark, directions=100)["positivity"].verdict == "fail"


def test_published_phong_is_found_out() -> None:
    """(r.v)^n / c_i: its albedo has no bound and it is not reciprocal, as NUMERICS says; it declares neither."""
    report = check(bc.model("phong", exponent=10, convention="published"), directions=20_000)
    assert report["energy"].verdict == report["reciprocity"].verdict == "fail"
    worst = report["energy"].worst[0]
    assert worst.theta_i == 89.9
    assert report["energy"].value == pytest.approx(
        bc.model("phong", exponent=10, convention="published").albedo(np.radians(89.9))[0] - 1, rel=1e-4
    )
    assert report["bilateral"].verdict == report["positivity"].verdict == "pass"


@pytest.mark.parametrize("flag", ["reciprocal", "bilateral", "non_negative"])
def test_entries_are_held_to_what_they_declare(flag: str) -> None:
    """A defect far below what fails anybody fails who denies it."""
    small = {
        "reciprocal": lambda i, o, d: 0.1 * (1 + 0.01 * np.cos(i)),
        "bilateral": lambda i, o, d: 0.1 * (1 + 0.01 * np.sin(d) * np.sin(i) * np.sin(o)),
        "non_negative": lambda i, o, d: np.where(o > 1.565, -0.01, 0.1),
    }[flag]
    name = {"reciprocal": "reciprocity", "bilateral": "bilateral", "non_negative": "positivity"}[flag]
    honest, liar = (check(Of(small, **{**FREE, flag: says}), directions=50_000)[name] for says in (False, True))
    assert (honest.verdict, liar.verdict) == ("note", "fail")
    assert honest.value == liar.value
    assert 0 < honest.value < FAILS_ABOVE[name][0]


def test_the_horizon() -> None:
    bounded = Of(lambda i, o, d: 0.1 / np.maximum(np.cos(o), 1e-12), **FREE)
    assert check(bounded, directions=100)["horizon"].verdict == "pass"
    for power in (1.2, 2.0):
        wild = Of(lambda i, o, d, p=power: 1e-4 / np.maximum(np.cos(o), 1e-12) ** p, **FREE)  # type: ignore[misc]
        found = check(wild, directions=100)["horizon"]
        assert found.verdict == "fail"
        assert f"{power - 1:.2g}" in found.says
        assert found.worst[0].theta_o == 90.0
    towards_light = Of(lambda i, o, d: 1e-4 / np.maximum(np.cos(i), 1e-12) ** 1.5, **FREE)
    assert check(towards_light, directions=100)["horizon"].worst[0].theta_i == 90.0
    edge = Of(lambda i, o, d: np.where(o >= np.pi / 2, np.inf, 0.1), **FREE)
    found = check(edge, directions=100)["horizon"]
    assert found.verdict == "fail"
    assert "not finite" in found.says


def test_worst_directions_are_where_the_defect_is() -> None:
    def bump(i: Any, o: Any, d: Any) -> Any:
        near = (np.abs(i - 0.7) < 0.04) & (np.abs(o - 0.3) < 0.04) & (np.abs(np.abs(d) - 1.0) < 0.04)
        return 0.1 + 0.3 * near

    found = check(Of(bump, **FREE), directions=200_000)["reciprocity"]
    worst = found.worst[0]
    here = sorted([worst.theta_i or 0.0, worst.theta_o or 0.0])
    assert here == pytest.approx([np.degrees(0.3), np.degrees(0.7)], abs=3)
    assert abs(worst.delta_phi or 0.0) == pytest.approx(np.degrees(1.0), abs=3)
    assert len(found.worst) == 1  # both sides of the plane of incidence, and exchanged, are one place


# ---- channels, values that are not finite, options -----------------------------------------------


def test_channels_are_judged_apart() -> None:
    report = check(Skewed(), directions=20_000)
    assert report["positivity"].by_channel[:2] == [0.0, 0.0]
    assert report["positivity"].by_channel[2] > 0
    assert {w.channel for w in report["positivity"].worst} == {"B"}
    assert {w.channel for w in report["energy"].worst} == {"R"}
    assert report["bilateral"].worst[0].channel == "R"
    many = Channels([float(x) for x in range(400, 595)])
    scale = np.linspace(0.1, 0.9, 195)
    wide = check(Of(lambda i, o, d: np.outer(np.ones_like(i), scale / np.pi), many), directions=2_000)
    assert wide.verdict == "pass"
    assert wide["energy"].by_channel == pytest.approx(scale - 1, abs=1e-6)
    assert "195 in all" in str(wide)


@pytest.mark.parametrize("bad", [np.nan, np.inf], ids=str)
def test_values_that_are_not_finite(bad: float) -> None:
    report = check(Of(lambda i, o, d: np.where(o > 1.0, bad, 0.2)), directions=2_000)
    found = verdicts(report)
    assert found["energy"] == found["positivity"] == found["horizon"] == "fail"
    assert "not finite" in report["positivity"].says
    json.dumps(report.to_json(), allow_nan=False)
    assert str(report).count("not finite") >= 3


@pytest.mark.parametrize(
    "options", [{"directions": 0}, {"directions": 1.5}, {"seed": -1}, {"directions": True}], ids=str
)
def test_options_that_cannot_be(options: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        check(bc.model("lambert"), **options)


def test_the_same_seed_gives_the_same_report() -> None:
    b = bc.tabulate(bc.model("ggx", roughness=0.4), "angle_grid", shape=(8, 8, 9))
    assert check(b, directions=1_000, seed=3) == check(b, directions=1_000, seed=3)
    assert check(b, directions=1_000, seed=3) != check(b, directions=1_000, seed=4)


# ---- the page ------------------------------------------------------------------------------------


def test_one_page() -> None:
    report = check(Skewed(), directions=5_000)
    lines = str(report).splitlines()
    assert len(lines) <= 50
    assert max(map(len, lines)) <= 132
    for f in report.findings:
        assert any(line.startswith(f"{f.name} ") and f" {f.verdict} " in line and f.says in line for line in lines)
    assert "0.01 is 1 %" in lines[2]
    degrees, radians = report.to_json(), report.to_json("rad")
    there, here = degrees["findings"][3]["worst"][0], radians["findings"][3]["worst"][0]
    assert here["theta_i"] == pytest.approx(np.radians(there["theta_i"]))
    assert radians["findings"][0]["worst"][0]["theta_o"] is None
    json.dumps(degrees, allow_nan=False)


# ---- real data -----------------------------------------------------------------------------------


@needs_shared
@pytest.mark.shared
def test_real_materials() -> None:
    """Bilateral and not reciprocal, with the L1 of NUMERICS section 3; sunflower's negative blue is found."""
    aurora, sunflower = (check(bc.read(rgl_path(n)), directions=20_000) for n in ("aurora_white", "cg_sunflower"))
    for report in (aurora, sunflower):
        assert report["bilateral"].verdict == "pass"
        assert report["reciprocity"].verdict == "note"
        assert report["energy"].verdict == "pass"
    assert aurora["positivity"].verdict == "pass"
    assert sunflower["positivity"].verdict == "fail"
    assert sunflower["positivity"].worst[0].channel == "B"
    assert aurora["reciprocity"].relative == pytest.approx(0.06, abs=0.035)
