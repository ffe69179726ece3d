"""`albedo` and `albedo_error`: closed forms, kinks, the estimate itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.quadrature import integrate_hemisphere
from tests.support.sources import Multilinear
from tests.support.tiers import first_fast

GRAZING = np.radians([0, 20, 45, 70, 85, 89, 89.9, 89.99, 90])


@pytest.mark.parametrize("m", [1e-4, 1e-2, 0.1, 0.5, 1.0, 1.5])
def test_white_furnace_of_v_grooves_with_the_default_rule(m: float) -> None:
    """Their min() is a kink; with a fixed rule the albedo is 1.0004 near the horizon."""
    assert (bc.model("cook_torrance", roughness=m).albedo(GRAZING) <= 1 + 1e-6).all()


@pytest.mark.parametrize("m", [1e-4, 0.1, 1.0])
def test_ggx_has_closed_forms(m: float) -> None:
    """Without masking, at normal incidence, int D cos theta_h dw to 45 deg = 1/(1 + m^2)."""
    b = bc.model("cook_torrance", distribution="ggx", masking="none", roughness=m)
    albedo, error = b.albedo_error(0.0)
    assert albedo.shape == error.shape == (1,)
    assert albedo[0] == pytest.approx(1 / (1 + m * m), abs=1e-12)
    assert abs(albedo[0] - 1 / (1 + m * m)) <= error[0] <= 5e-7


@pytest.mark.parametrize(
    ("name", "parameters"),
    first_fast(
        ("cook_torrance", {"roughness": 1e-3, "diffuse": 0.3, "specular": 0.7}),
        ("cook_torrance", {"roughness": 0.3}),
        ("phong", {"exponent": 0.5}),
        ("phong", {"exponent": 1e6}),
        ("oren_nayar", {"sigma": 0.6}),
    ),
)
def test_the_estimate_covers_the_error(name: str, parameters: dict[str, float]) -> None:
    theta = np.radians([45, 80, 89.9])
    b = bc.model(name, **parameters)
    fine, left = b.albedo_error(theta, tolerance=1e-9, budget=2_000_000)
    for tolerance in (1e-3, 1e-5):
        rough, error = b.albedo_error(theta, tolerance=tolerance)
        assert (error <= tolerance).all()
        assert (np.abs(rough - fine) <= error + left).all()


def test_a_small_budget_is_kept_and_said() -> None:
    calls: list[int] = []

    def stripes(theta_o: np.ndarray, delta_phi: np.ndarray) -> np.ndarray:
        calls.append(theta_o.size)
        return (np.sin(300 * theta_o) > 0).astype(float)[:, None]

    value, error = integrate_hemisphere(stripes, 0.4, bilateral=True, tolerance=1e-9, budget=20_000)
    assert sum(calls[1:]) <= 20_000
    assert error[0] > 1e-9
    assert abs(value[0] - 0.5 * math.pi) <= error[0]


def test_delta_channels_and_shape() -> None:
    b = bc.model("mirror", reflectance=[0.2, 0.3, 0.4]) + bc.model("lambert", reflectance=0.5)
    albedo, error = b.albedo_error(np.array([[0.1, 0.5]]))
    assert albedo.shape == error.shape == (1, 2, 3)
    np.testing.assert_allclose(albedo[0, 1], [0.7, 0.8, 0.9], rtol=1e-9)
    assert (error < 1e-6).all()
    half = (0.5 * bc.model("ggx", roughness=0.3)).albedo_error(1.0)
    whole = bc.model("ggx", roughness=0.3).albedo_error(1.0)
    assert [x[0] for x in half] == [0.5 * x[0] for x in whole]


def test_what_is_no_formula_is_integrated_once_unless_asked() -> None:
    b = Multilinear()
    _, error = b.albedo_error(0.5)
    assert error[0] < 1e-5
    assert b.albedo(0.5) == pytest.approx(b.albedo_error(0.5)[0], rel=1e-3)


def test_known_angles_are_not_integrated_again() -> None:
    b = bc.model("ggx", roughness=0.2)
    first = b.albedo([0.3, 1.5])
    assert len(b._albedos) == 2
    assert (b.albedo([1.5, 0.3])[::-1] == first).all()
    assert len(b._albedos) == 2
