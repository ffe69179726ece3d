"""The plain grid: kernel against twin, claims, folds, edges."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

import brdfcore as bc
from brdfcore import testing
from brdfcore.kernels.machine import launch
from brdfcore.kernels.tables import trilinear
from brdfcore.metrics import FLAG_DEFECT, reciprocity_defect
from brdfcore.tables.angle_grid import AngleGrid
from brdfcore.tables.base.sampled import SMALLEST_NODE
from brdfcore.tables.base.table import BuildOptions
from tests.support.sources import Constant, Multilinear, Skewed
from tests.support.tiers import first_fast


def random_grid(channels: int, bilateral: bool, shape: tuple[int, int, int] = (7, 6, 9)) -> AngleGrid:
    rng = np.random.default_rng(channels)
    values = rng.random((*shape, channels)).astype(np.float32)
    if not bilateral:
        values[:, :, -1] = values[:, :, 0]
    flags = {"bilateral": bilateral, "reciprocal": False, "energy_conserving": False, "non_negative": True}
    names = bc.Channels(["value"] if channels == 1 else [f"c{k}" for k in range(channels)])
    return AngleGrid(values, names, flags)


@pytest.mark.parametrize("bilateral", [True, False])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_conforms(channels: int, bilateral: bool, tmp_path: Path) -> None:
    grid = random_grid(channels, bilateral)
    testing.check_brdf(grid)
    testing.check_table(grid, tmp_path)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("bilateral", [True, False])
@pytest.mark.parametrize("channels", first_fast(1, 3, 4))
def test_serial_parallel_and_numpy_twin_agree_to_the_bit(channels: int, bilateral: bool, dtype: type) -> None:
    grid = random_grid(channels, bilateral)
    rng = np.random.default_rng(0)
    n = 3 * launch.PARALLEL_FROM
    angles = [rng.uniform(-0.1 if top < 3 else -top, top, n).astype(dtype) for top in (1.6, 1.6, 9.6)]
    for x in angles:
        x[:3] = np.nan, np.inf, -np.inf
    number = np.dtype(dtype)
    arguments = (*angles, grid._flat)
    rest = (trilinear.grid_scale(grid.values.shape[:3], bilateral, number), *grid._steps, bilateral)
    kernel = {1: trilinear.trilinear_one, 3: trilinear.trilinear_three, 4: trilinear.trilinear_many}[channels]
    found, counts = [], []
    for run in (kernel.serial, kernel.parallel, trilinear.trilinear_numpy):
        out = np.zeros(n * channels, number)
        counts.append(run(*arguments, out, *rest))
        found.append(out)
    assert counts[0] == counts[1] == counts[2] > 0
    inside = (angles[0] >= 0) & (angles[0] <= np.float32(np.pi / 2))
    inside &= (angles[1] >= 0) & (angles[1] <= np.float32(np.pi / 2)) & (np.abs(angles[2]) <= 3 * np.pi)
    assert counts[0] == n - np.count_nonzero(inside)
    serial, parallel, twin = (x.reshape(n, channels)[inside] for x in found)
    assert np.array_equal(serial, parallel)
    assert np.array_equal(serial, twin)


def test_against_an_independent_interpolator() -> None:
    """scipy's RegularGridInterpolator on the same nodes, float64."""
    grid = random_grid(3, True)
    axes = [np.linspace(0, top, n) for top, n in zip((np.pi / 2, np.pi / 2, np.pi), grid.values.shape)]
    reference = RegularGridInterpolator(axes, grid.values.astype(np.float64))
    rng = np.random.default_rng(2)
    angles = [rng.uniform(0, top, 2_000) for top in (np.pi / 2, np.pi / 2, np.pi)]
    assert np.allclose(grid.evaluate(*angles), reference(np.stack(angles, axis=1)), rtol=0, atol=3e-7)


def test_nodes_are_reproduced() -> None:
    grid = random_grid(1, True)
    axes = [np.linspace(0, top, n) for top, n in zip((np.pi / 2, np.pi / 2, np.pi), grid.values.shape)]
    found = grid.evaluate(*np.meshgrid(*axes, indexing="ij"))
    assert np.allclose(found, grid.values, rtol=0, atol=1.2e-7)


@given(
    theta_i=st.floats(0, np.pi / 2),
    theta_o=st.floats(0, np.pi / 2),
    delta_phi=st.floats(-1e6, 1e6),
)
@settings(max_examples=300, deadline=None)
def test_between_the_smallest_and_largest_node(theta_i: float, theta_o: float, delta_phi: float) -> None:
    grid = GRID
    value = grid.evaluate(theta_i, theta_o, delta_phi)
    assert grid.values.min() * (1 - 1e-6) <= value[0] <= grid.values.max() * (1 + 1e-6)


GRID = random_grid(1, True)


def test_multilinear_source_is_exact() -> None:
    table = bc.tabulate(Multilinear(), "angle_grid", shape=(5, 6, 7))
    rng = np.random.default_rng(3)
    # short of the last theta cell, whose far node is sampled inside it
    angles = rng.uniform(0, 1.15, 500), rng.uniform(0, 1.2, 500), rng.uniform(-np.pi, np.pi, 500)
    assert np.allclose(table.evaluate(*angles), Multilinear().evaluate(*angles), rtol=1e-6)


def test_energy_of_the_last_cell_is_kept_where_f_grows_like_one_over_cosine() -> None:
    """f = 1/cos(theta_o): the last cell of 2 degrees carries 3.5 % of the albedo and keeps it.

    What is left, about .5 %, is the convexity of 1/cos in the cells before the last.
    """

    class Grazing(Constant):
        energy_conserving = reciprocal = False

        def _evaluate(self, theta_i, theta_o, delta_phi, out):  # type: ignore[no-untyped-def]
            out[:, 0] = 1 / np.cos(theta_o)
            return True

    table = bc.tabulate(Grazing(1.0), "angle_grid", shape=(10, 46, 10))
    exact = 2 * np.pi  # int dphi int sin(theta) dtheta
    assert abs(table.albedo(0.3)[0] / exact - 1) < 0.008


def test_a_source_without_any_symmetry() -> None:
    table = bc.tabulate(Skewed(), "angle_grid", shape=(61, 61, 121))
    assert table.flags == {"bilateral": False, "reciprocal": False, "energy_conserving": False, "non_negative": False}
    rng = np.random.default_rng(4)
    angles = rng.uniform(0, 1.5, 500), rng.uniform(0, 1.5, 500), rng.uniform(-20, 20, 500)
    assert np.abs(table.evaluate(*angles) - Skewed().evaluate(*angles)).max() < 1e-3
    # directions swapped are told apart: a source that is not reciprocal shows it
    swapped = Skewed().evaluate(angles[1], angles[0], -angles[2])
    assert np.abs(table.evaluate(*angles) - swapped).max() > 0.5
    assert table.error["l1"] < 1e-3


def test_folds_only_when_asked_and_their_cost_is_in_the_error() -> None:
    plain = bc.tabulate(Skewed(), "angle_grid", shape=(31, 31, 61))
    folded = bc.tabulate(Skewed(), "angle_grid", shape=(31, 31, 61), fold="bilateral")
    both = bc.tabulate(Skewed(), "angle_grid", shape=(31, 31, 61), fold=("bilateral", "reciprocal"))
    assert (plain.bilateral, folded.bilateral, both.bilateral, both.reciprocal) == (False, True, True, True)
    assert plain.error["l1"] < 0.005 < 0.05 < folded.error["l1"] < both.error["l1"]
    testing.check_claims(both)
    assert any("bilateral" in sentence for sentence in folded.report["done"])
    # the average of f(delta_phi) and f(-delta_phi)
    angles = (0.5, 0.6, np.array([0.7, -0.7]))
    assert np.allclose(folded.evaluate(*angles), Skewed().evaluate(*angles).mean(axis=0), atol=2e-3)


def test_reciprocal_fold_of_a_source_that_is_not_bilateral() -> None:
    """f(i, o, d) and f(o, i, -d) are averaged: swapping the directions turns delta_phi round as well."""

    class Sided(Constant):
        bilateral = reciprocal = energy_conserving = False

        def _evaluate(self, theta_i, theta_o, delta_phi, out):  # type: ignore[no-untyped-def]
            out[:, 0] = 1 + 0.5 * np.sin(delta_phi) * np.sin(theta_i) * np.sin(theta_o) + 0.2 * np.cos(theta_i)
            return True

    table = bc.tabulate(Sided(1.0), "angle_grid", shape=(31, 31, 61), fold="reciprocal")
    assert table.reciprocal
    assert not table.bilateral
    assert reciprocity_defect(table) <= FLAG_DEFECT
    # the sine changes its sign with the directions swapped, so that its average is 0
    assert table.evaluate(0.5, 0.9, [1.0, -2.0])[:, 0] == pytest.approx(1 + 0.1 * (np.cos(0.5) + np.cos(0.9)), abs=1e-3)


@pytest.mark.parametrize("channels", [1, 3, 195])
def test_a_generous_limit_asks_for_no_grid_that_cannot_be(channels: int) -> None:
    source = bc.model("lambert", reflectance=[0.5] * channels)
    for limit in (20_000_000_000, 10**15):
        (options,) = AngleGrid.candidates(source, BuildOptions(), limit)
        assert options.shape is not None
        values = math.prod(options.shape) * channels
        assert 2**30 < values < 2**31


def test_delta_nodes_do_not_depend_on_the_grid() -> None:
    source = bc.model("mirror", ior=1.5)
    table = bc.tabulate(source, "angle_grid", shape=(2, 2, 3))
    theta = np.linspace(0, np.pi / 2, 1_000)
    assert np.abs(table.delta_reflectance(theta) - source.delta_reflectance(theta)).max() < 1e-4
    small = bc.tabulate(source + bc.model("lambert"), "angle_grid", max_bytes=10_000)
    assert 5_000 < small.nbytes <= 10_000  # its delta part counts
    # a file from before, with the delta part at the nodes of theta_i
    flags = random_grid(1, True).flags
    before = AngleGrid.from_arrays(
        {"values": np.ones((3, 2, 2, 1), np.float32), "delta": np.array([[0.0], [0.5], [1.0]])},
        {}, bc.Channels(["value"]), flags,
    )  # fmt: skip
    assert before.delta_reflectance([0.0, np.pi / 8, np.pi / 2])[:, 0] == pytest.approx([0.0, 0.25, 1.0])


def test_a_delta_part_above_1_is_refused() -> None:
    with pytest.raises(bc.InputError, match="within"):
        bc.tabulate(2 * bc.model("mirror"), "angle_grid", shape=(2, 2, 3))


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"delta": np.full((2, 1), 1.5)}, "delta"),
        ({"delta": np.full((2, 1), -0.1)}, "delta"),
        ({"delta": np.full((2, 1), np.nan)}, "delta"),
        ({"delta": np.full((1, 1), 0.5)}, "delta"),
        ({"delta": np.full((2, 2), 0.5)}, "delta"),
        ({"delta": np.full((2, 1), 0.5, np.float32)}, "delta"),
        ({"values": np.full((2, 2, 2, 1), -1, np.float32)}, "values"),
    ],
)
def test_arrays_that_contradict_their_claims(change: dict[str, np.ndarray], field: str) -> None:
    flags = {"bilateral": True, "reciprocal": False, "energy_conserving": False, "non_negative": True}
    arrays = {"values": np.ones((2, 2, 2, 1), np.float32), **change}
    with pytest.raises(bc.FileFormatError) as caught:
        AngleGrid.from_arrays(arrays, {}, bc.Channels(["value"]), flags)
    assert caught.value.context["where"] == field


def test_each_type_has_its_own_horizon() -> None:
    """float32's pi/2, given as float32, is pi/2; the same number in float64 is past the horizon."""
    grid = GRID
    single, past = np.float32(np.pi / 2), np.pi / 2 + 4e-8
    at_horizon = grid.evaluate(np.pi / 2, 0.1, 1.0)
    assert np.array_equal(grid.evaluate(single, 0.1, 1.0), at_horizon)  # mixed: promoted to pi/2
    assert grid.evaluate(single, np.float32(0.1), np.float32(1)) == pytest.approx(at_horizon, rel=1e-5)
    for bad in (past, float(single), np.nextafter(np.pi / 2, 2)):
        for source in (grid, Skewed()):
            with pytest.raises(bc.InputError, match="outside"):
                source.evaluate(0.1, bad, 1.0)
        assert np.isnan(grid.evaluate(bad, 0.1, 1.0, outside="nan")).all()
        assert np.array_equal(grid.evaluate(bad, 0.1, 1.0, outside="clip"), at_horizon)


def test_negatives_are_kept_or_zeroed_and_counted() -> None:
    kept = bc.tabulate(Skewed(), "angle_grid", shape=(16, 16, 16))
    zeroed = bc.tabulate(Skewed(), "angle_grid", shape=(16, 16, 16), negatives="zero")
    count = int((kept.to_arrays()["values"] < 0).sum())
    assert count > 0
    assert kept.report["negative_nodes"] == count
    assert zeroed.non_negative
    assert zeroed.to_arrays()["values"].min() == 0
    assert any(str(count) in sentence for sentence in zeroed.report["done"])


@pytest.mark.parametrize("representation", ["angle_grid", "half_angle_grid"])
def test_no_node_is_subnormal(representation: str) -> None:
    """A lobe of roughness .1 falls below float32's normal numbers, which a look-up pays for threefold."""
    lobe = bc.model("cook_torrance", roughness=0.1, ior="gold")
    values = np.abs(bc.tabulate(lobe, representation, shape=(19, 19, 37)).to_arrays()["values"])
    assert (values == 0).any()
    assert values[values > 0].min() >= SMALLEST_NODE


def test_a_mirror_stays_a_delta() -> None:
    mirror = bc.model("mirror", ior="silver")
    table = bc.tabulate(0.5 * mirror + bc.model("lambert", reflectance=0.25), "angle_grid", shape=(91, 8, 8))
    assert table.has_delta
    assert not isinstance(table, bc.Brdf) or table.evaluate(0.4, 0.4, np.pi)[0] == pytest.approx(0.25 / np.pi, rel=1e-6)
    theta = np.array([0.0, 0.5, 1.3])
    assert np.allclose(table.delta_reflectance(theta), 0.5 * mirror.delta_reflectance(theta), atol=1e-4)
    assert np.allclose(table.albedo(theta), 0.25 + 0.5 * mirror.delta_reflectance(theta), atol=1e-4)


def test_a_source_that_is_not_finite_is_refused() -> None:
    with pytest.raises(bc.InputError, match=r"theta_i, theta_o, delta_phi = .* degrees"):
        bc.tabulate(Constant(1e39), "angle_grid", shape=(4, 4, 4))


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"shape": (1, 4, 4)}, "shape"),
        ({"shape": (4, 4)}, "shape"),
        ({"shape": (4.5, 4, 4)}, "shape"),
        ({"shape": "abc"}, "shape"),
        ({"shape": (2**16, 2**16, 2**16)}, "shape"),
        ({"shape": (4, 4, 4), "tolerance": 0.1}, "shape"),
        ({"shape": (4, 5, 4), "fold": "reciprocal"}, "shape"),
        ({"interpolation": "cubic"}, "interpolation"),
        ({"negatives": "drop"}, "negatives"),
        ({"fold": "sideways"}, "fold"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"max_bytes": 0}, "max_bytes"),
        ({"max_bytes": 3}, "max_bytes"),
        ({"max_bytes": "4MB"}, "max_bytes"),
        ({"max_bytes": float("nan")}, "max_bytes"),
        ({"max_bytes": 10**400}, "max_bytes"),
        ({"tolerance": "0.1"}, "tolerance"),
        ({"tolerance": float("inf")}, "tolerance"),
        ({"shape": (float("inf"), 3, 3)}, "shape"),
        ({"shape": (float("nan"), 3, 3)}, "shape"),
        ({"shape": (10**5000, 3, 3)}, "shape"),
        ({"shape": ()}, "shape"),
        ({"shape": 5}, "shape"),
        ({"fold": 5}, "fold"),
        ({"fold": [["bilateral"]]}, "fold"),
        ({"fold": ["sideways", 1]}, "fold"),
        ({"negatives": ["zero"]}, "negatives"),
        ({"interpolation": 1}, "interpolation"),
    ],
)
def test_bad_requests(options: dict[str, object], where: str) -> None:
    with pytest.raises(bc.InputError) as caught:
        bc.tabulate(Constant(0.1), "angle_grid", **options)  # type: ignore[arg-type]
    assert caught.value.context["where"] == where
