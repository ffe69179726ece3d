"""Environments as coefficients: maps, directional lights, irradiance; against sums that know nothing of harmonics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import sph_harm_y

import brdfcore as bc
from brdfcore.base.errors import InputError, LimitError
from brdfcore.harmonics.environment import solid_angles
from brdfcore.harmonics.light import Light


def pixel_directions(rows: int, columns: int) -> np.ndarray:
    theta, phi = (np.arange(rows) + 0.5) * np.pi / rows, (np.arange(columns) + 0.5) * 2 * np.pi / columns
    t, p = np.meshgrid(theta, phi, indexing="ij")
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def sky(rows: int = 24, columns: int = 48) -> np.ndarray:
    w = pixel_directions(rows, columns)
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    return np.stack([1 + x * y, np.exp(z), 2 + y + 0.3 * (x > 0.5)], axis=-1)


def integral(pixels: np.ndarray, l: int, m: int, per: int = 6) -> np.ndarray:  # noqa: E741
    """int L Y_lm over constant pixels by Gauss-Legendre inside each pixel, with SciPy's harmonics."""
    rows, columns = pixels.shape[:2]
    x, w = np.polynomial.legendre.leggauss(per)
    theta = (np.arange(rows)[:, None] + (x + 1) / 2) * np.pi / rows
    phi = (np.arange(columns)[:, None] + (x + 1) / 2) * 2 * np.pi / columns
    y = sph_harm_y(l, abs(m), theta[:, :, None, None], phi[None, None])
    real = y.real if m >= 0 else y.imag
    real = real * (1.0 if m == 0 else np.sqrt(2) * (-1.0) ** m)  # without the Condon-Shortley phase
    weights = (w * np.sin(theta) * np.pi / rows / 2)[:, :, None, None] * (w * np.pi / columns)
    return np.asarray(np.einsum("rkcj,rcq->q", real * weights, pixels))


@pytest.mark.parametrize(
    ("l", "m"), [(0, 0), (1, -1), (1, 0), (1, 1), (2, -2), (7, 5), (7, -5), (20, 0), (31, 31), (31, -30)]
)
def test_coefficients_of_constant_pixels_are_exact(l: int, m: int) -> None:  # noqa: E741
    pixels = sky(10, 14)  # degrees far beyond what so few pixels resolve
    light = Light.from_map(pixels, 31)
    np.testing.assert_allclose(light.coefficients[l * l + l + m], integral(pixels, l, m, 20), rtol=0, atol=1e-13)


def test_orientation() -> None:
    """Row 0 is +z; the first columns are at +x, a quarter of the way is +y."""
    for index, direction in [((0, slice(None)), (0, 0, 1)), ((11, 0), (1, 0, 0)), ((11, 12), (0, 1, 0))]:
        pixels = np.zeros((24, 48))
        pixels[index] = 1.0
        linear = Light.from_map(pixels, 1).coefficients[[3, 1, 2], 0]
        assert linear / np.linalg.norm(linear) == pytest.approx(direction, abs=0.08)


def test_solid_angles_fill_the_sphere_and_stay_exact_beside_the_poles() -> None:
    w = solid_angles(5_000, 10_000)
    assert 10_000 * w.sum() == pytest.approx(4 * np.pi, rel=1e-14)
    a = np.pi / 5_000
    assert w[0] == pytest.approx(2 * np.pi / 10_000 * 2 * np.sin(a / 2) ** 2, rel=1e-14)


def test_parseval() -> None:
    pixels = sky()
    energy = np.einsum("r,rcq->q", solid_angles(24, 48), pixels**2)
    light = Light.from_map(pixels, 12)
    assert (light.coefficients**2).sum(axis=0) + light.left_out**2 == pytest.approx(energy, rel=1e-13)
    # what is left out, found by evaluation at Gauss-Legendre nodes inside each pixel
    x, weights = np.polynomial.legendre.leggauss(4)
    theta = ((np.arange(24)[:, None] + (x + 1) / 2) * np.pi / 24).reshape(-1)
    phi = ((np.arange(48)[:, None] + (x + 1) / 2) * np.pi / 24).reshape(-1)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    w = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    residual = (light.radiance(w) - np.kron(pixels, np.ones((4, 4, 1)))) ** 2
    found = (
        np.einsum("r,c,rcq->q", np.tile(weights, 24) * np.sin(theta), np.tile(weights, 48), residual)
        * (np.pi / 48) ** 2
    )
    assert np.sqrt(found) == pytest.approx(light.left_out, rel=1e-9)
    assert light.error_by_degree()[-1] == pytest.approx(np.sqrt((light.left_out**2).sum() / energy.sum()), rel=1e-12)
    for lmax in (0, 3, 12):
        assert light.truncated(lmax).error_by_degree()[-1] == pytest.approx(light.error_by_degree()[lmax], rel=1e-12)


def test_a_constant_environment() -> None:
    light = Light.from_map(np.full((3, 5), 2.0), 8)
    assert light.channels == ("value",)
    expected = np.zeros((81, 1))
    expected[0] = 2 * np.sqrt(4 * np.pi)
    np.testing.assert_allclose(light.coefficients, expected, rtol=0, atol=2e-14)
    assert light.irradiance([0, 0, 1]) == pytest.approx([2 * np.pi], rel=1e-13)
    assert (light.error_by_degree() < 1e-7).all()


def test_irradiance_against_a_sum_over_the_pixels() -> None:
    pixels = sky(64, 128)
    light = Light.from_map(pixels, 40)
    w, weights = pixel_directions(64, 128), solid_angles(64, 128)
    normals = np.array([[0, 0, 1], [0.6, 0, -0.8], [1, 2, 3]]) / np.array([[1], [1], [np.sqrt(14)]])
    cosine = np.maximum(np.einsum("ni,rci->nrc", normals, w), 0)
    brute = np.einsum("nrc,r,rcq->nq", cosine, weights, pixels)
    assert light.irradiance(normals, None) == pytest.approx(brute, rel=1e-3)
    nine = light.irradiance(normals)
    assert nine == pytest.approx(light.truncated(2).irradiance(normals, None), rel=1e-14)
    # this sky is smooth: nine coefficients do, but they are not the whole
    assert 1e-4 < np.abs(nine / brute - 1).max() < 0.05


def test_directional_lights_are_exact_and_their_expansion_tends_to_them() -> None:
    sun = Light.directional([[3.0, 0, 4]], [[5.0, 6.0, 7.0]])
    normals = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0]])
    np.testing.assert_allclose(sun.irradiance(normals), np.outer([0.8, 0, 0.6], [5, 6, 7]), rtol=1e-15)
    spread = sun.expanded(30)
    assert np.isinf(spread.error_by_degree()).all()
    assert len(spread.directions) == 0
    assert spread.irradiance(normals, None) == pytest.approx(sun.irradiance(normals), abs=0.02 * 7)
    # nine coefficients at the lit pole: A_0/4pi + A_1 3/4pi + A_2 5/4pi = 1/4 + 1/2 + 5/16
    assert sun.expanded(2).irradiance([0.6, 0, 0.8]) == pytest.approx(np.array([5.0, 6, 7]) * 17 / 16, rel=1e-13)


def test_superposition() -> None:
    a, b = Light.from_map(sky(), 6), Light.directional([0, 0, 1], 2.0)
    both = a + 0.5 * b + Light.from_map(np.ones((4, 8)), 3)
    assert both.lmax == 6
    assert both.channels == ("R", "G", "B")
    n = [[0.0, 0.6, 0.8]]
    expected = a.irradiance(n) + 0.5 * b.irradiance(n) + np.pi
    assert both.irradiance(n) == pytest.approx(expected, rel=1e-13)
    r = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    turned = both.rotated(r)
    assert turned.irradiance(n @ r.T) == pytest.approx(expected, rel=1e-13)
    np.testing.assert_allclose(turned.spectrum(), both.spectrum(), rtol=1e-12)
    np.testing.assert_array_equal(turned.directions, [[1.0, 0, 0]])


def test_a_window_lowers_what_rings_and_says_what_it_costs() -> None:
    pixels = np.zeros((32, 64))
    pixels[:2] = 1.0
    light = Light.from_map(pixels, 16)
    w = pixel_directions(32, 64)
    plain, windowed = light.radiance(w), light.windowed("lanczos").radiance(w)
    assert plain.min() < 3 * windowed.min() < 0
    assert light.windowed("lanczos").left_out > light.left_out
    with pytest.raises(InputError):
        light.windowed("boxcar")


def test_lights_are_immutable() -> None:
    light = Light.from_map(sky(), 4)
    with pytest.raises(ValueError, match="read-only"):
        light.coefficients[0] = 1
    with pytest.raises(AttributeError):
        light.channels = bc.Channels(["a"])  # type: ignore[misc]


@pytest.mark.parametrize(
    ("pixels", "code"),
    [
        (np.zeros((0, 4, 3)), "bad_map"),
        (np.zeros(4), "bad_map"),
        (np.array([[1.0, np.nan]]), "bad_map"),
        (np.array([[1.0, np.inf]]), "bad_map"),
        (np.zeros((2, 4, 5)), "bad_channels"),
        (np.full((2, 2), "x"), "not_numbers"),
    ],
    ids=["empty", "1-D", "nan", "inf", "unnamed channels", "text"],
)
def test_bad_maps(pixels: np.ndarray, code: str) -> None:
    with pytest.raises(InputError) as caught:
        Light.from_map(pixels, 4)
    assert caught.value.code == code


def test_bad_lights() -> None:
    with pytest.raises(LimitError):
        Light.from_map(np.ones((2, 2)), 257)
    for directions, irradiance in [([0, 0, 0], 1.0), ([0, 0, np.nan], 1.0), ([0, 1], 1.0), ([0, 0, 1], np.nan)]:
        with pytest.raises(InputError):
            Light.directional(directions, irradiance)
    with pytest.raises(InputError):
        Light.directional(np.eye(3), np.ones((2, 3)))
    with pytest.raises(InputError):
        Light(np.ones((5, 1)), bc.Channels(["value"]))
    with pytest.raises(InputError):
        Light.from_map(np.ones((2, 2, 3)), 2) + Light.from_map(
            np.ones((2, 2, 3)), 2, channels=bc.Channels([400, 500, 600])
        )


def test_float32_maps_and_single_pixels() -> None:
    one = Light.from_map(np.array([[3.0]], np.float32), 5)
    assert one.coefficients[0, 0] == pytest.approx(3 * np.sqrt(4 * np.pi), rel=1e-14)
    assert np.abs(one.coefficients[1:]).max() < 1e-13
    a, b = Light.from_map(sky().astype(np.float32), 9), Light.from_map(sky(), 9)
    np.testing.assert_allclose(a.coefficients, b.coefficients, rtol=0, atol=1e-6)
