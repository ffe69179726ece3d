"""tabulate: what it chooses, and that the error it states is the error."""

from __future__ import annotations

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.build import ToleranceWarning
from brdfcore.directions import mixture
from tests.core.sources import Constant


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


def test_tolerance_picks_the_smallest_that_meets_it() -> None:
    loose, tight = bc.tabulate(gold(0.3), tolerance=0.02), bc.tabulate(gold(0.3), tolerance=0.0007)
    assert loose.error["l1"] <= 0.02
    assert tight.error["l1"] <= 0.0007
    assert loose.nbytes < tight.nbytes
    assert loose.error["tolerance"] == 0.02


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
