"""The picture of what was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.formats.base.regrid import to_brdf
from tests.brdfcore.conftest import Run
from tests.support import goniometer


@pytest.fixture(scope="module")
def listed() -> bc.Brdf:
    return to_brdf(goniometer.measured(bc.model("lambert"), lights=3, viewers=5, turns=5), shape="[6,6,6]")


def words(figure: object) -> str:
    axes = figure.axes[0]  # type: ignore[attr-defined]
    legend = figure.legends[0]  # type: ignore[attr-defined]
    return " | ".join([t.get_text() for t in axes.texts] + [t.get_text() for t in legend.get_texts()])


def test_each_measured_angle_has_a_disc(listed: bc.Brdf) -> None:
    said = words(bc.plot.coverage(listed, title="made"))
    for text in ("made", "θᵢ = 0°, 5 measured", "θᵢ = 37.5°, 21 measured", "θᵢ = 75°", "interpolated", "filled"):
        assert text in said, said
    assert "measured" not in words(bc.plot.coverage(listed, np.radians([20.0]), title="")).split("|")[0]
    assert bc.plot.render(bc.plot.coverage(listed)) == bc.plot.render(bc.plot.coverage(listed))


def test_a_model_is_measured_everywhere() -> None:
    said = words(bc.plot.coverage(bc.model("lambert"), np.radians([0.0, 60.0])))
    assert "the source's own value" in said
    assert "filled" not in said


def test_bad_angles(listed: bc.Brdf) -> None:
    with pytest.raises(bc.InputError, match="1 to 12"):
        bc.plot.coverage(listed, np.linspace(0, 1, 13))
    with pytest.raises(bc.InputError, match="theta_i"):
        bc.plot.coverage(listed, [2.0])


def test_on_the_command_line(listed: bc.Table, run: Run, tmp_path: Path) -> None:
    listed.save(tmp_path / "m.h5")
    out = tmp_path / "where.svg"
    assert run("plot", str(tmp_path / "m.h5"), "-o", str(out), "--view", "coverage")[0] == 0
    assert out.read_bytes().startswith(b"<?xml")
    status, _, err = run("plot", str(tmp_path / "m.h5"), "-o", str(tmp_path / "x.csv"), "--view", "coverage")
    assert status == 2
    assert "picture" in err
