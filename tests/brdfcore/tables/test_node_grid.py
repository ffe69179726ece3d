"""Grids of given nodes: sampled, folded, looked up between incidences, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.status import Status
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.node_grid import NodeGrid, cell_centres
from tests.support.sources import Skewed


def grid(between: str = "angles", **changed: Any) -> NodeGrid:
    rng = np.random.default_rng(1)
    nodes = {
        "theta_i": np.radians([10.0, 30.0, 50.0]),
        "theta_o": np.radians([0.0, 20.0, 45.0, 80.0]),
        "delta_phi": np.radians([0.0, 50.0, 120.0, 180.0]),
    }
    nodes |= changed
    values = rng.uniform(0.1, 1, (*(n.size for n in nodes.values()), 1))
    return NodeGrid.from_nodes(*nodes.values(), values, bc.Channels(["value"]), bilateral=True, between=between)


@pytest.mark.parametrize("between", ["angles", "mirror"])
def test_nodes_are_answered_to_the_bit(between: str) -> None:
    table = grid(between)
    own = np.flatnonzero(table.lent == 0)
    angles = table.theta_i[own][:, None, None], table.theta_o[:, None], table.delta_phi
    assert np.array_equal(table.evaluate(*angles), table.values[own])
    assert (table.status(*angles) == Status.MEASURED).all()
    assert np.array_equal(table.evaluate(*angles[:2], -angles[2]), table.values[own])
    assert table.status(np.radians(30.0), 0.3, 1.0) == Status.INTERPOLATED
    assert table.status(np.radians([5.0, 60.0]), 0.3, 1.0).tolist() == [Status.EXTRAPOLATED] * 2
    assert table.status(np.radians(30.0), np.radians(85.0), 1.0) == Status.EXTRAPOLATED


def test_linear_between_angles() -> None:
    table = grid()
    middle = np.radians(20.0), np.radians(10.0), np.radians(25.0)
    assert table.evaluate(*middle)[0] == pytest.approx(table.values[:2, :2, :2].mean(), rel=1e-12)


def test_a_lobe_goes_with_the_mirror_direction() -> None:
    theta_i, theta_o = np.radians([20.0, 50.0]), np.radians(np.arange(0.0, 91, 2))
    delta_phi = np.radians(np.arange(0.0, 181, 5))
    i, o, d = np.meshgrid(theta_i, theta_o, delta_phi, indexing="ij")
    away = np.arccos(np.clip(np.cos(i) * np.cos(o) - np.sin(i) * np.sin(o) * np.cos(d), -1, 1))
    values = np.exp(-((away / 0.1) ** 2))[..., None]
    channels = bc.Channels(["value"])
    slid, stuck = (
        NodeGrid.from_nodes(theta_i, theta_o, delta_phi, values, channels, bilateral=True, between=between)
        for between in ("mirror", "angles")
    )
    at = np.radians(35.0)
    assert slid.evaluate(at, at, np.pi)[0] > 0.9
    assert stuck.evaluate(at, at, np.pi)[0] < 0.3
    # nothing at the normal depends on an azimuth that light has not
    assert np.ptp(slid.evaluate(0.0, 0.4, np.linspace(0, 6, 9))) <= 1e-12


def test_built_in_the_middle_of_cells() -> None:
    source = bc.model("ggx", roughness=0.5)
    table = NodeGrid.build(source, BuildOptions(shape=(6, 5, 4)))
    assert np.array_equal(table.theta_i, cell_centres(6, np.pi / 2))
    f = source.evaluate(table.theta_i[2], table.theta_o[3], table.delta_phi[1])[0]
    assert table.values[2, 3, 1, 0] == np.float32(f)
    skewed = NodeGrid.build(Skewed(), BuildOptions(shape=(4, 4, 6)))
    assert not skewed.bilateral
    assert (skewed.delta_phi[0], skewed.delta_phi[-1]) == (0, 2 * np.pi)
    folded = NodeGrid.build(Skewed(), BuildOptions(shape=(4, 4, 6), fold=frozenset({"bilateral"})))
    assert folded.bilateral
    angles = folded.theta_i[1], folded.theta_o[2], folded.delta_phi
    mean = 0.5 * (Skewed().evaluate(*angles) + Skewed().evaluate(*angles[:2], -angles[2]))
    assert folded.evaluate(*angles) == pytest.approx(mean, rel=1e-6)
    for options in ({"shape": (1, 4, 4)}, {"interpolation": "nearest"}, {"fold": frozenset({"reciprocal"})}):
        with pytest.raises(InputError):
            NodeGrid.build(source, BuildOptions(**options))


@pytest.mark.parametrize(
    ("name", "nodes"),
    [
        ("theta_i", [30.0, 10.0, 50.0]),
        ("theta_i", [10.0, 30.0, 95.0]),
        ("theta_o", [0.0, 20.0, 20.0, 80.0]),
        ("delta_phi", [0.0, 50.0, 120.0, 190.0]),
    ],
)
def test_nodes_out_of_order_are_refused(name: str, nodes: list[float]) -> None:
    with pytest.raises(FileFormatError, match=name):
        grid(**{name: np.radians(nodes)})


def test_arrays_that_do_not_fit_are_refused() -> None:
    table = grid()
    for name, array in (
        ("values", np.zeros((3, 4, 4), np.float32)),
        ("values", np.full((3, 4, 4, 1), np.nan)),
        ("lent", np.ones(3, np.uint8)),
        ("theta_i", np.zeros(2)),
    ):
        with pytest.raises(FileFormatError):
            NodeGrid.from_arrays({**table.to_arrays(), name: array}, {"between": "angles"}, table.channels, table.flags)
    with pytest.raises(FileFormatError, match="between"):
        NodeGrid.from_arrays(table.to_arrays(), {"between": "lines"}, table.channels, table.flags)
