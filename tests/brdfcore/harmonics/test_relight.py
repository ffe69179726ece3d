"""Reflected radiance by an expansion: against plain quadrature over the hemisphere, view by view."""

from __future__ import annotations

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.errors import InputError
from brdfcore.harmonics.expansion import HarmonicExpansion, expanded
from brdfcore.harmonics.light import Light
from brdfcore.harmonics.transfer import Transfer, relight
from tests.brdfcore.harmonics.test_light import sky
from tests.brdfcore.harmonics.test_rotation import ROTATIONS, directions
from tests.support.sources import Skewed
from tests.support.tiers import first_fast

LMAX = 10


def brute(b: bc.Brdf, light: Light, normals: np.ndarray, views: np.ndarray) -> np.ndarray:
    """sum f_r L cos over a product rule of the local hemisphere, in a frame of its own."""
    x, w = np.polynomial.legendre.leggauss(24)
    x, w = (x + 1) / 2, w / 2
    phi = 2 * np.pi * np.arange(48) / 48
    z, p = (a.reshape(-1) for a in np.meshgrid(x, phi, indexing="ij"))
    weights = np.repeat(w, 48) * 2 * np.pi / 48 * z
    s = np.sqrt(1 - z * z)
    local = np.stack([s * np.cos(p), s * np.sin(p), z], axis=1)
    found = []
    for n, v in zip(*np.broadcast_arrays(normals, views)):
        x_axis = np.cross(n, [0.31, -0.55, 0.77])
        x_axis /= np.linalg.norm(x_axis)
        frame = np.stack([x_axis, np.cross(n, x_axis), n], axis=1)
        f = b.evaluate_vectors(local, (frame.T @ v)[None])
        found.append((weights[:, None] * f * light.radiance(local @ frame.T)).sum(axis=0))
    return np.array(found)


def upper(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Normals and views above their surfaces; the poles, a view along its normal and a grazing one among them."""
    normals, views = directions(n, 5), directions(n, 6)
    normals[0], normals[1] = (0, 0, 1), (0, 0, -1)
    views[2] = normals[2]
    views = np.where((normals * views).sum(axis=1)[:, None] < 0, -views, views)
    side = np.cross(normals[3], views[3])
    views[3] = side / np.linalg.norm(side) + 0.02 * normals[3]
    return normals, views / np.linalg.norm(views, axis=1)[:, None]


@pytest.fixture(scope="module")
def glossy() -> HarmonicExpansion:
    b = bc.model("cook_torrance", diffuse=[0.3, 0.2, 0.1], specular=0.5, roughness=0.5, ior="glass")
    return expanded(b, LMAX)


@pytest.mark.parametrize("degree", [0, 1, 7, 10, 13], ids=lambda d: f"light to {d}")
def test_it_is_the_integral_of_the_expansion_times_the_light(glossy: HarmonicExpansion, degree: int) -> None:
    light = Light.from_map(sky(), degree)
    normals, views = upper(12)
    expected = brute(glossy, light, normals, views)
    found = Transfer(glossy, degree).radiance(light, normals, views)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("target", first_fast("f_cos_o", "f"))
def test_other_targets(target: str) -> None:
    made = expanded(bc.model("oren_nayar", sigma=0.5), 6, target=target)
    light = Light.from_map(sky()[..., 1], 7)
    normals, views = upper(6)
    expected = brute(made, light, normals, views)
    found = relight(made, light, normals, views)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_a_source_without_bilateral_symmetry_keeps_its_sense_of_rotation() -> None:
    source = Skewed()
    made = expanded(source, 6)
    assert not made.bilateral
    light = Light.from_map(sky()[..., 0], 6)
    normals, views = upper(8)
    expected = brute(made, light, normals, views)
    found = Transfer(made, 6).radiance(light, normals, views)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    mirrored = expanded(source, 6, bilateral=True)
    assert np.abs(Transfer(mirrored, 6).radiance(light, normals, views) - found).max() > 1e-3 * np.abs(found).max()


def test_a_lambertian_reflects_its_irradiance() -> None:
    light = Light.from_map(sky(), 24)
    normals, views = upper(9)
    found = relight(bc.model("lambert", reflectance=0.6), light, normals, views)
    # degree 24 of the surface: f cos cos is x x', whose odd extension is degree 1 alone
    np.testing.assert_allclose(found, 0.6 / np.pi * light.irradiance(normals, None), rtol=1e-7)


def test_turning_everything_changes_nothing(glossy: HarmonicExpansion) -> None:
    light = Light.from_map(sky(), LMAX) + Light.directional([1, 2, 3], 4.0)
    normals, views = upper(8)
    found = relight(glossy, light, normals, views)
    for name, r in ROTATIONS.items():
        turned = relight(glossy, light.rotated(r), normals @ r.T, views @ r.T)
        np.testing.assert_allclose(turned, found, rtol=0, atol=1e-12 * np.abs(found).max(), err_msg=name)


def test_directional_lights_are_reflected_by_the_material_itself() -> None:
    b = bc.model("ggx", roughness=0.2)
    lights = Light.directional([[0, 0, 2], [1, 0, 1], [0, 0, -1]], [[3.0], [5.0], [7.0]])
    view = np.array([0.0, np.sin(0.4), np.cos(0.4)])
    expected = 3 * b.evaluate(0.0, 0.4, 0.0) + 5 * np.sqrt(0.5) * b.evaluate(np.pi / 4, 0.4, np.pi / 2)
    assert relight(b, lights, [0, 0, 1], view) == pytest.approx(expected, rel=1e-12)


def test_a_mirror_shows_the_environment() -> None:
    b = bc.model("mirror", ior="silver")
    light = Light.from_map(sky(), 12)
    normals, views = upper(7)
    back = 2 * (normals * views).sum(axis=1)[:, None] * normals - views
    theta = np.arccos(np.clip((normals * views).sum(axis=1), -1, 1))
    expected = light.radiance(back) * b.delta_reflectance(theta)
    np.testing.assert_allclose(relight(b, light, normals, views), expected, rtol=1e-7, atol=1e-12)


def test_below_the_surface_nothing_is_seen(glossy: HarmonicExpansion) -> None:
    light = Light.from_map(sky(), 4) + Light.directional([0, 0, 1], 1.0)
    found = relight(glossy, light, [0, 0, 1], [[0, 0, -1], [1, 0, 0], [1, 0, -1e-9], [0, 1, 1]])
    assert (found[:3] == 0).all()
    assert (found[3] > 0).all()


def test_shapes_channels_and_parts(glossy: HarmonicExpansion) -> None:
    grey = Light.from_map(sky()[..., 0], 5)
    normals = directions(5_000, 9).reshape(50, 100, 3)
    found = relight(glossy, grey, normals, [0, 0, 1])
    assert found.shape == (50, 100, 3)
    one = relight(glossy, grey, normals[20, 30], [0, 0, 1])
    np.testing.assert_allclose(found[20, 30], one, rtol=0, atol=1e-13)
    single = expanded(bc.model("oren_nayar", sigma=0.3), 3)
    assert relight(single, Light.from_map(sky(), 3), [0, 0, 1], [0, 0, 1]).shape == (3,)


def test_the_error_falls_with_the_degree() -> None:
    """Against the source itself and the map itself: no expansion is exact, a higher one is nearer."""
    b = bc.model("cook_torrance", roughness=0.6)
    light = Light.from_map(sky(12, 24)[..., 1], 24)
    normals, views = upper(10)
    cosine = (normals * views).sum(axis=1)[:, None]
    exact = brute(b, light, normals, views) * cosine
    errors = [
        float(np.linalg.norm(relight(b, light.truncated(n), normals, views) * cosine - exact)) for n in (2, 6, 14)
    ]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
    assert errors[2] < 0.01 * float(np.linalg.norm(exact))


def test_bad_requests_name_what_the_caller_named(glossy: HarmonicExpansion) -> None:
    light = Light.from_map(sky(), 2)
    for normals, views, where in [([0, 0, 0], [0, 0, 1], "normals"), ([0, 0, 1], [0, np.nan, 1], "views")]:
        with pytest.raises(InputError) as caught:
            relight(glossy, light, normals, views)
        assert caught.value.context["where"] == where
        assert where in caught.value.detail
    with pytest.raises(InputError):
        relight(glossy, sky(), [0, 0, 1], [0, 0, 1])  # type: ignore[arg-type]
    with pytest.raises(InputError) as caught:
        relight(bc.model("lambert"), Light.from_map(sky(), 2), np.ones((2, 3)), np.ones((3, 3)))
    assert "normals" in caught.value.detail


def test_a_lobe_far_narrower_than_the_degree_still_reflects_smooth_light() -> None:
    """Degree 12 holds two per cent of this lobe's energy; dropping directions by what is left out would empty it."""
    b = bc.model("cook_torrance", roughness=0.01)
    made = expanded(b, 12)
    assert made.report["harmonics"]["truncation"]["target"] > 0.9
    theta = np.radians([0.0, 30.0, 50.0])
    views = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=1)
    found = relight(made, Light.from_map(np.ones((4, 8)), 12), [0, 0, 1], views)
    np.testing.assert_allclose(found, b.albedo(theta), rtol=0.15)
