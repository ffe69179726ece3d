"""Fresnel reflectance, optical constants and the `ior` grammar."""

from __future__ import annotations

import math
import warnings

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brdfcore.base.errors import InputError, UnknownNameError
from brdfcore.models.base import fresnel
from brdfcore.models.base.optical_constants import CONSTANTS, ior_to_json, parse_ior
from tests.support import oracle

COSINES = np.concatenate(
    [[6.123233995736766e-17, 1e-12, 1e-8, 1e-4], np.linspace(0.01, 1, 23), 1 - np.geomspace(1e-15, 1e-3, 5)]
)
INDICES = [complex(n, k) for n in (1 + 1e-8, 1.0003, 1.5, 2.42, 1e-4, 0.37, 1e4) for k in (0, 1e-4, 2.82, 100)]


def relative(got: float, want: mp.mpf) -> float:
    return float(abs(mp.mpf(float(got)) / want - 1))


@pytest.mark.parametrize("exterior", [1.0, 1.00029, 2.0])
def test_exact_forms_and_absorptance_agree_with_mpmath(exterior: float) -> None:
    """Snell's law at 60 digits; for every (n, k) both F and 1 - F keep their digits, whichever is small."""
    for index in INDICES:
        got, rest = fresnel.conductor(COSINES, index, exterior), fresnel.absorptance(COSINES, index, exterior)
        for c, f, a in zip(COSINES, got, rest, strict=True):
            want = oracle.fresnel(float(c), index, exterior)
            assert relative(f, want) <= 4e-15, (index, c)
            if 1 - want > mp.mpf(10) ** -50:
                assert relative(a, 1 - want) <= 1e-12, (index, c)
            else:
                assert a == 0, (index, c)  # total internal reflection


@pytest.mark.parametrize("n", [1 + 1e-8, 1.0003, 1.5, 2.42, 0.5])
def test_dielectric_is_the_conductor_without_absorption(n: float) -> None:
    for c, got in zip(COSINES, fresnel.dielectric(COSINES, n), strict=True):
        assert relative(got, oracle.fresnel(float(c), n)) <= 4e-15, c


def test_approximations_agree_with_mpmath() -> None:
    for c in COSINES:
        for index in (1 + 1e-8, 1.0003, 1.5, complex(0.37, 2.82), complex(1e-3, 100)):
            want = oracle.schlick(float(c), index)
            assert relative(fresnel.schlick(c, index), want) <= 1e-12
            want = oracle.conductor_approximate(float(c), index)
            assert relative(fresnel.conductor_approximate(c, index), want) <= 1e-12


@pytest.mark.parametrize(("degrees", "value"), [(20, 0.049078), (60, 0.100056), (85, 0.619148)])
def test_black_glass_of_the_gloss_standards(degrees: float, value: float) -> None:
    """ASTM D523 / ISO 2813: the reflectance of n = 1.567 defines 100 gloss units at each geometry."""
    assert abs(fresnel.dielectric(math.cos(math.radians(degrees)), 1.567) - value) <= 5.1e-7


#: Mitsuba 3.9.1, `fresnel_conductor` and `fresnel`, variant scalar_rgb (float32): an independent implementation.
MITSUBA = [
    (0.37, 2.82, (0.84942997, 0.84662211, 0.88739812, 0.98533952)),
    (2.485, 3.433, (0.58463424, 0.57851589, 0.59002334, 0.91409361)),
    (0.177, 3.638, (0.95157427, 0.94976783, 0.95172560, 0.99327099)),
    (1.5, 0.0, (0.04, 0.05023991, 0.38770437, 0.90418494)),
    (2.42, 0.0, (0.17239495, 0.18152106, 0.43332765, 0.89969289)),
]


@pytest.mark.parametrize(("n", "k", "values"), MITSUBA)
def test_agrees_with_mitsuba(n: float, k: float, values: tuple[float, ...]) -> None:
    c = np.cos(np.radians([0, 45, 80, 89]))
    np.testing.assert_allclose(fresnel.conductor(c, complex(n, k)), values, rtol=2e-6)


def test_inside_glass_agrees_with_mitsuba_and_reflects_totally() -> None:
    """Mitsuba 3.9.1 `fresnel(-cos 30 deg, 1.5)`; past the critical angle, asin(1/1.5) = 41.81 deg, exactly 1."""
    np.testing.assert_allclose(fresnel.dielectric(math.cos(math.radians(30)), 1.0, 1.5), 0.055190168, rtol=2e-6)
    beyond = np.cos(np.radians([41.82, 45, 60, 89.999, 90]))
    assert (fresnel.dielectric(beyond, 1.0, 1.5) == 1).all()
    assert (fresnel.absorptance(beyond, 1.0, 1.5) == 0).all()
    assert fresnel.dielectric(math.cos(math.radians(41.8)), 1.0, 1.5) < 1


@pytest.mark.parametrize("n", [1.333, 1.5, 2.42])
def test_brewster_angle(n: float) -> None:
    """Brewster: at tan theta = n only the s component is left, r_s = (1 - n^2)/(1 + n^2), and F = r_s^2/2."""
    got = fresnel.dielectric(math.cos(math.atan(n)), n)
    np.testing.assert_allclose(got, 0.5 * ((1 - n**2) / (1 + n**2)) ** 2, rtol=1e-14)


@pytest.mark.parametrize("form", [fresnel.dielectric, fresnel.conductor])
def test_equal_media_have_no_interface(form: object) -> None:
    c = np.array([0.0, 6e-17, 0.5, 1.0])
    assert callable(form)
    assert (form(c, 1.5, 1.5) == 0).all()
    np.testing.assert_allclose(fresnel.absorptance(c, 1.5, 1.5), 1, atol=4e-16)


@pytest.mark.parametrize("index", [1.5, complex(0.37, 2.82)])
def test_grazing_incidence_reflects_all(index: complex) -> None:
    assert fresnel.conductor(0.0, index) == pytest.approx(1, abs=1e-15)
    assert fresnel.absorptance(0.0, index) == 0


@given(
    st.floats(0, 1), st.floats(1e-6, 1e6), st.one_of(st.just(0.0), st.floats(1e-6, 1e6)), st.sampled_from([1.0, 1.333])
)
def test_reflectances_lie_between_0_and_1(c: float, n: float, k: float, exterior: float) -> None:
    for form in (fresnel.conductor, fresnel.schlick, fresnel.conductor_approximate, fresnel.absorptance):
        assert 0 <= form(c, complex(n, k), exterior) <= 1
    assert 0 <= fresnel.dielectric(c, n, exterior) <= 1
    together = fresnel.conductor(c, complex(n, k), exterior) + fresnel.absorptance(c, complex(n, k), exterior)
    # near the critical angle F moves by the square root of a rounding of its argument
    assert abs(together - 1) <= (4e-15 if n >= exterior else 1e-7)


LARGEST = {"silver": 0.0022, "steel": 0.0053, "gold": 0.0054, "copper": 0.0068, 2.42: 0.026, 1.5: 0.099, 1.05: 0.40}


@pytest.mark.parametrize(("ior", "largest"), LARGEST.items())
def test_approximate_conductor_measures_itself_and_warns_above_a_hundredth(ior: object, largest: float) -> None:
    index = parse_ior("test", ior)
    digits = 4 if largest < 0.01 else 3 if largest < 0.1 else 2
    # against the oracle's own maximum, searched independently on plain angles
    angles = [mp.mpf(t) * mp.pi / 3600 for t in range(0, 1800, 3)]
    found = max(
        abs(oracle.conductor_approximate(mp.cos(t), complex(index[0])) - oracle.fresnel(mp.cos(t), complex(index[0])))
        for t in angles
    )
    got = fresnel.largest_approximation_error(index)
    assert got == pytest.approx(float(found), rel=1e-3)
    assert round(got, digits) == largest
    if largest > 0.01:
        with pytest.warns(UserWarning, match="off the exact reflectance"):
            fresnel.make("test", "conductor_approximate", index)
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            fresnel.make("test", "conductor_approximate", index)


def test_kind_is_chosen_by_the_ior() -> None:
    assert fresnel.make("test", "auto", None).kind == "none"
    assert fresnel.make("test", "auto", parse_ior("test", 1.5)).kind == "dielectric"
    assert fresnel.make("test", "auto", parse_ior("test", [1.5, "gold", 1.4])).kind == "conductor"
    with pytest.raises(InputError, match="needs an ior"):
        fresnel.make("test", "schlick", None)
    with pytest.raises(InputError, match="absorbs"):
        fresnel.make("test", "dielectric", parse_ior("test", "gold"))


GRAMMAR = [
    (1.5, [1.5]),
    (2, [2]),
    (np.float64(1.5), [1.5]),
    (1.5 + 2j, [1.5 + 2j]),
    ((0.37, 2.82), [0.37 + 2.82j]),
    ([0.37, 2.82], [0.37, 2.82]),  # a list is one index per channel; only a tuple is (n, k)
    ([1.5], [1.5]),
    (np.array([1.4, 1.5, 1.6]), [1.4, 1.5, 1.6]),
    ([(0.2, 3), "water", {"n": 1.1, "k": 2}], [0.2 + 3j, 1.333, 1.1 + 2j]),
    ({"n": 1.5}, [1.5]),
    ({"n": [0.1, 0.4, 1.4], "k": [4, 2.4, 1.6]}, [0.1 + 4j, 0.4 + 2.4j, 1.4 + 1.6j]),
    ({"n": 1.5, "k": [1, 2]}, [1.5 + 1j, 1.5 + 2j]),
    ("Fused quartz", [1.46]),
]


@pytest.mark.parametrize(("ior", "indices"), GRAMMAR)
def test_ior_grammar_and_its_json(ior: object, indices: list[complex]) -> None:
    assert parse_ior("test", ior).tolist() == indices
    assert parse_ior("test", ior_to_json(ior)).tolist() == indices


WRONG = [0, -1.5, 1e7, float("nan"), complex(1.5, -1), complex(1, float("nan")), True, None, object()]
WRONG += [(1, 2, 3), (1, "gold"), [], [[1, 2]], np.ones((2, 2)), {}, {"k": 1}, {"n": 1, "q": 2}]
WRONG += [{"n": [1, 2], "k": [1, 2, 3]}, {"n": True}, {"n": []}, [{"n": [1, 2]}]]


@pytest.mark.parametrize("ior", WRONG)
def test_ior_errors_name_what_is_wrong(ior: object) -> None:
    with pytest.raises(InputError) as caught:
        parse_ior("test", ior)
    assert caught.value.context["where"] == "ior"
    assert caught.value.context["expected"]


def test_unknown_name_is_answered_with_close_ones() -> None:
    with pytest.raises(UnknownNameError, match="'gold'"):
        parse_ior("test", "golld")


def test_constants_are_the_listed_ones() -> None:
    """Course-table values at 589 nm as listed in the project's numerics notes, not a measurement of this library."""
    assert CONSTANTS["silver"] == 0.177 + 3.638j
    assert CONSTANTS["steel"] == 2.485 + 3.433j
    assert CONSTANTS["diamond"] == 2.42
    assert len(CONSTANTS) == 15
