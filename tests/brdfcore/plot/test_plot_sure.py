"""Slices show how sure their values are: bands, dashes, measured points, and the words for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Polygon

import brdfcore as bc
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.plot.sure import WEAK_DASHES, sure_of
from tests.support import goniometer

THETA_O = np.radians(np.linspace(-90, 90, 181))


@pytest.fixture(scope="module")
def listed() -> Any:
    return to_brdf(goniometer.measured(goniometer.paint(), lights=4, viewers=6, turns=7), shape="[16,12,12]")


def bands(figure: Any) -> list[Polygon]:
    return [p for p in figure.axes[0].patches if isinstance(p, Polygon) and p.get_alpha() == 0.2]


def note(figure: Any) -> str:
    return next((t.get_text() for t in figure.axes[0].texts if "95 %" in t.get_text()), "")


def test_a_formula_has_no_band() -> None:
    figure = bc.plot.polar(bc.model("lambert"), [0.5])
    assert not bands(figure)
    assert not note(figure)


def test_a_table_has_a_band_of_its_half_widths() -> None:
    table = bc.tabulate(bc.model("ggx", roughness=0.3), "angle_grid", shape=(6, 6, 7))
    figure = bc.plot.polar(table, [0.5])
    assert len(bands(figure)) == 1
    assert note(figure) == "bands: 95 % intervals"
    sure = sure_of(table, 0.5, THETA_O, 0)
    turn = np.where(THETA_O >= 0, np.pi, 0.0)
    assert sure.widths is not None
    assert np.array_equal(sure.widths, table.uncertainty(0.5, np.abs(THETA_O), turn)[:, 0])
    assert bc.plot.render(figure, "svg") == bc.plot.render(bc.plot.polar(table, [0.5]), "svg")
    table.local_error = None
    assert "tabulate again" in " ".join(t.get_text() for t in bc.plot.polar(table, [0.5]).axes[0].texts)


def test_measurements_show_their_points_and_what_is_beyond(listed: Any) -> None:
    light = float(np.radians(25.0))
    figure = bc.plot.polar(listed, [light], channel=listed.channels[0])
    assert note(figure) == "bands: 95 % intervals; dashed: extrapolated or filled; circles: measured"
    sure = sure_of(listed, light, THETA_O, 0)
    assert sure.measured is not None
    signed, values = sure.measured
    assert sorted(np.rint(np.degrees(signed)).tolist()) == [-80, -64, -48, -32, -16, 0, 16, 32, 48, 64, 80]
    assert values.min() > 0
    assert sure.weak[[0, -1]].all()  # nothing is measured beyond 80 degrees
    assert not sure.weak[90]
    dashed = [x for x in figure.axes[0].lines if x._unscaled_dash_pattern[1] == WEAK_DASHES[1]]  # type: ignore[attr-defined]
    assert len(dashed) == 1
    assert sure_of(listed, 0.6, THETA_O, 0).measured is None


def test_on_a_log_scale_a_band_stays_within_the_picture(listed: Any) -> None:
    figure = bc.plot.polar(listed, np.radians([25.0, 75.0]), scale="log")
    for band in bands(figure):
        assert np.isfinite(band.get_xy()).all()
