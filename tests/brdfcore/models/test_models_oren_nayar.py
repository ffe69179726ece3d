"""Oren-Nayar: limits, the qualitative model of the same paper, the clamp, energy.

Agreement with mpmath over hard cases is in test_models_hard_cases.py.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from brdfcore.base.channels import RGB
from brdfcore.base.errors import InputError
from brdfcore.models.lambert import Lambert
from brdfcore.models.oren_nayar import OrenNayar
from brdfcore.testing import sample_angles
from tests.support import oracle

HALF_PI = 0.5 * math.pi


def test_a_smooth_surface_is_lamberts() -> None:
    angles = sample_angles(200)
    np.testing.assert_array_equal(OrenNayar(reflectance=0.7, sigma=0).evaluate(*angles), 0.7 / np.pi)
    np.testing.assert_allclose(OrenNayar(reflectance=0.7, sigma=1e-9).evaluate(0.3, 0.4, 1.0), 0.7 / np.pi, rtol=1e-14)
    assert OrenNayar(sigma=0).albedo(1.0) == pytest.approx(Lambert().albedo(1.0), rel=1e-12)


@pytest.mark.parametrize("sigma", [0.1, 0.3, 0.7, 1.2])
def test_along_the_normal(sigma: float) -> None:
    """theta_i = theta_o = 0: (rho/pi)(C1 + .17 rho s/(s + .13)), eqs. 30 and 31 with alpha = beta = 0."""
    s, rho = sigma**2, 0.6
    want = rho / math.pi * (1 - 0.5 * s / (s + 0.33) + 0.17 * rho * s / (s + 0.13))
    assert OrenNayar(reflectance=rho, sigma=sigma).evaluate(0, 0, 0.7)[0] == pytest.approx(want, rel=1e-14)


@pytest.mark.parametrize("sigma", [0.1, 0.35, 0.7])
def test_towards_the_light_it_is_the_qualitative_model(sigma: float) -> None:
    """Eq. 32 of the paper, as renderers have it: A + B max(0, cos phi) sin alpha tan beta; exact in the plane of
    incidence on the light's side but for the interreflections, which a dark surface lacks."""
    s, rho = sigma**2, 1e-9
    theta_i, theta_o = np.radians([10, 40, 75, 20]), np.radians([30, 40, 60, 80])
    alpha, beta = np.maximum(theta_i, theta_o), np.minimum(theta_i, theta_o)
    want = 1 - 0.5 * s / (s + 0.33) + 0.45 * s / (s + 0.09) * np.sin(alpha) * np.tan(beta)
    got = OrenNayar(reflectance=rho, sigma=sigma).evaluate(theta_i, theta_o, 0.0)[:, 0] * np.pi / rho
    np.testing.assert_allclose(got, want, rtol=1e-9)


def test_retro_reflection_beats_the_mirror_direction() -> None:
    """What the model is for: a rough disc lit from the viewer looks flat, with no dark limb."""
    b = OrenNayar(sigma=0.5)
    theta = np.radians([30, 50, 70])
    assert (b.evaluate(theta, theta, 0.0) > 1.2 * b.evaluate(theta, theta, np.pi)).all()


def test_the_printed_form_is_negative_where_f_is_clamped() -> None:
    """-.085 rho at sigma near pi/2, both directions grazing, opposite azimuths; f is 0 there and never below."""
    theta = HALF_PI - 1e-6
    printed = oracle.oren_nayar(*oracle.from_angles(theta, theta, math.pi), reflectance=0.01, sigma=1.57)
    assert float(printed) / 0.01 == pytest.approx(-0.085, abs=5e-4)
    assert OrenNayar(reflectance=0.01, sigma=1.57).evaluate(theta, theta, math.pi)[0] == 0
    grid = np.meshgrid(np.linspace(0, HALF_PI, 40), np.linspace(0, HALF_PI, 40), np.linspace(0, np.pi, 21))
    assert (OrenNayar(reflectance=0.01, sigma=1.57).evaluate(*grid) >= 0).all()


def test_digits_at_the_horizon_where_two_tangents_have_no_bound() -> None:
    """A plain evaluation of sin alpha - (2 beta/pi)^3 and 1 - |cos phi| has none left: both multiply tan near 90."""
    for theta_i, theta_o in ((HALF_PI, HALF_PI), (HALF_PI, HALF_PI - 1e-12), (HALF_PI - 1e-9, HALF_PI - 3e-9)):
        for delta_phi in (0.0, 1e-6, math.pi / 2, math.pi - 1e-6, math.pi):
            for sigma in (0.05, 0.3, 1.0):
                want = float(
                    oracle.oren_nayar(*oracle.from_angles(theta_i, theta_o, delta_phi), reflectance=0.5, sigma=sigma)
                )
                got = OrenNayar(reflectance=0.5, sigma=sigma).evaluate(theta_i, theta_o, delta_phi)[0]
                assert got == pytest.approx(max(want, 0.0), rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("sigma", [0.1, 0.3, 0.6, 1.5])
def test_energy_as_claimed(sigma: float) -> None:
    theta = np.radians([0, 45, 70, 80, 85, 88, 89.9, 89.99])
    claimed, above = OrenNayar(reflectance=0.95, sigma=sigma), OrenNayar(reflectance=1.0, sigma=sigma)
    assert (claimed.energy_conserving, above.energy_conserving) == (True, False)
    assert (claimed.albedo(theta) <= 1).all()
    assert (above.albedo(theta) <= 1.06).all()
    if sigma == 0.3:
        assert above.albedo(theta).max() > 1.05
    assert OrenNayar(reflectance=1.0, sigma=0).energy_conserving


def test_reciprocity_and_parameters() -> None:
    theta_i, theta_o, delta_phi = sample_angles(300)
    b = OrenNayar(reflectance=[0.2, 0.5, 0.9], sigma=[0.1, 0.5, 1.0])
    assert b.channels == RGB
    assert (b.evaluate(theta_i, theta_o, delta_phi) == b.evaluate(theta_o, theta_i, -delta_phi)).all()
    for bad in ({"reflectance": 1.1}, {"sigma": -0.1}, {"sigma": 1.6}, {"roughness": 0.1}):
        with pytest.raises((InputError, KeyError)):
            OrenNayar(**bad)
