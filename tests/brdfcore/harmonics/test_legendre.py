"""Legendre functions against 40-digit Gegenbauer polynomials and exact fractions; spherical harmonics against scipy."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import sph_harm_y_all

import brdfcore as bc
from brdfcore.harmonics.legendre import (
    SphericalHarmonics,
    _coefficients,
    degrees,
    entries,
    legendre,
    order_offset,
    order_size,
)
from brdfcore.kernels.harmonics.legendre import legendre_numpy

HORIZON = float(np.cos(np.pi / 2))


def exact(l: int, m: int, x: float) -> Any:  # noqa: E741
    """p_l^m by Gegenbauer polynomials at 60 digits: P_l^m = (2m-1)!! (1-x^2)^(m/2) C_(l-m)^(m+1/2)."""
    with mp.workdps(60):
        t = mp.mpf(x)
        # hypergeometric sums cancel by about 10^(0.8 l): mpmath raises its precision until they don't matter
        polynomial = mp.gegenbauer(l - m, m + mp.mpf(1) / 2, t, maxprec=100_000, zeroprec=2_000)
        norm = mp.sqrt((2 * l + 1) / (4 * mp.pi) * mp.fac(l - m) / mp.fac(l + m)) * mp.fac2(2 * m - 1)
        return norm * (1 - t * t) ** (mp.mpf(m) / 2) * polynomial


def one(l: int, m: int, x: float) -> float:  # noqa: E741
    return float(legendre(l, x, first_order=m, last_order=m)[l - m])


def drawn(count: int, seed: int) -> list[tuple[int, int, float]]:
    """(l, m, x) to l = 1024: m anywhere, and near l; x anywhere, near 1 and near 0."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        l = int(rng.integers(0, 1025)) if k % 4 else 1024  # noqa: E741
        m = int(rng.integers(0, l + 1)) if k % 3 else max(l - int(rng.integers(0, 4)), 0)
        x = (rng.uniform(-1, 1), 1 - 10 ** rng.uniform(-15, -1), 10 ** rng.uniform(-17, -1))[k % 5 % 3]
        found.append((l, m, float(x)))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_against_mpmath(seed: int) -> None:
    """<= 1e-11 of p itself where |p| > 1e-290: no exception beside zeros of p, as x is taken to be exact."""
    checked = 0
    for l, m, x in drawn(60, seed):  # noqa: E741
        found, want = one(l, m, x), exact(l, m, x)
        assert np.isfinite(found)
        if abs(want) > 1e-290:
            assert abs(found - want) <= 1e-11 * abs(want), (l, m, x, found, float(want))
            checked += 1
        else:
            assert abs(found - want) <= 1e-300, (l, m, x)
        if abs(want) > 5e-324:
            assert found != 0, f"false zero at {(l, m, x)}: {float(want)}"
    assert checked > 30


@pytest.mark.parametrize(("l", "m"), [(1024, 0), (1024, 3), (1000, 512), (700, 690)])
def test_beside_zeros(l: int, m: int) -> None:  # noqa: E741
    """At the float64 numbers beside sign changes, where terms cancel down to 1e-16 l of the envelope."""
    x = np.linspace(0.02, 0.6 if m < 600 else 0.1, 4001)
    p = legendre(l, x, first_order=m, last_order=m)[l - m]
    changes = np.flatnonzero(p[1:] * p[:-1] < 0)
    assert changes.size >= 3
    for k in changes[:: max(changes.size // 4, 1)]:
        low, high = x[k], x[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            if middle in (low, high):
                break
            same = (one(l, m, middle) > 0) == (one(l, m, low) > 0)
            low, high = (middle, high) if same else (low, middle)
        for zero in (low, high):
            want = exact(l, m, float(zero))
            found = one(l, m, float(zero))
            assert abs(want) < 1e-9 * np.abs(p).max()
            assert abs(found - want) <= 1e-11 * abs(want), (zero, found, float(want))


@pytest.mark.parametrize("lmax", [0, 1, 7, 40])
def test_against_the_twin(lmax: int) -> None:
    x = np.array([0.3, -0.7, 0.999, 1.0, -1.0, 0.0, 1e-20, HORIZON, 0.5, 1 - 1e-16])
    p = legendre(lmax, x)
    assert p.shape == (entries(lmax), x.size) == ((lmax + 1) * (lmax + 2) // 2, x.size)
    for m in range(lmax + 1):
        block = p[order_offset(lmax, m) :][: order_size(lmax, m)]
        np.testing.assert_allclose(block, legendre_numpy(lmax, m, x), rtol=1e-13, atol=0)


def test_blocks_and_parities_are_the_same_bits() -> None:
    lmax, x = 37, np.random.default_rng(5).uniform(-1, 1, 71)
    p = legendre(lmax, x)
    for parity in ("odd", "even"):
        part = legendre(lmax, x, parity=parity)
        for m in range(lmax + 1):
            rows = order_offset(lmax, m) + degrees(lmax, m, parity) - m
            at = order_offset(lmax, m, parity)
            assert np.array_equal(part[at : at + order_size(lmax, m, parity)], p[rows])
    some = legendre(lmax, x, first_order=4, last_order=9)
    assert np.array_equal(some, p[order_offset(lmax, 4) : order_offset(lmax, 10)])
    assert np.array_equal(legendre(lmax, x[3]), p[:, 3]), "a node alone has other bits"
    assert legendre(lmax, x.reshape(71, 1)).shape == (entries(lmax), 71, 1)


@pytest.mark.parametrize("lmax", [0, 1, 6, 9])
@pytest.mark.parametrize("parity", [None, "odd", "even"])
def test_rows_are_those_of_the_orders_before(lmax: int, parity: Any) -> None:
    for m in range(lmax + 2):
        assert order_offset(lmax, m, parity) == sum(order_size(lmax, k, parity) for k in range(m))


@pytest.mark.parametrize("lmax", [9, 300])
def test_recursion_coefficients(lmax: int) -> None:
    """alpha_l alpha_(l-1) = a_(l-1)^2 to 2^-102, pairs that sum to their high part, and s = p/q as the product of b."""
    table = _coefficients(lmax)
    for m in (0, 1, lmax // 2, lmax - 3):
        first = order_offset(lmax, m)
        s = [mp.mpf(1), mp.mpf(1)]
        with mp.workdps(60):
            for l in range(m + 1, lmax + 1):  # noqa: E741
                high, low, scale = table[first + l - m].tolist()
                assert high + low == high
                before = mp.fsum(table[first + l - m - 1, :2].tolist())
                a2 = mp.mpf(4 * (l - 1) ** 2 - 1) / ((l - 1) ** 2 - m * m) if l > m + 1 else mp.mpf(2 * m + 3)
                product = mp.fsum([high, low]) * (before if l > m + 1 else mp.fsum([high, low]))
                assert abs(product - a2) <= mp.mpf(2) ** -102 * a2, (l, m)
                if l > m + 1:
                    b2 = mp.mpf(4 * l * l - 1) / (l * l - m * m) / a2
                    s.append(mp.sqrt(b2) * s[-2])
                assert abs(scale - s[-1]) <= mp.mpf(2) ** -52 * s[-1], (l, m)


def test_over_x() -> None:
    """p/x is finite at x = 0, where it is the derivative, and p/x elsewhere."""
    lmax, x = 64, np.array([0.0, HORIZON, 1e-300, 1e-8, 0.3, 1.0])
    q = legendre(lmax, x, parity="odd", over_x=True)
    p = legendre(lmax, x, parity="odd")
    np.testing.assert_allclose(q[:, 3:] * x[3:], p[:, 3:], rtol=4e-16, atol=1e-300)
    for l, m in ((1, 0), (3, 0), (64, 1), (64, 63), (50, 21)):  # noqa: E741
        row = order_offset(lmax, m, "odd") + (l - m - 1) // 2
        want = exact_over_x(l, m)
        for k in range(3):
            assert abs(q[row, k] - want) <= 1e-13 * abs(want)


def exact_over_x(l: int, m: int) -> Any:  # noqa: E741
    """Derivative of p_l^m at 0: C_n^(a)' = 2 a C_(n-1)^(a+1)."""
    with mp.workdps(60):
        a = m + mp.mpf(1) / 2
        norm = mp.sqrt((2 * l + 1) / (4 * mp.pi) * mp.fac(l - m) / mp.fac(l + m)) * mp.fac2(2 * m - 1)
        return norm * 2 * a * mp.gegenbauer(l - m - 1, a + 1, 0)


@pytest.mark.slow
def test_orthonormal_to_degree_1024() -> None:
    """int p_l^m p_l'^m dx = delta/(2 pi) on composite Gauss-Legendre nodes, orders 0, 7, 500 and 1020."""
    from brdfcore.base.quadrature import composite

    x, w = composite(-np.cos(np.linspace(0, np.pi, 65)), 64)
    for m in (0, 7, 500, 1020):
        p = legendre(1024, x, first_order=m, last_order=m)
        gram = 2 * np.pi * (p * w) @ p.T
        np.testing.assert_allclose(gram, np.eye(len(p)), atol=2e-13)


@given(st.integers(0, 300), st.integers(0, 300), st.floats(-1, 1))
@settings(max_examples=60, deadline=None)
def test_parity_and_size(l: int, m: int, x: float) -> None:  # noqa: E741
    m = min(m, l)
    found = one(l, m, x)
    assert np.isfinite(found)
    assert one(l, m, -x) == (-found if (l - m) % 2 else found)
    # the addition theorem bounds it
    assert abs(found) <= np.sqrt((2 * l + 1) / (4 * np.pi)) * (1 + 1e-12)


@pytest.mark.parametrize("lmax", [0, 3, 30])
def test_complex_harmonics_are_scipys(lmax: int) -> None:
    """scipy has the Condon-Shortley phase and orthonormal functions."""
    theta, phi = np.array([0.1, 1.3, 2.9]), np.array([0.0, 2.0, -1.0])
    want = sph_harm_y_all(lmax, lmax, theta, phi)
    found = SphericalHarmonics(lmax, "complex", "orthonormal", phase=True).evaluate(theta, phi)
    for l in range(lmax + 1):  # noqa: E741
        for m in range(-l, l + 1):
            np.testing.assert_allclose(found[SphericalHarmonics.index(l, m)], want[l, m], rtol=1e-11, atol=1e-14)


def test_normalisations() -> None:
    theta, phi = 0.4, 0.7
    plain = SphericalHarmonics(3).evaluate(theta, phi)
    assert plain[0] == pytest.approx(0.28209479177387814)  # 1/sqrt(4 pi)
    assert plain[2] == pytest.approx(0.48860251190291992 * np.cos(theta))  # sqrt(3/(4 pi))
    # x is positive towards phi = 0 without the phase
    assert plain[3] == pytest.approx(0.48860251190291992 * np.sin(theta) * np.cos(phi))
    assert plain[1] == pytest.approx(0.48860251190291992 * np.sin(theta) * np.sin(phi))
    geodesy = SphericalHarmonics(3, normalisation="4pi").evaluate(theta, phi)
    assert geodesy[0] == pytest.approx(1)
    schmidt = SphericalHarmonics(3, normalisation="schmidt").evaluate(theta, phi)
    assert schmidt[2] == pytest.approx(np.cos(theta))
    phased = SphericalHarmonics(3, phase=True).evaluate(theta, phi)
    assert phased[3] == -plain[3]


@pytest.mark.parametrize(
    ("arguments", "options", "code"),
    [
        ((-1, 0.5), {}, "bad_lmax"),
        ((2.5, 0.5), {}, "bad_lmax"),
        ((True, 0.5), {}, "bad_lmax"),
        ((10**6, 0.5), {}, "lmax_too_large"),
        ((4, [0.5, np.nan]), {}, "bad_nodes"),
        ((4, 1.0000001), {}, "bad_nodes"),
        ((4, "text"), {}, "bad_nodes"),
        ((4, 0.5), {"parity": "both"}, "bad_parity"),
        ((4, 0.5), {"over_x": True}, "bad_parity"),
        ((4, 0.5), {"first_order": 5}, "bad_order"),
        ((4096, np.zeros(1000)), {}, "legendre_too_large"),
    ],
    ids=lambda value: str(value)[:24],
)
def test_refusals(arguments: tuple[Any, Any], options: dict[str, Any], code: str) -> None:
    with pytest.raises(bc.BrdfError) as caught:
        legendre(*arguments, **options)
    assert caught.value.code == code


def test_empty_and_options() -> None:
    assert legendre(3, np.zeros((0, 2))).shape == (10, 0, 2)
    with pytest.raises(bc.InputError, match="kind"):
        SphericalHarmonics(2, "imaginary")  # type: ignore[arg-type]
