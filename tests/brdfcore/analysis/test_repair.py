"""Repairs: only what was asked, with what it changed; the result holds what it claims."""

from __future__ import annotations

import json
import pickle
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.analysis.check.checks import check
from brdfcore.analysis.check.repair import REPAIRS, repair
from brdfcore.base.errors import InputError
from brdfcore.testing import check_claims, check_scalar_equals_batch, check_signature, sample_angles
from tests.brdfcore.analysis.test_checks import FREE
from tests.brdfcore.analysis.test_gloss import Of
from tests.support.sources import Skewed

ANGLES = sample_angles(200)


def published() -> bc.Brdf:
    return bc.model("phong", exponent=10, convention="published")


@pytest.mark.parametrize("name", ["negatives", "reciprocity", "bilateral"])
def test_each_repair_is_its_formula(name: str) -> None:
    b, (i, o, d) = Skewed(), ANGLES
    f = b.evaluate(i, o, d)
    formula = {
        "negatives": np.maximum(f, 0),
        "reciprocity": 0.5 * (f + b.evaluate(o, i, -d)),
        "bilateral": 0.5 * (f + b.evaluate(i, o, -d)),
    }[name]
    fixed = repair(b, name, directions=2_000)
    assert fixed.evaluate(i, o, d) == pytest.approx(formula, abs=1e-15)
    assert list(fixed.channels) == list(b.channels)
    flag = {"negatives": "non_negative", "reciprocity": "reciprocal"}.get(name, name)
    assert [f for f in ("bilateral", "reciprocal", "non_negative") if getattr(fixed, f)] == [flag]


def test_nothing_is_repaired_unasked() -> None:
    b = Of(lambda i, o, d: 0.1 - 0.3 * (o > 1), **FREE)
    fixed = repair(b, "bilateral", directions=1_000)
    assert np.array_equal(fixed.evaluate(*ANGLES), b.evaluate(*ANGLES))
    entry = fixed.report["repairs"][0]
    assert (entry["l1"], entry["values_changed"], entry["misplaced"]) == (0.0, 0.0, 0.0)
    assert not fixed.non_negative


def test_what_a_repair_changed_is_its_size() -> None:
    """-0.2 beyond 60 degrees: a quarter of the light; the albedo rises by it."""
    b = Of(lambda i, o, d: np.where(o > np.pi / 3, -0.2, 0.2), **FREE)
    entry = repair(b, "negatives").report["repairs"][0]
    assert entry["l1"] == pytest.approx(0.25, abs=4 * entry["l1_stderr"])
    assert entry["misplaced"] == pytest.approx(0.25 * 0.2 * np.pi, abs=8 * entry["l1_stderr"])
    before, after = np.array(entry["albedo_before"]), np.array(entry["albedo_after"])
    assert before == pytest.approx(0.2 * np.pi * 0.5, abs=1e-3)
    assert after == pytest.approx(0.2 * np.pi * 0.75, abs=1e-3)
    assert 0 < entry["values_changed"] < 1


def test_every_repair_in_its_order() -> None:
    fixed = repair(Skewed(), reversed(REPAIRS), directions=2_000)
    assert [e["name"] for e in fixed.report["repairs"]] == list(REPAIRS)
    assert fixed.repairs == tuple(REPAIRS)
    check_claims(fixed)
    check_signature(fixed)
    check_scalar_equals_batch(fixed)
    found = check(fixed, directions=5_000)
    assert all(found[n].verdict == "pass" for n in ("energy", "reciprocity", "positivity", "bilateral")), str(found)
    json.dumps(fixed.report, allow_nan=False)
    json.dumps(fixed.describe(), allow_nan=False)
    assert pickle.loads(pickle.dumps(fixed)).evaluate(0.3, 0.4, 1.0) == pytest.approx(fixed.evaluate(0.3, 0.4, 1.0))


def test_energy() -> None:
    """Below the angle where it passes 1 nothing is touched; from there the albedo is 1, between the nodes too."""
    b = published()
    fixed = repair(b, "energy", directions=5_000)
    entry = fixed.report["repairs"][0]
    low = np.radians([0.0, 30.0, 60.0, 75.0])
    assert np.array_equal(fixed.evaluate(low, 0.3, 2.0), b.evaluate(low, 0.3, 2.0))
    theta = np.radians([83.0, 84.7, 86.1, 88.123, 89.37, 89.91, 89.995, 89.99999])
    albedo = fixed.albedo(theta)
    assert (albedo <= 1 + 1e-6).all(), albedo
    assert (albedo[2:] > 0.97).all()
    assert max(map(max, entry["albedo_before"])) > 30
    assert max(map(max, entry["albedo_after"])) <= 1
    assert 75 < entry["scaled_from"] < 87
    assert fixed.energy_conserving
    assert not fixed.reciprocal


@pytest.mark.slow
def test_energy_with_reciprocity_keeps_both() -> None:
    fixed = repair(published(), ["energy", "reciprocity"], directions=2_000)
    assert fixed.reciprocal
    assert fixed.energy_conserving
    i, o, d = ANGLES
    assert np.array_equal(fixed.evaluate(i, o, d), fixed.evaluate(o, i, d))
    assert (fixed.albedo(np.radians([60, 85, 88.3, 89.9])) <= 1 + 1e-6).all()
    alone = repair(bc.model("ward", variant="duer", roughness=0.5), "energy", directions=2_000)
    assert not alone.reciprocal  # it was, and the report says so
    assert any("reciproc" in w for w in alone.report["warnings"])


def test_energy_of_a_mirror_part() -> None:
    both = bc.model("mirror", reflectance=0.8) + bc.model("lambert", reflectance=0.6)
    fixed = repair(both, "energy", directions=1_000)
    assert fixed.has_delta
    assert fixed.delta_reflectance(0.4)[0] == pytest.approx(0.8 / 1.4, rel=1e-3)
    assert fixed.albedo(np.radians([0, 45, 89]))[:, 0] == pytest.approx(1.0, abs=1e-3)
    assert (fixed.albedo(np.radians([0, 45, 89])) <= 1).all()


def test_a_repaired_material_becomes_a_table(tmp_path: Any) -> None:
    fixed = repair(Skewed(), ["negatives", "bilateral"], directions=1_000)
    table = bc.tabulate(fixed, "angle_grid", shape=(12, 12, 13))
    table.save(tmp_path / "fixed.h5")
    again = bc.open_table(tmp_path / "fixed.h5")
    assert again.bilateral
    assert again.non_negative
    assert [e["name"] for e in again.report["repairs"]] == ["bilateral", "negatives"]


@pytest.mark.parametrize(
    "repairs", [[], "", "everything", ["negatives", 3], None, 7, ["negatives", "energie"]], ids=str
)
def test_repairs_that_are_none(repairs: Any) -> None:
    with pytest.raises(InputError) as caught:
        repair(bc.model("lambert"), repairs)
    assert caught.value.code == "bad_repair"
    assert "negatives" in caught.value.detail


def test_energy_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InputError, match="not finite"):
        repair(Of(lambda i, o, d: np.where(o > 1, np.nan, 0.1)), "energy", directions=100)
