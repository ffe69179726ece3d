"""The stated error finds the energy: lobes of any width at the mirror direction, at the light and elsewhere."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.peaks import FOUND_FROM, peaks
from brdfcore.metrics.estimators import honest_ratio
from brdfcore.metrics.incidence import Incidences, worst
from brdfcore.metrics.lobes import Lobes as Draws
from tests.support.lobes import LAST, Lobes
from tests.support.sources import Constant

WIDTHS = (1e-8, 1e-7, 1e-6, 1e-5, 3e-4, 0.01, 0.02)
PLACES = (("mirror",), ("light",), ("mirror", "light"))


@pytest.mark.parametrize("places", PLACES, ids="+".join)
@pytest.mark.parametrize("width", WIDTHS)
def test_l1_of_a_table_without_the_lobe(places: tuple[str, ...], width: float) -> None:
    """Whether the reference has the lobe, or only the candidate; the truth is in closed form."""
    for diffuse in (0.3, 0.5):
        source, flat = Lobes(places, width, diffuse=diffuse), Constant(diffuse / np.pi)
        missing, added = bc.compare(source, flat, directions=60_000), bc.compare(flat, source, directions=60_000)
        truth = source.lobe_share
        for found, right in ((missing, truth), (added, truth / (1 - truth))):
            assert found.l1_stderr <= 0.05 * found.l1
            assert found.l1 == pytest.approx(right, abs=4 * found.l1_stderr)
            assert not found.skipped
        right_at = source.lobe_albedo / (source.lobe_albedo + diffuse)
        for row in missing.by_theta_i:
            if row["theta_i"] <= LAST:
                assert row["l1_stderr"] <= 0.2 * row["l1"]
                assert row["l1"] == pytest.approx(right_at, abs=4.5 * row["l1_stderr"]), np.degrees(row["theta_i"])
                assert row["albedo_ratio"][0] == pytest.approx(1 - right_at, abs=4.5 * row["l1_stderr"])
        assert worst(missing.by_theta_i, 0.01) > 0.3


def test_standard_errors_hold() -> None:
    """Of 60 seeds at most a tenth beyond two standard errors, none beyond four and a half."""
    source, flat = Lobes(("mirror", "light"), 1e-6), Constant(0.3 / np.pi)
    off = []
    for seed in range(60):
        drawn = Incidences(source, source.channels, Draws([source], seed), light=(0.9, 1.1), view=(0, 1.6), seed=seed)
        rows = drawn.rows(flat)
        right = source.lobe_albedo / (source.lobe_albedo + 0.3)
        off += [(row["l1"] - right) / row["l1_stderr"] for row in rows[:1]]
    assert np.mean(np.abs(off) > 2) <= 0.1
    assert np.abs(off).max() < 4.5


@pytest.mark.parametrize("width", [0.007, 0.01, 0.02, 0.05])
def test_a_lobe_away_from_mirror_direction_and_light(width: float) -> None:
    source = Lobes(("off",), width)
    found = bc.compare(source, Constant(0.3 / np.pi), directions=60_000)
    assert found.l1 == pytest.approx(source.lobe_share, abs=4 * found.l1_stderr)
    assert found.l1_stderr <= 0.1 * found.l1


@pytest.mark.parametrize("width", [FOUND_FROM, 0.005])
def test_a_narrower_one_is_found_or_said_not_to_be_known(width: float) -> None:
    source = Lobes(("off",), width)
    found = bc.compare(source, Constant(0.3 / np.pi), directions=60_000)
    assert found.lobes_from == FOUND_FROM
    assert abs(found.l1 - source.lobe_share) <= 4 * found.l1_stderr
    assert worst([*found.by_theta_i, *found.between], 0.01) > 0.3


def test_what_leaves_no_room_for_one_says_so() -> None:
    gold, white = bc.model("cook_torrance", ior="gold"), bc.model("lambert")
    assert bc.compare(gold, white + 0.5 * gold, directions=2_000).lobes_from == 0
    assert bc.compare(gold, Constant(0.1), directions=2_000).lobes_from > 0


@pytest.mark.parametrize(("places", "width"), [*product(PLACES, WIDTHS), *product([("off",)], (0.0035, 0.01, 0.02))])
def test_albedo_finds_the_same_lobes(places: tuple[str, ...], width: float) -> None:
    """Away from mirror direction and light those that the scan can see."""
    source = Lobes(places, width)
    theta = np.radians([0.7, 10.0, 30.0, 60.0, 75.0])
    albedo, error = source.albedo_error(theta, tolerance=1e-3)
    assert albedo[:, 0] == pytest.approx(0.3 + source.lobe_albedo, abs=1.5e-3)
    assert (np.abs(albedo[:, 0] - 0.3 - source.lobe_albedo) <= error[:, 0] + 1e-6).all()


def test_albedo_of_a_lobe_cut_by_the_horizon() -> None:
    """At the light at 89 degrees, .02 wide, on a fine lattice of directions."""
    source = Lobes(("light",), 0.02)
    theta_i = LAST - 1e-3
    theta, step = np.linspace(theta_i - 0.12, theta_i + 0.12, 1201, retstep=True)
    phi = np.linspace(-0.12, 0.12, 1201)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    lobe = source.evaluate(theta_i, t, p)[..., 0] - 0.3 / np.pi
    right = 0.3 + float((lobe * np.cos(t) * np.sin(t)).sum() * step * (phi[1] - phi[0]))
    assert source.albedo(theta_i)[0] == pytest.approx(right, abs=1e-4)


def test_a_mixed_spike_of_a_model() -> None:
    """The spike with half the energy that a fixed set of widths is blind to."""
    source = 0.5 * bc.model("ggx", roughness=1e-7) + 0.5 * bc.model("lambert", reflectance=1.0)
    found = bc.compare(source, bc.model("lambert", reflectance=0.5))
    assert found.l1 == pytest.approx(0.5, abs=4 * found.l1_stderr + 2e-3)
    assert found.l1_stderr < 0.01


def test_an_equal_table_has_no_error() -> None:
    source = Lobes(("mirror", "light"), 1e-5)
    found = bc.compare(source, source, directions=2_000)
    assert found.l1 == 0
    assert all(row["l1"] == 0 and row["albedo_ratio"] == [1.0] for row in found.by_theta_i)
    assert worst(found.by_theta_i, 0.01) == 0


def test_few_heavy_draws_are_no_certainty() -> None:
    """One draw that holds all of the difference: the value is not known, whatever the other draws say."""
    weight, f = np.ones(1_000), np.ones(1_000)
    apart = np.zeros(1_000)
    apart[3] = 500.0
    one = honest_ratio(weight, apart, f)
    assert one.stderr > 1.9 * one.value
    even = honest_ratio(weight, np.full(1_000, 0.5), f)
    assert (even.value, even.stderr) == (0.5, 0.0)


def test_an_albedo_that_the_draws_did_not_find_raises_the_error() -> None:
    from brdfcore.metrics.incidence import floored

    rows = [{"theta_i": 0.5, "l1": 0.001, "l1_stderr": 1e-5, "albedo_ratio": [1.0], "albedo_error": 0.0}]
    missed = floored(rows, {"theta_i": [0.5], "bias": [-0.4], "error": [0.01]})
    assert missed == pytest.approx(0.389)
    assert rows[0]["l1"] == rows[0]["l1_stderr"] == pytest.approx(0.39)
    assert worst(rows, 0.01) == np.inf


def test_peaks_are_where_they_are() -> None:
    source = Lobes(("off",), 0.02)
    for theta in (0.1, 0.6, 1.2):
        found = peaks(lambda *angles: source.evaluate(*angles)[:, 0], theta, bilateral=False)
        assert found.shape == (1, 2)
        # the highest value of f cos theta_o lies a little towards the normal from the lobe's centre
        assert found[0] == pytest.approx([0.5 * theta + 0.2, 2.0], abs=1e-3)
    assert peaks(lambda *angles: np.ones(angles[0].size), 0.5, bilateral=True).size == 0


def test_rows_near_the_pole_are_of_means_over_the_azimuth() -> None:
    class Striped(Constant):
        """f = value (1 + a cos 3 phi_h), phi_h the azimuth of the half vector."""

        bilateral = False
        reciprocal = False

        def _evaluate(self, theta_i, theta_o, delta_phi, out):  # type: ignore[no-untyped-def]
            x = np.sin(theta_i) + np.sin(theta_o) * np.cos(delta_phi)
            y = np.sin(theta_o) * np.sin(delta_phi)
            out[:, 0] = self.value * (1 + 0.4 * np.cos(3 * np.arctan2(y, x)))
            return True

    rows = bc.compare(Striped(0.2), Constant(0.2)).by_theta_i
    degrees = np.degrees([row["theta_i"] for row in rows])
    assert degrees[:5] == pytest.approx([0, 0.5, 1, 2, 5])
    assert max(row["l1"] for row in rows[:4]) < 0.01
    assert min(row["l1"] for row in rows[4:8]) > 0.2  # E|.4 cos| = .8/pi


def test_ranges_of_light_have_rows_of_their_own() -> None:
    rows = bc.compare(Constant(0.2), Constant(0.21), directions=5_000, light=(0.4, 0.45)).by_theta_i
    assert [row["theta_i"] for row in rows] == pytest.approx([0.4, 0.45])
    assert [row["l1"] for row in rows] == pytest.approx([0.05, 0.05])
    rows = bc.compare(Constant(0.2), Constant(0.21), directions=5_000, light=(0.0, 0.3)).by_theta_i
    assert np.degrees(rows[-1]["theta_i"]) == pytest.approx(np.degrees(0.3))
    assert len(rows) == 7
