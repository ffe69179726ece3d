"""Spectra to linear sRGB and XYZ, against published colorimetry and the library's own integration."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.channels import Channels
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from tests.support import goniometer

with np.printoptions():  # which the library sets for the whole process
    pytest.importorskip("colour")

BANDS = Channels([float(w) for w in range(400, 701, 10)], "wavelength")


def spectrum(values: np.ndarray) -> bc.Brdf:
    """A constant BRDF of these values at `BANDS`."""
    theta_i, theta_o, delta_phi = goniometer.geometries(lights=3, viewers=3, turns=4)
    table = np.tile(values, (theta_i.size, 1))
    m = Measurements.from_columns(theta_i, 0.0, theta_o, delta_phi, table, BANDS, file="x", format="t")
    return to_brdf(m, shape="[4,4,4]")


@pytest.fixture(scope="module")
def white() -> bc.Brdf:
    return spectrum(np.full(len(BANDS), 1 / np.pi))


@pytest.mark.parametrize(
    ("illuminant", "xyz"),  # CIE 15:2018, table T.3: white points of the 2 degree observer
    [
        ("D65", (0.95047, 1.0, 1.08883)),
        ("A", (1.0985, 1.0, 0.35585)),
        ("D50", (0.96422, 1.0, 0.82521)),
        ("E", (1, 1, 1)),
    ],
)
def test_white(white: bc.Brdf, illuminant: str, xyz: tuple[float, float, float]) -> None:
    """What reflects all light has the illuminant's own colour in XYZ, and is white in sRGB."""
    found = bc.to_rgb(white, illuminant, space="XYZ").evaluate(0.3, 0.4, 1.0) * np.pi
    assert found == pytest.approx(np.array(xyz), abs=1.5e-3)
    assert bc.to_rgb(white, illuminant).evaluate(0.3, 0.4, 1.0) * np.pi == pytest.approx(np.ones(3), abs=1e-3)


def test_a_colour_as_the_library_integrates_it() -> None:
    import colour

    waves = np.array(BANDS)
    values = 0.05 + 0.6 / (1 + np.exp((590 - waves) / 12))  # a red paint
    b = spectrum(values / np.pi)
    measured = b.evaluate(0.3, 0.4, 1.0) * np.pi
    sd = colour.SpectralDistribution(dict(zip(waves.tolist(), measured.tolist(), strict=True)))
    sd = sd.interpolate(colour.SpectralShape(400, 700, 1), interpolator=colour.LinearInterpolator)
    sd = sd.extrapolate(colour.SpectralShape(360, 830, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it says that it interpolates the illuminant
        xyz = colour.sd_to_XYZ(sd, illuminant=colour.SDS_ILLUMINANTS["D65"], method="Integration") / 100
    assert bc.to_rgb(b, space="XYZ").evaluate(0.3, 0.4, 1.0) * np.pi == pytest.approx(xyz, rel=2e-3)
    rgb = colour.XYZ_to_sRGB(xyz, apply_cctf_encoding=False)
    assert bc.to_rgb(b).evaluate(0.3, 0.4, 1.0) * np.pi == pytest.approx(rgb, rel=5e-3, abs=2e-3)
    assert bc.to_rgb(b).channels == ("R", "G", "B")


def test_between_the_wavelengths_as_colour_science_recommends() -> None:
    """CIE 167:2005: the library's own interpolation to 1 nm; straight lines are .3 Delta E*ab away."""
    import colour

    waves = np.array(BANDS)
    b = spectrum((0.05 + 0.6 / (1 + np.exp((590 - waves) / 12))) / np.pi)
    sd = colour.SpectralDistribution(
        dict(zip(waves.tolist(), (b.evaluate(0.3, 0.4, 1.0) * np.pi).tolist(), strict=True))
    )
    sd = sd.interpolate(colour.SpectralShape(400, 700, 1)).extrapolate(colour.SpectralShape(360, 830, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        xyz = colour.sd_to_XYZ(sd, illuminant=colour.SDS_ILLUMINANTS["D65"], method="Integration") / 100
    found = {how: bc.to_rgb(b, space="XYZ", interpolation=how) for how in ("linear", "cie167")}
    labs = {how: colour.XYZ_to_Lab(c.evaluate(0.3, 0.4, 1.0) * np.pi) for how, c in found.items()}
    assert colour.delta_E(labs["cie167"], colour.XYZ_to_Lab(xyz), method="CIE 1976") < 1e-6
    assert 0.1 < colour.delta_E(labs["linear"], colour.XYZ_to_Lab(xyz), method="CIE 1976") < 0.51
    assert "Sprague" in found["cie167"].report["done"][-1]
    testing.check_brdf(found["cie167"])


def test_unequal_steps_have_a_cubic_spline() -> None:
    """A parabola in the wavelength, which the spline holds and straight lines do not."""
    waves = [400.0, 410.0, 425.0, 450.0, 480.0, 520.0, 555.0, 590.0, 620.0, 660.0, 700.0]
    dense = [float(w) for w in range(400, 701)]

    def parabola(channels: list[float]) -> bc.Brdf:
        values = 0.2 + 0.5 * ((np.array(channels) - 400) / 300) ** 2
        grey = bc.model("lambert", reflectance=1.0) + 0 * bc.model("mirror", ior="silver", wavelengths=channels)
        return grey * values

    want = bc.to_rgb(parabola(dense)).evaluate(0.3, 0.4, 1.0)
    spline = bc.to_rgb(parabola(waves), interpolation="cie167")
    assert "cubic spline" in spline.metadata["colour"]
    assert spline.evaluate(0.3, 0.4, 1.0) == pytest.approx(want, rel=1e-9)
    assert bc.to_rgb(parabola(waves)).evaluate(0.3, 0.4, 1.0) != pytest.approx(want, rel=1e-4)


def test_it_is_a_brdf(white: bc.Brdf) -> None:
    b = bc.to_rgb(white)
    testing.check_brdf(b)
    testing.check_pickle(b)
    assert "illuminant D65" in b.report["done"][-1]
    assert "constant beyond them" in b.metadata["colour"]
    assert (b.status(0.3, 0.4, 1.0) == white.status(0.3, 0.4, 1.0)).all()


def test_what_is_refused(white: bc.Brdf) -> None:
    with pytest.raises(bc.InputError, match="not wavelengths"):
        bc.to_rgb(bc.model("lambert"))
    with pytest.raises(bc.UnknownNameError, match="D65"):
        bc.to_rgb(white, "sun")
    with pytest.raises(bc.InputError, match="'linear' or 'cie167'"):
        bc.to_rgb(white, interpolation="sprague")
    with pytest.raises(bc.InputError, match="'sRGB' or 'XYZ'"):
        bc.to_rgb(white, space="Lab")
    lasers = bc.model("cook_torrance", ior="gold", wavelengths=[450.0, 532.0, 633.0])
    with pytest.raises(bc.InputError, match="101 nm of 400 to 700 nm open"):
        bc.to_rgb(lasers)
    assert bc.to_rgb(lasers, largest_gap=120).channels == ("R", "G", "B")
