"""Phong and Blinn-Phong: values, normalisations, what each convention claims.

Agreement with mpmath over hard cases is in test_models_hard_cases.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from brdfcore.base.channels import RGB
from brdfcore.base.errors import InputError
from brdfcore.base.quadrature import composite
from brdfcore.models.blinn_phong import BlinnPhong
from brdfcore.models.phong import Phong
from brdfcore.testing import sample_angles

EXPONENTS = (0.0, 1.0, 10.0, 1e2, 1e4, 1e6)
GRAZING = np.radians([0.0, 30, 60, 80, 85, 89, 89.9, 89.99])
MODELS = (Phong, BlinnPhong)


def lobe_at_normal_incidence(n: float, cosine: Any) -> float:
    """int cosine(theta)^n cos theta dw over the hemisphere, on panels graded towards the normal."""
    theta, weight = composite(np.concatenate([[0.0], np.geomspace(1e-5, 0.5 * math.pi, 40)]), 16)
    return float((weight * cosine(theta) ** n * np.cos(theta) * 2 * np.pi * np.sin(theta)).sum())


@pytest.mark.parametrize("n", EXPONENTS)
def test_normalisations_are_one_over_the_integral(n: float) -> None:
    """Lafortune & Willems 1994: 2 pi/(n + 2); Giesen 2009 for n.h, theta_h = theta/2 at normal incidence."""
    mirror = (0.0, 0.0, math.pi)
    assert Phong(exponent=n).evaluate(*mirror)[0] * lobe_at_normal_incidence(n, np.cos) == pytest.approx(1, rel=1e-11)
    half = lobe_at_normal_incidence(n, lambda theta: np.cos(0.5 * theta))
    assert BlinnPhong(exponent=n).evaluate(*mirror)[0] * half == pytest.approx(1, rel=1e-11)


def test_values_of_a_lobe_by_hand() -> None:
    """In the plane of incidence r.v = cos(theta_o - theta_i) and theta_h = (theta_o - theta_i)/2."""
    theta_i, theta_o = math.radians(30), math.radians(50)
    r_v, n_h = math.cos(math.radians(20)), math.cos(math.radians(10))
    got = Phong(exponent=20, diffuse=0.3, specular=0.7).evaluate(theta_i, theta_o, math.pi)[0]
    assert got == pytest.approx(0.3 / math.pi + 0.7 * 22 / (2 * math.pi) * r_v**20, rel=1e-14)
    got = Phong(exponent=20, convention="published").evaluate(theta_i, theta_o, math.pi)[0]
    assert got == pytest.approx(r_v**20 / math.cos(theta_i), rel=1e-14)
    got = BlinnPhong(exponent=80).evaluate(theta_i, theta_o, math.pi)[0]
    assert got == pytest.approx(82 * 84 / (8 * math.pi * (2**-40 + 80)) * n_h**80, rel=1e-14)
    got = BlinnPhong(exponent=80, convention="published").evaluate(theta_i, theta_o, math.pi)[0]
    assert got == pytest.approx(n_h**80 / math.cos(theta_i), rel=1e-14)


def test_real_time_rendering_gives_the_same_blinn_normaliser() -> None:
    """Akenine-Moeller, Haines, Hoffman, Real-Time Rendering, 3rd ed., 2008, eq. 7.49: (n + 8)/(8 pi), approximate."""
    n = np.array([1e2, 1e4, 1e6])
    peak = np.array([BlinnPhong(exponent=x).evaluate(0.0, 0.0, 0.0)[0] for x in n])
    assert (np.abs(peak / ((n + 8) / (8 * np.pi)) - 1) <= 2.1 / n).all()


def test_the_lobe_ends_where_r_v_does() -> None:
    b = Phong(exponent=0)
    assert b.evaluate(1.0, 1.0, 0.0)[0] == 0  # r.v = cos 2
    assert b.evaluate(1.0, 0.5, 0.0)[0] == pytest.approx(1 / math.pi, rel=1e-15)
    assert b.evaluate(0.0, np.pi / 2, 1.0)[0] == pytest.approx(1 / math.pi, rel=1e-15)  # cos(pi/2) is 6e-17, not 0
    near_end = np.radians([59.9999999, 60.0000001])
    assert (Phong(exponent=1).evaluate(math.radians(30), near_end, 0.0)[:, 0] > [1e-10, -1]).all()
    assert Phong(exponent=1).evaluate(math.radians(30), near_end, 0.0)[1, 0] == 0


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("n", [*EXPONENTS, 2e12])
def test_white_furnace(model: type, n: float) -> None:
    b = model(exponent=n)
    assert b.energy_conserving
    albedo, error = b.albedo_error(GRAZING)
    assert (albedo <= 1 + 1e-6).all()
    assert albedo[0, 0] == pytest.approx(1, abs=1e-9)
    # a discontinuity at the end of Phong's lobe for n = 0 is all that stays above the tolerance
    assert error.max() <= (1e-3 if n == 0 else 1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_the_published_form_creates_light(model: type) -> None:
    """k_s (r.v)^n reflects any share of a light that grazes: its irradiance vanishes and its highlight does not."""
    b = model(exponent=100, convention="published")
    assert (b.reciprocal, b.energy_conserving) == (False, False)
    factor = float(model(exponent=100).evaluate(0.0, 0.0, 0.0)[0])
    albedo = b.albedo(GRAZING)[:, 0]
    np.testing.assert_allclose(
        albedo, model(exponent=100).albedo(GRAZING)[:, 0] / (factor * np.cos(GRAZING)), rtol=1e-5
    )
    assert albedo[-1] > 1


@pytest.mark.parametrize("model", MODELS)
def test_reciprocal_only_if_normalised(model: type) -> None:
    theta_i, theta_o, delta_phi = sample_angles(200)
    forward, back = (model(exponent=30).evaluate(*a, delta_phi) for a in ((theta_i, theta_o), (theta_o, theta_i)))
    assert (forward == back).all()
    published = model(exponent=30, convention="published")
    assert not np.allclose(published.evaluate(0.2, 0.9, 3.0), published.evaluate(0.9, 0.2, 3.0))


@pytest.mark.parametrize("model", MODELS)
def test_parameters(model: type) -> None:
    assert (model().parameters["diffuse"], model().parameters["specular"]) == (0.0, 1.0)
    assert model().parameters["convention"] == "normalised"
    many = model(exponent=[1, 20, 300], diffuse=0.1, specular=[0.1, 0.2, 0.9])
    assert many.channels == RGB
    one = model(exponent=300, diffuse=0.1, specular=0.9)
    assert many.evaluate(0.3, 0.4, 3.0)[2] == one.evaluate(0.3, 0.4, 3.0)[0]
    with pytest.raises(InputError, match=r"diffuse \+ specular = 1.01"):
        model(diffuse=0.01)
    with pytest.warns(UserWarning, match=r"diffuse \+ specular"):
        model(diffuse=0.01, convention="published")
    for bad in ({"exponent": -1}, {"exponent": 1e17}, {"convention": "slides"}, {"specular": -1}):
        with pytest.raises(InputError) as caught:
            model(**bad)
        assert caught.value.context["where"] in bad
