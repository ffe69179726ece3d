"""Domain, units and broadcasting at the one place they are defined."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf

import brdfcore as bc
from brdfcore.base import conventions
from tests.support.sources import Skewed


@given(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12))
@settings(max_examples=500, deadline=None)
def test_reduction_of_delta_phi_against_mpmath(delta_phi: float) -> None:
    """Within an ulp of pi of the exact remainder, taken with 60 digits of pi; the float itself inside [-pi, pi]."""
    reduced = float(conventions.reduce_delta_phi(np.array([delta_phi]))[0])
    assert abs(reduced) <= np.pi * (1 + 1e-15)
    if abs(delta_phi) <= np.pi:
        assert reduced == delta_phi
        return
    with mp.workdps(60):
        turns = mp.nint(mpf(delta_phi) / (2 * mp.pi))
        exact = mpf(delta_phi) - turns * 2 * mp.pi
        # at half a turn both ends are right
        assert min(abs(reduced - exact), abs(abs(reduced - exact) - 2 * mp.pi)) < 9e-16


def test_huge_delta_phi_stays_finite() -> None:
    huge = np.array([1e300, -1.7e308, 2.0**60])
    assert (np.abs(conventions.reduce_delta_phi(huge)) <= 3.2).all()
    assert np.isfinite(Skewed().evaluate(0.1, 0.2, huge)).all()
    assert np.isfinite(Skewed().evaluate(np.float32(0.1), np.float32(0.2), np.float32(3e38))).all()


def test_one_unit_conversion() -> None:
    assert np.array_equal(conventions.to_radians([30, 90]), np.radians([30.0, 90.0]))
    assert conventions.to_radians(np.float32(30)).dtype == np.float32


@pytest.mark.parametrize("dtype", [np.int32, np.uint8, np.float16, ">f8", ">f4"])
def test_other_number_types(dtype: object) -> None:
    angles = np.array([0, 1], dtype=dtype)  # type: ignore[call-overload]
    expected = Skewed().evaluate(np.array([0.0, 1.0]), 0.5, 1.0)
    found = Skewed().evaluate(angles, 0.5, 1.0)
    assert found.dtype == np.float64
    assert np.array_equal(found, expected)


def test_empty_and_zero_dimensional() -> None:
    assert Skewed().evaluate([], 0.1, 0.2).shape == (0, 3)
    assert Skewed().evaluate_vectors(np.empty((0, 3)), [0, 0, 1.0]).shape == (0, 3)
    assert Skewed().status(0.1, 0.2, 0.3).shape == ()


def test_vectors_of_any_length() -> None:
    wi, wo = np.array([0.3, 0.1, 0.9]), np.array([-0.2, 0.5, 0.4])
    for scale in (1e-300, 1e-160, 1.0, 1e160, 1e300):
        assert np.allclose(Skewed().evaluate_vectors(scale * wi, wo), Skewed().evaluate_vectors(wi, wo), rtol=1e-14)


def test_channels() -> None:
    rgb = bc.Channels(["R", "G", "B"])
    assert rgb == ("R", "G", "B")
    assert rgb.kind == "name"
    assert rgb.find("G") == rgb.find("1") == 1
    waves = bc.Channels([400, 550.5])
    assert waves.kind == "wavelength"
    assert waves.find("550.5") == waves.find(550.5) == 1
    assert waves.labels() == ["400 nm", "550.5 nm"]
    assert pickle.loads(pickle.dumps(waves)) == waves
    for bad in ([], ["R", "R"], ["R", 5.0], [-1.0], [float("nan")], [True]):
        with pytest.raises(bc.InputError):
            bc.Channels(bad)  # type: ignore[arg-type]
    for miss in ("purple", "\u00b2", "\u0661", "9" * 5_000, "", " ", "-1", "3"):  # digits to isdigit, not to int
        with pytest.raises(bc.UnknownNameError, match="R, G, B"):
            rgb.find(miss)
    assert bc.Channels(["a", ""]).find("1") == 1
    with pytest.raises(bc.InputError):
        bc.Channels([10**400])


def test_sums_and_multiples() -> None:
    a, b = bc.model("lambert", reflectance=0.3), bc.model("cook_torrance", roughness=0.2, ior="gold")
    angles = (np.array([0.2, 0.9]), 0.4, 3.0)
    both = 2 * a + b * 0.5
    assert np.array_equal(both.evaluate(*angles), 2 * a.evaluate(*angles) + 0.5 * b.evaluate(*angles))
    assert (both.reciprocal, both.bilateral, both.energy_conserving) == (True, True, False)
    coloured = [0.1, 0.2, 0.3] * Skewed()
    assert np.array_equal(coloured.evaluate(*angles), Skewed().evaluate(*angles) * [0.1, 0.2, 0.3])
    assert (a + Skewed()).channels == Skewed().channels
    for bad in (-1, float("nan"), [1, 2], "x"):
        with pytest.raises(bc.InputError, match="factor"):
            bad * Skewed()
    with pytest.raises(bc.InputError, match="channels differ"):
        Skewed() + bc.model("lambert", reflectance=[0.1, 0.2])
    with pytest.raises(TypeError):
        a + 1  # type: ignore[operator]
    with pytest.raises(TypeError):
        1 + a
    total = sum([a, b, a])
    assert isinstance(total, bc.Brdf)
    assert np.array_equal(total.evaluate(*angles), (a + b + a).evaluate(*angles))
    for factor in (np.array([0.1, 0.2, 0.3]), np.float32(0.5), np.float64(0.5), np.array(0.5)):
        scaled = factor * Skewed()
        assert isinstance(scaled, bc.Brdf)
        assert np.array_equal(scaled.evaluate(*angles), (Skewed() * factor).evaluate(*angles))
    for bad in (10**400, 10**5_000):
        with pytest.raises(bc.InputError, match="factor"):
            bad * a


def test_errors_travel_between_processes() -> None:
    with pytest.raises(bc.InputError) as caught:
        Skewed().evaluate([0.1, 2.0], 0.1, 0.0)
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is bc.InputError
    assert (again.code, again.detail, again.context) == (
        caught.value.code,
        caught.value.detail,
        caught.value.context,
    )
    assert "theta_i[1] = 2.0" in str(again)
    assert again.context["index"] == [1]


@pytest.mark.parametrize(
    "value", [10**400, 10**5_000, [10**400, 0.5], -(10**400)], ids=["400", "5000", "list", "minus"]
)
def test_whole_numbers_beyond_any_float(value: object) -> None:
    with pytest.raises(bc.InputError) as caught:
        bc.model("lambert", reflectance=value)
    assert caught.value.context["where"] == "reflectance"
    with pytest.raises(bc.InputError):
        Skewed().evaluate(value, 0.1, 0.1)  # type: ignore[arg-type]
