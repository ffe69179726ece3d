"""A share of the hard cases (`python -m tests.benchmarks.hard_cases` runs them all) on every model but Cook-Torrance,
whose own are in test_hard_cases.py: every goal met, no NaN, nothing negative, nothing infinite."""

from __future__ import annotations

import numpy as np
import pytest

import brdfcore as bc
from tests.benchmarks import hard_cases, hard_grid

#: A prime, so that no angle of the grid is always left out.
STRIDE = {"ggx": 29, "oren_nayar": 7, "mirror": 7}
NEW = ("mirror", "phong", "blinn_phong", "ward", "ggx", "oren_nayar")


@pytest.mark.parametrize("entry", hard_cases.ENTRY_POINTS)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", NEW)
def test_goals(name: str, dtype: str, entry: str) -> None:
    total: dict[str, hard_cases.Found] = {}
    for m in hard_grid.ROUGHNESS:
        for found in hard_cases.run([name], m, entry, dtype, STRIDE.get(name, 11)):
            total.setdefault(found.label, hard_cases.Found(found.label)).merge(found)
    for found in total.values():
        assert not found.missed(), (found.label, found.missed(), found.worst)
    assert sum(f.cases for f in total.values()) > (0 if (name, entry) == ("mirror", "vectors") else 100) or not total


def test_a_wrong_value_would_be_found() -> None:
    """The comparison itself: a lobe 1e-11 too high, a NaN and a negative value are each reported."""
    given = hard_grid.inputs(0.1, "angles", "float64", 29)
    (case, *_) = hard_grid.cases("ward", 0.1, "angles")
    want = [case.want(hard_grid.Parts(*d, 0.1)) for d in given.directions]
    good = case.model("exact").evaluate(*given.arrays)[:, 0]
    for spoil, said in ((1 + 1e-11, "float64 angles 1e-11"), (np.nan, "NaN"), (-1.0, "negative")):
        found = hard_cases.Found("ward")
        hard_cases.measure(found, case, "exact", good * spoil, want, given)
        assert any(said in line for line in found.missed()), found.missed()


@pytest.mark.parametrize("name", ["phong", "blinn_phong", "ward", "ggx", "oren_nayar"])
@pytest.mark.parametrize("z", [5e-324, 1e-200, 1e-30])
def test_vectors_closer_to_the_horizon_than_any_angle_are_finite(name: str, z: float) -> None:
    for option in hard_grid.cases(name, 0.3, "vectors"):
        model = option.model("exact")
        for wo in ([-1, 0, z], [1, 0, z], [0, 1, z], [0, 0, 1]):
            with np.errstate(divide="raise", over="raise", invalid="raise"):
                value = model.evaluate_vectors([1, 0, z], wo)
            assert np.isfinite(value).all(), option.describe()
            assert (value >= 0).all(), option.describe()


@pytest.mark.parametrize("name", ["phong", "blinn_phong", "ward", "ggx", "oren_nayar"])
def test_reciprocal_bit_by_bit_and_no_azimuth_at_the_pole(name: str) -> None:
    for m in hard_grid.ROUGHNESS:
        theta_i, theta_o, delta_phi = (np.array(x) for x in zip(*hard_grid.pairs(m), strict=True))
        for option in hard_grid.cases(name, m, "angles"):
            model = option.model("exact")
            if model.reciprocal:
                back = model.evaluate(theta_o, theta_i, -delta_phi)
                assert (model.evaluate(theta_i, theta_o, delta_phi) == back).all(), option.describe()
            around = model.evaluate(0.0, m, np.linspace(-7, 7, 23))
            assert (around == around[0]).all(), option.describe()


def test_the_grid_holds_every_model() -> None:
    assert set(hard_grid.MODELS) == set(bc.models())
