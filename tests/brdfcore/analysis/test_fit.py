"""Fitted models: their own parameters back, intervals that hold, what is lost, and what cannot be told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

import brdfcore as bc
from brdfcore.analysis.fit.families import FAMILIES, Family
from brdfcore.analysis.fit.fit import drawn_rows, search
from brdfcore.analysis.fit.intervals import estimates
from brdfcore.analysis.fit.losses import LOSSES, Loss, Rows
from brdfcore.analysis.fit.solve import Solver, non_negative
from brdfcore.metrics.comparison import WHOLE
from tests.support.tiers import first_fast

EVERYWHERE = {"light": WHOLE, "view": WHOLE}
SHAPES = {"roughness": -0.9, "exponent": 2.3, "ior": 0.2}
EVERY = [f for variants in FAMILIES.values() for f in variants]


def of(family: Family, **weights: object) -> bc.Brdf:
    given = {"diffuse": [0.1, 0.2, 0.3], "specular": [0.5, 0.4, 0.3], **weights}
    return bc.model(family.model, **given, **family.parameters([SHAPES[f.name] for f in family.free]))


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_weights_are_those_of_nnls(seed: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.random((30, columns)), rng.standard_normal(30)
    found = non_negative((x.T @ x)[None], (x.T @ y)[None])[0][0]
    expected = nnls(x, y)[0]
    assert found == pytest.approx(expected, abs=1e-6 * max(1.0, float(expected.max())))


@pytest.mark.parametrize("family", first_fast(*EVERY), ids=lambda f: f.key)
def test_a_model_is_found_again(family: Family) -> None:
    b = of(family)
    found = bc.fit(b, family.model, 1)
    assert found.l1 < 1e-8
    (term,) = found.terms
    assert term["model"] == family.model
    own = b.metadata["parameters"]
    for name, value in term["parameters"].items():
        if not isinstance(value, str):
            assert value == pytest.approx(own[name], rel=1e-6), name


@pytest.mark.parametrize("loss", first_fast(*LOSSES))
def test_every_loss_ends_at_the_truth(loss: str) -> None:
    b = of(EVERY[0])
    assert bc.fit(b, "ggx", 1, loss).l1 < 1e-7


def test_two_lobes_on_a_rough_base() -> None:
    b = (
        bc.model("oren_nayar", reflectance=0.4, sigma=0.5)
        + bc.model("ward", roughness=0.08, specular=0.3)
        + bc.model("ward", roughness=0.4, specular=0.2)
    )
    found = bc.fit(b, "ward", 2, base="oren_nayar")
    assert found.l1 < 1e-6
    assert [t["model"] for t in found.terms] == ["oren_nayar", "ward", "ward"]
    assert found.terms[0]["parameters"]["sigma"] == pytest.approx(0.5, rel=1e-4)


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    """2 % noise on 400 directions: 30 fits of 5 parameters. 95 % of 150 is 142.5; four standard errors below, 132."""
    rng, family = np.random.default_rng(5), FAMILIES["ward"][0]
    b = bc.model("ward", diffuse=[0.2, 0.3], specular=[0.4, 0.2], roughness=0.15)
    truth = {"diffuse a": 0.2, "diffuse b": 0.3, "specular a": 0.4, "specular b": 0.2, "roughness": 0.15}
    inside = 0
    for _ in range(30):
        drawn = drawn_rows(b, 400, int(rng.integers(1 << 30)), EVERYWHERE)
        noisy = drawn.values * (1 + 0.02 * rng.standard_normal(drawn.values.shape))
        rows = Rows(drawn.angles, noisy, drawn.weight)
        found, _, _ = estimates(rows, "relative", search(rows, "relative", [family], [1], "lambert"), ["a", "b"])
        assert all(e.low is not None and e.high is not None for e in found)
        inside += sum(e.low <= truth[e.name] <= e.high for e in found)  # type: ignore[operator]
    assert 132 <= inside <= 150


def test_a_parameter_that_nothing_tells_has_no_interval() -> None:
    found = bc.fit(bc.model("lambert", reflectance=0.5), "ggx", 1)
    assert found.l1 < 1e-8
    by_name = {e.name: e for e in found.estimates}
    assert by_name["specular value"].why == "at its bound"
    assert by_name["roughness"].why == "of a lobe that is not used"
    assert by_name["roughness"].low is None
    assert any("do not tell" in said for said in found.remarks)


@pytest.mark.slow
def test_more_lobes_never_fit_worse() -> None:
    b = bc.model("ggx", roughness=0.3, specular=0.4, diffuse=0.1) + bc.model("phong", exponent=8, specular=0.3)
    losses = [bc.fit(b, "ggx", n).value for n in (1, 2)]
    assert losses[1] < losses[0]
    assert bc.fit(b, "ggx").value <= losses[0]


@pytest.mark.slow
def test_measured_points_are_fitted_as_points(tmp_path: Path) -> None:
    """Scattered noise of 2 %: the truth, not the table of the points, and an L1 of the noise's size."""
    rng = np.random.default_rng(3)
    b = bc.model("ggx", roughness=0.25, diffuse=0.2, specular=0.6, ior=1.5)
    theta_i, theta_o = np.radians(rng.uniform(0, 75, (2, 500)))
    delta_phi = rng.uniform(0, np.pi, 500)
    f = b.evaluate(theta_i, theta_o, delta_phi)[:, 0] * (1 + 0.02 * rng.standard_normal(500))
    rows = np.degrees([theta_i, theta_o, delta_phi]).T
    lines = [f"{a:.9f},{o:.9f},{d:.9f},{v:.9g}" for (a, o, d), v in zip(rows, f)]
    text = "\n".join(["theta_i,theta_o,delta_phi,f_r", *lines]) + "\n"
    (tmp_path / "scan.csv").write_text(text)
    found = bc.fit(bc.read(tmp_path / "scan.csv", angles="deg"), "ggx", 1)
    assert found.loss == "relative"
    assert found.l1 == pytest.approx(0.016, abs=0.004)  # the mean of |2 % noise|
    assert found.terms[0]["parameters"]["roughness"] == pytest.approx(0.25, rel=0.03)


def test_it_is_a_brdf_and_a_file(tmp_path: Path) -> None:
    b = bc.model("ggx", roughness=0.2, specular=0.4, diffuse=0.1) + bc.model("phong", exponent=8, specular=0.3)
    found = bc.fit(b, "ggx", 2)
    angles = (0.3, 0.5, 2.0)
    bc.write(found, tmp_path / "fit.json")
    assert bc.read(tmp_path / "fit.json").evaluate(*angles) == found.evaluate(*angles)
    assert json.dumps(found.to_json())
    assert found.albedo(0.3) == pytest.approx(b.albedo(0.3), rel=0.1)
    assert float(found.uncertainty(*angles).max()) == 0


def test_a_weight_beyond_its_bound_is_a_factor(tmp_path: Path) -> None:
    b = 3.0 * bc.model("lambert", reflectance=[0.5, 0.9])
    found = bc.fit(b, "ggx", 0)
    assert found.terms[0]["factor"] == pytest.approx(2.7)
    bc.write(found, tmp_path / "bright.json")
    assert bc.read(tmp_path / "bright.json").evaluate(0.1, 0.2, 3.0) == pytest.approx([1.5 / np.pi, 2.7 / np.pi])


def test_only_what_a_scene_sees() -> None:
    b = bc.model("ggx", roughness=0.2, diffuse=0.1, specular=0.5)
    found = bc.fit(b, "phong", 1, angles={"light": (0.0, 0.5)})
    assert found.angles["light"] == [0.0, 0.5]
    assert found.l1 < bc.fit(b, "phong", 1).l1


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"model": "mirror"}, "model"),
        ({"loss": "least"}, "loss"),
        ({"base": "snow"}, "base"),
        ({"lobes": 4}, "lobes"),
        ({"lobes": True}, "lobes"),
        ({"angles": {"light": (2.0, 3.0)}}, "light"),
        ({"angles": {"light": 0.5}}, "light"),
        ({"angles": {"view": ("low", np.nan)}}, "view"),
    ],
)
def test_what_is_refused(options: dict[str, object], where: str) -> None:
    with pytest.raises(bc.InputError) as error:
        bc.fit(bc.model("lambert"), **options)  # type: ignore[arg-type]
    assert error.value.context["where"] == where


def test_a_perfect_mirror_is_left_out() -> None:
    found = bc.fit(bc.model("mirror"))
    assert (found.l1, found.remarks) == (0.0, ["the perfect mirror part is not in the model"])
    assert not found.evaluate(0.3, 0.3, np.pi).any()


def test_the_first_start_is_no_start_of_the_caller() -> None:
    """The same source gives the same fit, to the bit."""
    b = of(EVERY[0])
    assert bc.fit(b, "phong", 1).terms == bc.fit(b, "phong", 1).terms


def test_slopes_are_those_of_differences() -> None:
    rows = drawn_rows(of(EVERY[0]), 300, 2, EVERYWHERE)
    solver = Solver(rows, "energy")
    state = solver.weighted(solver.starts([EVERY[0]], 1, "lambert", 1, None)[0])
    where, step = state.free[0], 1e-4
    ends = [solver.columns.values(state.moved(where, state.at(where) + s)) for s in (-step, step)]
    assert solver.slopes(state)[..., 0] == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("name", LOSSES)
def test_a_step_of_the_squares_lowers_the_loss(name: str) -> None:
    rows = drawn_rows(of(EVERY[0]), 300, 2, EVERYWHERE)
    loss = Loss(name, rows)
    g = rows.values * np.linspace(0.7, 1.4, rows.weight.size)[:, None]
    v, z = loss.quadratic(g)
    assert (v >= 0).all()
    toward = g + 0.3 * (z - g)
    assert loss.value(toward) < loss.value(g)
