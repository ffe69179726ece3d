"""A remote material answers what the local one answers, to the bit, and is a `Brdf` like any other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.client import Client
from tests.client.conftest import NAMES


def same(a: Any, b: Any) -> bool:
    """Equal in dtype, shape and every bit; NaN equals NaN."""
    return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", NAMES)
def test_values(client: Client, local: dict[str, bc.Brdf], name: str, dtype: Any) -> None:
    remote, here = client.material(name), local[name]
    i, o, d = (x.astype(dtype) for x in testing.sample_angles(2000))
    assert same(remote.evaluate(i, o, d), here.evaluate(i, o, d))
    assert same(remote.evaluate(i[:5, None], o[None, :7], d[0]), here.evaluate(i[:5, None], o[None, :7], d[0]))
    assert same(remote.evaluate(i[3], o[3], d[3]), here.evaluate(i[3], o[3], d[3]))
    assert same(remote.evaluate(0.3, 0.4, 3.0), here.evaluate(0.3, 0.4, 3.0))
    assert same(remote.evaluate(i[:0], o[:0], d[:0]), here.evaluate(i[:0], o[:0], d[:0]))
    out = np.empty((len(here.channels), i.size), dtype).T  # not contiguous
    assert remote.evaluate(i, o, d, out=out) is out
    assert same(out, here.evaluate(i, o, d))
    bad = i.copy()
    bad[[3, 8]] = np.nan, -1.0
    assert same(remote.evaluate(bad, o, d, outside="nan"), here.evaluate(bad, o, d, outside="nan"))
    bad[3] = 1.6
    assert same(remote.evaluate(bad, o, d, outside="clip"), here.evaluate(bad, o, d, outside="clip"))


@pytest.mark.parametrize("name", NAMES)
def test_everything_else_of_a_brdf(client: Client, local: dict[str, bc.Brdf], name: str) -> None:
    remote, here = client.material(name), local[name]
    assert (remote.channels, remote.channels.kind) == (here.channels, here.channels.kind)
    for flag in ("bilateral", "reciprocal", "energy_conserving", "non_negative", "has_delta"):
        assert getattr(remote, flag) is getattr(here, flag), flag
    assert remote.metadata == here.metadata
    for dtype in (np.float32, np.float64):
        i, o, d = (x.astype(dtype) for x in testing.sample_angles(200))
        i[5] = -1
        assert same(remote.status(i, o, d), here.status(i, o, d))
        assert same(remote.uncertainty(i, o, d, outside="nan"), here.uncertainty(i, o, d, outside="nan"))
        i[5] = 0.5
        assert same(remote.uncertainty(i, o, d), here.uncertainty(i, o, d))
        assert same((2 * remote + remote).uncertainty(i, o, d), (2 * here + here).uncertainty(i, o, d))
    theta = np.radians([[0.0, 30.0], [75.0, 90.0]])
    assert same(remote.delta_reflectance(theta), here.delta_reflectance(theta))
    assert same(remote.albedo(theta), here.albedo(theta))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", NAMES)
def test_vectors(client: Client, local: dict[str, bc.Brdf], name: str, dtype: Any) -> None:
    """The directions are sent as they are: not unit, below the horizon, broadcast, in either precision or both."""
    wi, wo = np.random.default_rng(2).normal(size=(2, 300, 3)).astype(dtype)
    wo[::3] = wi[::3] * [-1, -1, 1] + dtype(0.05) * wo[::3]  # around the mirror direction
    remote, here = client.material(name), local[name]
    assert (here.evaluate_vectors(wi, wo) > 0).any() or name == "mirror"
    other = wo.astype(np.float64 if dtype is np.float32 else np.float32)
    for a, b in (
        (wi, wo), (wi[:, None][:5], wo[None, :7]), (wi[3], wo[3]), (wi[:0], wo[:0]), (wi, other), (wi.tolist(), wo),
        (np.asfortranarray(wi), wo[::-1]), (1e-30 * wi, 1e30 * wo),
    ):  # fmt: skip
        assert same(remote.evaluate_vectors(a, b), here.evaluate_vectors(a, b))
    out = np.empty((len(here.channels), wi.shape[0]), dtype).T  # not contiguous
    assert remote.evaluate_vectors(wi, wo, out=out) is out
    assert same(out, here.evaluate_vectors(wi, wo))
    both, both_here = 2 * remote + remote, 2 * here + here
    assert same(both.evaluate_vectors(wi, wo), both_here.evaluate_vectors(wi, wo))
    for bad in ([0.0, 0.0, 0.0], [np.nan, 0, 1]):
        spoilt = wi.copy()
        spoilt[17] = bad
        errors = []
        for material in (remote, here):
            with pytest.raises(bc.InputError) as caught:
                material.evaluate_vectors(spoilt, wo)
            errors.append((caught.value.code, caught.value.context["where"], caught.value.context["index"]))
        assert errors[0] == errors[1] == ("not_a_direction", "wi", [17])


@pytest.mark.parametrize("name", ["gold", "gold-grid", "measured"])
def test_conformance(client: Client, name: str) -> None:
    """The suite of every model and every table."""
    testing.check_brdf(client.material(name))


def test_works_where_a_brdf_works(client: Client, local: dict[str, bc.Brdf]) -> None:
    remote, here = client.material("gold-grid"), local["gold-grid"]
    angles = testing.sample_angles(50)
    both = 2 * remote + client.material("gold")
    assert same(both.evaluate(*angles), (2 * here + local["gold"]).evaluate(*angles))
    again = bc.tabulate(remote, "angle_grid", shape=(8, 8, 9))
    assert isinstance(again, bc.Table)
    assert again.id == bc.tabulate(here, "angle_grid", shape=(8, 8, 9)).id
