"""Tables made for the angles that a scene sees: smaller or better there, stored as such, and honest beyond."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.directions import mixture
from brdfcore.base.status import Status
from brdfcore.tables.base.seen import EVERYWHERE, Seen
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.half_difference import HalfDifference
from tests import shared

SEEN = Seen((0.0, np.radians(60.0)), (np.radians(50.0), np.radians(75.0)))
GOLD = bc.model("ggx", roughness=0.15, ior="gold")


def built(source: bc.Brdf, seen: Seen, nodes: tuple[int, int, int] = (20, 14, 8)) -> HalfDifference:
    return HalfDifference.build(source, BuildOptions(nodes, seen=seen))


def error(source: bc.Brdf, table: bc.Brdf, seen: Seen = SEEN) -> float:
    return bc.compare(source, table, light=seen.light, view=seen.view, seed=41).l1


@pytest.fixture(scope="module")
def limited() -> HalfDifference:
    return built(GOLD, SEEN)


@pytest.mark.slow
def test_less_error_where_it_is_seen_for_the_same_bytes(limited: HalfDifference) -> None:
    whole = built(GOLD, EVERYWHERE)
    assert limited.nbytes == whole.nbytes
    assert error(GOLD, limited) < 0.8 * error(GOLD, whole)
    assert error(GOLD, limited, EVERYWHERE) > error(GOLD, whole, EVERYWHERE)  # nothing is for nothing


@shared.needs_shared
@pytest.mark.slow
def test_a_measured_file_takes_half_the_bytes_for_the_same_error() -> None:
    paint = bc.read(shared.rgl_path("vch_golden_yellow"))
    seen = Seen((0.0, np.radians(60.0)), (np.radians(60.0), np.radians(85.0)))
    small, large = built(paint, seen, (26, 26, 13)), built(paint, EVERYWHERE, (33, 33, 17))
    assert small.nbytes < 0.55 * large.nbytes
    assert error(paint, small, seen) < error(paint, large, seen)


def test_beyond_what_is_seen_it_continues_and_says_so(limited: HalfDifference) -> None:
    drawn = mixture(20_000, 3)
    used = (drawn.weight > 0) & (np.maximum(drawn.theta_i, drawn.theta_o) < 1.5)
    angles = (drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used])
    inside = SEEN.holds(*angles[:2])
    assert 0 < inside.sum() < inside.size
    codes = limited.status(*angles)
    assert (codes[inside] == Status.INTERPOLATED).all()
    assert (codes[~inside] == Status.EXTRAPOLATED).all()
    f, g = GOLD.evaluate(*angles), limited.evaluate(*angles)
    assert np.isfinite(g).all()
    assert (g >= 0).all()
    assert np.abs(g - f)[~inside].sum() < 0.3 * f[~inside].sum()
    assert (built(GOLD, EVERYWHERE).status(*angles) == Status.INTERPOLATED).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_both_ends_are_seen(limited: HalfDifference, dtype: type) -> None:
    ends = [np.array(SEEN.light, dtype), np.array(SEEN.view, dtype)]
    assert (limited.status(*ends, np.zeros(2, dtype)) == Status.INTERPOLATED).all()
    past = [ends[0], ends[1] + np.array([-0.01, 0.01], dtype)]
    assert (limited.status(*past, np.zeros(2, dtype)) == Status.EXTRAPOLATED).all()


def test_the_limit_is_stored_and_part_of_the_identity(limited: HalfDifference, tmp_path: Path) -> None:
    limited.save(tmp_path / "limited.h5")
    again = bc.open_table(tmp_path / "limited.h5")
    assert isinstance(again, HalfDifference)
    assert again.seen == SEEN
    assert again.id == limited.id
    assert again.describe()["attributes"]["view"] == list(SEEN.view)
    other = HalfDifference.from_arrays(
        limited.to_arrays(),
        {k: v for k, v in limited.attributes().items() if k not in ("light", "view")},
        limited.channels,
        limited.flags,
    )
    assert other.seen.whole
    assert other.id != limited.id  # they answer differently: by their status


@pytest.mark.slow
def test_a_table_for_all_angles_is_what_it_was() -> None:
    whole = built(GOLD, EVERYWHERE)
    assert set(whole.attributes()) == {"scale", "factor", "mirror", "guide_low", "guide_step"}
    np.testing.assert_array_equal(whole.to_arrays()["values"], built(GOLD, Seen((0.0, 1.6))).to_arrays()["values"])


@pytest.mark.parametrize("given", [[1.0, 0.5], [0.0], "all", [0.0, float("nan")], [-0.1, 1.0], [0.0, True], [0.0, 9.0]])
def test_stored_limits_that_can_not_be(limited: HalfDifference, given: object) -> None:
    attributes = {**limited.attributes(), "view": given}
    with pytest.raises(bc.FileFormatError, match="view"):
        HalfDifference.from_arrays(limited.to_arrays(), attributes, limited.channels, limited.flags)


def test_tabulate_for_the_angles_seen() -> None:
    """What is asked for reaches the table, and its error is measured there on draws of another seed."""
    table = bc.tabulate(GOLD, "half_difference", max_bytes=8_000, light=SEEN.light, view=SEEN.view)
    everywhere = bc.tabulate(GOLD, "half_difference", max_bytes=8_000)
    assert isinstance(table, HalfDifference)
    assert table.seen == SEEN
    assert (table.error["light"], table.error["view"]) == (list(SEEN.light), list(SEEN.view))
    assert "light" not in everywhere.error
    for made, stated in ((table, table.error["l1"]), (everywhere, None)):
        found = bc.compare(GOLD, made, light=SEEN.light, view=SEEN.view, seed=5)
        if stated is None:
            assert found.l1 > table.error["l1"]
        else:
            assert abs(found.l1 - stated) < 5 * (found.l1_stderr + table.error["l1_stderr"])
    assert Seen.of((0, np.pi / 2), (0, np.float32(np.pi / 2))).whole
    assert Seen.of(None, (0.0, 1.5)).attributes() == {"light": [0.0, 1.6], "view": [0.0, 1.5]}


@pytest.mark.parametrize("given", [(1.0, 0.5), (0.0,), "all", 3.0, (0.0, float("nan")), (-0.1, 1.0), (0.0, 9.0)])
def test_ranges_that_can_not_be(given: object) -> None:
    with pytest.raises(bc.InputError, match=r"view = .*from < to") as caught:
        bc.tabulate(GOLD, view=given)  # type: ignore[arg-type]
    assert caught.value.context["where"] == "view"


@pytest.mark.parametrize("narrow", [(1e-9, 1e-8), (0.5, 0.5001)])
def test_a_range_that_nothing_falls_into_is_said_before_anything_is_built(narrow: tuple[float, float]) -> None:
    with pytest.raises(bc.InputError, match="wider ranges") as caught:
        bc.tabulate(GOLD, "half_difference", max_bytes=8_000, light=narrow, view=narrow)
    assert caught.value.code == "range_too_narrow"


def test_a_range_that_hardly_anything_falls_into() -> None:
    narrow = Seen((np.radians(30.0), np.radians(31.0)), (np.radians(30.0), np.radians(31.0)))
    table = built(GOLD, narrow)
    found = bc.compare(GOLD, table, light=narrow.light, view=narrow.view, directions=400_000)
    assert found.l1 < 0.01
