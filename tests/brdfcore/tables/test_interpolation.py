"""Monotone cubic and nearest interpolation: the local bound, order, continuity, kernels against their twins."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import brdfcore as bc
from brdfcore import testing
from brdfcore.kernels.machine import launch
from brdfcore.kernels.tables import angle_lattice, half_angle_numpy, trilinear
from brdfcore.kernels.tables.interpolation import hermite, limited
from brdfcore.metrics import FLAG_DEFECT, reciprocity_defect
from brdfcore.tables.angle_grid import AngleGrid
from brdfcore.tables.base.sampled import INTERPOLATIONS
from brdfcore.tables.half_angle_grid import HalfAngleGrid
from tests.support.sources import Skewed
from tests.support.tiers import first_fast

HALF, THREE = 0.5, 3.0


def exact_hermite(a: Fraction, b: Fraction, c: Fraction, d: Fraction, t: Fraction) -> Fraction:
    """The piece in the form of its basis functions, in rational numbers: no rounding, and nothing limits the value."""

    def slope(p: Fraction, q: Fraction) -> Fraction:
        if p * q <= 0:
            return Fraction(0)
        size = min(abs(p + q) / 2, 3 * abs(p), 3 * abs(q))
        return size if p > 0 else -size

    left, right = slope(b - a, c - b), slope(c - b, d - c)
    return (
        (2 * t**3 - 3 * t**2 + 1) * b
        + (t**3 - 2 * t**2 + t) * left
        + (-2 * t**3 + 3 * t**2) * c
        + (t**3 - t**2) * right
    )


#: Node values that break interpolators: signs, plateaus, spikes over 40 orders of magnitude, subnormal numbers.
HOSTILE = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 1e-40, 1e-20, 1e20, 1e30, -1e30, 3e-45]),
    st.floats(-(2.0**100), 2.0**100, width=32),
)
UNIT = st.floats(0, 1, width=32)


@given(nodes=st.tuples(HOSTILE, HOSTILE, HOSTILE, HOSTILE), t=UNIT)
@settings(max_examples=400, deadline=None)
@example(nodes=(0.0, 1.0, 0.0, 0.0), t=0.5)
@example(nodes=(0.0, 0.0, 1.0, 1e30), t=1e-3)
def test_one_axis_is_monotone_by_its_formula_and_not_by_its_last_clip(nodes: tuple[float, ...], t: float) -> None:
    """The exact value is within the two nodes and rises or falls with t; the computed one is the exact one, rounded."""
    a, b, c, d = (Fraction(x) for x in nodes)
    at = Fraction(t)
    exact = exact_hermite(a, b, c, d, at)
    assert min(b, c) <= exact <= max(b, c)
    later = exact_hermite(a, b, c, d, at + (1 - at) / 16)
    assert (later - exact) * (c - b) >= 0
    found = float(hermite(*(np.float64(x) for x in nodes), np.float64(t), False, False, HALF, THREE))
    scale = max(abs(x) for x in nodes[1:3])
    assert abs(found - float(exact)) <= 1e-14 * scale
    assert min(nodes[1:3]) <= found <= max(nodes[1:3])


def test_slopes() -> None:
    """Mean of the differences, three times the smaller at most, 0 at an extremum and beside a plateau."""
    for p, q, expected in (
        (1.0, 2.0, 1.5),
        (1.0, 7.0, 3.0),
        (-1.0, -7.0, -3.0),
        (-1.0, 7.0, 0.0),
        (0.0, 7.0, 0.0),
        (2.0, 2.0, 2.0),
    ):
        assert limited(np.float64(p), np.float64(q), HALF, THREE) == expected
        assert limited(np.float64(q), np.float64(p), HALF, THREE) == expected


def test_straight_lines_are_exact_and_smooth_functions_third_order() -> None:
    line = hermite(*np.arange(1.0, 5.0), np.linspace(0, 1, 11), False, False, HALF, THREE)
    assert np.allclose(line, 2 + np.linspace(0, 1, 11), rtol=0, atol=1e-15)
    worst = []
    for n in (16, 32, 64):  # exp: monotone and convex, so that only the end pieces are less than third order
        x = np.linspace(0, 3, n + 1)
        t = np.linspace(0, 1, 9)
        piece = [
            hermite(*np.exp(x[k - 1 : k + 3]), t, False, False, HALF, THREE) - np.exp(x[k] + t * x[1])
            for k in range(1, n - 1)
        ]
        worst.append(np.abs(piece).max())
    assert worst[0] / worst[1] > 7
    assert worst[1] / worst[2] > 7


# ---- on a lattice ----------------------------------------------------------------------------------


def grid_of(values: np.ndarray, interpolation: str, bilateral: bool = True) -> AngleGrid:
    values = np.ascontiguousarray(values, np.float32)
    if not bilateral:
        values[:, :, -1] = values[:, :, 0]
    flags = {"bilateral": bilateral, "reciprocal": False, "energy_conserving": False, "non_negative": False}
    names = bc.Channels([f"c{k}" for k in range(values.shape[3])])
    return AngleGrid(values, names, flags, interpolation=interpolation)


def lattice_of(values: np.ndarray, interpolation: str) -> HalfAngleGrid:
    flags = {"bilateral": False, "reciprocal": True, "energy_conserving": False, "non_negative": False}
    names = bc.Channels([f"c{k}" for k in range(values.shape[3])])
    return HalfAngleGrid(np.ascontiguousarray(values, np.float32), names, flags, interpolation=interpolation)


def random_angles(n: int, dtype: type = np.float64) -> list[np.ndarray]:
    """Inside the domain, its ends and seams among them."""
    rng = np.random.default_rng(5)
    drawn = [rng.uniform(low, top, n).astype(dtype) for low, top in ((0, 1.57), (0, 1.57), (-9.4, 9.4))]
    ends = np.array(list(product((0, np.pi / 4, np.pi / 2), (0, np.pi / 4, np.pi / 2), (0, 1.0, np.pi, -np.pi, 6.2))))
    return [np.concatenate([x, e.astype(dtype)]) for x, e in zip(drawn, ends.T)]


def corners_of_angles(table: AngleGrid, angles: list[np.ndarray]) -> np.ndarray:
    """The eight nodes around each look-up, (8, n, channels)."""
    scale = table._scales[angles[0].dtype]
    _, cells, _ = angle_lattice.placed_numpy(*angles, scale, table.bilateral)
    i, j, l = cells  # noqa: E741
    return np.stack([table.values[i + a, j + b, l + c] for a, b, c in product((0, 1), repeat=3)])


def corners_of_half_angles(table: HalfAngleGrid, angles: list[np.ndarray]) -> np.ndarray:
    """As above; a neighbouring cell counts where rounding could place the look-up in it, and where theta_h or theta_d
    is next to nothing every phi_d."""
    n_h, n_d, n_p = table.values.shape[:3]
    theta_h, theta_d, _ = half_angle_numpy.half_angles(*angles)
    position = half_angle_numpy.indices_numpy(*angles, (n_h, n_d, n_p), 0.5)
    slack = 1e-9 if angles[0].dtype == np.float64 else 1e-3
    found = []
    for shift in (-slack, slack):
        h, d, p = (np.floor(x + shift).astype(int) for x in position)
        near = [(h + a, d + b, p + c) for a, b, c in product((0, 1), repeat=3)]
        near = [(np.clip(i, 0, n_h - 1), np.clip(j, 0, n_d - 1), k % n_p) for i, j, k in near]
        found += [table.values[place] for place in near]
        vague = np.minimum(theta_h, theta_d) < 1e-5
        for (i, j, _), k in product(near, range(n_p)):
            found.append(np.where(vague[:, None], table.values[i, j, k], found[0]))
    return np.stack(found)


VALUES = st.integers(0, 2**32 - 1)


def hostile_values(seed: int, shape: tuple[int, ...], non_negative: bool) -> np.ndarray:
    rng = np.random.default_rng(seed)
    values = rng.choice([0.0, 1.0, 1e-42, 1e-30, 1e-6, 1e6, 1e30], shape) * rng.choice([1.0, rng.random()], shape)
    return np.asarray(values if non_negative else values * rng.choice([-1, 1], shape), np.float32)


@given(seed=VALUES, non_negative=st.booleans(), bilateral=st.booleans(), single=st.booleans())
@settings(max_examples=30, deadline=None)
def test_never_beyond_the_nodes_of_the_cell(seed: int, non_negative: bool, bilateral: bool, single: bool) -> None:
    """Largest and smallest node of the cell bound every value, exactly for nearest and cubic; nothing is negative
    from nodes that are not. Values span 70 orders of magnitude."""
    dtype = np.float32 if single else np.float64
    angles = random_angles(300, dtype)
    values = hostile_values(seed, (4, 5, 6, 1), non_negative)
    for interpolation in INTERPOLATIONS:
        for table, corners in (
            (grid_of(values.copy(), interpolation, bilateral), corners_of_angles),
            (lattice_of(values, interpolation), corners_of_half_angles),
        ):
            around = corners(table, angles)  # type: ignore[operator]
            found = table.evaluate(*angles)
            # linear: a + t (b - a) rounds
            slack = np.abs(around).max(axis=0) * (4e-7 if interpolation == "linear" else 0)
            assert (found <= around.max(axis=0) + slack).all()
            assert (found >= around.min(axis=0) - slack).all()
            if non_negative:
                assert (found >= 0).all()


@pytest.mark.parametrize("parallel", first_fast(False, True), ids=["serial", "parallel"])
@pytest.mark.parametrize("interpolation", ["nearest", "monotone_cubic"])
@pytest.mark.parametrize("bilateral", [True, False])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_serial_parallel_and_numpy_twin_agree_to_the_bit(
    channels: int, bilateral: bool, interpolation: str, parallel: bool
) -> None:
    shape = (7, 6, 9, channels)
    grid = grid_of(np.random.default_rng(channels).normal(size=shape), interpolation, bilateral)
    n = 2 * launch.PARALLEL_FROM
    rng = np.random.default_rng(0)
    for dtype in (np.float32, np.float64):
        angles = [rng.uniform(-0.1 if top < 3 else -top, top, n).astype(dtype) for top in (1.6, 1.6, 9.6)]
        for x in angles:
            x[:3] = np.nan, np.inf, -np.inf
        inside = (angles[0] >= 0) & (angles[0] <= np.float32(np.pi / 2)) & (np.abs(angles[2]) <= 3 * np.pi)
        inside &= (angles[1] >= 0) & (angles[1] <= np.float32(np.pi / 2))
        scale = trilinear.grid_scale(shape[:3], bilateral, dtype)
        twin = angle_lattice.nearest_numpy if interpolation == "nearest" else angle_lattice.cubic_numpy
        found, counts = [], []
        for run in (grid._kernel.serial, twin, *([grid._kernel.parallel] if parallel else [])):
            out = np.zeros(n * channels, dtype)
            counts.append(run(*angles, grid._flat, out, scale, *grid._steps, bilateral))
            found.append(out.reshape(n, channels)[inside])
        assert counts == [n - np.count_nonzero(inside)] * len(counts)
        assert all(np.array_equal(found[0], other) for other in found[1:])


@pytest.mark.parametrize("bilateral", [True, False])
def test_nodes_are_reproduced_and_pieces_meet(bilateral: bool) -> None:
    grid = grid_of(np.random.default_rng(3).random((5, 4, 9, 2)), "monotone_cubic", bilateral)
    tops = (np.pi / 2, np.pi / 2, np.pi if bilateral else 2 * np.pi)
    axes = [np.linspace(0, top, n) for top, n in zip(tops, grid.values.shape)]
    nodes = np.meshgrid(*axes, indexing="ij")
    assert np.allclose(grid.evaluate(*nodes), grid.values, rtol=0, atol=1e-6)
    # continuous across every face, the fold at 0 and pi and the seam of a turn included
    theta_i, theta_o, delta_phi = random_angles(50)
    for edge in axes[2]:
        both = grid.evaluate(theta_i[:, None], theta_o[:, None], edge + np.array([-1e-9, 1e-9]))
        assert np.abs(both[:, 0] - both[:, 1]).max() < 1e-7
    for edge in axes[0][1:-1]:
        both = grid.evaluate(edge + np.array([-1e-9, 1e-9]), theta_o[:, None], delta_phi[:, None])
        assert np.abs(both[:, 0] - both[:, 1]).max() < 1e-7
    # and smooth along a line of nodes: the derivative across a node is one number
    step = 1e-4
    for edge in axes[2]:
        f = grid.evaluate(axes[0][2], axes[1][1], edge + np.array([-step, 0, step]))
        assert np.abs((f[2] - 2 * f[1] + f[0]) / step).max() < 0.02


def test_nearest_is_the_nearest_node() -> None:
    grid = grid_of(np.arange(5 * 4 * 9).reshape(5, 4, 9, 1), "nearest")
    theta_i, theta_o, delta_phi = random_angles(500)
    folded = np.abs(np.remainder(delta_phi + np.pi, 2 * np.pi) - np.pi)
    place = [np.floor(x * n + 0.5) for x, n in zip((theta_i, theta_o, folded), (8 / np.pi, 6 / np.pi, 8 / np.pi))]
    assert (grid.evaluate(theta_i, theta_o, delta_phi)[:, 0] == place[0] * 36 + place[1] * 9 + place[2]).mean() > 0.99


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_a_symmetric_table_stays_reciprocal(interpolation: str) -> None:
    """The limiter is not linear: without the mean of both orders the cubic one would lose this."""
    values = hostile_values(1, (8, 8, 9, 1), True)
    values = np.clip(values, 0, 1e6)
    grid = grid_of(values + values.transpose(1, 0, 2, 3), interpolation)
    assert reciprocity_defect(grid) <= FLAG_DEFECT


@pytest.mark.parametrize("representation", first_fast("angle_grid", "half_angle_grid"))
def test_accuracy_rises_from_nearest_to_cubic(representation: str) -> None:
    source = bc.model("cook_torrance", roughness=0.3, ior="gold")
    found = {
        i: bc.tabulate(source, representation, shape=(32, 32, 63), interpolation=i).error["l1"] for i in INTERPOLATIONS
    }
    assert found["nearest"] > 5 * found["linear"] > 10 * found["monotone_cubic"] > 0


def test_a_source_without_any_symmetry() -> None:
    table = bc.tabulate(Skewed(), "angle_grid", shape=(31, 31, 61), interpolation="monotone_cubic")
    testing.check_claims(table)
    # the pieces at the ends are second order, and the last node of theta is sampled inside its cell
    theta_i, theta_o = np.random.default_rng(1).uniform(0.06, 1.4, (2, 300))
    angles = theta_i, theta_o, random_angles(0)[2][0] + np.linspace(-9, 9, 300)
    assert np.abs(table.evaluate(*angles) - Skewed().evaluate(*angles)).max() < 1e-3
    assert table.error["l1"] < 3e-4
    assert table.attributes() == {"interpolation": "monotone_cubic"}


def test_the_linear_table_keeps_its_identity() -> None:
    """It has no attributes, as before there were other interpolations; the same nodes read otherwise are another."""
    values = np.ones((2, 3, 4, 1))
    tables = [grid_of(values.copy(), i) for i in INTERPOLATIONS]
    assert grid_of(values, "linear").attributes() == {}
    assert len({t.id for t in tables}) == 3


@pytest.mark.parametrize("bad", ["cubic", 1, None, ["linear"]])
def test_an_interpolation_that_is_none(bad: object) -> None:
    for table in (grid_of(np.ones((2, 2, 2, 1)), "linear"), lattice_of(np.ones((2, 2, 2, 1)), "linear")):
        attributes = {**table.attributes(), "interpolation": bad}
        with pytest.raises(bc.FileFormatError) as caught:
            type(table).from_arrays(table.to_arrays(), attributes, table.channels, table.flags)
        assert caught.value.context["where"] == "interpolation"
    for representation in ("angle_grid", "half_angle_grid"):
        with pytest.raises(bc.InputError) as refused:
            bc.tabulate(bc.model("lambert"), representation, shape=(2, 2, 2), interpolation=bad)  # type: ignore[arg-type]
        assert refused.value.context["where"] == "interpolation"
