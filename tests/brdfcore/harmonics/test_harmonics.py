"""Expansions: coefficients that are known, stated errors against evaluated ones, windows, slices, storage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.harmonics.expansion import expanded
from brdfcore.harmonics.irradiance import irradiance_factors, kernel_energy
from brdfcore.harmonics.legendre import legendre
from brdfcore.harmonics.targets import TARGETS, count
from brdfcore.harmonics.windows import WINDOWS, step_response
from tests.support.formulas import Formula, evaluated_error, lopsided
from tests.support.tiers import first_fast

# ---- coefficients that are known ------------------------------------------------------------------


def test_lambert_is_one_coefficient() -> None:
    """f c c = c c/pi: rho_110 = (4 pi/3)/pi."""
    h = bc.project(bc.model("lambert", reflectance=1.0), 9)
    rho = h.coefficients(0)[0]
    assert rho[0, 0] == pytest.approx(4 / 3, rel=1e-12)
    assert np.abs(rho.reshape(-1)[1:]).max() < 1e-12
    assert max(np.abs(h.coefficients(m)).max() for m in range(1, h.orders)) < 1e-12
    f = h.evaluate(np.linspace(0, np.pi / 2, 7), 0.3, 1.0)
    np.testing.assert_allclose(f, 1 / np.pi, rtol=1e-11)  # at the horizon too: p/x
    assert h.report["harmonics"]["truncation"]["target"] < 1e-7
    assert h.non_negative
    assert h.energy_conserving


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("bilateral", first_fast(True, False), ids=["bilateral", "not bilateral"])
def test_a_sum_of_basis_functions_comes_back(target: str, bilateral: bool) -> None:
    """Random coefficients, two channels, not reciprocal: evaluated by Legendre functions, found again by projection."""
    lmax, kind = 4, TARGETS[target]
    rng = np.random.default_rng(4)
    cosines = rng.normal(size=(2, lmax + 1, lmax + 1, lmax + 1))
    sines = rng.normal(size=cosines.shape) * (not bilateral)

    def basis(theta: Any, parity: str) -> Any:
        p = legendre(lmax, np.cos(theta))
        out = np.zeros((lmax + 1, lmax + 1, theta.size))
        row = 0
        for m in range(lmax + 1):
            for l in range(m, lmax + 1):  # noqa: E741
                if (l - m) % 2 == (parity == "odd"):
                    out[l, m] = p[row] / (np.cos(theta) if parity == "odd" else 1)
                row += 1
        return out

    def function(theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
        left, right = basis(theta_i, kind.parity_i), basis(theta_o, kind.parity_o)
        m = np.arange(lmax + 1)[:, None]
        double = np.where(m == 0, 1, 2)
        return sum(
            np.einsum("clkm,lmn,kmn,mn->nc", rho, left, right, double * wave(m * delta_phi), optimize=True)
            for rho, wave in ((cosines, np.cos), (sines, np.sin))
        )

    source = Formula(function, bilateral=bilateral, reciprocal=False, channels=bc.Channels(["a", "b"]))
    h = expanded(source, lmax, target=target)
    for m in range(h.orders):
        rows, columns = h.degrees(m)
        for rho, found in ((cosines, h.coefficients(m)), (sines, h.coefficients(m, sines=True))):
            want = rho[:, rows][:, :, columns][..., m] * (1 if m or rho is cosines else 0)
            np.testing.assert_allclose(found, want, atol=1e-11)
    angles = rng.uniform(0, 1.5, 50), rng.uniform(0, 1.5, 50), rng.uniform(-3, 3, 50)
    np.testing.assert_allclose(h.evaluate(*angles), source.evaluate(*angles), atol=1e-9)
    assert h.report["harmonics"]["quadrature"]["target"] < 1e-10


def test_counts() -> None:
    """sum_m k(k+1)/2, k = floor((L-m+1)/2)."""
    target = TARGETS["f_cos_cos"]
    for lmax, entries in ((32, 1_632), (200, 343_400)):
        assert count(lmax, target, True, True) == entries
    assert 8 * count(326, target, True, True) * 3 > 34_992_012
    assert bc.project(bc.model("lambert"), 32).size == 1_632


# ---- stated errors ----------------------------------------------------------------------------------


def cubic(theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
    return (1 + np.cos(theta_o)) ** 3


@pytest.mark.parametrize(
    ("lmax", "of_f_cos", "of_f", "even"),
    [
        (8, 2.987e-3, 2.6e-2, 1.1e-2),
        (16, 5.775e-4, 9.7e-3, 4.4e-3),
        (32, 1.063e-4, 3.5e-3, 1.7e-3),
        (64, 1.917e-5, 1.3e-3, 6.1e-4),
    ],
)
def test_cubic_in_both_norms(lmax: int, of_f_cos: float, of_f: float, even: float) -> None:
    """f = (1+x)^3: x f extended oddly, in its own norm and f's; f extended evenly."""
    source = Formula(cubic)
    odd = bc.project_slice(source, 0.0, lmax)
    assert odd.truncation["target"] == pytest.approx(of_f_cos, rel=5e-4)
    assert odd.truncation["f"] == pytest.approx(of_f, rel=0.05)
    assert bc.project_slice(source, 0.0, lmax, target="f").truncation["f"] == pytest.approx(even, rel=0.05)


@pytest.mark.parametrize(
    ("name", "parameters", "lmax"),
    [
        ("phong", {"exponent": 10}, 14),
        ("cook_torrance", {"roughness": 0.4, "ior": "gold"}, 16),
        ("cook_torrance", {"roughness": 0.05, "ior": ["gold", "copper", "silver"]}, 16),
        ("oren_nayar", {}, 12),
    ],
)
def test_parseval_is_what_evaluation_finds(name: str, parameters: dict[str, Any], lmax: int) -> None:
    source = bc.model(name, **parameters)
    h = expanded(source, lmax)
    stated = h.report["harmonics"]
    assert evaluated_error(source, h)[0] == pytest.approx(stated["truncation"]["target"], rel=0.01)
    assert stated["quadrature"]["target"] < 0.05 * stated["truncation"]["target"]


@pytest.mark.parametrize("target", ["f", "f_cos_o"])
def test_parseval_of_other_targets(target: str) -> None:
    source = bc.model("phong", exponent=10)  # bounded, so that f has a norm
    h = expanded(source, 12, target=target)
    stated = h.report["harmonics"]["truncation"]
    in_target, in_f = evaluated_error(source, h)
    assert in_target == pytest.approx(stated["target"], rel=0.01)
    assert in_f == pytest.approx(stated["f"], rel=0.01)


def test_f_error_of_a_smooth_source() -> None:
    """The norm of f by Gram matrices; f itself, 1/(c_i c_o) away from what is projected, by evaluation."""
    source = Formula(
        lambda i, o, d: (1 + np.cos(i)) ** 3 * (1 + np.cos(o)) ** 3 * (2 + np.sin(i) * np.sin(o) * np.cos(d))
    )
    h = expanded(source, 10)
    stated = h.report["harmonics"]
    assert stated["quadrature"]["target"] < 1e-12
    in_target, in_f = evaluated_error(source, h, 64)
    assert in_target == pytest.approx(stated["truncation"]["target"], rel=5e-3)
    assert in_f == pytest.approx(stated["truncation"]["f"], rel=5e-3)
    assert 3 * stated["truncation"]["target"] < stated["truncation"]["f"]


@pytest.mark.parametrize("window", WINDOWS)
def test_stated_errors_hold_with_windows(window: str) -> None:
    source = bc.model("ggx", roughness=0.5)
    h = expanded(source, 12, window=window)
    assert evaluated_error(source, h)[0] == pytest.approx(h.report["harmonics"]["truncation"]["target"], rel=0.01)
    assert h.report["harmonics"]["truncation"]["target"] >= h.report["harmonics"]["projection"]["target"]


def test_quadrature_is_no_worse_than_stated() -> None:
    """Against a rule with three times the nodes: the stated distance bounds the error of a lobe far too sharp for the
    degree, on the graded rule."""
    from brdfcore.harmonics.moments import moments
    from brdfcore.harmonics.projection import projected
    from brdfcore.harmonics.spectrum import distance

    source = bc.model("cook_torrance", roughness=0.02, ior="gold")
    found = projected(source, 8, TARGETS["f_cos_cos"])
    assert found.rule.graded
    better = moments(source, TARGETS["f_cos_cos"], found.rule.finer(2.0))
    error = distance(better, found.moments.rho, better.rho)[0]
    stated = distance(found.moments, found.moments.rho, found.coarse)[0]
    assert error <= 1.5 * stated
    assert stated < 5e-3


def test_reciprocal_to_the_bit() -> None:
    h = expanded(bc.model("ggx", roughness=0.3), 24)
    assert h.packed
    rng = np.random.default_rng(3)
    a, b = rng.uniform(0, np.pi / 2, (2, 500))
    d = rng.uniform(-3, 3, 500)
    assert np.array_equal(h.evaluate(a, b, d), h.evaluate(b, a, -d))
    rho = h.coefficients(2)
    assert np.array_equal(rho, rho.transpose(0, 2, 1))


def test_symmetrise_states_the_energy_removed() -> None:
    """g = (1 + c_i/2 + ...) c_i c_o: its antisymmetric part is known, and what is left is its reciprocal part."""
    source = Formula(lopsided, reciprocal=False)
    plain = expanded(source, 12)
    assert not plain.reciprocal
    assert "symmetrised" not in plain.report["harmonics"]
    h = expanded(source, 12, symmetrise=True)
    assert h.reciprocal
    mean = Formula(lambda i, o, d: 0.5 * (lopsided(i, o, d) + lopsided(o, i, -d)))
    angles = np.linspace(0.1, 1.2, 9)[:, None], np.linspace(0.1, 1.2, 7), 0.8
    direct = expanded(mean, 12)
    np.testing.assert_allclose(h.evaluate(*angles), direct.evaluate(*angles), rtol=0.02)
    x, w = (a / 2 for a in np.polynomial.legendre.leggauss(20))
    x = x + 0.5
    c_i, c_o = x[:, None], x[None, :]
    # mean over delta_phi of the squares of g and of its antisymmetric part
    s_i, s_o = np.sqrt(1 - c_i**2), np.sqrt(1 - c_o**2)
    whole = ((1 + 0.5 * c_i) ** 2 + 0.5 * (0.2 * s_o) ** 2) * (c_i * c_o) ** 2
    part = ((0.25 * (c_i - c_o)) ** 2 + 0.5 * (0.1 * (s_o - s_i)) ** 2) * (c_i * c_o) ** 2
    expected = float(w @ part @ w / (w @ whole @ w))
    assert h.report["harmonics"]["symmetrised"]["energy_removed"] == pytest.approx(expected, rel=0.02)


def test_mirror_stays_a_delta() -> None:
    source = bc.model("mirror", ior=1.5) + bc.model("lambert", reflectance=0.5)
    h = bc.project(source, 8)
    assert h.has_delta
    theta = np.radians([0.0, 33.3, 60.0, 88.0])
    np.testing.assert_allclose(h.delta_reflectance(theta), source.delta_reflectance(theta), atol=1e-4)
    np.testing.assert_allclose(h.evaluate(theta, 0.2, np.pi), 0.5 / np.pi, rtol=1e-6)


def test_a_source_that_is_nothing() -> None:
    h = bc.project(bc.model("mirror"), 4)
    assert (h.evaluate([0.1, 1.2], 0.3, np.pi) == 0).all()
    assert h.report["harmonics"]["truncation"] == {"target": 0.0, "f": 0.0}


# ---- degrees and windows ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lobe", "degree", "spread"),
    [
        (lambda t, n=400: np.cos(2 * np.minimum(t, np.pi / 4)) ** n, 3.0 * 20, 0.06),
        (lambda t, m=0.05: np.exp(-((np.tan(t) / m) ** 2)) / np.cos(t) ** 4, 2.1 / 0.05, 0.05),
        (lambda t, m=0.05: (m * (1 + np.tan(t) ** 2) / (np.tan(t) ** 2 + m * m)) ** 2, 3.3 / 0.05, 0.05),
    ],
    ids=["phong", "beckmann", "ggx"],
)
def test_degree_laws(lobe: Callable[..., Any], degree: float, spread: float) -> None:
    """Degree for 1 % at theta_i = 0, D alone with theta_h = theta_o/2: 3.0 sqrt(n), 2.1/m, 3.3/m, relative L2."""
    source = Formula(lambda i, o, d: lobe(o / 2))
    low, high = int(0.5 * degree), int(2 * degree)
    while high - low > 1:
        middle = (low + high) // 2
        found = bc.project_slice(source, 0.0, middle, target="f").truncation["f"]
        low, high = (low, middle) if found <= 0.01 else (middle, high)
    assert high == pytest.approx(degree, rel=spread)


@pytest.mark.parametrize(
    ("window", "undershoot", "l2"),
    [("none", 0.0910, 0.139), ("lanczos", 0.0188, 0.165), ("hann", 0.0143, 0.178), ("lanczos2", 0.0107, 0.188)],
)
def test_window_numbers(window: str, undershoot: float, l2: float) -> None:
    found = step_response(window, 16)
    assert found["undershoot"] == pytest.approx(undershoot, abs=6e-5)
    assert found["l2"] == pytest.approx(l2, abs=6e-4)


def test_irradiance_factors() -> None:
    pi = np.pi
    expected = [pi, 2 * pi / 3, pi / 4, 0, -pi / 24, 0, pi / 64]
    np.testing.assert_allclose(irradiance_factors(6), expected, atol=1e-13)
    np.testing.assert_allclose(irradiance_factors(200)[:7], expected, atol=1e-13)
    assert np.abs(irradiance_factors(200)[3::2]).max() < 1e-13
    assert kernel_energy(2)["energy"] == pytest.approx(0.99219, abs=5e-6)
    assert kernel_energy(2)["l2"] == pytest.approx(0.08839, abs=5e-6)
