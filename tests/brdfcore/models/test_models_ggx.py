"""GGX: values of other programs, masking, energy.

Agreement with mpmath over hard cases is in test_models_hard_cases.py.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from brdfcore.base.channels import RGB
from brdfcore.base.errors import InputError
from brdfcore.models.cook_torrance import CookTorrance
from brdfcore.models.ggx import GGX
from brdfcore.testing import sample_angles

#: (alpha, theta_i, theta_o, delta_phi in degrees): f of Mitsuba 3.9.1 `roughconductor` (scalar_rgb, float32), GGX with
#: its separable Smith, n = .37, k = 2.82; its value divided by cos theta_o.
MITSUBA = {
    (0.1, 30, 30, 180): 8.991092784388865,
    (0.1, 30, 45, 170): 1.1427731065659585,
    (0.1, 80, 75, 175): 5.869031851739348,
    (0.1, 60, 20, 90): 0.015642260800021953,
    (0.5, 30, 30, 180): 0.34597155026915755,
    (0.5, 30, 45, 170): 0.36054062157995526,
    (0.5, 80, 75, 175): 1.5836601700643114,
    (0.5, 60, 20, 90): 0.1382280434397487,
}


@pytest.mark.parametrize("key", MITSUBA)
def test_agrees_with_mitsuba(key: tuple[float, ...]) -> None:
    got = GGX(roughness=key[0], ior=(0.37, 2.82), correlated=False).evaluate(*np.radians(key[1:]))[0]
    assert got == pytest.approx(MITSUBA[key], rel=1e-6)


@pytest.mark.parametrize("alpha", [1e-3, 0.1, 0.5, 1.0])
def test_values_by_walter_2007(alpha: float) -> None:
    """Eqs. 20, 33 and 34 in plain Python, where none of them cancels."""
    theta_i, theta_o = math.radians(40), math.radians(55)
    theta_h = 0.5 * (theta_o - theta_i)
    tan2 = math.tan(theta_h) ** 2
    d = alpha**2 / (math.pi * math.cos(theta_h) ** 4 * (alpha**2 + tan2) ** 2)
    g1 = [2 / (1 + math.sqrt(1 + alpha**2 * math.tan(t) ** 2)) for t in (theta_i, theta_o)]
    cosines = 4 * math.cos(theta_i) * math.cos(theta_o)
    got = GGX(roughness=alpha, correlated=False).evaluate(theta_i, theta_o, math.pi)[0]
    assert got == pytest.approx(d * g1[0] * g1[1] / cosines, rel=1e-13)
    correlated = 1 / (1 / g1[0] + 1 / g1[1] - 1)  # 1/(1 + L_i + L_o), G1 = 1/(1 + L)
    got = GGX(roughness=alpha).evaluate(theta_i, theta_o, math.pi)[0]
    assert got == pytest.approx(d * correlated / cosines, rel=1e-13)


def test_is_cook_torrance_with_ggx_and_smith() -> None:
    angles = sample_angles(100)
    for ior in (None, 1.5, "gold"):
        a = GGX(roughness=0.2, ior=ior, diffuse=0.1, specular=0.9)
        b = CookTorrance(distribution="ggx", masking="smith", roughness=0.2, ior=ior, diffuse=0.1, specular=0.9)
        np.testing.assert_allclose(a.evaluate(*angles), b.evaluate(*angles), rtol=1e-14)


@pytest.mark.parametrize("correlated", [True, False])
@pytest.mark.parametrize("alpha", [1e-4, 1e-2, 0.1, 0.5, 1.0])
def test_white_furnace(alpha: float, correlated: bool) -> None:
    b = GGX(roughness=alpha, correlated=correlated)
    albedo, error = b.albedo_error(np.radians([0, 45, 80, 89, 89.9, 89.99]))
    assert (albedo <= 1 + 1e-6).all()
    assert error.max() <= 1e-6
    assert b.energy_conserving


def test_a_grazing_light_loses_nothing_to_correlated_masking() -> None:
    """For alpha = 1, D = 1/pi and sqrt(c^2 + alpha^2 s^2) = 1, so the separable f cos_o is cos_o/(pi (1 + cos_i)
    (1 + cos_o)), whose integral is 2 (1 - ln 2)/(1 + cos_i); correlated, all light is returned at the horizon."""
    horizon = 0.5 * math.pi
    for theta in (0.0, 1.0):
        want = 2 * (1 - math.log(2)) / (1 + math.cos(theta))
        assert GGX(roughness=1.0, correlated=False).albedo(theta)[0] == pytest.approx(want, abs=1e-6)
    assert GGX(roughness=1.0).albedo(horizon)[0] == pytest.approx(1, abs=1e-6)
    assert GGX(roughness=1.0, correlated=False).albedo(horizon)[0] == pytest.approx(2 - 2 * math.log(2), abs=1e-6)


def test_reciprocity_channels_and_parameters() -> None:
    theta_i, theta_o, delta_phi = sample_angles(200)
    for correlated in (True, False):
        b = GGX(alpha=[0.1, 0.2, 0.3], ior=["gold", 1.5, 1.0003], correlated=correlated)
        assert b.channels == RGB
        assert (b.evaluate(theta_i, theta_o, delta_phi) == b.evaluate(theta_o, theta_i, -delta_phi)).all()
        single = GGX(roughness=0.2, ior=1.5, correlated=correlated).evaluate(0.3, 0.4, 3.0)[0]
        assert b.evaluate(0.3, 0.4, 3.0)[1] == pytest.approx(single, rel=1e-14)
    for bad in ({"correlated": "yes"}, {"roughness": 0}, {"ior": -1}, {"diffuse": 0.1}):
        with pytest.raises(InputError):
            GGX(**bad)
    with pytest.raises(InputError, match="channels"):
        GGX(roughness=[0.1, 0.2], ior=[1.4, 1.5, 1.6])
