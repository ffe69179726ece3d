"""Nodes and weights against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base import geometry, quadrature


@pytest.mark.parametrize("bilateral", [True, False])
@pytest.mark.parametrize("theta_i", [0.0, 1e-9, 0.5, 1.2, 1.5, np.pi / 2 - 1e-6])
def test_hemisphere_rule_integrates_smooth_functions(theta_i: float, bilateral: bool) -> None:
    """int cos = pi and int cos^2 cos(theta_o) = 2 pi/4 ... over the outgoing hemisphere."""
    theta_o, delta_phi, weight = quadrature.hemisphere_rule(theta_i, bilateral=bilateral)
    cos_o = np.cos(theta_o)
    assert (weight * cos_o).sum() == pytest.approx(np.pi, rel=1e-13)
    assert (weight * cos_o**3).sum() == pytest.approx(np.pi / 2, rel=1e-12)
    odd = weight * cos_o * np.sin(theta_o) * np.cos(delta_phi)
    assert odd.sum() == pytest.approx(0, abs=1e-11)
    assert ((theta_o >= 0) & (theta_o <= np.pi / 2)).all()


@pytest.mark.parametrize("alpha", [0.5, 0.03, 1e-3, 1e-4])
def test_hemisphere_rule_resolves_a_lobe(alpha: float) -> None:
    """Projected area of a GGX distribution over the half vectors seen at theta_i = 0 up to 45 degrees.

    int D nh dwh = alpha-independent closed form: 1 - alpha^2 / (alpha^2 + tan^2 45).
    """
    theta_o, delta_phi, weight = quadrature.hemisphere_rule(0.0, bilateral=True)
    pair = geometry.pair_from_angles(np.zeros_like(theta_o), theta_o, delta_phi)
    d = (alpha * (1 + pair.tan2_h) / (pair.tan2_h + alpha**2)) ** 2 / np.pi
    found = (weight * d / np.sqrt(1 + pair.tan2_h) / (4 * pair.cos_d)).sum()
    assert found == pytest.approx(1 / (1 + alpha**2), rel=1e-7)


def test_composite_panels_are_exact_for_polynomials() -> None:
    x, w = quadrature.composite([0.0, 0.25, 2.0], 5)
    assert (np.diff(x) > 0).all()
    for power in range(10):
        assert (w * x**power).sum() == pytest.approx(2.0 ** (power + 1) / (power + 1), rel=1e-13)
    x, w = quadrature.gauss_legendre(6, -1.0, 3.0)
    assert (w * x**11).sum() == pytest.approx((3.0**12 - 1) / 12, rel=1e-13)


def test_albedo_of_a_lambertian_and_of_a_mirror() -> None:
    theta = np.radians([0.0, 45.0, 89.9, 90.0])
    assert bc.model("lambert", reflectance=0.7).albedo(theta)[:, 0] == pytest.approx([0.7] * 4, rel=1e-12)
    mirror = bc.model("mirror", reflectance=0.9)
    assert mirror.albedo(theta)[:, 0] == pytest.approx([0.9] * 4)


def test_reflection_and_half_vector_are_consistent() -> None:
    rng = np.random.default_rng(1)
    theta_i, theta_h, phi_h = rng.uniform(0, 1.5, 300), rng.uniform(0, 0.7, 300), rng.uniform(-np.pi, np.pi, 300)
    theta_o, delta_phi, dot = geometry.outgoing_from_half(theta_i, theta_h, phi_h)
    wi, wo = geometry.vectors_from_angles(theta_i, theta_o, delta_phi)
    h = np.stack([np.sin(theta_h) * np.cos(phi_h), np.sin(theta_h) * np.sin(phi_h), np.cos(theta_h)], axis=1)
    assert np.abs(wi + wo - 2 * dot[:, None] * h).max() < 1e-15 * 4
    assert np.array_equal(geometry.reflect(wi), wi * [-1, -1, 1])
    limit = geometry.horizon_theta_h(theta_i, phi_h)
    on_horizon, _, _ = geometry.outgoing_from_half(theta_i, limit, phi_h)
    assert np.abs(on_horizon - np.pi / 2).max() < 1e-15 * 4
