"""MERL's layout as a representation: coordinates, kernels, cells and nodes, folds, continued cells, hostile arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.conventions import FloatArray
from brdfcore.build.search import Search
from brdfcore.kernels.machine import launch
from brdfcore.kernels.tables import half_angle_numpy
from brdfcore.metrics import FLAG_DEFECT, bilateral_defect, reciprocity_defect
from brdfcore.tables.base.sampled import INTERPOLATIONS
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.half_angle_grid import HalfAngleGrid, cell_angles, continued
from tests.support.merl_plain import cell_of
from tests.support.sources import Constant, Skewed
from tests.support.tiers import first_fast

SHAPE = (12, 11, 16)


class Twisted(Constant):
    """Reciprocal and not bilateral: sin(delta_phi) and cos(theta_i) - cos(theta_o) both change sign."""

    bilateral = energy_conserving = False

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        sines = np.sin(theta_i) * np.sin(theta_o)
        out[:, 0] = 1 + sines * np.sin(delta_phi) * (np.cos(theta_i) - np.cos(theta_o))
        return True


SOURCES = {
    "one channel": bc.model("cook_torrance", roughness=0.4, ior="gold"),
    "three channels": bc.model("cook_torrance", roughness=0.3, ior=["gold", "copper", "silver"]),
    "four channels": bc.model("lambert", reflectance=[0.1, 0.2, 0.3, 0.4]),
    "not bilateral": Twisted(1.0),
}


def build(source: bc.Brdf, shape: tuple[int, int, int] = SHAPE, **options: object) -> HalfAngleGrid:
    table = bc.tabulate(source, "half_angle_grid", shape=shape, **options)  # type: ignore[arg-type]
    assert isinstance(table, HalfAngleGrid)
    return table


def as_read_by(table: HalfAngleGrid, interpolation: str, cells: str = "centre") -> HalfAngleGrid:
    attributes = {"interpolation": interpolation, "cells": cells}
    return HalfAngleGrid.from_arrays(table.to_arrays(), attributes, table.channels, table.flags)


@pytest.fixture(scope="module")
def tables() -> dict[str, HalfAngleGrid]:
    return {name: build(source) for name, source in SOURCES.items()}


# ---- coordinates -----------------------------------------------------------------------------------


def test_coordinates_against_mpmath() -> None:
    """theta_h, theta_d, phi_d from 40-digit vectors, near the mirror direction, retro-reflection and the horizon."""
    cases = [
        (0.3, 0.3 + 1e-7, np.pi - 1e-6),
        (1.2, 0.4, 2.0),
        (0.4, 1.2, 2.0),
        (0.7, 0.7 + 1e-9, 1e-8),
        (1.5, 1.45, -0.4),
        (1e-5, 0.9, 1.0),
        (1.57, 1.5707, np.pi - 1e-7),
        (0.6, 0.5, 9.0),
    ]
    found = np.array(half_angle_numpy.half_angles(*np.array(cases).T)).T
    for (ti, to, dp), (theta_h, theta_d, phi_d) in zip(cases, found):
        with mp.workdps(40):
            a, b, c = mpf(ti), mpf(to), mpf(dp)
            wi = [mp.sin(a), mpf(0), mp.cos(a)]
            wo = [mp.sin(b) * mp.cos(c), mp.sin(b) * mp.sin(c), mp.cos(b)]
            h = [p + q for p, q in zip(wi, wo)]
            exact_h, phi_h = mp.atan2(mp.hypot(h[0], h[1]), h[2]), mp.atan2(h[1], h[0])
            x, y = wi[0] * mp.cos(phi_h) + wi[1] * mp.sin(phi_h), wi[1] * mp.cos(phi_h) - wi[0] * mp.sin(phi_h)
            x, z = x * mp.cos(exact_h) - wi[2] * mp.sin(exact_h), x * mp.sin(exact_h) + wi[2] * mp.cos(exact_h)
            exact_d, exact_p = mp.atan2(mp.hypot(x, y), z), mp.atan2(y, x) % mp.pi
        assert theta_h == pytest.approx(float(exact_h), rel=1e-13)
        assert theta_d == pytest.approx(float(exact_d), rel=1e-13)
        # theta_i - theta_o is known to 1e-16: at 1e-7 from the mirror direction phi_d is to 1e-9
        assert np.abs(np.sin(phi_d - float(exact_p))) < 1e-8


def test_cells_are_found_where_they_were_sampled() -> None:
    for cells, shift in (("centre", 0.5), ("lower_edge", 0.0)):
        theta_i, theta_o, delta_phi, valid = cell_angles(SHAPE, slice(2, 9), cells)
        h, d, p = half_angle_numpy.indices_numpy(theta_i[valid], theta_o[valid], delta_phi[valid], SHAPE, shift)
        i, j, k = np.nonzero(valid)
        assert np.abs(h - (i + 2)).max() < 1e-10
        assert np.abs(d - j).max() < 1e-10
        known = np.minimum(theta_i, theta_o)[valid] > 1e-7
        known &= (j > 0) | (cells == "centre")  # phi_d has no meaning at theta_d = 0
        assert np.abs(np.remainder(p - k + 1, SHAPE[2]) - 1)[known].max() < 1e-9
    assert not valid.all()


@pytest.mark.parametrize("parallel", first_fast(False, True), ids=["serial", "parallel"])
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("name", SOURCES)
def test_kernels_against_their_twin(
    name: str, interpolation: str, parallel: bool, tables: dict[str, HalfAngleGrid]
) -> None:
    """Serial and parallel to the bit; the twin, library functions in float64, to rounding."""
    table = as_read_by(tables[name], interpolation)
    rng = np.random.default_rng(1)
    n, channels = 2 * launch.PARALLEL_FROM, len(table.channels)
    angles = [rng.uniform(low, top, n) for low, top in ((-0.05, 1.6), (-0.05, 1.6), (-9.5, 9.5))]
    angles[0][:2] = np.nan, np.inf
    twin = getattr(half_angle_numpy, {"monotone_cubic": "cubic"}.get(interpolation, interpolation) + "_numpy")
    for dtype, tolerance in ((np.float64, 1e-6), (np.float32, 2e-4)):
        given = [x.astype(dtype) for x in angles]
        inside = (given[0] >= 0) & (given[0] <= 1.57) & (given[1] >= 0) & (given[1] <= 1.57)
        inside &= np.abs(given[2]) <= 3 * np.pi
        found, counts = [], []
        for run in (table._kernel.serial, *([table._kernel.parallel] if parallel else [])):
            out = np.zeros(n * channels, dtype)
            counts.append(run(*given, table._flat, out, table._scales[np.dtype(dtype)], *table._steps))
            found.append(out.reshape(n, channels)[inside])
        assert counts[0] == counts[-1] >= n - inside.sum() - 100
        assert np.array_equal(found[0], found[-1])
        places = half_angle_numpy.indices_numpy(*(x[inside] for x in given), SHAPE, 0.5)
        expected = twin(*places, table.values)
        off = np.abs(found[0] - expected) / (np.abs(expected) + np.abs(expected).mean())
        # the nearest cell of a direction on its edge is a matter of rounding
        assert np.mean(off > tolerance) < (1e-3 if interpolation == "nearest" else 1e-9)


# ---- the suites ------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("name", SOURCES)
def test_conforms(name: str, interpolation: str, tables: dict[str, HalfAngleGrid], tmp_path: Path) -> None:
    table = as_read_by(tables[name], interpolation)
    if interpolation == "nearest":  # float32 may find a neighbouring cell: not close, but a node all the same
        for check in (testing.check_signature, testing.check_scalar_equals_batch, testing.check_domain):
            check(table)
        testing.check_claims(table)
    else:
        testing.check_brdf(table)
    testing.check_table(table, tmp_path)
    table.save(tmp_path / "t.h5")
    testing.check_damage(tmp_path / "t.h5", tmp_path, reads=8)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_a_constant_is_exact_everywhere(interpolation: str) -> None:
    """To the horizon, over the continued cells and the seam of phi_d: nothing bleeds in."""
    table = build(Constant(0.25), interpolation=interpolation)
    assert table.filled_cells.any()
    theta = np.array([0, 1e-12, 0.3, 1.2, 1.57, np.pi / 2])
    for dtype in (np.float32, np.float64):
        values = table.evaluate(
            *(x.astype(dtype) for x in np.meshgrid(theta, theta, [0, 1e-9, 1.0, np.pi, -np.pi, 3.2, 7.0]))
        )
        assert np.abs(values - 0.25).max() < 1e-7


def test_symmetries_are_kept() -> None:
    """A reciprocal material that is not bilateral is held; only a fold makes it bilateral."""
    table, folded = build(Twisted(1.0), (24, 24, 48)), build(Twisted(1.0), (24, 24, 48), fold="bilateral")
    assert (table.bilateral, table.reciprocal, folded.bilateral) == (False, True, True)
    assert reciprocity_defect(table) <= FLAG_DEFECT < 0.01 < bilateral_defect(table)
    assert table.error["l1"] < 2e-3 < folded.error["l1"]
    assert bilateral_defect(folded) <= FLAG_DEFECT
    rng = np.random.default_rng(3)
    angles = *rng.uniform(0.1, 1.2, (2, 400)), rng.uniform(-3, 3, 400)
    assert np.abs(table.evaluate(*angles) - Twisted(1.0).evaluate(*angles)).max() < 0.01


def test_what_is_not_reciprocal_is_refused_unless_folded() -> None:
    with pytest.raises(bc.InputError, match="fold='reciprocal'") as caught:
        build(Skewed())
    assert caught.value.context["where"] == "fold"
    assert not HalfAngleGrid.can_hold(Skewed())
    folded = build(Skewed(), (24, 24, 48), fold=("reciprocal", "bilateral"))
    assert folded.error["l1"] > 0.05
    rng = np.random.default_rng(3)
    theta_i, theta_o, delta_phi = *rng.uniform(0.1, 1.2, (2, 200)), rng.uniform(-3, 3, 200)
    orders = ((theta_i, theta_o), (theta_o, theta_i))
    mean = np.mean([Skewed().evaluate(*o, s * delta_phi) for o in orders for s in (1, -1)], axis=0)
    assert np.abs(folded.evaluate(theta_i, theta_o, delta_phi) - mean).max() < 0.01
    done = " ".join(folded.report["done"])
    assert "reciprocal" in done
    assert "bilateral" in done


def test_auto_leaves_it_to_better_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    considered: list[str] = []

    def run(search: Search, classes: list[type[bc.Table]]) -> bc.Table:
        considered.extend(c.name for c in classes)
        return build(search.source)

    monkeypatch.setattr(Search, "run", run)
    bc.tabulate(Constant(0.1), max_bytes=10**6)
    assert sorted(considered) == ["angle_grid", "half_difference", "lobe_grid"]


# ---- cells and nodes -------------------------------------------------------------------------------


def test_nearest_is_the_floor_of_the_coordinates() -> None:
    """The usual practice, by an independent look-up through turned vectors."""
    table = as_read_by(build(SOURCES["one channel"], (30, 30, 60)), "nearest")
    rng = np.random.default_rng(9)
    angles = np.stack([*rng.uniform(0, 1.57, (2, 2_000)), rng.uniform(-6, 6, 2_000)], axis=1)
    cells = np.array([cell_of(*row, (30, 30, 60)) for row in angles])
    expected = table.values[tuple(cells.T)]
    assert np.mean(table.evaluate(*angles.T) == expected) > 0.999


@pytest.mark.slow
def test_half_a_cell_matters() -> None:
    """Nodes taken for the lower edges of their cells, the classic mistake, cost twenty times the layout's error."""
    source = bc.model("cook_torrance", roughness=0.1, ior="gold")
    table = bc.tabulate(source, "half_angle_grid")
    assert isinstance(table, HalfAngleGrid)
    right, wrong = (bc.compare(source, as_read_by(table, "linear", cells)) for cells in ("centre", "lower_edge"))
    assert right.l1 < 0.004 < 0.05 < wrong.l1
    assert wrong.albedo_bias["bias"][0] < -0.05
    # a lattice that was sampled at the edges is right when it is read so
    theta_i, theta_o, delta_phi, valid = cell_angles((90, 90, 180), slice(None), "lower_edge")
    values = source.evaluate(theta_i, theta_o, delta_phi).astype(np.float32)
    continued(values, valid)
    edges = HalfAngleGrid(values, source.channels, table.flags, cells="lower_edge")
    assert bc.compare(source, edges).l1 < 0.006


# ---- continued cells and status ----------------------------------------------------------------------


def test_continuation_takes_the_nearest_valid_cell() -> None:
    values = np.arange(5 * 3 * 2, dtype=np.float32).reshape(5, 3, 2, 1)
    valid = np.ones((5, 3, 2), np.bool_)
    valid[3:, 0, 0] = False  # from below
    valid[:2, 1, 0] = False  # from above, none lower
    valid[:, 2, 1] = False  # a whole column: from the lower theta_d
    expected = values.copy()
    expected[3:, 0, 0] = values[2, 0, 0]
    expected[:2, 1, 0] = values[2, 1, 0]
    expected[:, 2, 1] = values[:, 1, 1]
    values[~valid] = -1
    continued(values, valid)
    assert np.array_equal(values, expected)
    single = np.zeros((3, 2, 2, 1), np.float32)
    known = np.zeros((3, 2, 2), np.bool_)
    known[1, 1] = True
    single[1, 1] = 5
    continued(single, known)
    assert (single == 5).all()


def test_status_says_what_is_filled() -> None:
    table = build(SOURCES["one channel"])
    nodes = cell_angles(SHAPE, slice(None))
    inner = nodes[3] & ~np.pad(table.filled_cells, ((0, 1), (0, 1), (0, 0)))[1:, 1:]
    angles = [a[inner] for a in nodes[:3]]
    assert (table.status(*angles) == bc.Status.INTERPOLATED).mean() > 0.9
    assert not (table.status(*angles) == bc.Status.FILLED).any()
    rng = np.random.default_rng(0)
    drawn = *rng.uniform(0, np.pi / 2, (2, 5_000)), rng.uniform(-3, 3, 5_000)
    linear, nearest = (as_read_by(table, i).status(*drawn) for i in ("linear", "nearest"))
    assert {int(c) for c in linear} == {bc.Status.INTERPOLATED, bc.Status.EXTRAPOLATED, bc.Status.FILLED}
    assert {int(c) for c in nearest} == {bc.Status.INTERPOLATED, bc.Status.FILLED}
    assert np.array_equal(linear == bc.Status.FILLED, nearest == bc.Status.FILLED)
    assert (table.status(np.pi / 2, [0.1, 1.0], 1.0) != bc.Status.INTERPOLATED).any()
    # the table's own arrays decide: without the bits nothing is filled
    bare = HalfAngleGrid(table.values, table.channels, table.flags)
    assert not (bare.status(*drawn) == bc.Status.FILLED).any()


# ---- edges of the build ------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [10_000, 300_000, 10**15])
def test_a_limit_of_bytes_is_kept_and_used(limit: int) -> None:
    source = bc.model("lambert", reflectance=[0.5, 0.4, 0.3])
    (options,) = HalfAngleGrid.candidates(source, BuildOptions(), limit)
    assert options.shape is not None
    if limit < 10**9:
        table = bc.tabulate(source, "half_angle_grid", max_bytes=limit)
        assert 0.5 * limit < table.nbytes <= limit
    else:
        assert 2**30 < 3 * np.prod(options.shape, dtype=float) < 2**31


def test_a_mirror_stays_a_delta_and_negatives_are_counted() -> None:
    table = build(bc.model("mirror", ior="silver") + bc.model("lambert"))
    assert table.has_delta
    assert np.allclose(table.delta_reflectance([0.0, 1.0]), bc.model("mirror", ior="silver").delta_reflectance([0, 1]))
    kept, zeroed = (build(Skewed(), fold="reciprocal", negatives=n) for n in ("keep", "zero"))
    assert kept.report["negative_nodes"] == int((kept.values < 0).sum()) > 0
    assert zeroed.values.min() == 0
    assert zeroed.non_negative


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"shape": (1, 4, 4)}, "shape"),
        ({"shape": (4, 4)}, "shape"),
        ({"shape": (2**16, 2**16, 2**16)}, "shape"),
        ({"interpolation": "cubic"}, "interpolation"),
        ({"max_bytes": 3}, "max_bytes"),
    ],
)
def test_bad_requests(options: dict[str, object], where: str) -> None:
    with pytest.raises(bc.InputError) as caught:
        bc.tabulate(Constant(0.1), "half_angle_grid", **options)  # type: ignore[arg-type]
    assert caught.value.context["where"] == where
    with pytest.raises(bc.InputError, match=r"theta_i, theta_o, delta_phi = .* degrees"):
        build(Constant(1e39))


@pytest.mark.parametrize(
    ("change", "attributes", "field"),
    [
        ({"values": np.ones((2, 2, 2, 2), np.float32)}, {}, "values"),
        ({"values": np.ones((1, 2, 2, 1), np.float32)}, {}, "values"),
        ({"values": np.ones((2, 2, 2, 1))}, {}, "values"),
        ({"values": np.full((2, 2, 2, 1), np.nan, np.float32)}, {}, "values"),
        ({"values": np.full((2, 2, 2, 1), -1, np.float32)}, {}, "values"),
        ({"filled": np.zeros(2, np.uint8)}, {}, "filled"),
        ({"filled": np.zeros(1, np.int8)}, {}, "filled"),
        ({"delta": np.full((2, 1), 1.5)}, {}, "delta"),
        ({}, {"cells": "corner"}, "cells"),
        ({}, {"cells": 1}, "cells"),
    ],
)
def test_arrays_that_no_table_has(change: dict[str, np.ndarray], attributes: dict[str, object], field: str) -> None:
    flags = {"bilateral": True, "reciprocal": True, "energy_conserving": False, "non_negative": True}
    arrays = {"values": np.ones((2, 2, 2, 1), np.float32), **change}
    with pytest.raises(bc.FileFormatError) as caught:
        HalfAngleGrid.from_arrays(arrays, attributes, bc.Channels(["value"]), flags)
    assert caught.value.context["where"] == field
