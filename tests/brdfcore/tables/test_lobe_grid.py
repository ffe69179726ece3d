"""lobe_grid: coordinates against their inverse and twin, lobes of any width, one value at the normal."""

from __future__ import annotations

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.kernels.tables import lobe_grid as kernels
from brdfcore.metrics.incidence import worst
from brdfcore.tables.lobe_grid import LobeGrid
from tests.support.lobes import Lobes
from tests.support.sources import Constant, Skewed

CENTRES = (kernels.HALF, kernels.MIRROR, kernels.LIGHT)


def pairs(n: int = 20_000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    return (
        np.arcsin(np.sqrt(rng.random(n))), np.arcsin(np.sqrt(rng.random(n))), rng.uniform(-np.pi, np.pi, n)
    )  # fmt: skip


@pytest.mark.parametrize("bilateral", [True, False])
@pytest.mark.parametrize("centre", CENTRES)
def test_coordinates_and_their_inverse(centre: int, bilateral: bool) -> None:
    a, b, c = pairs()
    found = kernels.angles_of(*kernels.coordinates_numpy(a, b, c, bilateral, False, centre), centre)
    turn = np.abs(c) if bilateral else c
    assert found[0] == pytest.approx(a, abs=1e-14)
    assert found[1] == pytest.approx(b, abs=1e-14)
    assert np.abs((np.exp(1j * found[2]) - np.exp(1j * turn)) * np.sin(b)).max() < 1e-14


@pytest.mark.parametrize("centre", CENTRES)
def test_distances_keep_their_digits(centre: int) -> None:
    """1e-8 rad from the centre, to 7 digits: what a float64 angle of 1 rad can say."""
    theta = np.array([0.3, 1.0, 1.4])
    apart = 1e-8
    turn = 0.0 if centre == kernels.LIGHT else np.pi
    u, _, _ = kernels.coordinates_numpy(theta, theta + apart, np.full(3, turn), True, False, centre)
    right = np.tan(0.5 * apart) ** 2 if centre == kernels.HALF else np.sin(0.5 * apart) ** 2
    assert u == pytest.approx(right, rel=1e-7)


@pytest.mark.parametrize(
    "source", [bc.model("ggx", roughness=[0.2, 0.3, 0.4]), bc.model("phong", exponent=300), Skewed()]
)
def test_kernels_agree_with_their_twin(source: bc.Brdf) -> None:
    table = bc.tabulate(source, "lobe_grid", shape=(20, 10, 10))
    assert isinstance(table, LobeGrid)
    a, b, c = pairs(4_000)
    plain = np.empty(a.size * len(table.channels))
    outside = kernels.lobe_numpy(
        a, b, c, *table._flat, plain, table._scales[np.dtype(np.float64)], table.bilateral, False, table._n_d,
        table._n_p,
    )  # fmt: skip
    assert outside == 0
    plain = plain.reshape(a.size, -1)
    size = np.abs(plain) + (1e-6 if table.non_negative else 1e-2) * np.abs(plain).max()
    assert (np.abs(table.evaluate(a, b, c) - plain) / size).max() < 1e-5
    single = table.evaluate(*(x.astype(np.float32) for x in (a, b, c)))
    assert np.median(np.abs(single - plain) / size) < 1e-5
    wi = np.stack([np.sin(a), 0 * a, np.cos(a)], axis=1)
    wo = np.stack([np.sin(b) * np.cos(c), np.sin(b) * np.sin(c), np.cos(b)], axis=1)
    assert (np.abs(table.evaluate_vectors(3 * wi, 0.2 * wo) - plain) / size).max() < 1e-5


@pytest.mark.parametrize(
    ("source", "centre"),
    [
        (0.5 * bc.model("ggx", roughness=1e-6) + 0.5 * bc.model("lambert", reflectance=1.0), "half_vector"),
        (bc.model("phong", exponent=2_000), "mirror_direction"),
        (bc.model("ggx", roughness=0.005) + bc.model("ggx", roughness=0.15), "half_vector"),
    ],
    ids=["spike", "phong", "two"],
)
def test_narrow_lobes_in_few_bytes(source: bc.Brdf, centre: str) -> None:
    table = bc.tabulate(source, "lobe_grid", tolerance=0.01)
    assert table.attributes()["centre"] == centre
    assert table.nbytes < 60_000
    assert worst(table.error["by_theta_i"]) <= 0.01
    again = bc.compare(source, table, seed=5, directions=20_000).by_theta_i
    assert worst(again) <= 0.012


@pytest.mark.parametrize("width", [1e-7, 3e-4, 0.02])
def test_a_lobe_at_the_light(width: float) -> None:
    source = Lobes(("light",), width)
    table = bc.tabulate(source, "lobe_grid", shape=(40, 20, 18), light=(0.0, 1.3))
    assert table.attributes()["centre"] == "light"
    rows = [r for r in table.error["by_theta_i"] if r["theta_i"] < 1.25]
    assert max(r["l1"] for r in rows) < 0.02
    assert max(abs(r["albedo_ratio"][0] - 1) for r in rows) < 0.02


def test_one_value_at_the_normal() -> None:
    table = bc.tabulate(Skewed(), "lobe_grid", shape=(16, 8, 12))
    theta = np.linspace(0.1, 1.5, 7)
    around = table.evaluate(0.0, theta[:, None], np.linspace(-3, 3, 9))
    assert np.ptp(around, axis=1).max() <= 1e-5 * np.abs(around).max()  # the last step of a map of 16-bit words
    # and it is the mean: that of f = 1 + sin theta_o sin delta_phi cos theta_i is 1
    assert around[:, 0, 0] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("name", ["angle_grid", "lobe_grid", "half_difference", "half_angle_grid", "specular_grid"])
def test_a_constant_is_held_exactly(name: str) -> None:
    """By every lattice, at and between its nodes, at the horizon too. (An expansion in harmonics ends somewhere.)"""
    assert name in REPRESENTATIONS
    value = 0.159
    table = bc.tabulate(Constant(value), name)
    rng = np.random.default_rng(2)
    theta_i, theta_o = (
        np.concatenate([rng.uniform(0, np.pi / 2, 4_000), np.radians([0, 88, 89, 89.5, 90])]) for _ in "io"
    )
    found = table.evaluate(theta_i, theta_o, rng.uniform(-np.pi, np.pi, theta_i.size))
    assert found == pytest.approx(value, rel=2e-6)


@pytest.mark.parametrize("name", ["angle_grid", "lobe_grid", "half_difference", "specular_grid"])
def test_light_from_exactly_above_whatever_the_signs_of_zeros(name: str) -> None:
    table = bc.tabulate(Skewed(), name, shape=(10, 8, 9) if name != "angle_grid" else (9, 9, 17))
    turn = np.linspace(0, 2 * np.pi, 13)
    wo = np.stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), np.full(13, 0.8)], axis=1)
    found = np.concatenate([table.evaluate_vectors([x, y, 1.0], wo) for x in (0.0, -0.0) for y in (0.0, -0.0)])
    assert np.ptp(found, axis=0).max() <= 1e-6 * np.abs(found).max()
