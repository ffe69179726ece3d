"""Regridding scattered measurements: accuracy on known models, policies for holes, status, storage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.channels import VALUE
from brdfcore.base.status import Status
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.tables.scattered.table import MIN_POINTS, Scattered
from tests.benchmarks.holdout import FILES, held_out, measurements
from tests.shared import needs_shared
from tests.support import goniometer
from tests.support.sources import Skewed


@pytest.fixture(scope="module")
def painted() -> Any:
    return to_brdf(goniometer.measured(goniometer.paint(), lights=6, viewers=8, turns=10))


def test_a_smooth_material_comes_back(painted: Scattered) -> None:
    """Between 432 geometries, in the middle of the cells: a few percent of a lobe of roughness .4."""
    theta_i, theta_o, delta_phi = (
        np.radians(x) for x in ([22.0, 37, 52, 67], [17.0, 40, 51, 28], [70.0, 170, 110, 10])
    )
    truth = goniometer.paint().evaluate(theta_i, theta_o, delta_phi)
    assert np.abs(painted.evaluate(theta_i, theta_o, delta_phi) / truth - 1).max() < 0.05


def test_constant_data_is_constant_and_its_albedo_known() -> None:
    b = to_brdf(goniometer.measured(bc.model("lambert", reflectance=0.6)))
    theta = np.radians([0.0, 30, 60, 89])
    assert b.albedo(theta)[:, 0] == pytest.approx(0.6, rel=2e-3)  # float16 nodes: 2^-11
    assert b.non_negative
    assert b.bilateral


def test_noise_is_smoothed_not_followed() -> None:
    """2 % noise on a constant: predictions come closer to it than the measurements are."""
    noisy = to_brdf(goniometer.measured(bc.model("lambert", reflectance=0.6), noise=0.02, lights=6, viewers=8, turns=9))
    off = noisy.evaluate(noisy.angles[:, 0], noisy.angles[:, 1], noisy.angles[:, 2]) / (0.6 / np.pi) - 1
    measured_off = noisy.measured / (0.6 / np.pi) - 1
    assert np.sqrt((off**2).mean()) < 0.6 * np.sqrt((measured_off**2).mean())


def test_status(painted: Scattered) -> None:
    degrees = [(30, 45.714286, 120), (37, 40, 100), (80, 30, 100), (30, 85, 100), (10, 10, 90)]
    theta_i, theta_o, delta_phi = np.radians(np.array(degrees)).T
    codes = painted.status(theta_i, theta_o, delta_phi).tolist()
    measured, interpolated, filled = Status.MEASURED, Status.INTERPOLATED, Status.FILLED
    assert codes == [measured, interpolated, filled, filled, interpolated]
    assert painted.status(2.0, 0.1, 0.1) == Status.OUTSIDE
    # both sides count as one, and delta_phi has no meaning at the normal
    assert painted.status(theta_i[0], theta_o[0], -delta_phi[0]) == measured
    assert painted.status(0.0, theta_o[0], 1.234) == measured


@pytest.mark.parametrize("holes", ["continue", "nearest", "zero"])
def test_holes_follow_the_policy(holes: str) -> None:
    """A quarter of the geometries is missing; beyond the most grazing light nothing is measured."""
    whole = goniometer.measured(bc.model("lambert", reflectance=0.6), lights=6, viewers=8, turns=9)
    m = whole.select(~((whole.theta_o > 0.8) & (whole.delta_phi < 1.6)))
    b = to_brdf(m, holes=holes)
    inside, grazing = b.evaluate(0.7, 1.2, 0.5)[0], b.evaluate(1.5, 0.5, 2.0)[0]
    assert (b.status(0.7, 1.2, 0.5), b.status(1.5, 0.5, 2.0)) == (Status.FILLED, Status.FILLED)
    expected = 0.0 if holes == "zero" else 0.6 / np.pi
    assert inside == pytest.approx(expected, rel=3e-3, abs=1e-3)  # a hole's edge is a cell of the lattice wide
    assert grazing == pytest.approx(expected, rel=3e-3, abs=1e-3)
    assert any(f"holes={holes!r}" in text for text in b.report["done"])
    albedo = b.report["albedo"]
    assert all(before <= after * 1.001 for before, after in zip(albedo["before"], albedo["after"], strict=True))
    assert albedo["before"][-1] == 0  # 85 degrees: all of it is filled


def test_measured_in_the_plane_of_incidence_only() -> None:
    theta_o = np.radians(np.arange(-85.0, 86, 2.5))
    grid = np.meshgrid(np.radians([5.0, 30, 60]), theta_o, indexing="ij")
    theta_i, theta_o = (g.reshape(-1) for g in grid)
    paint = goniometer.paint()
    values = paint.evaluate(theta_i, np.abs(theta_o), np.where(theta_o < 0, 0.0, np.pi))
    m = Measurements.from_columns(
        theta_i, 0.0, theta_o, np.pi, values, paint.channels, file="x", format="t", degrees=False
    )
    b = to_brdf(m)
    assert b.report["coverage"]["only in the plane of incidence"] is True
    assert b.status(0.5, 0.6, np.pi) == Status.INTERPOLATED
    for delta_phi in (0.05, 1.0, 2.0, 3.0):
        assert b.status(0.5, 0.6, delta_phi) >= Status.EXTRAPOLATED
    assert b.status(0.9, 0.9, 1.6) == Status.FILLED
    ratio = b.evaluate(0.8, 0.7, np.pi) / paint.evaluate(0.8, 0.7, np.pi)
    assert np.abs(ratio - 1).max() < 0.1
    testing.check_signature(b)


@pytest.mark.slow
def test_two_sided_measurements_keep_both_sides() -> None:
    skewed = Skewed()
    m = goniometer.measured(skewed, both_sides=True, lights=5, viewers=7, turns=8)
    b, folded = to_brdf(m), to_brdf(m, fold="bilateral")
    assert (b.bilateral, folded.bilateral) == (False, True)
    assert (b.evaluate(0.6, 0.9, 1.2) != b.evaluate(0.6, 0.9, -1.2)).any()
    assert b.evaluate(0.6, 0.9, -1.2) == pytest.approx(skewed.evaluate(0.6, 0.9, -1.2), abs=0.05)
    even = 0.5 * (skewed.evaluate(0.6, 0.9, 1.2) + skewed.evaluate(0.6, 0.9, -1.2))
    assert folded.evaluate(0.6, 0.9, -1.2) == pytest.approx(even, abs=0.05)
    assert b.report["counts"]["negative"]["B"] > 0  # negative values stay, unless asked otherwise
    assert b.evaluate(1.2, 0.3, 0.3)[2] < -0.3
    zeroed = to_brdf(m, negatives="zero")
    assert 0 <= zeroed.evaluate(1.2, 0.3, 0.3)[2] < 0.02
    assert zeroed.non_negative
    assert any("negative values set to zero" in text for text in zeroed.report["done"])


def test_conformance_and_round_trip(painted: Scattered, tmp_path: Path) -> None:
    testing.check_brdf(painted)
    testing.check_table(painted, tmp_path)


def test_a_damaged_table_is_refused(painted: Scattered) -> None:
    arrays, attributes = painted.to_arrays(), painted.attributes()
    for name, bad in (
        ("angles", arrays["angles"][:, :2]),
        ("angles", arrays["angles"] + 2),
        ("measured", arrays["measured"][:-1]),
        ("measured", arrays["measured"].astype(np.float32)),
    ):
        with pytest.raises(bc.FileFormatError, match=name):
            Scattered.from_arrays({**arrays, name: bad}, attributes, painted.channels, painted.flags)
    for bad_attributes in (
        {**attributes, "policy": {"holes": "guess"}},
        {**attributes, "policy": None},
        {**attributes, "settings": {"width": "x"}},
        {k: v for k, v in attributes.items() if k != "policy"},
    ):
        with pytest.raises(bc.FileFormatError, match="policy"):
            Scattered.from_arrays(arrays, bad_attributes, painted.channels, painted.flags)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"holes": "guess"}, "bad_parameter"),
        ({"shape": "1,2"}, "bad_shape"),
        ({"shape": "a,b,c"}, "bad_shape"),
        ({"shape": "2,8,8"}, "bad_shape"),
        ({"shape": "5000,5000,5000"}, "too_large"),
        ({"gap": 0}, "bad_parameter"),
        ({"smoothing": -1}, "bad_parameter"),
        ({"fold": "reciprocal"}, "bad_parameter"),
    ],
)
def test_bad_options(options: dict[str, Any], code: str) -> None:
    m = goniometer.measured(bc.model("lambert"))
    with pytest.raises(bc.BrdfError) as error:
        to_brdf(m, **options)
    assert error.value.code == code


def test_too_few_geometries() -> None:
    m = goniometer.measured(bc.model("lambert")).select(np.arange(MIN_POINTS - 1))
    with pytest.raises(bc.InputError, match="at least 8"):
        to_brdf(m)


@pytest.mark.parametrize("values", [0.0, 1e-300, 1e30])
def test_extreme_values(values: float) -> None:
    """All zero, and the ends of what a table's numbers hold: finite, no warning."""
    theta_i, theta_o, delta_phi = goniometer.geometries()
    m = Measurements.from_columns(
        theta_i, 0.0, theta_o, delta_phi, np.full((theta_i.size, 1), values), VALUE, file="x", format="t"
    )
    if values == 1e30:
        with pytest.raises(bc.LimitError, match="unit"):
            to_brdf(m)
        return
    assert np.isfinite(to_brdf(m).evaluate(0.5, 0.5, 2.0)).all()


def test_many_measurements_use_their_neighbours() -> None:
    """More than are solved for at once."""
    m = goniometer.measured(bc.model("lambert", reflectance=0.6), lights=12, viewers=16, turns=17)
    assert len(m) > 2_500
    b = to_brdf(m, shape="[8,6,6]")
    assert b.evaluate(0.5, 0.5, 2.0)[0] == pytest.approx(0.6 / np.pi, rel=3e-3)


@needs_shared
@pytest.mark.parametrize(("name", "limit"), [("garnet_red", 0.05), ("cayman", 0.06)])
@pytest.mark.slow
def test_held_out_geometries(name: str, limit: float) -> None:
    """A fifth left out, on every third channel; the benchmark `tests.benchmarks.holdout` takes all, and the others."""
    m = measurements(*FILES[name])
    fewer = Measurements.from_columns(
        m.theta_i, 0.0, m.theta_o, m.delta_phi, m.values[:, ::3], bc.Channels(m.channels[::3]),
        file=name, format="t", degrees=False,
    )  # fmt: skip
    found = held_out(fewer, 0.2, seed=0, shape="[40,16,16]")
    assert float(np.median(found["geometry"])) < limit


@needs_shared
@pytest.mark.slow
def test_ptfe() -> None:
    """Sintered PTFE reflects 98 % at normal incidence; a fifth of its geometries predicted to 1 %."""
    m = measurements(*FILES["ptfe"])
    found = held_out(m, 0.2, seed=0, shape="[24,16,16]")
    assert float(np.median(found["geometry"])) < 0.01
    assert float(found["table"].albedo(0.0).mean()) == pytest.approx(0.98, abs=0.01)
    assert m.found["rows"] == 1824
    assert m.channels == (351.0, 532.0, 633.0, 1064.0)


@needs_shared
def test_solar_array_is_read() -> None:
    b = to_brdf(measurements(*FILES["solar_array"]))
    assert b.report["coverage"]["only in the plane of incidence"] is True
    peak = b.evaluate(*np.radians([75.0, 75, 180]))[0]
    assert peak == pytest.approx(53_341.4, rel=0.02)
    assert b.status(*np.radians([60.0, 60, 120])) == Status.FILLED


@pytest.mark.parametrize("kind", ["one theta_i", "retro-reflection", "mirror", "on a line", "at the normal"])
def test_measurements_that_span_little(kind: str) -> None:
    """No basis is singular for them, and nothing is said to be known away from them."""
    t = np.linspace(0.05, 1.3, 30)
    theta_i, theta_o, delta_phi = {
        "one theta_i": (0 * t + 0.5, t, np.tile([0.0, 1.0, 2.0], 10)),
        "retro-reflection": (t, t, 0 * t),
        "mirror": (t, t, 0 * t + np.pi),
        "on a line": (0 * t + 0.5, t, 0 * t + 1),
        "at the normal": (0 * t, t, 0 * t),
    }[kind]
    m = Measurements.from_columns(
        theta_i, 0.0, theta_o, delta_phi, np.full((30, 1), 0.2), VALUE, file="x", format="t", degrees=False
    )
    b = to_brdf(m, shape="[8,8,8]")
    assert b.evaluate(theta_i, theta_o, delta_phi)[:, 0] == pytest.approx(0.2, rel=2e-3)
    assert (b.status(theta_i, theta_o, delta_phi) == Status.MEASURED).all()
    assert b.status(1.45, 1.45, 1.5) == Status.FILLED
