"""MBSDF files: the real ones against a plain look-up, bytes after a round trip, what is said, refusals, writing."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.formats.base.format import LossWarning
from tests.shared import FOLDER, needs_shared
from tests.support.plain_mbsdf import Plain, plain

DATA = FOLDER / "data" / "mbsdf"
CARPAINT = DATA / "carpaint_blue.mbsdf"
REFLECTION, TRANSMISSION = b"MBSDF_DATA_REFLECTION=\n", b"MBSDF_DATA_TRANSMISSION=\n"


def block(key: bytes, theta: int, phi: int, channels: int = 1, values: np.ndarray | None = None) -> bytes:
    if values is None:
        values = np.random.default_rng(theta).uniform(0.01, 0.4, theta * theta * phi * channels)
    return key + struct.pack("<3I", int(channels == 3), theta, phi) + values.astype("<f4").tobytes()


def put(folder: Path, *blocks: bytes, header: bytes = b"") -> Path:
    path = folder / "made.mbsdf"
    path.write_bytes(b"NVIDIA ARC MBSDF V1\n" + header + b"".join(blocks))
    return path


def check_own_cells(b: bc.Brdf, found: Plain) -> None:
    """Every cell's numbers, to the bit, at the cell's own angles."""
    theta = np.radians((np.arange(found.theta) + 0.5) * (90 / found.theta))
    phi = np.radians((np.arange(found.phi) + 0.5) * (180 / found.phi))
    values = b.evaluate(theta[:, None, None], theta[None, :, None], phi)
    expected = np.array(found.numbers).reshape(found.theta, found.theta, found.phi, found.channels)
    assert np.array_equal(values, expected)
    assert (b.status(theta[:, None, None], theta[None, :, None], phi) == bc.Status.MEASURED).all()


def check_look_up(b: bc.Brdf, found: Plain, count: int = 400) -> None:
    angles = testing.sample_angles(count)
    expected = np.array([found.looked_up(*(float(x) for x in row)) for row in np.stack(angles, axis=1)])
    # azimuths of many turns are reduced by another arithmetic
    assert np.abs(b.evaluate(*angles) - expected).max() <= 1e-9 * np.abs(found.numbers).max()


@needs_shared
def test_the_real_paint() -> None:
    b, found = bc.read(CARPAINT), plain(CARPAINT.read_bytes())
    assert (found.theta, found.phi, found.channels, list(b.channels)) == (45, 90, 3, ["R", "G", "B"])
    check_own_cells(b, found)
    check_look_up(b, found)
    said = b.report["warnings"]
    assert any("75159 of 546750 values are negative" in s and "renderers clip" in s for s in said)
    assert any("0.575" in s and "renderers average both orders" in s for s in said)
    assert sum(b.report["counts"]["negative"].values()) == sum(x < 0 for x in found.numbers) == 75_159
    assert not b.reciprocal
    assert not b.non_negative
    assert b.bilateral


@needs_shared
@pytest.mark.parametrize("name", ["carpaint_blue", "test_rgb_theta_2_phi_3", "test_scalar_theta_2_phi_3"])
def test_bytes_after_read_and_write(name: str, tmp_path: Path) -> None:
    source = DATA / f"{name}.mbsdf"
    b = bc.read(source)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing is lost
        bc.write(b, tmp_path / "again.mbsdf")
        b.save(tmp_path / "kept.h5")  # type: ignore[attr-defined]
        bc.write(bc.open_table(tmp_path / "kept.h5"), tmp_path / "third.mbsdf")
    assert (tmp_path / "again.mbsdf").read_bytes() == source.read_bytes()
    assert (tmp_path / "third.mbsdf").read_bytes() == source.read_bytes()


@needs_shared
def test_the_sdk_s_own_small_files(tmp_path: Path) -> None:
    both = DATA / "test_reflection_scalar_theta_2_phi_3_transmission_scalar_theta_2_phi_4.mbsdf"
    b = bc.read(both)
    check_own_cells(b, plain(both.read_bytes()))
    assert any("MBSDF_DATA_TRANSMISSION (2 x 2 x 4 cells) is left out" in s for s in b.report["warnings"])
    with pytest.warns(LossWarning, match="transmission"):
        bc.write(b, tmp_path / "r.mbsdf")
    assert both.read_bytes().startswith((tmp_path / "r.mbsdf").read_bytes())
    with pytest.raises(FileFormatError, match="transmission only") as caught:
        bc.read(DATA / "test_transmission_scalar_theta_2_phi_4.mbsdf")
    assert caught.value.code == "transmission_only"


@pytest.mark.parametrize("channels", [1, 3])
def test_made_files(tmp_path: Path, channels: int) -> None:
    header = b'name="made"\ndescription="a \\"test\\""\n'
    path = put(tmp_path, block(REFLECTION, 4, 6, channels), header=header)
    b, found = bc.read(path), plain(path.read_bytes())
    check_own_cells(b, found)
    check_look_up(b, found, 100)
    testing.check_brdf(b)
    testing.check_table(b, tmp_path)  # type: ignore[arg-type]
    bc.write(b, tmp_path / "again.mbsdf")
    assert (tmp_path / "again.mbsdf").read_bytes() == path.read_bytes()
    old = put(tmp_path, block(b"MBSDF_DATA=\n", 4, 6, channels))
    assert np.array_equal(bc.read(old).evaluate(0.3, 0.4, 0.5), b.evaluate(0.3, 0.4, 0.5))


def test_one_cell_is_a_constant(tmp_path: Path) -> None:
    b = bc.read(put(tmp_path, block(REFLECTION, 1, 1, 1, np.array([0.25]))))
    assert (b.evaluate(*testing.sample_angles(50)) == 0.25).all()


@pytest.mark.parametrize(
    ("data", "field"),
    [
        (b"", "block"),
        (block(TRANSMISSION, 2, 2), "transmission"),
        (REFLECTION + struct.pack("<3I", 0, 2**31, 2**31), "cells of theta"),
        (REFLECTION + struct.pack("<3I", 0, 4_096, 4_096), "ends too early"),
        (REFLECTION + struct.pack("<3I", 2, 2, 2) + bytes(32), "type"),
        (REFLECTION + struct.pack("<3I", 0, 0, 2), "cells of theta"),
        (REFLECTION + b"\0\0", "counts"),
        (block(REFLECTION, 2, 2, values=np.array([0.1] * 7 + [np.nan])), "value 7 is not finite"),
        (block(REFLECTION, 2, 2) + b"rest", "more follows"),
        (block(REFLECTION, 2, 2) * 2, "second block"),
        (b"x=1\n" * 40_000, "no block"),
    ],
)
def test_what_is_wrong_is_named_with_its_byte(tmp_path: Path, data: bytes, field: str) -> None:
    with pytest.raises(FileFormatError, match=field) as caught:
        bc.read(put(tmp_path, data))
    assert "made.mbsdf" in caught.value.detail
    assert "offset" in caught.value.context


def test_models_are_written_at_cells(tmp_path: Path) -> None:
    b = bc.model("ggx", roughness=0.4)
    with pytest.warns(LossWarning, match="90 x 90 x 180 cells"):
        bc.write(b, tmp_path / "m.mbsdf")
    assert bc.compare(b, bc.read(tmp_path / "m.mbsdf"), directions=20_000).l1 <= 0.01
    with pytest.warns(LossWarning, match="8 x 8 x 16"):
        bc.write(b, tmp_path / "s.mbsdf", shape="8,16")
    found = plain((tmp_path / "s.mbsdf").read_bytes())
    centre = np.radians((np.arange(8) + 0.5) * 90 / 8)
    f = b.evaluate(centre[2], centre[5], np.radians(11.25 * 9.5))[0]
    assert found.at(2, 5, 9) == (np.float32(f),)
    for refused in (bc.model("mirror"), bc.model("lambert", reflectance=[0.1, 0.2])):
        with pytest.raises(InputError):
            bc.write(refused, tmp_path / "no.mbsdf")
    for wrong in ("90", "1,1", "4096,4096", "a,b"):
        with pytest.raises(InputError, match="shape"):
            bc.write(b, tmp_path / "no.mbsdf", shape=wrong)


def test_negative_values_become_what_was_asked(tmp_path: Path) -> None:
    path = put(tmp_path, block(REFLECTION, 2, 2, values=np.array([0.1, -0.2] * 4)))
    assert bc.read(path).evaluate(*np.radians([22.5, 22.5, 135.0]))[0] == np.float32(-0.2)
    b = bc.read(path, negatives="zero")
    assert b.non_negative
    assert "4 negative values set to zero, as asked" in b.report["done"]
    with pytest.warns(LossWarning, match="4 negative values written as 0"):
        bc.write(bc.read(path), tmp_path / "z.mbsdf", negatives="zero")
    assert min(plain((tmp_path / "z.mbsdf").read_bytes()).numbers) == 0
