"""Slices and pictures: signs, refinement at the mirror direction, files that read back, bytes that repeat."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
import threading
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest
from PIL import Image

import brdfcore as bc
from brdfcore import plot
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB, Channels
from brdfcore.plot import style


class Signed(Brdf):
    """1 on the mirror side (cos delta_phi < 0), 2 on the side of the light; neither bilateral nor reciprocal."""

    bilateral = False

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        out[:, 0] = np.where(np.cos(delta_phi) < 0, 1.0, 2.0) + 0.1 * np.sin(delta_phi)
        return True


class Lobe(Brdf):
    """A Gaussian lobe of width m about the mirror direction, three channels, zero far away."""

    channels = RGB

    def __init__(self, m: float = 0.003) -> None:
        super().__init__()
        self.m = m

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        turn = np.abs(np.remainder(delta_phi, 2 * np.pi) - np.pi)
        square = (theta_o - theta_i) ** 2 + (np.sin(theta_i) * turn) ** 2
        peak = np.exp(-square / self.m**2) / self.m**2
        out[...] = peak[:, None] * np.array([1.0, 0.8, 0.3])
        return True


class Grazing(Brdf):
    """0.2, divided by the viewer's cosine as a file of f cos theta_o is: 1e15 at the horizon."""

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        out[:, 0] = 0.2 + 0.001 / np.cos(theta_o)
        return True


class Odd(Brdf):
    """Negative, zero, NaN and positive values, by theta_o."""

    has_delta = True

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        deg = np.degrees(theta_o)
        out[:, 0] = np.select([deg < 10, deg < 20, deg < 30], [-1.0, 0.0, np.nan], 1.0 + deg)
        return True

    def _delta_reflectance(self, theta_i: Any) -> Any:
        return np.full((theta_i.size, 1), 0.25)


def png(figure: Any) -> Image.Image:
    image = Image.open(io.BytesIO(plot.render(figure, "png")))
    image.load()
    return image


# ---- slices ------------------------------------------------------------------------------------


def test_the_mirror_side_is_positive() -> None:
    data = bc.slice(Signed(), [0.3, 1.2])
    assert data.values.shape == (*data.theta_o.shape, 1)
    assert (data.delta_phi == np.where(data.theta_o >= 0, np.pi, 0.0)).all()
    np.testing.assert_allclose(data.values[..., 0], np.where(data.theta_o >= 0, 1.0, 2.0), atol=1e-15)


@pytest.mark.parametrize("theta_i", [0.0, 1e-9, np.pi / 6, 1.0, 1.57, np.pi / 2])
def test_nodes_hold_the_ends_the_normal_and_the_mirror(theta_i: float) -> None:
    (theta_o,) = bc.slice(Signed(), theta_i).theta_o
    assert (np.diff(theta_o) > 0).all()
    assert theta_o[0] == -np.pi / 2
    assert theta_o[-1] == np.pi / 2
    assert theta_i in theta_o
    assert np.abs(theta_o).min() <= 1e-9
    assert np.diff(theta_o).max() <= np.radians(0.5) * (1 + 1e-9)


def test_slices_of_different_angles_have_one_length() -> None:
    data = bc.slice(Signed(), np.radians([0, 10.1, 45, 89.99, 90]))
    assert data.theta_o.shape[0] == 5


@pytest.mark.parametrize("m", [0.3, 0.003, 1e-5])
def test_a_sharp_lobe_shows_its_peak_and_its_width(m: float) -> None:
    data = bc.slice(Lobe(m), np.radians([35.0]), channel="R")
    f = data.values[0, :, 0]
    assert f.max() == 1 / m**2
    above = data.theta_o[0][f > f.max() / 2]
    assert above.size >= 11  # enough nodes for a smooth curve
    assert np.ptp(above) == pytest.approx(2 * m * np.sqrt(np.log(2)), rel=0.25)


def test_points_and_channels() -> None:
    b = Lobe()
    assert bc.slice(b, 0.5).channels == RGB
    one = bc.slice(b, 0.5, channel="B", points=11)
    assert one.channels == Channels(["B"])
    assert one.values.shape[-1] == 1
    assert one.theta_o.shape[1] < bc.slice(b, 0.5).theta_o.shape[1]
    with pytest.raises(bc.UnknownNameError, match="R, G, B"):
        bc.slice(b, 0.5, channel="Q")


@pytest.mark.parametrize(
    "arguments",
    [
        {"theta_i": [1.6]},
        {"theta_i": [np.nan]},
        {"theta_i": []},
        {"theta_i": 0.1, "view": "sphere"},
        {"theta_i": 0.1, "points": 2},
        {"theta_i": 0.1, "points": 10**9},
        {"theta_i": 0.1, "points": 9.5},
        {"theta_i": [0.1, 0.2], "view": "hemisphere"},
    ],
)
def test_bad_requests_are_input_errors(arguments: dict[str, Any]) -> None:
    with pytest.raises(bc.InputError):
        bc.slice(Lobe(), **arguments)


@pytest.mark.parametrize("b", [Signed(), Lobe(0.1)])
def test_hemisphere_is_what_evaluate_says(b: Brdf) -> None:
    data = bc.slice(b, 0.7, view="hemisphere", points=19)
    assert data.values.shape == (data.theta_o.size, data.delta_phi.size, len(b.channels))
    assert (data.theta_o[0], data.theta_o[-1]) == (0.0, np.pi / 2)
    assert (data.delta_phi[0], data.delta_phi[-1]) == (0.0, 2 * np.pi)
    assert 0.7 in data.theta_o
    assert np.pi in data.delta_phi
    expected = b.evaluate(0.7, data.theta_o[:, None], data.delta_phi)
    np.testing.assert_allclose(data.values, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("view", ["polar", "hemisphere"])
def test_csv_and_json_hold_every_digit(view: Any) -> None:
    b, theta_i = Lobe(0.2), np.radians(30.0)
    data = bc.slice(b, theta_i, view=view, points=13)
    lines = [line for line in data.to_csv().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    values = np.array([[float(r[f"f_r_{c}"]) for c in "RGB"] for r in rows])
    assert (values == data.values.reshape(-1, 3)).all()
    # the printed degrees are the angles that were evaluated, to the last bit
    angles = [np.radians([float(r[f"{n}_deg"]) for r in rows]) for n in ("theta_i", "theta_o", "delta_phi")]
    np.testing.assert_array_equal(angles[1], np.abs(np.broadcast_to(_column(data), data.values.shape[:-1])).ravel())
    np.testing.assert_allclose(b.evaluate(*angles), values, rtol=1e-9)

    read = json.loads(json.dumps(data.to_json("rad"), allow_nan=False))
    assert (read["unit"], read["angles"], read["channels"]) == ("1/sr", "rad", ["R", "G", "B"])
    assert (np.array(read["values"]) == data.values).all()
    assert (np.array(read["theta_o"]) == data.theta_o).all()
    with pytest.raises(bc.InputError):
        data.to_csv("grad")  # type: ignore[arg-type]


def _column(data: Any) -> Any:
    return data.theta_o if data.view == "polar" else data.theta_o[:, None]


def test_values_that_are_not_finite_are_null_in_json() -> None:
    data = bc.slice(Odd(), 0.5)
    text = json.dumps(data.to_json(), allow_nan=False)
    nulls = sum(v is None for row in json.loads(text)["values"][0] for v in row)
    assert nulls == np.isnan(data.values).sum() > 0


# ---- the radial scale --------------------------------------------------------------------------


def test_log_scale_says_what_it_leaves_out() -> None:
    values = np.array([0.0, -1.0, np.nan, 1e-9, 0.5, 2000.0])
    radial = style.Radial.fit(values, "log")
    assert (radial.low, radial.high) == (-2.0, 4.0)  # six decades below the top
    radii = radial(values)
    assert np.isnan(radii[:3]).all()
    assert radii[3] == 0
    assert radii[5] == pytest.approx((np.log10(2000) + 2) / 6)
    notes = " ".join(radial.notes(values))
    assert "2 of 6 values ≤ 0 not drawn" in notes
    assert "1 of 6 values below 0.01" in notes
    assert "1 of 6 values not finite" in notes


@pytest.mark.parametrize("kind", ["polar", "hemisphere"])
@pytest.mark.parametrize("scale", ["linear", "log"])
def test_the_horizon_does_not_hide_the_rest(kind: str, scale: Any) -> None:
    texts = _texts(getattr(plot, kind)(Grazing(), 0.5, scale=scale))
    assert any("at the horizon (up to" in t for t in texts)
    data = bc.slice(Grazing(), 0.5)
    radial = style.Radial.fit(data.values[0, :, 0], scale, style.at_horizon(data.theta_o[0]))
    assert max(radial.tick_values()) <= 1.0
    smooth = bc.slice(bc.model("lambert"), 0.5)
    assert style.Radial.fit(smooth.values[0, :, 0], "linear", style.at_horizon(smooth.theta_o[0])).high < 0.3


def test_linear_scale_ends_on_a_round_number() -> None:
    radial = style.Radial.fit(np.array([0.318, -0.1]), "linear")
    assert radial.high == pytest.approx(0.4)
    assert "1 of 2 values < 0 not drawn" in radial.notes(np.array([0.318, -0.1]))[0]


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("values", [[], [0.0], [np.nan], [1e-310], [1e308], [1.0], [-1.0], [np.inf]])
def test_scales_of_extreme_data_are_finite(scale: Any, values: list[float]) -> None:
    radial = style.Radial.fit(np.array(values), scale)
    assert np.isfinite([radial.low, radial.high, *radial.ticks]).all()
    assert radial.high > radial.low
    assert 2 <= len(radial.ticks) <= 8
    assert all(radial.tick_labels())


@pytest.mark.parametrize(
    ("value", "text"), [(0, "0"), (0.25, "0.25"), (30000.0, "30000"), (2.5e6, "2.5×10⁶"), (1e-7, "10⁻⁷")]
)
def test_number_labels(value: float, text: str) -> None:
    assert style.number_text(value) == text


# ---- figures -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("b", [Signed(), Lobe(), Lobe(1e-5), Odd(), 0.0 * Lobe()], ids=lambda b: type(b).__name__)
def test_every_material_makes_a_picture(b: Brdf, scale: Any) -> None:
    assert png(plot.polar(b, scale=scale)).size == (960, 690)
    assert png(plot.hemisphere(b, 1.0, scale=scale, points=31, dpi=100)).size == (600, 490)


def _texts(figure: Any) -> list[str]:
    texts = [t.get_text() for a in figure.axes for t in a.texts]
    return texts + [t.get_text() for legend in figure.legends for t in legend.get_texts()]


def test_the_picture_says_what_is_drawn() -> None:
    several = _texts(plot.polar(Lobe()))
    assert any("channel G" in t for t in several)
    assert [t for t in several if t.startswith("θᵢ = ")] == ["θᵢ = 0°", "θᵢ = 30°", "θᵢ = 60°"]
    assert "fᵣ (1/sr)" in several
    one = _texts(plot.polar(Lobe(), np.pi / 4, scale="log"))
    assert {"R", "G", "B"} <= set(one)
    assert any("all 3 channels, θᵢ = 45°" in t for t in one)
    assert "fᵣ (1/sr), log scale" in one
    odd = " ".join(_texts(plot.polar(Odd(), 0.5)))
    assert "delta" in odd
    assert "0.25 at" in odd
    assert "not finite" in odd


def test_two_materials_are_named() -> None:
    texts = _texts(plot.polar({"reference": Lobe(0.2), "table": 0.9 * Lobe(0.2)}, 0.5))
    assert {"reference", "table"} <= set(texts)


def test_errors_of_a_picture() -> None:
    with pytest.raises(bc.InputError, match="12"):
        plot.polar(Lobe(), np.linspace(0, 1, 13))
    with pytest.raises(bc.InputError, match="linear"):
        plot.polar(Lobe(), scale="cubic")
    with pytest.raises(bc.InputError, match="svg"):
        plot.render(plot.polar(Lobe()), "pdf")
    with pytest.raises(bc.InputError, match="dpi"):
        plot.polar(Lobe(), size=(1, 1))


HOSTILE = "$x_{1}$ <script>alert(1)</script> --> & ]]> _a_ \\frac{ \x00\x1b\ud800\n漢字 " + "W" * 400


@pytest.mark.parametrize("kind", ["polar", "hemisphere"])
def test_hostile_names_are_drawn_as_text(kind: str) -> None:
    draw = getattr(plot, kind)
    figure = draw(Lobe(0.2), 0.5, title=HOSTILE)
    svg = plot.render(figure, "svg")
    root = ET.fromstring(svg)  # well-formed, whatever the name
    assert not [e for e in root.iter() if e.tag.endswith("}script")]
    assert b"<script" not in b"".join(part.split(b"-->")[-1] for part in svg.split(b"<!--"))
    assert png(figure).size[0] > 0
    if kind == "polar":
        plot.render(plot.polar({HOSTILE: Lobe(0.2), "$": Lobe(0.1)}), "svg")


def test_no_label_is_cut_off() -> None:
    for figure in (
        plot.polar(Lobe(), scale="log", title="W" * 200),
        plot.polar({"a" * 60: Lobe(0.2), "W" * 60: Lobe(0.1)}),
        plot.polar({"W" * 60: Lobe(0.2), "b" * 60: Lobe(0.1)}, size=(4.5, 3.4)),
        plot.hemisphere(Odd(), 1.0, title="W" * 200),
        plot.hemisphere(Lobe(), 0.5, scale="log", size=(4.5, 3.4)),
    ):
        image = np.asarray(png(figure).convert("L"))
        frame = np.concatenate([image[:4].ravel(), image[-4:].ravel(), image[:, :4].ravel(), image[:, -4:].ravel()])
        assert (frame == 255).all()


@pytest.mark.parametrize("format", ["png", "svg"])
def test_bytes_repeat(format: Any) -> None:
    first, second = (plot.render(plot.polar(Lobe(0.1), 0.5), format) for _ in range(2))
    assert first == second
    first, second = (plot.render(plot.hemisphere(Lobe(0.1), 0.5, points=31), format) for _ in range(2))
    assert first == second


def test_bytes_are_the_same_from_threads() -> None:
    expected = plot.render(plot.polar(Lobe(0.1), 0.5), "svg")
    found: list[bytes] = []
    threads = [
        threading.Thread(target=lambda: found.append(plot.render(plot.polar(Lobe(0.1), 0.5), "svg"))) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 4


def test_matplotlib_settings_are_left_alone() -> None:
    import matplotlib as mpl

    mpl.rcParams["font.size"] = 33.0
    try:
        plot.render(plot.polar(Lobe(0.1), 0.5), "svg")
        assert mpl.rcParams["font.size"] == 33.0
    finally:
        mpl.rcdefaults()


def test_importing_loads_no_matplotlib() -> None:
    code = (
        "import sys, brdfcore, brdfcore.plot; brdfcore.slice; brdfcore.plot.slice; dir(brdfcore.plot);"
        "sys.exit('matplotlib' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_pictures_never_load_pyplot() -> None:
    code = (
        "import sys, brdfcore as bc; from brdfcore import plot; b = bc.model('lambert');"
        "plot.render(plot.polar(b), 'svg'); plot.render(plot.hemisphere(b), 'png');"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
