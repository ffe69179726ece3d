"""Sampling: kernels and their twin, noise of the weights, materials of several parts, and what is not reciprocal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.sampling import Sample
from brdfcore.kernels.base import quantile_warp_numpy
from brdfcore.kernels.machine import launch
from brdfcore.sampling.quantiles import cell_masses, make_sampler
from tests import shared

GOLD = bc.model("ggx", roughness=0.1, ior="gold")
SHARP = bc.model("lambert", reflectance=0.4) + 0.5 * bc.model("cook_torrance", roughness=1e-3, ior="gold")


class OneWay(bc.Brdf):
    """Neither reciprocal nor even in azimuth."""

    bilateral = reciprocal = energy_conserving = False

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        lobe = np.exp(-8 * ((theta_o - 0.5 * theta_i) ** 2 + 2 - 2 * np.cos(delta_phi - 2.0)))
        out[:, 0] = (0.1 + lobe) * (0.2 + np.cos(theta_i) ** 2)
        return True


def directions(n: int, seed: int = 3) -> Any:
    rng = np.random.default_rng(seed)
    theta, phi = np.arccos(rng.uniform(0.01, 1, n)), rng.uniform(-np.pi, np.pi, n)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


@pytest.mark.parametrize("source", [GOLD, SHARP, OneWay()], ids=["gold", "sharp", "one way"])
def test_kernels_agree_with_their_twin(source: bc.Brdf) -> None:
    made = make_sampler(source)
    wi, u = directions(20_000), np.random.default_rng(4).random((20_000, 2))
    wo, density, usable = made.draw(wi, u)
    twin_wo, twin_density = quantile_warp_numpy.draw(wi, u, made.azimuth, made.polar, cell_masses())
    assert usable
    assert np.abs(wo - twin_wo).max() < 1e-7  # next to u1 = 0 the twin's t^16 - 1 cancels
    assert np.quantile(np.abs(wo - twin_wo), 0.99) < 1e-9
    assert np.quantile(np.abs(density / twin_density - 1), 0.999) < 1e-6
    again = made.density(wi, wo)
    assert np.quantile(np.abs(again / density - 1), 0.999) < 1e-6
    with launch.one_thread():
        alone = made.draw(wi, u)
    assert np.array_equal(alone[0], wo)
    assert np.array_equal(alone[1], density)
    single = made.draw(wi.astype(np.float32), u.astype(np.float32).clip(0, 1 - 2**-24))
    if source is GOLD:
        assert np.median(np.abs(single[0] - wo)) < 1e-6
        assert np.median(np.abs(single[1] / density - 1)) < 1e-4


@pytest.mark.parametrize("source", [SHARP, OneWay(), GOLD + bc.model("mirror", ior=1.5), 2 * OneWay()])
def test_conformance(source: bc.Brdf) -> None:
    testing.check_sampling(source)


def test_wi_is_held() -> None:
    """weight = f(wi, wo) cos theta_o / pdf, not f(wo, wi)."""
    source = OneWay()
    wi = directions(500)
    drawn = source.sample(wi, np.random.default_rng(1).random((500, 2)))
    cos = drawn.wo[:, 2:] / drawn.pdf[:, None]
    assert np.allclose(drawn.weight, source.evaluate_vectors(wi, drawn.wo) * cos, rtol=1e-12)
    assert not np.allclose(drawn.weight, source.evaluate_vectors(drawn.wo, wi) * cos, rtol=0.1)


def test_shapes_broadcast() -> None:
    drawn = GOLD.sample(directions(4)[:, None], np.random.default_rng(0).random((5, 2)))
    assert isinstance(drawn, Sample)
    assert drawn.wo.shape == (4, 5, 3)
    assert drawn.weight.shape == (4, 5, 1)
    assert drawn.pdf.shape == (4, 5)
    assert GOLD.sample([0, 0, 1], np.zeros((0, 2))).pdf.shape == (0,)
    far = GOLD.sample([0, 0, 1e-200], [0.2, 0.3])
    assert np.array_equal(far.wo, GOLD.sample([0, 0, 1], [0.2, 0.3]).wo)
    with pytest.raises(bc.InputError) as caught:
        GOLD.sample(directions(2), [[0.1, 0.2], [0.3, 1.5]])
    assert caught.value.context["index"] == [1, 1]


def test_a_mirror_alone_and_nothing_at_all() -> None:
    drawn = bc.model("mirror", ior="gold").sample([0.6, 0, 0.8], np.random.default_rng(0).random((100, 2)))
    assert drawn.delta.all()
    assert np.allclose(drawn.wo, [-0.6, 0, 0.8])
    assert np.allclose(drawn.weight, bc.model("mirror", ior="gold").delta_reflectance(np.arccos(0.8)))
    black = bc.model("lambert", reflectance=0.0).sample([0.6, 0, 0.8], [[0.1, 0.2], [0.8, 0.3]])
    assert (black.weight == 0).all()
    assert np.isfinite(black.pdf).all()


@shared.needs_shared
@pytest.mark.slow
def test_weights_of_measured_files() -> None:
    """Relative standard deviation at 30 and 70 degrees: the median and the worst of ten files."""
    spreads = []
    for name in shared.rgl_names():
        b = bc.read(shared.rgl_path(name))
        testing.check_sampling(b, n=10_000)
        for theta in np.radians([30.0, 70.0]):
            u = np.random.default_rng(2).random((20_000, 2))
            weight = b.sample([np.sin(theta), 0, np.cos(theta)], u).weight.mean(axis=1)
            spreads.append(weight.std() / weight.mean())
    assert np.median(spreads) <= 0.15
    assert max(spreads) <= 0.3


def test_a_stored_table_draws_the_same(tmp_path: Path) -> None:
    table = bc.tabulate(GOLD, "half_difference", shape=(16, 12, 13))
    table.save(tmp_path / "t.h5")
    u = np.random.default_rng(2).random((100, 2))
    kept = bc.open_table(tmp_path / "t.h5")
    assert all(np.array_equal(a, b) for a, b in zip(table.sample([0.6, 0, 0.8], u), kept.sample([0.6, 0, 0.8], u)))
