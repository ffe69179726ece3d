"""Speos files: the real one against a plain parser and against its Zemax twin, made ones, what is said, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.errors import FileFormatError
from tests.shared import FOLDER, needs_shared
from tests.support.format_examples import speos_text
from tests.support.plain_speos import about_mirror, plain_speos, plain_zemax

SPEOS = FOLDER / "data" / "speos" / "planesymmetric.anisotropicbsdf"
ZEMAX = FOLDER / "data" / "speos" / "planesymmetric_zemax.bsdf"
#: Ratio of the two at an incidence in degrees: the Speos tables are scaled to the stated reflectance.
RATIOS = {15.0: 1.033, 30.0: 1.082, 45.0: 1.142, 60.0: 1.198, 75.0: 1.118}


def put(folder: Path, text: str, name: str = "made.anisotropicbsdf") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@needs_shared
def test_the_real_file_at_its_own_geometries() -> None:
    b, plain = bc.read(SPEOS), plain_speos(SPEOS)
    level = plain.percent[0] / 100 / plain.reflectance(0)
    assert level == pytest.approx(1.0004, abs=1e-4)
    theta_i, theta_o, phi = (np.radians(x) for x in (plain.incidences, plain.theta, plain.phi))
    values = b.evaluate(theta_i[:, None, None], theta_o[:, None], phi + np.pi)[..., 0]
    expected = np.array(plain.tables) * level / np.pi
    assert np.abs(values - expected).max() <= 1e-13 * expected.max()
    stored = bc.read(SPEOS, scale="stored")
    assert np.allclose(
        stored.evaluate(theta_i[2], theta_o, np.pi)[:, 0], np.array(plain.tables)[2, :, 0] / np.pi, 1e-13
    )
    assert (b.status(theta_i[:, None, None], theta_o[:, None], phi + np.pi) == bc.Status.MEASURED).all()
    assert b.status(np.radians(10.0), 0.3, 1.0) == bc.Status.EXTRAPOLATED
    assert b.bilateral
    assert any("13.4506 % at all 2 wavelengths" in s for s in b.report["done"])


@needs_shared
def test_speos_and_zemax_of_one_sample() -> None:
    """One ratio an incidence, beyond it equal: to 1e-12, to 1e-7 at the specular pole; outside radial 80 nothing."""
    speos, zemax = plain_speos(SPEOS), plain_zemax(ZEMAX)
    b, twin = bc.read(SPEOS, scale="stored"), bc.read(ZEMAX, holes="zero")
    for k, theta_i in enumerate(speos.incidences):
        places = [[about_mirror(theta_i, t, p) for p in speos.phi] for t in speos.theta]
        radial = np.array([[place[1] for place in row] for row in places])
        own = b.evaluate(np.radians(theta_i), np.radians(speos.theta)[:, None], np.radians(np.array(speos.phi) + 180))[
            ..., 0
        ]
        other = np.array([[zemax.at(k, *place) for place in row] for row in places])
        inside = radial < 80 - 1e-6
        some = inside & (other > 0)
        ratio = np.median(own[some] / other[some])
        assert 1.03 <= ratio <= 1.20
        if theta_i in RATIOS:
            assert ratio == pytest.approx(RATIOS[theta_i], abs=1.5e-3)
        off = np.abs(own - ratio * other) / own.max()
        assert off[inside & (radial > 1e-3)].max() <= 1e-12
        assert off[inside].max() <= 1e-7
        assert (own[radial > 80 + 1e-6] <= 1e-13 * own.max()).all()
        # our own reader of the twin says the same where it was measured
        seen = twin.evaluate(
            np.radians(theta_i), np.radians(speos.theta)[:, None], np.radians(np.array(speos.phi) + 180)
        )[..., 0]
        assert np.abs(seen - other)[radial < 70].max() <= 1e-6 * other.max()
        stated = b.report["found"]["reflectance of the numbers as stored"][k][0]
        assert stated == pytest.approx(speos.reflectance(k), abs=1e-6)
        assert stated == pytest.approx(zemax.tis[k], rel=0.01)
        assert b.albedo(np.radians(theta_i))[0] == pytest.approx(stated, rel=0.002)  # the file's own rule is coarse


def test_made_files(tmp_path: Path) -> None:
    path = put(tmp_path, speos_text())
    b = bc.read(path)
    plain = plain_speos(path)
    level = plain.percent[0] / 100 / plain.reflectance(1)
    for k, theta_i in enumerate(plain.incidences):
        f = b.evaluate(np.radians(theta_i), np.radians(plain.theta)[:, None], np.radians(np.array(plain.phi) + 180))
        assert np.allclose(f[..., 0], np.array(plain.tables[k]) * level / np.pi, rtol=1e-12)
    assert b.evaluate(0.0, 0.5, 0.0) == pytest.approx(b.evaluate(0.0, 0.5, 2.0)), "no azimuth at the normal"
    testing.check_brdf(b)
    testing.check_table(b, tmp_path)  # type: ignore[arg-type]
    spectral = bc.read(put(tmp_path, speos_text(percent=(30.0, 60.0))))
    assert list(spectral.channels) == [400.0, 700.0]
    f = spectral.evaluate(0.4, 0.5, 3.0)
    assert f[1] == pytest.approx(2 * f[0], rel=1e-12)
    assert f[0] == pytest.approx(b.evaluate(0.4, 0.5, 3.0)[0], rel=1e-12)


def test_a_lobe_between_two_incidences_is_one_lobe(tmp_path: Path) -> None:
    b = bc.read(put(tmp_path, speos_text(theta=np.arange(0.0, 91, 2.5), phi=np.arange(0.0, 361, 5), width=6.0)))
    theta_o = np.radians(np.arange(10.0, 60, 1))
    f = b.evaluate(np.radians(35.0), theta_o, np.pi)[:, 0]
    assert np.degrees(theta_o[f.argmax()]) == pytest.approx(35, abs=1.5)
    assert (np.diff(f)[: f.argmax()] > 0).all()


def test_an_asymmetric_file_keeps_its_two_sides(tmp_path: Path) -> None:
    path = put(tmp_path, speos_text(skew=0.3, phi=np.arange(0.0, 360, 25)))
    b, plain = bc.read(path), plain_speos(path)
    assert not b.bilateral
    f = b.evaluate(np.radians(20.0), np.radians(plain.theta)[:, None], np.radians(np.array(plain.phi) + 180))[..., 0]
    ratio = f / np.array(plain.tables[0])
    assert np.abs(ratio / ratio[0, 0] - 1).max() <= 1e-12
    testing.check_table(b, tmp_path)  # type: ignore[arg-type]


def test_values_of_the_intensity_are_divided_by_the_cosine(tmp_path: Path) -> None:
    f = bc.read(put(tmp_path, speos_text()))
    g = bc.read(put(tmp_path, speos_text(intensity=True)))
    angles = np.radians([20.0, 50.0]), np.radians([20.0, 40.0]), np.radians(180.0)
    assert np.allclose(g.evaluate(*angles), f.evaluate(*angles), rtol=2e-2)  # the integral has no row at 90 degrees
    assert any("1 rows at theta_o = 90 left out" in s for s in g.report["done"])


def test_brdf_files_are_scaled_table_by_table(tmp_path: Path) -> None:
    b = bc.read(put(tmp_path, speos_text(kind="brdf", percent=(20.0, 40.0, 30.0, 60.0)), "made.brdf"))
    assert bc.sniff(tmp_path / "made.brdf") == "speos"
    assert list(b.channels) == [400.0, 700.0]
    for theta_i, stated in ((20.0, (0.2, 0.4)), (50.0, (0.3, 0.6))):
        assert b.albedo(np.radians(theta_i)) == pytest.approx(np.array(stated), rel=0.05)


def test_tables_of_different_angles_stand_on_the_angles_of_both(tmp_path: Path) -> None:
    b = bc.read(put(tmp_path, speos_text(other_angles=True)))
    assert any("different angles" in s for s in b.report["done"])
    plain = bc.read(put(tmp_path, speos_text()))
    f, g = (x.evaluate(np.radians(20.0), np.radians([30.0, 60.0]), np.radians(180.0)) for x in (b, plain))
    assert (f / g)[0] == pytest.approx((f / g)[1], rel=1e-12)


def test_rotations_that_differ_are_refused_and_averaged_on_request(tmp_path: Path) -> None:
    path = put(tmp_path, speos_text(rotations=(1.0, 2.0)))
    with pytest.raises(FileFormatError, match="isotropic='mean'") as caught:
        bc.read(path)
    assert caught.value.code == "anisotropic"
    b = bc.read(path, isotropic="mean")
    said = next(s for s in b.report["done"] if "averaged over rotation, as asked" in s)
    assert "0.333" in said, said
    alike = bc.read(put(tmp_path, speos_text(rotations=(1.0, 1.01))))
    assert any("2 rotations" in s for s in alike.report["done"])


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("\n1\t0\n1\n", "\n0\t1\n1\n", "transmission only"),
        ("v8.0\n0\n", "v8.0\n1\n", "binary form"),
        ("\n20.0\t50.0\n", "\n50.0\t20.0\n", "incidences"),
        ("\n20.0\t50.0\n", "\n20.0\t95.0\n", "incidences"),
        ("\n2\n20.0", "\n3\n20.0", "incidences"),
        ("\n2\n400", "\n20000000\n400", "wavelengths"),
        ("7\t9\n", "7\t9000000\n", "numbers of theta and phi"),
        ("7\t9\n", "30000\t9\n", "numbers of theta and phi"),
        ("\n15.0\t", "\n95.0\t", "theta"),
        ("End of file", "1 2 3", "the end"),
        ("\n0.0\t", "\nnan\t", "not finite"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, old: str, new: str, field: str) -> None:
    text = speos_text()
    assert old in text
    with pytest.raises(FileFormatError, match=field) as caught:
        bc.read(put(tmp_path, text.replace(old, new, 1)))
    assert "line" in caught.value.context
    assert "made.anisotropicbsdf" in caught.value.detail
