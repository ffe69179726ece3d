"""tabulate: what it chooses, and that the error it states is the error."""

from __future__ import annotations

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.directions import mixture
from brdfcore.build.tabulate import ToleranceWarning
from brdfcore.metrics.incidence import worst
from tests.support.sources import Constant


def gold(roughness: float) -> bc.Brdf:
    return bc.model("cook_torrance", roughness=roughness, ior="gold")


def test_stated_error_holds_on_fresh_directions() -> None:
    source = gold(0.2)
    table = bc.tabulate(source, "angle_grid", shape=(46, 46, 91))
    again = bc.compare(source, table, seed=99)
    assert again.seed != table.error["seed"]
    assert again.l1 == pytest.approx(table.error["l1"], abs=5 * (again.l1_stderr + table.error["l1_stderr"]))


def test_no_direction_of_the_error_is_a_node() -> None:
    table = bc.tabulate(Constant(0.1), "angle_grid", shape=(91, 91, 181))
    drawn = mixture(table.error["directions"], table.error["seed"])
    for angle, step in ((drawn.theta_i, np.pi / 180), (drawn.theta_o, np.pi / 180), (drawn.delta_phi, np.pi / 180)):
        off = np.abs(angle[drawn.weight > 0] / step - np.rint(angle[drawn.weight > 0] / step))
        assert (off > 1e-9).all()


def test_tolerance_picks_the_fastest_that_meets_it() -> None:
    """A plain grid while it fits into the caches; what needs one of many megabytes is faster about its lobe."""
    rough = bc.model("oren_nayar", sigma=0.5)
    loose, sharp = bc.tabulate(rough, tolerance=0.02), bc.tabulate(gold(0.05), tolerance=0.01)
    assert worst(loose.error["by_theta_i"]) <= 0.02
    assert loose.name == "angle_grid"
    assert loose.error["tolerance"] == 0.02
    assert worst(sharp.error["by_theta_i"]) <= 0.01
    assert sharp.name == "lobe_grid"
    assert sharp.nbytes < 100_000


@pytest.mark.slow
def test_a_tighter_tolerance_takes_more_nodes() -> None:
    asked = {"measure": "average"}  # which the L1 below is
    loose, tight = (bc.tabulate(gold(0.3), "half_difference", tolerance=t, **asked) for t in (0.005, 0.0007))
    assert loose.error["l1"] <= 0.005
    assert tight.error["l1"] <= 0.0007
    assert loose.nbytes < tight.nbytes


def test_a_tolerance_that_is_not_met_is_said() -> None:
    with pytest.warns(ToleranceWarning, match="no table met tolerance 0.01"):
        table = bc.tabulate(gold(0.005), "angle_grid", tolerance=0.01)
    assert table.error["l1"] > 0.01
    assert any("no table met" in sentence for sentence in table.error["warnings"])


def test_max_bytes_is_kept_and_used() -> None:
    for limit in (10_000, 1_000_000):
        table = bc.tabulate(gold(0.3), "angle_grid", max_bytes=limit)
        assert 0.5 * limit < table.nbytes <= limit


def test_a_bad_table_says_so() -> None:
    bad = bc.tabulate(gold(0.01), "angle_grid", shape=(61, 61, 121))
    good = bc.tabulate(gold(0.4), "angle_grid", shape=(61, 61, 121))
    assert any("misplaces" in sentence for sentence in bad.error["warnings"])
    assert not any("misplaces" in sentence for sentence in good.error["warnings"])


def test_progress_is_told_and_reaches_the_end() -> None:
    said: list[tuple[int, int, str]] = []
    bc.tabulate(gold(0.3), "angle_grid", shape=(46, 46, 181), progress=lambda *now: said.append(now))
    stages = {stage for _, _, stage in said}
    assert len(stages) == 2
    for stage in stages:
        steps = [(done, total) for done, total, s in said if s == stage]
        assert steps == sorted(steps)
        assert steps[-1][0] == steps[-1][1]


def test_only_a_mirror() -> None:
    table = bc.tabulate(bc.model("mirror", reflectance=0.9), "angle_grid", shape=(8, 8, 8))
    assert table.error["l1"] is None
    assert any("no regular part" in sentence for sentence in table.error["warnings"])


def test_unknown_representation_names_close_ones() -> None:
    with pytest.raises(bc.UnknownNameError, match="angle_grid"):
        bc.tabulate(Constant(0.1), "anglegrid")


def test_the_error_of_a_mirror_part_counts() -> None:
    """A smooth reflectance is held; total reflection has a kink that no table of angles holds, and it is said."""
    smooth = bc.tabulate(bc.model("mirror", ior=1.5), "angle_grid", shape=(2, 2, 3))
    assert 0 < smooth.error["delta"] < 1e-4
    assert not any("mirror part is off" in sentence for sentence in smooth.error["warnings"])
    kinked = bc.model("mirror", ior=1.0, exterior_ior=1.5)
    table = bc.tabulate(kinked, "angle_grid", shape=(2, 2, 3))
    assert table.error["delta"] > 0.05
    assert any("mirror part is off by" in sentence for sentence in table.error["warnings"])
    with pytest.warns(ToleranceWarning, match="mirror part is off by"):
        bc.tabulate(kinked, "angle_grid", tolerance=0.01)


def test_values_that_are_no_numbers_are_not_called_a_missing_regular_part() -> None:
    """The source is NaN between the nodes, where the error is measured."""

    class Holes(Constant):
        def _evaluate(self, theta_i, theta_o, delta_phi, out):  # type: ignore[no-untyped-def]
            out[:, 0] = np.where(np.isin(theta_i, np.append(np.linspace(0, np.pi / 2, 3), NEAR_HORIZON)), 1.0, np.nan)
            return True

        def albedo(self, theta_i, **_):  # type: ignore[no-untyped-def]
            return np.full((*np.shape(theta_i), 1), np.nan)

    source = Holes(1.0)
    source.energy_conserving = False
    table = bc.tabulate(source, "angle_grid", shape=(3, 3, 3))
    assert table.error["l1"] is None
    assert table.error["regular"]
    said = " ".join(table.error["warnings"])
    assert "not finite" in said
    assert "no regular part" not in said
    with pytest.warns(ToleranceWarning):
        bc.tabulate(NotANumber(0.1), "angle_grid", tolerance=0.01)


NEAR_HORIZON = np.pi / 2 - 0.25 * np.pi / 4


class NotANumber(Constant):
    """NaN away from multiples of 1/48 degree, which are the nodes of every grid that a tolerance tries."""

    energy_conserving = False

    def _evaluate(self, theta_i, theta_o, delta_phi, out):  # type: ignore[no-untyped-def]
        odd = np.degrees(theta_i) * 48
        out[:, 0] = np.where(np.abs(odd - np.rint(odd)) < 1e-6, 1.0, np.nan)
        return True


def test_advice_names_only_what_can_help() -> None:
    """A table of a model that is bad: another representation that can hold it and was not tried."""
    bad = bc.tabulate(gold(0.01), "angle_grid", shape=(10, 10, 19)).error["warnings"]
    advice = [sentence for sentence in bad if sentence.startswith("try ")]
    assert len(advice) == 1
    assert "half_difference" in advice[0]
    for other in ("vndf_warp", "angle_grid"):  # holds measured files only; was tried
        assert other not in advice[0]
    assert sum("misplaces" in sentence for sentence in bad) == 1
