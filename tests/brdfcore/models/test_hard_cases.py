"""Cook-Torrance against mpmath where float64 formulas usually fail: sharp lobes, grazing light, weak interfaces.

The oracle reads exactly the floats the model reads, from angles and from vectors separately. 1e-12 relative where
|f| >= 1e-290; for float32 inputs 1e-6 where 1e-30 <= |f| <= 1e38.
"""

from __future__ import annotations

import random
import warnings
from collections.abc import Iterator
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from brdfcore.base import geometry
from brdfcore.models.cook_torrance import CookTorrance
from brdfcore.models.lambert import Lambert
from brdfcore.models.ward import Ward
from tests.support import oracle

HALF_PI = float(np.pi / 2)
EPS = float(np.finfo(np.float64).eps)
ROUGHNESS = (1.0, 0.3, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6)
LOBES = [(d, g) for d in ("beckmann", "ggx", "blinn", "gaussian") for g in ("vgroove", "smith", "none")]
LOBES = [(d, g) for d, g in LOBES if g != "smith" or d in ("beckmann", "ggx")]
MATERIALS: list[tuple[str, Any]] = [
    ("none", None),
    ("dielectric", 1 + 1e-8),
    ("dielectric", 1.0003),
    ("dielectric", 2.42),
    ("conductor", complex(1e-3, 100)),
    ("conductor", complex(1e-3, 1e-3)),
    ("conductor", complex(0.37, 2.82)),
    ("schlick", 1 + 1e-8),
    ("schlick", 1.5),
    ("conductor_approximate", 1 + 1e-8),
    ("conductor_approximate", 1.0003),
    ("conductor_approximate", complex(0.37, 2.82)),
]
Pair = tuple[float, float, float]


def hard_pairs(m: float) -> list[Pair]:
    """The angles of the grid for one roughness: around the mirror direction, retro-reflection, the horizon."""
    found: list[Pair] = []
    for theta_i in (float(x) for x in np.radians([0, 1e-12, 1e-8, 45, 80, 89, 89.9, 89.999, 90])):
        outgoing = {theta_i + d for d in (0, 1e-12, m / 10, -m / 10, m, -m, 10 * m)}
        off_mirror = m / float(np.sin(theta_i)) if theta_i > 0 else 1.0
        azimuths = {0.0, np.pi, -np.pi, np.pi * (1 + EPS), np.pi * (1 - EPS), np.pi + off_mirror, np.pi - off_mirror}
        for theta_o in sorted(t for t in outgoing if 0 <= t <= HALF_PI):
            found += [(theta_i, theta_o, float(p)) for p in sorted(azimuths) if abs(p) <= 9]
    return found


def sample(count: int, seed: int) -> Iterator[tuple[Pair, dict[str, Any], CookTorrance]]:
    """Pairs, parameters and model, each lobe and material drawn equally often."""
    draw = random.Random(seed)
    grid = {m: hard_pairs(m) for m in ROUGHNESS}
    for k in range(count):
        m = ROUGHNESS[k % len(ROUGHNESS)]
        distribution, masking = LOBES[k % len(LOBES)]
        kind, ior = draw.choice(MATERIALS)
        diffuse = draw.choice([0.0, 0.0, 0.25])
        chosen = {"roughness": m, "distribution": distribution, "masking": masking, "fresnel": kind}
        chosen |= {"diffuse": diffuse, "specular": 1 - diffuse, "ior": 1.5 if ior is None else ior}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # conductor_approximate says that it is unfit for glass
            yield draw.choice(grid[m]), chosen, CookTorrance(**chosen)


def vectors_of(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    wi, wo = geometry.vectors_from_angles(*(np.array(x) for x in pair))
    return wi, wo


def error(got: Any, want: Any) -> float:
    return float(abs(mp.mpf(float(got)) / want - 1))


def test_the_lobes_and_roughnesses_are_all_combined() -> None:
    assert len({(k % len(ROUGHNESS), k % len(LOBES)) for k in range(1500)}) == len(ROUGHNESS) * len(LOBES)


@pytest.mark.slow
def test_angles_agree_with_mpmath() -> None:
    counted = 0
    for pair, chosen, model in sample(3000, seed=1):
        got = model.evaluate(*pair)[0]
        want = oracle.cook_torrance(*oracle.from_angles(*pair), **chosen)
        assert got >= 0, (pair, chosen)
        assert np.isfinite(got), (pair, chosen)
        if want >= 1e-290:
            counted += 1
            assert error(got, want) <= 1e-12, (pair, chosen, float(want))
        else:
            assert got <= 1.1e-290, (pair, chosen)
    assert counted > 2000


def test_vectors_agree_with_mpmath() -> None:
    """Of any length, through the public entry point."""
    counted, draw = 0, random.Random(2)
    for k, (pair, chosen, model) in enumerate(sample(2000, seed=2)):
        wi, wo = (v * (draw.uniform(0.3, 30) if k % 2 else 1) for v in vectors_of(pair))
        want = oracle.cook_torrance(*oracle.from_vectors(wi, wo), **chosen)
        got = model.evaluate_vectors(wi, wo)[0]
        assert got >= 0, (pair, chosen)
        if want >= 1e-290:
            counted += 1
            assert error(got, want) <= 1e-12, (pair, chosen, float(want))
    assert counted > 1300


def test_long_and_short_vectors_beside_the_horizon() -> None:
    """A lobe of 1e-6 at z = 1e-3: a direction that is rounded again is one ten-millionth of f off."""
    draw, model = np.random.default_rng(5), Ward(roughness=1e-6)
    for _ in range(100):
        turn, lengths = draw.uniform(0, 2 * np.pi), 10 ** draw.uniform(-2, 2, 2)
        flat = np.array([np.cos(turn), np.sin(turn), 0])
        wi = lengths[0] * (flat + np.array([0, 0, 1e-3]))
        wo = lengths[1] * (np.append(1e-9 * draw.normal(size=2), 1e-3) - flat)
        want = oracle.ward(*oracle.from_vectors(wi, wo), roughness=1e-6)
        assert want > 1e-290
        assert error(model.evaluate_vectors(wi, wo)[0], want) <= 1e-12


def test_raw_vectors_agree_with_mpmath() -> None:
    """On float vectors as the trigonometric functions round them, none of length exactly 1."""
    got = np.empty((1, 1))
    for pair, chosen, model in sample(1000, seed=3):
        wi, wo = vectors_of(pair)
        model._evaluate_vectors(wi[None], wo[None], got)
        want = oracle.cook_torrance(*oracle.from_vectors(wi, wo), **chosen)
        if want >= 1e-290:
            assert error(got[0, 0], want) <= 1e-12, (pair, chosen, float(want))


def test_float32_agrees_with_mpmath() -> None:
    counted = 0
    for pair, chosen, model in sample(1500, seed=4):
        rounded = [np.float32(x) for x in pair]
        got = model.evaluate(*rounded)
        assert got.dtype == np.float32
        want = oracle.cook_torrance(*oracle.from_angles(*rounded), **chosen)
        if 1e-30 <= want <= 1e38:
            counted += 1
            assert error(got[0], want) <= 1e-6, (pair, chosen, float(want))
        elif want > 3.41e38:
            assert got[0] == np.inf
        elif want < 1e-46:
            assert got[0] == 0
    assert counted > 900


def test_lobes_that_underflow_before_a_small_cosine_divides_keep_their_digits() -> None:
    """At 90 degrees 1/(4 c_i c_o) is 6.7e31: D = 1e-318 has lost its digits, f = 1e-287 has them."""
    pair = (HALF_PI, HALF_PI, float(np.nextafter(np.pi, 4)))  # tan theta_h = 2.6
    found = 0
    for m in (float(x) for x in np.linspace(0.095, 0.105, 41)):
        want = oracle.cook_torrance(*oracle.from_angles(*pair), roughness=m, masking="none")
        if want >= 1e-290:
            assert error(CookTorrance(roughness=m, masking="none").evaluate(*pair)[0], want) <= 1e-12
            found += want * oracle.from_angles(*pair)[0][2] ** 2 * 4 < 1e-310  # D alone would be subnormal
    assert found > 3


@pytest.mark.parametrize("factor", [4 / np.pi, 4.0])
def test_conventions_at_grazing_angles(factor: float) -> None:
    convention = "slides" if factor < 2 else "published"
    for pair in hard_pairs(0.01)[::7]:
        a, b = (CookTorrance(roughness=0.01, convention=c).evaluate(*pair)[0] for c in ("normalised", convention))
        np.testing.assert_allclose(b, factor * a, rtol=1e-15)


@pytest.mark.parametrize("turns", [-3, -1, 1, 2, 40])
def test_whole_turns_of_delta_phi_change_nothing_but_its_rounding(turns: int) -> None:
    """The float nearest delta_phi + 2 pi k is another angle: the oracle gets that one, at grazing incidence too."""
    for base in (0.0, 1.0, np.pi, np.pi * (1 + EPS), 2.5):
        delta_phi = base + turns * 2 * np.pi
        geometry_of = geometry.pair_from_angles(*(np.array([x]) for x in (HALF_PI, HALF_PI, delta_phi)))
        h = oracle.half(*oracle.from_angles(HALF_PI, HALF_PI, delta_phi))
        assert error(geometry_of.tan2_h[0], (1 - h[2] ** 2) / h[2] ** 2) <= 1e-12, base
        wi, wo = oracle.from_angles(0.7, 0.7, delta_phi)
        pair = geometry.pair_from_angles(*(np.array([x]) for x in (0.7, 0.7, delta_phi)))
        want = (1 - oracle.dot(wi, wo)) / 2
        assert float(pair.sin2_d[0]) == pytest.approx(float(want), rel=1e-13, abs=1e-60)


def test_bitwise_reciprocity_and_no_azimuth_at_the_pole() -> None:
    for m in ROUGHNESS:
        theta_i, theta_o, delta_phi = (np.array(x) for x in zip(*hard_pairs(m), strict=True))
        for distribution, masking in LOBES:
            model = CookTorrance(roughness=m, distribution=distribution, masking=masking, ior=[1.5, "gold", 1.0003])
            forward, back = model.evaluate(theta_i, theta_o, delta_phi), model.evaluate(theta_o, theta_i, -delta_phi)
            assert (forward == back).all()
            assert np.isfinite(forward).all()
            assert (forward >= 0).all()
            wi, wo = geometry.vectors_from_angles(theta_i, theta_o, delta_phi)
            assert (model.evaluate_vectors(wi, wo) == model.evaluate_vectors(wo, wi)).all()
            around = model.evaluate(0.0, m, np.linspace(-7, 7, 23))
            assert (around == around[0]).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("distribution", "masking"), LOBES)
def test_the_horizon_is_finite(dtype: type, distribution: str, masking: str) -> None:
    horizon = dtype(np.pi / 2)
    model = CookTorrance(roughness=0.1, distribution=distribution, masking=masking, ior="gold")
    theta = np.array([0, 0.5, 1.5, horizon], dtype=dtype)
    grid = np.meshgrid(theta, theta, np.array([0, 1, np.pi], dtype=dtype))
    values = model.evaluate(*grid)
    assert values.dtype == dtype
    assert np.isfinite(values).all()
    assert (values >= 0).all()


@pytest.mark.parametrize("z", [5e-324, 1e-200, 1e-100, 1e-30])
@pytest.mark.parametrize(("distribution", "masking"), LOBES)
def test_vectors_closer_to_the_horizon_than_any_angle_are_finite(z: float, distribution: str, masking: str) -> None:
    model = CookTorrance(roughness=0.3, distribution=distribution, masking=masking, ior=1.5)
    for wo in ([-1, 0, z], [1, 0, z], [0, 1, z], [0, 0, 1]):
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            value = model.evaluate_vectors([1, 0, z], wo)
        assert np.isfinite(value).all()
        assert (value >= 0).all()


def test_lambert_is_exact_everywhere() -> None:
    want = mp.mpf(0.3) / mp.pi
    for pair in hard_pairs(0.1)[::5]:
        assert error(Lambert(reflectance=0.3).evaluate(*pair)[0], want) <= 2e-16
