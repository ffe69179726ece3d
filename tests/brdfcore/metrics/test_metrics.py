"""Error measures against closed forms and a second implementation."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy.integrate import dblquad

import brdfcore as bc
from brdfcore import metrics
from brdfcore.base.directions import mixture
from brdfcore.metrics import comparison
from tests.support.sources import Constant, Multilinear, Skewed


def test_l1_of_scaled_material_is_the_scale() -> None:
    """int |.9 f - f| / int f = .1 for every f, with no sampling error."""
    gold = bc.model("cook_torrance", roughness=0.05, ior="gold")
    found = bc.compare(gold, 0.9 * gold)
    assert found.l1 == pytest.approx(0.1, rel=1e-12)
    assert found.l1_stderr < 1e-12
    assert found.rel_l2 == pytest.approx(0.1, rel=1e-12)
    assert found.albedo_bias["bias"] == pytest.approx([-0.1] * 7, rel=1e-9)
    assert found.log_ratio["max"] == pytest.approx(-np.log(0.9), rel=1e-3)
    assert found.negatives == found.nan == 0


def test_l1_against_a_deterministic_integral() -> None:
    """Reference 1/pi, candidate (1 + cos theta_i)/pi: L1 = int cos^2 dw / int cos dw over one hemisphere = 2/3."""

    class Candidate(Constant):
        def _evaluate(self, theta_i, theta_o, delta_phi, out):  # type: ignore[no-untyped-def]
            out[:, 0] = (1 + np.cos(theta_i)) / np.pi
            return True

    exact = dblquad(lambda t, p: np.cos(t) ** 2 * np.sin(t), 0, 2 * np.pi, 0, np.pi / 2)[0] / np.pi
    assert exact == pytest.approx(2 / 3)
    found = bc.compare(Constant(1 / np.pi), Candidate(0.0))
    assert found.l1 == pytest.approx(exact, abs=4 * found.l1_stderr)
    assert 1e-4 < found.l1_stderr < 3e-3


@pytest.mark.slow
def test_standard_error_is_the_spread_over_seeds() -> None:
    a = bc.model("cook_torrance", roughness=0.3, ior="gold")
    b = bc.model("cook_torrance", roughness=0.32, ior="gold")
    runs = [bc.compare(a, b, directions=4_000, seed=k) for k in range(40)]
    spread = np.std([r.l1 for r in runs])
    assert np.mean([r.l1_stderr for r in runs]) == pytest.approx(spread, rel=0.35)


def test_weights_integrate_the_hemispheres() -> None:
    """(1/n) sum w estimates (int c dw)^2 = pi^2; no weight exceeds pi^2 / cosine_share."""
    drawn = mixture(100_000, 3)
    assert drawn.weight.mean() == pytest.approx(np.pi**2, abs=5 * drawn.weight.std() / np.sqrt(100_000))
    assert drawn.weight.max() <= np.pi**2 / 0.5 * (1 + 1e-9)
    assert (drawn.weight == 0).any()
    assert mixture(50, 1).theta_o == pytest.approx(mixture(50, 1).theta_o, abs=0)


def test_density_is_that_of_the_draws() -> None:
    """The share of draws in a region equals the density's integral there (against a fixed, uniform grid)."""
    n = 400_000
    drawn = mixture(n, 8)
    used = drawn.weight > 0
    # E[1/p restricted to a region] is the region's solid angle squared: the upper hemispheres' 4 pi^2
    volume = np.mean(np.where(used, 1 / drawn.density, 0.0) * (drawn.theta_i < 1.3) * (drawn.theta_o < 1.3))
    assert volume == pytest.approx((2 * np.pi * (1 - np.cos(1.3))) ** 2, rel=0.02)


def test_flags_of_data() -> None:
    assert metrics.measured_flags(Skewed()) == {
        "bilateral": False,
        "reciprocal": False,
        "energy_conserving": False,
        "non_negative": False,
    }
    assert metrics.measured_flags(bc.model("cook_torrance", roughness=0.2)) == {
        "bilateral": True,
        "reciprocal": True,
        "energy_conserving": True,
        "non_negative": True,
    }
    assert metrics.measured_flags(Multilinear())["bilateral"]
    assert not metrics.measured_flags(Multilinear())["reciprocal"]


def test_channels_must_agree() -> None:
    with pytest.raises(bc.InputError, match="channels differ"):
        bc.compare(Skewed(), bc.model("lambert", reflectance=[0.1, 0.2]))


def test_no_regular_part() -> None:
    found = bc.compare(Constant(0.0), Constant(0.0))
    assert np.isnan(found.l1)
    assert found.to_json()["l1"] is None


def test_nan_and_negative_values_are_counted() -> None:
    found = bc.compare(Constant(1.0), Constant(-0.5), directions=1_000)
    assert found.negatives == found.values
    assert bc.compare(Constant(1.0), Constant(float("nan")), directions=1_000).nan > 0


class Wide(Constant):
    """195 channels, as the files of the spectral database have."""

    channels = bc.Channels([float(x) for x in range(360, 750, 2)])
    energy_conserving = False


@pytest.mark.slow
def test_memory_does_not_grow_with_the_channels() -> None:
    tracemalloc.start()
    try:
        found = bc.compare(Wide(0.3), Wide(0.27), directions=50_000)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.values > 9_000_000
    assert peak < 150e6  # float64 values of both take this already, before any difference of them
    assert found.l1 == pytest.approx(0.1, rel=1e-12)
    assert found.log_ratio["p50"] == pytest.approx(-np.log(0.9), rel=1e-5)


def test_pieces_give_the_same_measures(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = bc.model("ggx", roughness=[0.3, 0.2, 0.1]), bc.model("ggx", roughness=[0.31, 0.22, 0.1])
    whole = bc.compare(a, b, directions=9_000).to_json()
    monkeypatch.setattr(comparison, "_CHUNK", 3 * 1_000)
    pieces = bc.compare(a, b, directions=9_000).to_json()
    for key in ("l1", "l1_stderr", "rel_l2", "negatives", "nan", "values", "delta"):
        assert pieces[key] == pytest.approx(whole[key], rel=1e-12), key
    assert pieces["log_ratio"] == pytest.approx(whole["log_ratio"], rel=0.05)  # d comes from the first piece


@pytest.mark.parametrize("directions", [0, -1, 1.5, "5", True, 10**400, None])
def test_numbers_of_directions_that_cannot_be(directions: object) -> None:
    with pytest.raises(bc.InputError) as caught:
        bc.compare(Constant(0.1), Constant(0.2), directions=directions)  # type: ignore[arg-type]
    assert caught.value.context["where"] == "directions"


@pytest.mark.parametrize("seed", [-1, "x", 0.5])
def test_seeds_that_cannot_be(seed: object) -> None:
    with pytest.raises(bc.InputError) as caught:
        bc.compare(Constant(0.1), Constant(0.2), directions=10, seed=seed)  # type: ignore[arg-type]
    assert caught.value.context["where"] == "seed"


def test_delta_parts_are_compared_between_the_nodes() -> None:
    a, b = bc.model("mirror", ior=1.5), bc.model("mirror", ior=1.6)
    theta = np.linspace(0, np.pi / 2, 10_000)
    exact = np.abs(a.delta_reflectance(theta) - b.delta_reflectance(theta)).max()
    assert bc.compare(a, b, directions=10).delta == pytest.approx(exact, rel=1e-3)
