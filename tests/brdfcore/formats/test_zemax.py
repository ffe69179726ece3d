"""Zemax tabular BSDF files: the real ones, their coordinates, padding, refusals, and writing."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import brdfcore as bc
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.status import Status
from brdfcore.formats.base.format import LossWarning
from brdfcore.formats.zemax.text import ZemaxFile, compose, parse
from brdfcore.tables.base.mirror_coordinates import about_mirror, node_directions
from brdfcore.tables.specular_grid import SpecularGrid
from tests.shared import FOLDER, needs_shared
from tests.support.format_examples import measured, specular
from tests.support.plain_speos import plain_zemax

BLACK = FOLDER / "data" / "zemax" / "AnoBlackEC1onAlum.bsdf"
IMX = FOLDER / "data" / "zemax" / "IMX455.bsdf"


def content(rotations: int = 1, symmetry: str = "PlaneSymmetrical", channels: int = 1) -> ZemaxFile:
    """A file of a smooth lobe, its samples at and below the horizon 0."""
    rng = np.random.default_rng(2)
    incidences, radials = np.array([0.0, 20.0, 60.0]), np.array([0.0, 5.0, 20.0, 45.0, 80.0, 120.0])
    azimuths = np.linspace(0, 180 if symmetry == "PlaneSymmetrical" else 360, 7)
    axes = [np.radians(x) for x in (incidences, azimuths, radials)]
    theta_o = node_directions(*axes)[1]
    lobe = 0.1 + np.exp(-4 * axes[2]) * (1 + 0.2 * np.sin(axes[1]))[:, None] ** np.sign(axes[2])
    values = np.where(theta_o < np.radians(89), lobe[None] * rng.uniform(0.99, 1.01, (3, 1, 1)), 0.0)
    return ZemaxFile(
        symmetry, "Monochrome" if channels == 1 else "XYZ", 10.0 * np.arange(rotations), incidences, azimuths, radials,
        np.broadcast_to(values, (channels, rotations, *values.shape)).copy(), np.full((channels, rotations, 3), 0.2),
        ["made", ""],
    )  # fmt: skip


def put(folder: Path, made: ZemaxFile) -> Path:
    path = folder / "made.bsdf"
    path.write_bytes(compose(made))
    return path


@needs_shared
def test_the_real_file_answers_with_its_own_values() -> None:
    b = bc.read(BLACK)
    assert isinstance(b, SpecularGrid)
    raw = parse(BLACK.read_bytes(), BLACK.name)
    theta_i, theta_o, delta_phi = node_directions(*(np.radians(x) for x in (raw.incidences, raw.azimuths, raw.radials)))
    measured = raw.values[0, 0] > 0
    angles = [x[measured] for x in (theta_i, theta_o, delta_phi)]
    assert np.allclose(b.evaluate(*angles)[:, 0], raw.values[0, 0][measured], rtol=1e-9)
    assert (b.status(*angles) == Status.MEASURED).all()
    # counted in the file's text, and where the instrument stops
    assert b.report["found"]["zero"] == {"value": 193}
    assert b.report["found"]["padding above the horizon"] == 67
    assert np.degrees(theta_o[measured].max()) <= 80.0001
    beyond = (raw.values[0, 0] == 0) & (theta_o < np.pi / 2)
    assert (b.status(*(x[beyond] for x in (theta_i, theta_o, delta_phi))) == Status.FILLED).all()
    assert (b.evaluate(*(x[beyond] for x in (theta_i, theta_o, delta_phi))) > 0).all()
    assert any("padding" in s and "80.15" in s for s in b.report["done"])
    assert (b.status([0.05, 1.4], 0.2, 0.3) == Status.EXTRAPOLATED).all()


@needs_shared
def test_the_stated_tis_confirms_the_geometry() -> None:
    """The file's authors integrate f without the cosine over distance and azimuth and halve it: their four numbers."""
    raw = parse(BLACK.read_bytes(), BLACK.name)
    radial, azimuth = np.radians(raw.radials), np.radians(raw.azimuths)
    f = raw.values[0, 0]
    ring = 0.5 * (f[:, :, 1:] + f[:, :, :-1]) * 0.5 * (np.sin(radial[1:]) + np.sin(radial[:-1])) * np.diff(radial)
    found = np.trapezoid(ring.sum(axis=2), azimuth, axis=1)
    assert np.allclose(found, [0.038655, 0.039136, 0.047596, 0.106539], rtol=0.03)
    assert any("TIS" in s for s in bc.read(BLACK).report["warnings"])


@needs_shared
def test_the_anisotropic_file_is_refused_with_the_evidence() -> None:
    with pytest.raises(FileFormatError) as caught:
        bc.read(IMX)
    error = caught.value
    assert error.code == "anisotropic"
    assert error.context["got"] == pytest.approx(0.614, abs=0.01)
    raw = parse(IMX.read_bytes(), IMX.name)
    low, high = (int(np.flatnonzero(raw.rotations == r)[0]) for r in error.context["rotations"])
    gap = np.abs(raw.values[0, low] - raw.values[0, high])
    both = (raw.values[0, low] > 0) & (raw.values[0, high] > 0)
    k = np.unravel_index(np.where(both, gap, 0).argmax(), gap.shape)
    assert error.context["values"] == [raw.values[0, low][k], raw.values[0, high][k]]
    assert f"AngleOfIncidence {raw.incidences[k[0]]:g}" in error.detail


def test_coordinates_about_the_mirror_direction() -> None:
    theta = np.radians([0.0, 30.0, 70.0])
    azimuth, radial = about_mirror(theta, theta, np.full(3, np.pi))
    assert (radial <= 1e-15).all()
    # towards the normal, towards the horizon, across: by hand for theta_i = 30
    cases = {
        (20.0, 180.0): (0.0, 10.0),
        (0.0, 0.0): (0.0, 30.0),
        (10.0, 0.0): (0.0, 40.0),
        (75.0, 180.0): (180.0, 45.0),
    }
    for (theta_o, delta_phi), expected in cases.items():
        found = about_mirror(*(np.radians([x]) for x in (30.0, theta_o, delta_phi)))
        assert np.degrees([abs(found[0][0]), found[1][0]]) == pytest.approx(expected, abs=1e-9)
    azimuth, radial = about_mirror(*(np.radians([x]) for x in (30.0, 30.0, 179.0)))
    assert 0 < np.degrees(azimuth[0]) < 180, "0 < delta_phi < pi lies at azimuths between 0 and 180"


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 1.55), st.floats(0.01, 1.55), st.floats(-3.1, 3.1))
def test_coordinates_and_directions_are_inverse(theta_i: float, theta_o: float, delta_phi: float) -> None:
    azimuth, radial = about_mirror(*(np.array([x]) for x in (theta_i, theta_o, delta_phi)))
    i, o, d = (x.item() for x in node_directions(np.array([theta_i]), azimuth, radial))
    assert (i, o) == pytest.approx((theta_i, theta_o), abs=1e-9)
    assert np.cos(d - delta_phi) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("symmetry", ["PlaneSymmetrical", "Asymmetrical"])
@pytest.mark.parametrize("channels", [1, 3])
def test_round_trip(tmp_path: Path, symmetry: str, channels: int) -> None:
    made = content(symmetry=symmetry, channels=channels)
    path = put(tmp_path, made)
    b = bc.read(path)
    assert list(b.channels) == (["value"] if channels == 1 else ["X", "Y", "Z"])
    assert b.bilateral == (symmetry == "PlaneSymmetrical")
    bc.write(b, tmp_path / "again.bsdf", "zemax")
    again = parse((tmp_path / "again.bsdf").read_bytes(), "again")
    above = made.values > 0
    assert np.array_equal(again.values[:, :, 1:][above[:, :, 1:]], made.values[:, :, 1:][above[:, :, 1:]])
    assert (again.comments, again.symmetry) == (made.comments, made.symmetry)
    back = bc.read(tmp_path / "again.bsdf")
    assert back.id == b.id  # type: ignore[attr-defined]
    bc.write(back, tmp_path / "third.bsdf", "zemax")
    assert (tmp_path / "third.bsdf").read_bytes() == (tmp_path / "again.bsdf").read_bytes()


def test_zeros_and_holes_are_what_was_asked_for(tmp_path: Path) -> None:
    path = put(tmp_path, content())
    ask = (np.radians(60.0), np.radians(89.5), np.pi)
    filled, zero, data = (bc.read(path, **o) for o in ({}, {"holes": "zero"}, {"zeros": "data"}))
    assert filled.evaluate(*ask)[0] > 0.05
    assert zero.evaluate(*ask)[0] < 0.7 * filled.evaluate(*ask)[0]
    assert data.report["found"]["padding above the horizon"] == 0
    made = content()
    made.values[0, 0, 1, 2, 2] = 0.0  # within a row: a value like any other
    assert bc.read(put(tmp_path, made)).report["found"]["zero"]["value"] == int((made.values == 0).sum())


def test_sample_rotations_that_agree_are_averaged(tmp_path: Path) -> None:
    made = content(rotations=3, symmetry="Asymmetrical4D")
    made.values[:, 1] *= 1.02
    b = bc.read(put(tmp_path, made))
    assert "3 sample rotations averaged" in b.report["done"]
    made.values[:, 1, 2, 3, 1] *= 400
    with pytest.raises(FileFormatError, match="AngleOfIncidence 60, ScatterAzimuth 180, ScatterRadial 5"):
        bc.read(put(tmp_path, made))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        (b"ScatterType\tBRDF", b"ScatterType\tBTDF", "ScatterType"),
        (b"Symmetry\tPlaneSymmetrical", b"Symmetry\tRound", "Symmetry"),
        (b"AngleOfIncidence\t3", b"AngleOfIncidence\t4", "AngleOfIncidence"),
        (b"AngleOfIncidence\t3", b"AngleOfIncidence\t2147483648", "AngleOfIncidence"),
        (b"0\t20\t60", b"0\t60\t20", "AngleOfIncidence"),
        (b"0\t20\t60", b"0\t20\t95", "AngleOfIncidence"),
        (b"120\n", b"nan\n", "ScatterRadial"),
        (b"TIS\t0.2", b"TIS\tx", "TIS"),
        (b"DataEnd", b"DataStop", "DataEnd"),
        (b"Monochrome\nDataBegin", b"TristimulusX\nDataBegin", "Monochrome"),
    ],
)
def test_what_is_wrong_is_named_with_its_byte(tmp_path: Path, old: bytes, new: bytes, field: str) -> None:
    data = compose(content())
    assert old in data
    path = tmp_path / "wrong.bsdf"
    path.write_bytes(data.replace(old, new, 1))
    with pytest.raises(FileFormatError) as caught:
        bc.read(path, format="zemax")
    assert field in caught.value.context["field"]
    at = caught.value.context["offset"]
    assert abs(at - data.index(old)) <= len(old) + 40
    assert str(at) in caught.value.detail


def test_models_are_written_at_a_grid(tmp_path: Path) -> None:
    b = bc.model("ggx", roughness=0.3)
    with pytest.warns(LossWarning, match="sampled at"):
        bc.write(b, tmp_path / "m.bsdf", "zemax")
    assert bc.compare(b, bc.read(tmp_path / "m.bsdf"), directions=20_000).l1 <= 0.01
    three = bc.model("lambert", reflectance=[0.2, 0.4, 0.6])
    for refused, options in ((three, {}), (bc.model("mirror"), {})):
        with pytest.raises(InputError):
            bc.write(refused, tmp_path / "no.bsdf", "zemax", **options)
    with pytest.warns(LossWarning):
        bc.write(three, tmp_path / "g.bsdf", "zemax", channel="G")
    assert bc.read(tmp_path / "g.bsdf").evaluate(0.3, 0.4, 2.0)[0] == pytest.approx(0.4 / np.pi, rel=2e-3)


def test_the_extension_alone_is_settled_by_the_material(tmp_path: Path) -> None:
    bc.write(specular(), tmp_path / "s.bsdf")
    assert bc.sniff(tmp_path / "s.bsdf") == "zemax"


@needs_shared
def test_tables_that_do_not_integrate_to_their_tis_are_told() -> None:
    twin = FOLDER / "data" / "speos" / "planesymmetric_zemax.bsdf"
    b = bc.read(twin)
    said = next(s for s in b.report["warnings"] if "TIS lines" in s)
    less = [float(x) for x in re.search(r"integrate to ([\d.]+) to ([\d.]+) % less", said).groups()]  # type: ignore[union-attr]
    assert less == pytest.approx([3.2, 16.5], abs=0.3)
    plain = plain_zemax(twin)
    found = np.array(b.report["found"]["integral of the samples"][0])
    for k, theta_i in enumerate(plain.incidences):
        if k % 6:
            continue
        # the samples summed over half a turn on a fine grid about the mirror direction, twice
        r, a = (np.arange(160) + 0.5) * 0.5, (np.arange(90) + 0.5) * 2.0
        f = np.array([[plain.at(k, x, y) for y in r] for x in a])
        i, rr, aa = np.radians(theta_i), np.radians(r), np.radians(a)[:, None]
        cosine = np.cos(i) * np.cos(rr) + np.sin(i) * np.sin(rr) * np.cos(aa)
        total = 2 * (f * np.maximum(cosine, 0) * np.sin(rr)).sum() * np.radians(0.5) * np.radians(2.0)
        assert found[k] == pytest.approx(total, rel=3e-3)


@needs_shared
def test_a_groove_seen_at_the_normal_is_refused_and_averaged_on_request() -> None:
    case = FOLDER / "cases" / "grooved_normal.bsdf"
    with pytest.raises(FileFormatError, match="AngleOfIncidence 0, where light has no azimuth") as caught:
        bc.read(case)
    assert caught.value.code == "anisotropic"
    b = bc.read(case, isotropic="mean")
    assert any("averaged over rotation, as asked: the mean misplaces 0.896" in s for s in b.report["done"])
    raw = parse(case.read_bytes(), case.name).values[0, 0, 0]
    theta_o = np.radians([10.0, 20.0, 40.0])
    assert b.evaluate(0.0, theta_o, 0.7)[:, 0] == pytest.approx(raw[:, 1:4].mean(axis=0), rel=1e-9)


@needs_shared
def test_rotations_are_averaged_on_request() -> None:
    b = bc.read(IMX, isotropic="mean")
    raw = parse(IMX.read_bytes(), IMX.name)
    assert any("37 sample rotations averaged over rotation, as asked" in s for s in b.report["done"])
    k, a, r = 1, 3, 2
    given = raw.values[0, :, k, a, r]
    angles = node_directions(*(np.radians([x]) for x in (raw.incidences[k], raw.azimuths[a], raw.radials[r])))
    assert b.evaluate(*(x.reshape(-1) for x in angles))[0, 0] == pytest.approx(given[given > 0].mean(), rel=1e-9)


def test_tis_may_be_missing(tmp_path: Path) -> None:
    path = put(tmp_path, content())
    path.write_bytes(path.read_bytes().replace(b"TIS\t0.2", b"TIS N/A"))
    b = bc.read(path)
    assert "3 TIS lines say N/A" in b.report["warnings"]
    b.save(tmp_path / "kept.h5")  # type: ignore[attr-defined]
    bc.write(bc.open_table(tmp_path / "kept.h5"), tmp_path / "again.bsdf", "zemax")
    assert b"TIS\tN/A" in (tmp_path / "again.bsdf").read_bytes()
    assert bc.read(tmp_path / "again.bsdf").id == b.id  # type: ignore[attr-defined]


def test_one_azimuth_is_a_lobe_and_two_are_a_plane(tmp_path: Path) -> None:
    for count, said in ((1, "lobe of revolution about the mirror direction"), (2, "in the plane of incidence only")):
        made = content()
        made.azimuths = made.azimuths[[0, 6][:count]]
        made.values = made.values[:, :, :, [0, 6][:count]]
        b = bc.read(put(tmp_path, made))
        assert any(said in s for s in b.report["warnings"])
        angles = node_directions(np.radians([20.0]), np.radians([0.0, 90.0, 180.0]), np.radians([0.0, 5.0, 20.0]))
        f = b.evaluate(*(x.reshape(-1) for x in angles)).reshape(3, 3)
        assert f[0] == pytest.approx(made.values[0, 0, 1, 0, :3], rel=1e-9)
        if count == 1:
            assert f[1] == pytest.approx(f[0], rel=1e-9)
            assert f[2] == pytest.approx(f[0], rel=1e-9)


def test_a_spectral_material_is_written_one_wavelength_a_file(tmp_path: Path) -> None:
    b = measured(2)
    with pytest.raises(InputError, match="channel="):
        bc.write(b, tmp_path / "no.bsdf", "zemax")
    for wave in b.channels:
        with pytest.warns(LossWarning, match="sampled at"):
            bc.write(b, tmp_path / "one.bsdf", "zemax", channel=f"{wave:g}")
        assert list(bc.read(tmp_path / "one.bsdf").channels) == ["value"]
