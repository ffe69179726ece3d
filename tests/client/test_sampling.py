"""Directions that a service draws are those that the library draws."""

from __future__ import annotations

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.client import Client


@pytest.mark.parametrize("name", ["gold", "gold-half", "measured", "mirror", "spectral"])
def test_the_same_directions(client: Client, local: dict[str, bc.Brdf], name: str) -> None:
    wi, u = [[[0.6, 0.0, 0.8]], [[0.1, 0.2, 2.0]]], np.random.default_rng(3).random((20, 2))
    found, expected = client.material(name).sample(wi, u), local[name].sample(wi, u)
    assert found.wo.shape == (2, 20, 3)
    assert all(np.array_equal(a, b) for a, b in zip(found, expected))
    assert np.array_equal(found.delta, expected.delta)
    assert client.material(name).sample([0, 0, 1], [0.5, 0.5]).pdf.shape == ()


def test_errors_are_the_librarys(client: Client) -> None:
    gold = client.material("gold")
    for wi, u, where in (([0, 0, 1], [0.1, 0.2, 0.3], "u"), ([0, 1], [0.1, 0.2], "wi")):
        with pytest.raises(bc.InputError) as caught:
            gold.sample(wi, u)
        assert caught.value.context["where"] == where
    with pytest.raises(bc.InputError):
        gold.sample([0, 0, 1], [0.1, 1.2])
