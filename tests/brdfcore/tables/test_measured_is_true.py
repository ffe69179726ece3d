"""A value called measured is the file's; what a file resolves is kept; noise is smoothed and said to be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.channels import VALUE
from brdfcore.base.status import Status, weaker
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.tables.scattered.table import Scattered
from tests.benchmarks.uncertainty import _COLUMNS, _NAMED
from tests.shared import FOLDER, needs_shared
from tests.support import goniometer


def retro_reflector() -> Any:
    """A peak of 60/sr, 3 degrees wide, back towards the light, sampled each degree, on a white base."""
    away = np.array([-20.0, -8, -4, -2, -1, 0, 1, 2, 4, 8, 20])
    rows = [(i, i + d, t) for i in (20.0, 40, 60) for d in away for t in (0.0, 2, 5, 10, 45, 90, 180) if i + d < 85]
    theta_i, theta_o, turn = np.array(rows).T
    apart = (theta_o - theta_i) ** 2 + (np.sin(np.radians(theta_i)) * turn) ** 2
    values = 0.1 + 60 * np.exp(-apart / 9)
    return Measurements.from_columns(theta_i, 0.0, theta_o, turn, values[:, None], VALUE, file="retro", format="t")


def off(b: Any) -> Any:
    """Rows that are farther than 2 % from the file in some channel."""
    return (np.abs(b.evaluate(*b.angles.T) - b.measured) > 0.02 * np.abs(b.measured)).any(axis=1)


@pytest.fixture(scope="module")
def retro() -> Any:
    return to_brdf(retro_reflector(), shape="[24,12,12]")


def test_a_peak_that_is_resolved_is_kept(retro: Any) -> None:
    b = retro
    assert isinstance(b, Scattered)
    peak = np.radians([20.0, 40, 60])
    assert b.evaluate(peak, peak, 0.0)[:, 0] == pytest.approx(60.1, rel=1e-12)
    assert b.evaluate(peak, peak + np.radians(0.5), 0.0).min() > 30  # and between the samples
    assert not off(b).any()
    assert (b.status(*b.angles.T) == Status.MEASURED).all()
    assert b.report["smoothed"] == {"rows": 0, "of": len(b.angles)}


def test_noise_is_smoothed_and_said_to_be() -> None:
    m = goniometer.measured(bc.model("lambert", reflectance=0.6), noise=0.02, lights=6, viewers=8, turns=9)
    b: Any = to_brdf(m)
    codes, far = b.status(*b.angles.T), off(b)
    assert far.any()
    assert (codes[far] == Status.SMOOTHED).all()
    assert not far[codes == Status.MEASURED].any()
    told = b.report["smoothed"]
    assert told["rows"] == far.sum()
    assert 0.02 < told["off by, median"] <= told["off by, at most"]
    assert any(f"{told['rows']} of {len(b.angles)} rows are smoothed" in text for text in b.report["warnings"])


def test_stored_and_damaged(retro: Any, tmp_path: Path) -> None:
    b = retro
    b.save(tmp_path / "b.h5")
    again: Any = bc.open_table(tmp_path / "b.h5")
    angles = np.radians([[20.0, 40], [20.3, 41], [0.0, 3]])
    assert np.array_equal(again.evaluate(*angles), b.evaluate(*angles))
    assert np.array_equal(again.uncertainty(*angles), b.uncertainty(*angles))
    assert np.array_equal(again.status(*b.angles.T), b.status(*b.angles.T))
    arrays, attributes = b.to_arrays(), b.attributes()
    for name, bad in (
        ("kept", arrays["kept"][:, :2]),
        ("residuals", arrays["residuals"][1:]),
        ("residuals", arrays["residuals"].astype(np.float32)),
        ("reach", -arrays["reach"]),
    ):
        with pytest.raises(bc.FileFormatError, match=name):
            Scattered.from_arrays({**arrays, name: bad}, attributes, b.channels, b.flags)
    # a table of before has no residuals, and is looked up as it was
    without = {k: v for k, v in arrays.items() if k not in ("kept", "residuals", "reach")}
    old = Scattered.from_arrays(without, attributes, b.channels, b.flags)
    assert old.evaluate(*np.radians([20.0, 20, 0]))[0] < 60


def test_vectors_and_float32_get_the_residuals_too(retro: Any) -> None:
    b = retro
    w = [np.sin(np.radians(40.0)), 0.0, np.cos(np.radians(40.0))]
    assert b.evaluate_vectors(w, w)[0] == pytest.approx(60.1, rel=1e-12)
    assert b.evaluate(*np.radians([40.0, 40, 0]).astype(np.float32))[0] == pytest.approx(60.1, rel=1e-4)


def test_of_several_statuses_the_weakest_counts() -> None:
    every = np.array(list(Status), np.uint8)
    a, b = (x.ravel() for x in np.meshgrid(every, every))
    order = [Status.MEASURED, Status.SMOOTHED, Status.INTERPOLATED, Status.EXTRAPOLATED, Status.FILLED, Status.OUTSIDE]
    rank = {int(s): k for k, s in enumerate(order)}
    assert weaker(a, b).tolist() == [max(x, y, key=lambda s: rank[s]) for x, y in zip(a.tolist(), b.tolist())]


@needs_shared
@pytest.mark.parametrize(
    ("name", "degrees", "value"),
    [
        ("retro", (15, 15, 0), 75.05),
        ("retro", (30, 30, 0), 75.05),
        ("retro", (60, 60, 0), 75.05),
        ("grazing", (90, 85, 180), 3.23e-5),
    ],
)
def test_given_files(name: str, degrees: Any, value: float) -> None:
    path = FOLDER / f"cases/{name}.csv"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    b: Any = bc.read(path, **_COLUMNS, **_NAMED)
    assert b.evaluate(*np.radians(degrees))[0] == pytest.approx(value, rel=1e-4)
    assert not off(b)[b.status(*b.angles.T) == Status.MEASURED].any()


@needs_shared
def test_the_standard_s_own_example() -> None:
    b: Any = bc.read(FOLDER / "data/openmaterial/example_material_lidar_brdf.xompt")
    assert not off(b).any()
    assert (b.status(*b.angles.T) == Status.MEASURED).all()
