"""The lit sphere: its light against a direct sum over 100,000 lights, its colours against published values."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import brdfcore as bc
from brdfcore import cli, plot
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB, Channels
from brdfcore.plot import colour, lighting
from brdfcore.plot.lit import lit, render_sphere
from tests.support.tiers import first_fast

SIZE = 64


class Sided(Brdf):
    """Brighter on one side of the plane of incidence and towards the light: neither bilateral nor reciprocal."""

    bilateral = reciprocal = False

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        out[:, 0] = (1 + 0.6 * np.sin(delta_phi) + 0.3 * np.cos(delta_phi)) * (1 + np.cos(theta_i)) / (1 + theta_o)
        return True


class Rgb(Brdf):
    """The same three values everywhere."""

    channels = RGB

    def __init__(self, *values: float) -> None:
        super().__init__()
        self.values = values

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        out[...] = self.values
        return True


def spiral(count: int) -> Any:
    """Directions that share the sphere evenly."""
    z, turn = 1 - 2 * (np.arange(count) + 0.5) / count, np.pi * (1 + 5**0.5) * np.arange(count)
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)


def normal_of(row: int, column: int, size: int = SIZE) -> Any:
    x, y = (column + 0.5) / size * 2 - 1, 1 - (row + 0.5) / size * 2
    return np.array([x, y, np.sqrt(1 - x * x - y * y)])


def summed(b: Brdf, light: str, n: Any, count: int = 100_000) -> Any:
    """Radiance towards +z at a point of normal n: a plain sum over `count` lights, in a frame of its own."""
    towards = spiral(count)
    t = np.cross(n, [0.3, -0.5, 0.8])
    t /= np.linalg.norm(t)
    frame = np.stack([t, np.cross(n, t), n])
    values = b.evaluate_vectors(towards @ frame.T, frame @ np.array([0.0, 0.0, 1.0]))
    weight = np.maximum(towards @ n, 0) * lighting.surroundings(light)(towards) * 4 * np.pi / count
    return (values * weight[:, None]).sum(axis=0)


PLACES = ((10, 30), (20, 12), (32, 50), (45, 25), (31, 31), (50, 45), (18, 52))


@pytest.mark.parametrize("light", ["studio", "sky"])
@pytest.mark.parametrize(
    "b",
    first_fast(
        bc.model("cook_torrance", roughness=0.3, ior="gold"),
        bc.model("lambert", reflectance=0.7),
        bc.model("ggx", roughness=0.15, ior="copper"),
        Sided(),
    ),
    ids=["gold", "lambert", "copper", "sided"],
)
def test_radiance_is_the_integral_over_the_light(b: Brdf, light: str) -> None:
    image = render_sphere(b, SIZE, light)
    expected = np.array([summed(b, light, normal_of(*p))[0] for p in PLACES])
    found = np.array([image[p][0] for p in PLACES])
    assert np.abs(found - expected).max() < 0.02 * expected.max()


def test_white_reaches_the_white_of_the_scale() -> None:
    for light in lighting.SURROUNDINGS:
        assert render_sphere(bc.model("lambert", reflectance=1.0), 96, light).max() == pytest.approx(0.9, rel=0.01)


def test_a_narrow_lobe_keeps_its_energy() -> None:
    """At a roughness far below the cells of the surroundings the sphere is that of a mirror of the same Fresnel."""
    sharp = render_sphere(bc.model("ggx", roughness=1e-4, ior="gold"), 64, "sky")
    mirror = render_sphere(bc.model("mirror", ior="gold"), 64, "sky")
    inside = np.hypot(*(np.mgrid[:64, :64] - 31.5)) < 29
    inside &= np.abs(np.mgrid[:64, :64][0] - 31.5) > 4  # the horizon is as sharp as the cells
    assert np.abs(sharp[inside] / mirror[inside] - 1).max() < 0.02


def test_a_mirror_shows_the_light() -> None:
    b = bc.model("mirror", reflectance=0.5)
    image = render_sphere(b, 64, "studio")
    seen = 0
    for place in PLACES:
        n = normal_of(*place, size=64)
        towards = 2 * n[2] * n - np.array([0.0, 0.0, 1.0])
        there = lighting.surroundings("studio")(towards)
        around = [lighting.surroundings("studio")(towards + 0.1 * np.array(d)) for d in np.eye(3)]
        if max(around) < 1.2 * there:  # a pixel at the edge of a box is a mixture
            seen += 1
            assert image[place][0] == pytest.approx(0.5 * there, rel=0.05)
    assert seen >= 3
    lamp = render_sphere(b, 64, [[0.0, 0.6, 0.8]])
    row, column = np.unravel_index(int(lamp[..., 0].argmax()), (64, 64))
    half = np.array([0.0, 0.6, 1.8]) / np.linalg.norm([0.0, 0.6, 1.8])
    assert np.linalg.norm(normal_of(int(row), int(column), 64) - half) < 0.05
    assert (lamp[..., 0] > 0).sum() < 20


def test_lamps_follow_the_cosine() -> None:
    white = bc.model("lambert", reflectance=[1.0, 0.5, 0.25])
    lamps = np.array([[0.0, 0.6, 0.8], [3.0, 0.0, 0.0]])
    image = render_sphere(white, SIZE, lamps)
    for place in PLACES:
        n = normal_of(*place)
        expected = 0.9 * sum(max(0.0, float(n @ (d / np.linalg.norm(d)))) for d in lamps) / 2
        assert image[place] == pytest.approx(expected * np.array([1, 0.5, 0.25]), abs=0.005)
    assert render_sphere(white, SIZE, lamps[0]).max() == pytest.approx(0.9, rel=0.01)


def test_one_channel_and_the_edge() -> None:
    b = Rgb(0.1, 0.2, 0.3)
    whole = render_sphere(b, 48)
    assert whole.shape == (48, 48, 3)
    assert np.array_equal(render_sphere(b, 48, channel="G")[..., 0], whole[..., 1])
    assert not whole[0, 0].any()
    # anti-aliased: pixels of the edge hold part of the light, and the covered area is the circle's
    covered = lit(b, 48, "sky", np.eye(3)).coverage
    assert covered.sum() == pytest.approx(np.pi * 24**2, rel=2e-3)
    assert ((covered > 0) & (covered < 1)).sum() > 100


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ({"size": 8}, "bad_size"),
        ({"size": 4096}, "bad_size"),
        ({"size": 100.5}, "bad_size"),
        ({"light": "moon"}, "bad_option"),
        ({"light": [1.0, 2.0]}, "bad_option"),
        ({"light": np.ones((65, 3))}, "bad_option"),
        ({"light": [[0.0, 0.0, 0.0]]}, "not_a_direction"),
        ({"channel": "X"}, "unknown_channel"),
    ],
)
def test_refusals(arguments: dict[str, Any], code: str) -> None:
    with pytest.raises(bc.BrdfError) as caught:
        render_sphere(bc.model("lambert"), **arguments)
    assert caught.value.code == code


# ---- colours --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("nm", "xyz"),
    [(450, (0.3362, 0.0380, 1.7721)), (555, (0.5121, 1.0000, 0.0057)), (600, (1.0622, 0.6310, 0.0008))],
)
def test_observer(nm: float, xyz: tuple[float, float, float]) -> None:
    """CIE 15:2004, table T.4; the fit is good to 0.05 of the largest."""
    assert np.abs(colour.matching(np.array([float(nm)]))[0] - xyz).max() < 0.05


def test_srgb() -> None:
    """IEC 61966-2-1: 0.18 is code 118, 0.5 code 188, the linear part ends at 0.04045."""
    codes = 255 * colour.to_srgb(np.array([0.0, 0.18, 0.5, 1.0, 7.0, -1.0]))
    assert np.rint(codes).tolist() == [0, 118, 188, 255, 255, 0]
    assert colour.to_srgb(np.array([0.0031308]))[0] == pytest.approx(0.04045, abs=1e-5)


def test_wavelengths_become_a_colour() -> None:
    found = colour.screen_weights(Channels([700.0, *np.arange(400.0, 690.0, 20.0)]))
    assert found is not None
    assert found[0].sum(axis=0) == pytest.approx([1, 1, 1])  # a white stays white
    nm = np.array([700.0, *np.arange(400.0, 690.0, 20.0)])
    long = (nm > 600) @ found[0]
    assert long[0] > 0.5 > long[2]
    for none in ([550.0], [400.0, 500.0], [400.0, 450.0, 690.0], [800.0, 900.0, 1000.0]):
        assert colour.screen_weights(Channels(none)) is None
    assert colour.screen_weights(Channels(["value"])) is None
    swapped = colour.screen_weights(Channels(["B", "G", "R"]))
    assert swapped is not None
    assert (np.array([3.0, 2.0, 1.0]) @ swapped[0]).tolist() == [1.0, 2.0, 3.0]


def texts(figure: Any) -> str:
    return "\n".join(t.get_text() for axes in figure.axes for t in axes.texts)


def test_picture_says_what_it_shows() -> None:
    said = texts(plot.sphere(Rgb(0.2, 0.1, 0.05), title="clay"))
    assert "clay" in said
    assert "R, G, B as linear sRGB" in said
    assert "exposure 1" in said
    assert "clipped" not in said
    said = texts(plot.sphere(Rgb(0.2, 0.1, -0.05), [[0, 0, 1]], exposure=8))
    assert "exposure 8" in said
    assert "one lamp" in said
    assert "clipped as brighter than white" in said
    assert "below 0" in said
    assert "3 values" not in said
    assert "not finite" in texts(plot.sphere(Rgb(np.nan, 0.1, 0.1)))
    assert "mirror part" in texts(plot.sphere(bc.model("mirror", ior="gold")))
    assert "channel G in grey" in texts(plot.sphere(Rgb(0.2, 0.1, 0.05), channel="G"))
    assert "16 wavelengths" in texts(plot.sphere(bc.model("mirror", ior="gold", wavelengths=np.arange(400.0, 701, 20))))
    for bad in (0, -1, np.inf, "1"):
        with pytest.raises(bc.InputError, match="exposure"):
            plot.sphere(Rgb(1, 1, 1), exposure=bad)


def test_pixels_are_srgb_of_the_radiance() -> None:
    flat = Rgb(0.3 / np.pi, 0.15 / np.pi, 0.05 / np.pi)
    png = plot.render(plot.sphere(flat, "sky", dpi=50))
    assert png == plot.render(plot.sphere(flat, "sky", dpi=50))
    shown = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(float)
    row, column = shown.shape[0] // 2 - 12, shown.shape[1] // 2
    ratio = ((shown[row, column] / 255 + 0.055) / 1.055) ** 2.4
    assert ratio[:2] / ratio[0] == pytest.approx([1, 0.5], rel=0.03)


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.png"
    assert cli.main(["plot", "ggx:roughness=0.1,ior=gold", "--view", "sphere", "-o", str(out), "--dpi", "40"]) == 0
    assert Image.open(io.BytesIO(out.read_bytes())).size == (184, 200)
    capsys.readouterr()
    refused = (["--theta-i", "30"], ["--scale", "log"], ["--light", "moon"])
    for more in refused:
        assert cli.main(["plot", "lambert", "--view", "sphere", "-o", str(out), *more]) == 2
        assert more[0] in capsys.readouterr().err
    assert cli.main(["plot", "lambert", "--view", "sphere", "-o", str(tmp_path / "x.csv")]) == 2
    assert cli.main(["plot", "lambert", "--light", "sky", "-o", str(out)]) == 2
    assert cli.main(["plot", "lambert", "mirror", "--view", "sphere", "-o", str(out)]) == 2
