"""Half-widths of tables: what they cover, how wide they are, what they cost, and what has none."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.conventions import FloatArray
from brdfcore.base.geometry import vectors_from_angles
from brdfcore.tables.base.error_cells import BY_DISTANCE, LEVELS, cells
from brdfcore.tables.base.local_error import LocalError, decoded, encoded
from tests.benchmarks.uncertainty import INCIDENCES, by_energy, uniform
from tests.shared import needs_shared, rgl_path


class Off(bc.Brdf):
    """1 / pi, off by 10 % and a little, for a table that says how far it is."""

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = 1 / np.pi
        return True

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = 0.1 / np.pi
        return True


def paint() -> bc.Brdf:
    return bc.model("ggx", roughness=0.1) + bc.model("lambert", reflectance=0.3)


@pytest.fixture(scope="module")
def table() -> bc.Table:
    return bc.tabulate(paint(), "half_difference", max_bytes=100_000)


@pytest.mark.parametrize("name", ["half_difference", "angle_grid", "half_angle_grid", "specular_grid"])
def test_95_of_100_errors_are_within(name: str) -> None:
    source = paint()
    made = bc.tabulate(source, name, max_bytes=60_000)
    pooled = []
    for angles in (uniform(40_000, 5), by_energy(source, 40_000, 6)):
        error = np.abs(made.evaluate(*angles) - source.evaluate(*angles))
        width = made.uncertainty(*angles)
        assert np.median(width) <= 8 * np.median(error)
        pooled.append(error <= width)
    assert 0.93 <= np.mean(pooled) <= 0.985
    for degrees in INCIDENCES:
        angles = uniform(4_000, 7, np.radians(degrees))
        within = np.abs(made.evaluate(*angles) - source.evaluate(*angles)) <= made.uncertainty(*angles)
        assert within.mean() >= 0.85, (degrees, within.mean())


def test_slow_sums_are_measured_in_coarser_cells() -> None:
    """What an expansion of a large degree comes to: it tells the number of its terms as `size`."""
    levels = []
    for terms in (0, 10**9):
        source = paint()
        source.size = terms  # type: ignore[attr-defined]
        made = bc.tabulate(source, "angle_grid", shape=(20, 20, 21))
        assert made.local_error is not None
        levels.append(made.local_error.level)
        assert (made.uncertainty(0.3, [0.3, 1.0], 3.0) > 0).all()
    assert levels[1] < levels[0]


@pytest.mark.slow
@needs_shared
@pytest.mark.parametrize("name", ["vch_golden_yellow", "aurora_white", "paper_white"])
def test_measured_files(name: str) -> None:
    source = bc.read(rgl_path(name))
    made = bc.tabulate(source, "half_difference", tolerance=0.02, measure="average")
    for angles in (uniform(40_000, 5), by_energy(source, 40_000, 6)):
        within = np.abs(made.evaluate(*angles) - source.evaluate(*angles)) <= made.uncertainty(*angles)
        assert 0.93 <= within.mean() <= 0.98


def test_a_constant_is_not_off() -> None:
    made = bc.tabulate(bc.model("lambert", reflectance=0.6), "angle_grid", shape=(8, 8, 9))
    assert made.uncertainty(0.4, 0.9, 2.0)[0] < 1e-6


def test_the_source_s_own_is_added_in_squares() -> None:
    made = bc.tabulate(Off(), "angle_grid", shape=(8, 8, 9))
    assert made.uncertainty(*uniform(500, 1)) == pytest.approx(0.1 / np.pi, rel=0.1)  # a code is 9 %


def test_sums_and_multiples(table: bc.Table) -> None:
    other = bc.tabulate(paint(), "angle_grid", shape=(20, 20, 20))
    angles = uniform(100, 2)
    u, v = table.uncertainty(*angles), other.uncertainty(*angles)
    assert (3 * table).uncertainty(*angles) == pytest.approx(3 * u)
    assert (table + 2 * other).uncertainty(*angles) == pytest.approx(np.hypot(u, 2 * v))
    assert (table + (2 * table + other)).uncertainty(*angles) == pytest.approx(np.hypot(3 * u, v))
    assert (table + paint()).uncertainty(*angles) == pytest.approx(u)


def test_stored_beside_the_table_and_no_part_of_its_id(table: bc.Table, tmp_path: Path) -> None:
    table.save(tmp_path / "t.h5")
    angles = uniform(100, 2)
    again = bc.open_table(tmp_path / "t.h5")
    assert np.array_equal(again.uncertainty(*angles), table.uncertainty(*angles))
    assert np.array_equal(pickle.loads(pickle.dumps(table)).uncertainty(*angles), table.uncertainty(*angles))
    assert table.local_error is not None
    assert table.local_error.nbytes <= 0.1 * table.nbytes
    without = bc.open_table(tmp_path / "t.h5")
    without.local_error = None
    assert without.computed_id() == table.id
    without.save(tmp_path / "old.h5")
    with pytest.raises(bc.InputError, match="brdf tabulate") as refused:
        bc.open_table(tmp_path / "old.h5").uncertainty(*angles)
    assert refused.value.code == "missing_uncertainty"
    # a table of what has none has none
    made = bc.tabulate(bc.open_table(tmp_path / "old.h5"), "angle_grid", shape=(8, 8, 8))
    with pytest.raises(bc.InputError, match="holds no uncertainty"):
        made.uncertainty(*angles)


def test_a_file_s_own_table_is_off_by_rounding() -> None:
    made = bc.tabulate(paint(), "half_angle_grid", shape=(20, 20, 20))
    own = type(made).from_arrays(made.to_arrays(), made.attributes(), made.channels, made.flags)
    angles = uniform(100, 2)
    assert (own.uncertainty(*angles) <= 1e-14 * own.evaluate(*angles)).all()
    single = [a.astype(np.float32) for a in angles]
    assert (own.uncertainty(*single) <= 2e-6 * own.evaluate(*single)).all()


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("codes", np.zeros((3, 1), np.uint8)),
        ("codes", np.zeros((172, 1), np.float32)),
        ("by_incidence", np.full(42, -1, np.float32)),
        ("floors", np.zeros(2, np.float32)),
    ],
)
def test_damage_is_refused(name: str, bad: Any) -> None:
    made = bc.tabulate(paint(), "angle_grid", shape=(5, 5, 5))
    assert made.local_error is not None
    arrays = {**made.local_error.arrays, name: bad}
    with pytest.raises(bc.FileFormatError, match=name):
        LocalError.from_arrays(arrays, made.local_error.attributes(), 1)
    for level in (-1, LEVELS, True, "x", None):
        with pytest.raises(bc.FileFormatError, match="level"):
            LocalError.from_arrays(made.local_error.arrays, {"level": level}, 1)


@pytest.mark.slow
@needs_shared
@pytest.mark.parametrize("name", ["cc_iris_purple_gem", "chm_light_blue"])
def test_fewer_nodes_of_the_normals_density(name: str) -> None:
    """They move samples where that density bends: by half vector, not by distance from the mirror direction."""
    source = bc.read(rgl_path(name))
    whole = source.to_arrays()["warp"].shape
    made = bc.tabulate(source, "vndf_warp", shape=(whole[1] // 4, whole[2] // 2))
    assert made.local_error is not None
    assert made.local_error.level >= BY_DISTANCE
    assert made.local_error.nbytes <= 0.1 * made.nbytes
    for angles in (uniform(40_000, 5), by_energy(source, 40_000, 6)):
        error, width = np.abs(made.evaluate(*angles) - source.evaluate(*angles)), made.uncertainty(*angles)
        assert 0.93 <= (error <= width).mean() <= 0.98
        assert np.median(width) <= 8 * np.median(error)  # 7 to 18 times by distance


@pytest.mark.parametrize("level", range(BY_DISTANCE, LEVELS))
def test_cells_by_half_vector(level: int) -> None:
    """Those of the half vector as geometry has it, and every direction has one."""
    c, angles = cells(level), uniform(20_000, 3)
    wi, wo = vectors_from_angles(*angles)
    h = wi + wo
    theta_h, phi_h = np.arctan2(np.hypot(h[:, 0], h[:, 1]), h[:, 2]), np.abs(np.arctan2(h[:, 1], h[:, 0]))
    n = c.count // (4 * (len(c.edges_i) - 1))
    i = np.searchsorted(c.edges_i, angles[0], side="right") - 1
    expected = (i * n + np.minimum(np.sqrt(np.tan(theta_h / 2)) * n, n - 1).astype(int)) * 4
    expected += np.minimum(phi_h / np.pi * 4, 3).astype(int)
    assert (c.numbers(*angles) == expected).mean() > 0.95
    drawn = c.draw(3, np.random.default_rng(1))
    assert all((x >= 0).all() and (x <= np.pi / 2).all() for x in drawn[:2])
    own = c.numbers(*drawn) == np.repeat(np.arange(c.count), 3)
    assert own[drawn[1] < 1.55].mean() > 0.95  # where a cell's half vectors lead below the horizon, the horizon's


@pytest.mark.parametrize("level", range(BY_DISTANCE))
def test_directions_are_drawn_in_their_cells(level: int) -> None:
    c = cells(level)
    theta_i, theta_o, delta_phi = c.draw(20, np.random.default_rng(1))
    found = c.numbers(theta_i, theta_o, delta_phi)
    assert (found >= 0).all()
    assert (found < c.count).all()
    # some distances can't be reached in a cell's corners: the nearest that can is another cell's
    assert (found == np.repeat(np.arange(c.count), 20)).mean() > 0.8
    ends = np.array([0.0, 1e-9, np.pi / 2])
    every = [x.ravel() for x in np.meshgrid(ends, ends, [-3 * np.pi, -np.pi, 0.0, np.pi / 2, np.pi, 3 * np.pi])]
    assert ((c.numbers(*every) >= 0) & (c.numbers(*every) < c.count)).all()


def test_codes_are_rounded_up() -> None:
    relative = np.array([0.0, 1e-9, 1e-4, 0.5, 1.0, 1e9, np.inf])
    again = decoded()[encoded(relative)]
    assert again[0] == 0
    assert (again[1:5] >= relative[1:5]).all()
    assert again[2:5] == pytest.approx(relative[2:5], rel=0.1)
    assert again[-1] == again[-2] == decoded()[255]
