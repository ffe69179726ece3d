"""Rotation of real spherical harmonics: against the functions themselves, and as a group."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from brdfcore.base.errors import InputError, LimitError
from brdfcore.harmonics.legendre import SphericalHarmonics
from brdfcore.harmonics.rotation import euler, rotated, swap, swaps

DEGREES = [1, 2, 7, 33]


def about(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    x, y = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    r = np.eye(3)
    r[x, x] = r[y, y] = c
    r[x, y], r[y, x] = -s, s
    return r


def at(lmax: int, w: np.ndarray) -> np.ndarray:
    return SphericalHarmonics(lmax).evaluate(
        np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2]), np.arctan2(w[:, 1], w[:, 0])
    )


def directions(n: int, seed: int = 1) -> np.ndarray:
    w = np.random.default_rng(seed).normal(size=(n, 3))
    return np.asarray(w / np.linalg.norm(w, axis=1)[:, None])


ROTATIONS = {
    "general": about("z", 0.7) @ about("y", 1.9) @ about("z", -2.2),
    "none": np.eye(3),
    "about z": about("z", 2.5),
    "upside down": about("x", np.pi),
    "nearly none": about("x", 1e-9),
    "nearly upside down": about("y", np.pi - 1e-9) @ about("z", 0.4),
    "quarter about x": about("x", np.pi / 2),
    "axes in a ring": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
}


@pytest.mark.parametrize("name", ROTATIONS)
@pytest.mark.parametrize("lmax", DEGREES)
def test_the_rotated_function_is_the_function_at_the_direction_turned_back(lmax: int, name: str) -> None:
    r, w = ROTATIONS[name], directions(20)
    c = np.random.default_rng(lmax).normal(size=((lmax + 1) ** 2, 2))
    expected = c.T @ at(lmax, w @ r)  # rows of w @ r are R^-1 w
    np.testing.assert_allclose(rotated(c, r).T @ at(lmax, w), expected, rtol=0, atol=1e-13 * (lmax + 1) ** 2)


def test_degree_one_turns_like_a_vector() -> None:
    """Y_1,1, Y_1,-1, Y_1,0 are sqrt(3/4pi) x, y, z."""
    for name, r in ROTATIONS.items():
        for axis in np.eye(3):
            c = np.zeros((4, 1))
            c[[3, 1, 2], 0] = axis
            np.testing.assert_allclose(rotated(c, r)[[3, 1, 2], 0], r @ axis, rtol=0, atol=1e-15, err_msg=name)


def test_orthogonal_to_1e_12_at_degree_64() -> None:
    for l in (1, 2, 31, 63, 64):  # noqa: E741
        j = swap(l, np.eye(2 * l + 1))
        np.testing.assert_allclose(j @ j.T, np.eye(2 * l + 1), rtol=0, atol=1e-13)
        np.testing.assert_array_equal(j, j.T)
    lmax = 64
    columns = np.zeros(((lmax + 1) ** 2, 2 * lmax + 1))
    columns[lmax * lmax :] = np.eye(2 * lmax + 1)
    turned = rotated(columns, ROTATIONS["general"])[lmax * lmax :]
    assert np.abs(turned.T @ turned - np.eye(2 * lmax + 1)).max() <= 1e-12


@pytest.mark.parametrize(("l", "m", "k"), [(5, 3, 2), (40, 0, 0), (64, 60, 1), (200, 150, 149), (256, 256, 0)])
def test_quarter_turns_against_jacobi_polynomials(l: int, m: int, k: int) -> None:  # noqa: E741
    """|d^l_mk(pi/2)| = 2^-m sqrt((l+m)! (l-m)!/((l+k)! (l-k)!)) |P^(m-k, m+k)_(l-m)(0)|, in 60 digits."""
    with mpmath.workdps(60):
        n, f = l - m, mpmath.factorial
        # Rodrigues' sum at x = 0, for m >= k >= 0
        total = (
            sum(
                (-1) ** (n - s) * mpmath.binomial(n + m - k, n - s) * mpmath.binomial(n + m + k, s)
                for s in range(n + 1)
            )
            / mpmath.mpf(2) ** n
        )
        exact = float(abs(mpmath.sqrt(f(l + m) * f(l - m) / (f(l + k) * f(l - k))) * total / mpmath.mpf(2) ** m))
    table = swaps(256)[l]
    odd_m, odd_k = (l + m) % 2, (l + k) % 2
    # cosines_e from cosines_e; cosines_o from sines_e; sines_o from sines_o
    matrix = {(0, 0): table.cosines, (1, 0): table.mixed, (0, 1): table.mixed, (1, 1): table.sines}[odd_m, odd_k]
    scale = 2.0 / np.sqrt(2.0) ** ((m == 0) + (k == 0))
    assert np.abs(np.abs(matrix) - scale * exact).min() <= 1e-13 + 1e-12 * exact


def test_composition_and_inverse() -> None:
    lmax = 24
    c = np.random.default_rng(3).normal(size=((lmax + 1) ** 2, 3))
    a, b = ROTATIONS["general"], ROTATIONS["nearly upside down"]
    np.testing.assert_allclose(rotated(rotated(c, b), a), rotated(c, a @ b), rtol=0, atol=1e-12)
    np.testing.assert_allclose(rotated(rotated(c, a), a.T), c, rtol=0, atol=1e-12)


def test_euler_angles_keep_what_counts_where_they_degenerate() -> None:
    for name, r in ROTATIONS.items():
        alpha, beta, gamma = euler(r)
        again = about("z", alpha) @ about("y", beta) @ about("z", gamma)
        np.testing.assert_allclose(again, r, rtol=0, atol=4e-16, err_msg=name)
    assert euler(about("y", 1e-12))[1] == pytest.approx(1e-12, rel=1e-15)


@pytest.mark.parametrize(
    "bad",
    [np.eye(2), np.diag([1.0, 1.0, -1.0]), 1.001 * np.eye(3), np.full((3, 3), np.nan), np.zeros((3, 3))],
    ids=["2x2", "mirror", "scaled", "nan", "zero"],
)
def test_what_is_no_rotation_is_refused(bad: np.ndarray) -> None:
    with pytest.raises(InputError) as caught:
        rotated(np.ones((4, 1)), bad)
    assert caught.value.code == "bad_rotation"


def test_degrees_above_the_limit_are_refused() -> None:
    with pytest.raises(LimitError):
        rotated(np.ones((258**2, 1)), np.eye(3))
