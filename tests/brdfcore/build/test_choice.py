"""Which table `tabulate` takes: the fewest bytes that are fast enough, from the smallest up, at each incidence."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.build.costs import nanoseconds, table
from brdfcore.build.search import Tried, chosen
from brdfcore.metrics.incidence import worst
from tests.support.lobes import Lobes


def tried(nbytes: int, ns: float) -> Any:
    return Tried(SimpleNamespace(nbytes=nbytes), ns, 0.005)  # type: ignore[arg-type]


def test_fewest_bytes_within_a_quarter_of_the_fastest() -> None:
    fast, small, slow = tried(900, 4.0), tried(300, 4.9), tried(100, 5.1)
    assert chosen([fast, small, slow]) is small
    assert chosen([fast, slow]) is fast
    assert chosen([slow]) is slow


def test_costs_are_those_that_were_stored() -> None:
    costs = table()
    for way, rows in costs["ns"].items():
        name, _, interpolation = way.partition(" ")
        for channels, row in zip(costs["channels"], rows):
            for nbytes, ns in zip(costs["nbytes"], row):
                assert nanoseconds(name, interpolation, channels, nbytes) == pytest.approx(ns)
    assert nanoseconds("angle_grid", "linear", 3, 3e5) == pytest.approx(
        np.interp(np.log(3e5), np.log(costs["nbytes"]), costs["ns"]["angle_grid linear"][1])
    )
    assert nanoseconds("angle_grid", "linear", 64, 1e4) == pytest.approx(
        2 * nanoseconds("angle_grid", "linear", 32, 1e4)
    )
    assert nanoseconds("never_heard_of", "linear", 3, 1e4) > 100


def test_the_ladder_starts_small() -> None:
    rough = bc.tabulate(bc.model("oren_nayar", sigma=1.5), tolerance=0.05)
    assert worst(rough.error["by_theta_i"]) <= 0.05
    assert rough.nbytes <= 40_000


def test_a_tolerance_holds_at_each_incidence_on_fresh_draws() -> None:
    source = bc.model("cook_torrance", roughness=0.05, ior="gold")
    made = bc.tabulate(source, tolerance=0.01)
    assert made.error["measure"] == "incidence"
    assert worst(made.error["by_theta_i"]) <= 0.01
    assert worst(bc.compare(source, made, seed=77, directions=20_000).by_theta_i) <= 0.012


def test_the_average_is_the_old_meaning() -> None:
    """It allows at grazing light what the other meaning does not."""
    source = bc.model("cook_torrance", roughness=0.05, ior="gold")
    made = bc.tabulate(source, "half_difference", tolerance=0.01, measure="average")
    assert made.error["measure"] == "average"
    assert made.error["l1"] <= 0.01
    assert worst(made.error["by_theta_i"]) > 0.01
    with pytest.raises(bc.InputError, match="measure"):
        bc.tabulate(source, tolerance=0.01, measure="worst")  # type: ignore[arg-type]


def test_max_bytes_makes_the_worst_incidence_small() -> None:
    source = bc.model("ggx", roughness=0.05)
    small, large = (bc.tabulate(source, max_bytes=n) for n in (9_000, 60_000))
    assert small.nbytes <= 9_000 < large.nbytes <= 60_000
    assert worst(large.error["by_theta_i"]) < worst(small.error["by_theta_i"]) < 0.1


def test_albedo_towards_the_horizon_passes_1_by_what_is_stated() -> None:
    """The smallest table of this gold that meets the tolerance up to 89 degrees reflects 1.49 of the light at 90."""
    made = bc.tabulate(bc.model("cook_torrance", roughness=0.01, ior="gold"), tolerance=0.01)
    theta = np.radians([85.0, 89.0, 89.9, 89.95, 89.99, 90.0])
    assert made.albedo(theta).max() <= 1 + made.error["albedo_excess"] + 1e-3 <= 1.042


def test_a_spike_that_a_table_lacks_is_not_met() -> None:
    """A lobe of 1e-5 at the light, half the energy: an angle grid can't hold it, and says so."""
    with pytest.warns(UserWarning, match="no table met tolerance 0.01"):
        made = bc.tabulate(Lobes(("light",), 1e-5), "angle_grid", tolerance=0.01)
    assert made.error["l1"] > 0.3
