"""Scattered measurements: conventions, what is refused, what repeats say."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import brdfcore as bc
from brdfcore.base.channels import VALUE
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from tests.support import goniometer


def columns(*rows: tuple[float, float, float, float, float], **options: Any) -> Measurements:
    """Rows of theta_i, phi_i, theta_o, phi_o, f in degrees."""
    table = np.array(rows, np.float64)
    return Measurements.from_columns(
        *(table[:, k] for k in range(4)), table[:, 4:], VALUE, **{"file": "x.csv", "format": "test", **options}
    )


@pytest.mark.parametrize(
    ("row", "options", "expected"),
    [
        ((30, 0, 40, 180), {}, (30, 40, 180)),
        ((30, 0, 40, -180), {}, (30, 40, 180)),
        ((-30, 0, 40, 0), {}, (30, 40, 180)),  # PTFE: light at -30, its mirror direction at phi = 0
        ((30, -180, -40, 0), {}, (30, 40, 0)),  # the solar array: the viewer on the light's side
        ((30, -180, 40, 0), {}, (30, 40, 180)),
        ((-30, 0, -40, 180), {}, (30, 40, 180)),
        ((30, 10, 40, 350), {}, (30, 40, -20)),
        ((30, 0, 40, 0), {"mirror": 0}, (30, 40, 180)),
        ((30, 0, 40, 170), {"mirror": 0}, (30, 40, -10)),
        ((0, 0, 40, 77), {}, (0, 40, 0)),
        ((90, 0, 90, 90), {}, (90, 90, 90)),
    ],
)
def test_one_convention(row: Any, options: Any, expected: Any) -> None:
    m = columns((*row, 1.0), **options)
    got = [float(np.degrees(a[0])) for a in (m.theta_i, m.theta_o, m.delta_phi)]
    assert got == pytest.approx(expected, abs=1e-9)


def test_radians_are_kept_to_the_bit() -> None:
    angles = np.array([[0.1, 0.7, 3.0], [1.3, 0.2, -1.7], [0.4, 0.4, np.pi]])
    m = Measurements.from_columns(
        angles[:, 0], 0.0, angles[:, 1], angles[:, 2], np.ones((3, 1)), VALUE, file="x", format="t", degrees=False
    )
    assert (np.stack([m.theta_i, m.theta_o, m.delta_phi], axis=1) == angles).all()


@pytest.mark.parametrize(
    ("row", "field"),
    [
        ((91, 0, 0, 0, 1), "theta_i"),
        ((np.nan, 0, 0, 0, 1), "theta_i"),
        ((0, 0, -90.1, 0, 1), "theta_o"),
        ((0, np.inf, 0, 0, 1), "phi_i"),
        ((0, 0, 0, np.nan, 1), "phi_o"),
    ],
)
def test_bad_angles_name_the_line(row: Any, field: str) -> None:
    with pytest.raises(bc.FileFormatError, match=rf"x\.csv: line 12, {field}: got") as error:
        columns((0, 0, 0, 0, 1), row, lines=[7, 12])
    assert (error.value.context["line"], error.value.context["field"]) == (12, field)


def test_values_that_are_not_finite() -> None:
    rows = [(0.0, 0.0, 10.0 * k, 0.0, np.nan if k == 2 else 1.0) for k in range(5)]
    m = columns(*rows)
    assert len(m) == 4
    assert m.found["invalid"] == {"value": 1}
    assert any("left out" in text and "line 3" in text for text in m.done)
    with pytest.raises(bc.FileFormatError, match="line 3, value"):
        columns(*rows, invalid="error")
    with pytest.raises(bc.FileFormatError, match="no usable row"):
        columns((0, 0, 0, 0, np.nan))


def test_anisotropy_is_refused_with_the_evidence() -> None:
    rows = [(45, p, 30, p + d, 1.0 + (0.5 if p == 90 and d == 60 else 0)) for p in (0, 90) for d in (0, 60, 120)]
    columns(*[(*row[:4], 1.0) for row in rows])  # isotropic: the same value wherever the sample points
    wide = [(*row[:4], row[4] * (3 if row[1] == 90 else 1)) for row in rows]
    with pytest.raises(bc.FileFormatError, match="anisotropic") as error:
        columns(*wide)
    assert error.value.code == "anisotropic"
    for evidence in ("phi_i (0, 90 degrees)", "delta_phi = 60", "line 2", "line 5", "1/sr", "4.5/sr"):
        assert evidence in error.value.detail, (evidence, error.value.detail)


def test_azimuths_without_shared_geometries_are_said_to_be_untested() -> None:
    m = columns((45, 0, 30, 10, 1.0), (45, 90, 30, 150, 2.0))
    assert any("isotropy could not be tested" in text for text in m.warnings)


def test_immutable() -> None:
    m = columns((0, 0, 0, 0, 1))
    with pytest.raises(FrozenInstanceError):
        m.file = "y"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        m.values[0] = 2
    with pytest.raises(TypeError):
        m.found["x"] = 1  # type: ignore[index]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-90, 90), st.floats(-720, 720)] * 2), min_size=1, max_size=8))
def test_directions_are_those_of_the_source(rows: list[tuple[float, float, float, float]]) -> None:
    """The angle between the two directions, found from the source's own angles by vectors."""
    table = np.radians(np.array(rows))
    m = columns(*((*row, 1.0) for row in rows), invalid="drop")

    def vector(theta: Any, phi: Any) -> Any:
        return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)

    between = (vector(table[:, 0], table[:, 1]) * vector(table[:, 2], table[:, 3])).sum(axis=-1)
    ours = (vector(m.theta_i, 0 * m.theta_i) * vector(m.theta_o, m.delta_phi)).sum(axis=-1)
    assert np.allclose(between, ours, atol=2e-4)  # delta_phi is 0 within 1e-4 rad of the normal
    assert ((m.theta_i >= 0) & (m.theta_o >= 0) & (np.abs(m.delta_phi) <= np.pi)).all()


def test_noise_and_symmetries_in_the_report() -> None:
    """Repeats with 3 % noise are reported as such; a skewed pair is found, with its lines."""
    lambert = bc.model("lambert", reflectance=0.5)
    m = goniometer.measured(lambert, noise=0.03, both_sides=True)
    twice = Measurements.from_columns(
        *(np.tile(a, 8) for a in (m.theta_i, 0 * m.theta_i, m.theta_o, m.delta_phi)),
        lambert.evaluate(0.1, 0.1, 0.1)[0, None] * (1 + 0.03 * np.random.default_rng(3).normal(size=(8 * len(m), 1))),
        VALUE, file="x", format="t", degrees=False,
    )  # fmt: skip
    report = to_brdf(twice, shape="[12,8,8]").report
    assert report["noise"]["relative"]["value"] == pytest.approx(0.03, rel=0.05)
    assert report["noise"]["repeated geometries"] == len(m)
    assert report["counts"]["duplicate rows"] == 0
    values = np.array(m.values)
    odd = int(np.flatnonzero((m.delta_phi < -0.1) & (m.theta_o > 1) & (m.theta_i > 1))[0])
    values[odd] *= 5
    skewed = Measurements.from_columns(
        m.theta_i, 0.0, m.theta_o, m.delta_phi, values, VALUE, file="x", format="t", degrees=False
    )
    found = to_brdf(skewed, shape="[12,8,8]").report["bilateral"]
    assert odd + 1 in found["worst pair"]["lines"]
    assert 0.01 < found["defect"] < 0.2


def test_the_instrument_s_own_uncertainty_is_added_in_squares(tmp_path: Path) -> None:
    """A column of standard uncertainties: 1.96 of them, as the fit of a constant is off by next to nothing."""
    theta_i, theta_o, delta_phi = goniometer.geometries()
    rows = [f"{i:.9f},{o:.9f},{d:.9f},0.2,0.01" for i, o, d in zip(theta_i, theta_o, delta_phi)]
    path = tmp_path / "m.csv"
    path.write_text("\n".join(["theta_i_deg,theta_o_deg,delta_phi_deg,f_r_value,sigma", *rows]) + "\n")
    b = bc.read(path, uncertainty="sigma")
    i, o, d = np.radians([theta_i[::7], theta_o[::7], delta_phi[::7]])
    assert b.uncertainty(i, o, d) == pytest.approx(0.0196, rel=0.1)  # a code is 9 %
    assert (bc.read(path).uncertainty(i, o, d) < 1e-3).all()
    path.write_text(path.read_text().replace("0.2,0.01\n", "0.2,-1\n", 1))
    with pytest.raises(bc.FileFormatError, match="line 2, uncertainty"):
        bc.read(path, uncertainty="sigma")
    with pytest.raises(bc.FileFormatError, match="2 columns for 1"):
        bc.read(path, uncertainty="[sigma,f_r_value]")
