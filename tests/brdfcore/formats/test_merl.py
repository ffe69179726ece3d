"""MERL files: against an independent reader, invalid cells, what a file can't hold, hostile files."""

from __future__ import annotations

import struct
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import brdfcore as bc
from brdfcore import testing
from brdfcore.formats.base.format import LossWarning
from brdfcore.formats.merl import MerlFormat
from brdfcore.tables.base.sampled import SMALLEST_NODE
from brdfcore.tables.half_angle_grid import MERL_SHAPE, HalfAngleGrid, cell_angles
from tests import shared
from tests.support.merl_plain import SCALES, cell_of, read_plainly
from tests.support.sources import Skewed

METALS = bc.model("cook_torrance", roughness=0.25, ior=["gold", "copper", "silver"])
SHAPE = (6, 5, 8)


def file_of(path: Path, numbers: np.ndarray, header: tuple[int, ...] | None = None) -> Path:
    """A file of `numbers` (3, n_h, n_d, n_p), its header as given or as they are."""
    path.write_bytes(struct.pack("<3i", *(header or numbers.shape[1:])) + numbers.astype("<f8").tobytes())
    return path


def numbers_of(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(1, 1_000, (3, *SHAPE))


def written(b: bc.Brdf, path: Path) -> list[str]:
    """The losses that writing `b` told of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        bc.write(b, path)
    assert all(w.category is LossWarning for w in caught)
    return [str(w.message) for w in caught]


# ---- full size -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_full_size_against_an_independent_reader(tmp_path: Path) -> None:
    """Model to file, 35 MB; the file's numbers are the model's in the middle of the cells; both readers agree; nearest
    look-ups are those of the usual code; the second writing is the first to the byte."""
    path = tmp_path / "metals.binary"
    assert written(METALS, path) == []
    assert path.stat().st_size == 34_992_012
    plain = read_plainly(path)
    theta_i, theta_o, delta_phi, valid = cell_angles(MERL_SHAPE, slice(None))
    assert np.array_equal(valid, (plain >= 0).all(axis=-1))
    assert (plain[~valid] == -np.array(SCALES)).all()
    some = np.flatnonzero(valid)[:: 97 * 5]
    exact = METALS.evaluate(*(a.reshape(-1)[some] for a in (theta_i, theta_o, delta_phi)))
    assert np.allclose(plain.reshape(-1, 3)[some], exact, rtol=1.2e-7, atol=SMALLEST_NODE)
    table = bc.read(path)
    assert isinstance(table, HalfAngleGrid)
    assert np.array_equal(table.values[valid], plain[valid].astype(np.float32))
    assert np.array_equal(table.filled_cells, ~valid)
    nearest = bc.read(path, interpolation="nearest")
    rng = np.random.default_rng(1)
    angles = np.stack([*rng.uniform(0, 1.4, (2, 500)), rng.uniform(-3, 3, 500)], axis=1)
    usual = np.array([plain[cell_of(*row, MERL_SHAPE)] for row in angles])
    above = (usual >= 0).all(axis=1)
    same = np.isclose(nearest.evaluate(*angles[above].T), usual[above], rtol=1e-7, atol=0).all(axis=1)
    assert same.mean() > 0.99  # on the edge of a cell rounding decides
    assert above.mean() > 0.9
    assert bc.compare(METALS, table).l1 < 0.002 < 0.01 < bc.compare(METALS, nearest).l1
    again = tmp_path / "again.binary"
    assert written(table, again) == []
    assert again.read_bytes() == path.read_bytes()


# ---- small files -----------------------------------------------------------------------------------


def test_report(tmp_path: Path) -> None:
    numbers = numbers_of()
    numbers[:, 4, 4, 0] = -1
    numbers[0, 2, 2, 2] = -0.5
    numbers[2, 1] = 0
    table = bc.read(file_of(tmp_path / "x.binary", numbers))
    assert bc.sniff(tmp_path / "x.binary") == "merl"
    report = table.report
    assert table.channels == ("R", "G", "B")
    assert report["found"]["cells"] == {"theta_h": 6, "theta_d": 5, "phi_d": 8}
    assert report["found"]["negative"] == {"R": 2, "G": 1, "B": 1}
    assert report["found"]["zero"] == {"R": 0, "G": 0, "B": 40}
    assert report["found"]["not a number"] == {"R": 0, "G": 0, "B": 0}
    assert (report["found"]["invalid cells"], report["found"]["valid cells"]) == (1, 239)
    assert report["found"]["scale factors"] == dict(zip("RGB", SCALES))
    assert any("1 invalid cells continued" in text for text in report["done"])
    assert any("1 numbers of valid cells are negative" in text for text in report["warnings"])
    assert any("90 x 90 x 180" in text for text in report["warnings"])
    assert "middle of its cell" in report["conventions"]["cells"]
    assert table.source["format"] == "merl"
    assert table.reciprocal
    assert not table.non_negative
    zeroed = bc.read(tmp_path / "x.binary", negatives="zero")
    assert zeroed.non_negative
    assert any("set to zero, as asked" in text for text in zeroed.report["done"])


def test_invalid_cells_by_policy(tmp_path: Path) -> None:
    numbers = numbers_of()
    numbers[:, 3, 1, 2] = -1
    path = file_of(tmp_path / "x.binary", numbers)
    kept, zeroed = bc.read(path), bc.read(path, invalid="zero")
    assert isinstance(kept, HalfAngleGrid)
    assert isinstance(zeroed, HalfAngleGrid)
    assert np.array_equal(kept.values[3, 1, 2], kept.values[2, 1, 2])
    assert (zeroed.values[3, 1, 2] == 0).all()
    assert kept.filled_cells.sum() == zeroed.filled_cells.sum() == 1
    theta_i, theta_o, delta_phi, _ = cell_angles(SHAPE, slice(None))
    at = tuple(a[3, 1, 2] for a in (theta_i, theta_o, delta_phi))
    assert kept.status(*at) == bc.Status.FILLED
    assert any("set to 0, as asked" in text for text in zeroed.report["done"])
    testing.check_brdf(kept)
    testing.check_pickle(kept)
    with pytest.raises(bc.InputError):
        bc.read(path, invalid="ignore")


def test_values_at_the_lower_edge_when_asked(tmp_path: Path) -> None:
    path = file_of(tmp_path / "x.binary", numbers_of())
    table = bc.read(path, cells="lower_edge", interpolation="monotone_cubic")
    assert isinstance(table, HalfAngleGrid)
    theta_i, theta_o, delta_phi, valid = cell_angles(SHAPE, slice(1, 4), "lower_edge")
    valid[:, 0] = False  # phi_d has no meaning at theta_d = 0
    found = table.evaluate(theta_i[valid], theta_o[valid], delta_phi[valid])
    assert np.allclose(found, table.values[1:4][valid], rtol=1e-5)
    assert "as asked" in table.report["conventions"]["cells"]
    losses = written(table, tmp_path / "y.binary")
    assert any("lower_edge" in text for text in losses)
    assert np.allclose(read_plainly(tmp_path / "y.binary"), read_plainly(path), rtol=1e-7, atol=0)


def test_what_a_file_cannot_hold_is_said(tmp_path: Path) -> None:
    path = tmp_path / "x.binary"
    losses = written(Skewed(), path)
    assert any("not reciprocal (L1 defect 0." in text for text in losses)
    assert any("values are negative" in text for text in losses)
    plain = read_plainly(path)
    angles = (0.1, 0.2, 1.1)
    mean = 0.5 * (Skewed().evaluate(*angles) + Skewed().evaluate(0.2, 0.1, -1.1))
    assert plain[cell_of(*angles, MERL_SHAPE)] == pytest.approx(mean, rel=0.02)
    assert (plain[cell_of(0.8, 0.9, 1.1, MERL_SHAPE)] >= 0).tolist() == [True, True, True]
    assert plain[cell_of(0.8, 0.9, 1.1, MERL_SHAPE)][2] == 0
    mirror = bc.tabulate(
        bc.model("mirror", ior="silver") + bc.model("lambert"), "half_angle_grid", shape=SHAPE, interpolation="nearest"
    )
    losses = written(mirror, path)
    assert any("perfect mirror part" in text for text in losses)
    assert any("one channel, written three times" in text for text in losses)
    assert any("6 x 5 x 8 cells" in text for text in losses)
    plain = read_plainly(path)
    above = plain[..., 0] >= 0
    assert np.allclose(plain[above], plain[above][:, :1], rtol=1e-12, atol=0)
    for channels in ([450.0, 550.0], ["X", "Y", "Z"]):
        b = bc.tabulate(bc.model("lambert", reflectance=[0.5] * len(channels)), "half_angle_grid", shape=SHAPE)
        b.channels = bc.Channels(channels)
        with pytest.raises(bc.InputError, match="a MERL file holds R, G"):
            bc.write(b, tmp_path / "no.binary")
    assert not (tmp_path / "no.binary").exists()


@shared.needs_shared
def test_an_rgl_file_goes_to_merl_and_back(tmp_path: Path) -> None:
    source = bc.read(shared.rgl_path("paper_white"))
    losses = written(source, tmp_path / "paper.binary")
    assert len([text for text in losses if "not reciprocal" in text]) == 1
    back = bc.read(tmp_path / "paper.binary")
    assert bc.compare(source, back).l1 < 0.03  # of which the mean over both orders of the directions has .02


# ---- hostile files ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "cut", "field", "offset"),
    [
        ((2**31 - 1, 5, 8), 0, "cells of theta_h", 0),
        ((6, -5, 8), 0, "cells of theta_d", 4),
        ((6, 5, 0), 0, "cells of phi_d", 8),
        ((6, 5, -(2**31)), 0, "cells of phi_d", 8),
        ((1, 5, 8), 0, "cells of theta_h", 0),
        ((4096, 4096, 4096), 0, "red plane", 5772),
        ((6, 5, 9), 0, "blue plane", 5772),
        ((6, 5, 7), 0, "end", 5052),
        ((6, 5, 8), 1, "blue plane", 5771),
        ((6, 5, 8), 2000, "green plane", 3772),
        ((6, 5, 8), 5000, "red plane", 772),
        ((6, 5, 8), -1, "end", 5772),
        ((6, 5, 8), 5761, "dimensions", 11),
    ],
)
def test_header_and_size_that_do_not_fit(
    header: tuple[int, ...], cut: int, field: str, offset: int, tmp_path: Path
) -> None:
    """Named, with the offset, before anything is allocated by what the file claims."""
    path = file_of(tmp_path / "bad.binary", numbers_of(), header)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - cut] if cut >= 0 else data + b"x")
    bc.formats()  # what is imported first does not count
    tracemalloc.start()
    with pytest.raises(bc.FileFormatError, match=r"bad\.binary") as caught:
        bc.read(path, format="merl")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1_000_000
    assert (caught.value.context["field"], caught.value.context["offset"]) == (field, offset)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_numbers_that_are_none(bad: float, tmp_path: Path) -> None:
    numbers = numbers_of()
    numbers[1, 2, 3, 4] = bad
    path = file_of(tmp_path / "bad.binary", numbers)
    with pytest.raises(bc.FileFormatError) as caught:
        bc.read(path)
    assert caught.value.context["field"] == "green plane"
    assert caught.value.context["offset"] == 12 + 8 * (240 + (2 * 5 + 3) * 8 + 4)


def test_without_a_valid_cell(tmp_path: Path) -> None:
    with pytest.raises(bc.FileFormatError, match="no cell is valid"):
        bc.read(file_of(tmp_path / "bad.binary", -numbers_of()))
    with pytest.raises(bc.StorageError):
        bc.read(tmp_path / "absent.binary", format="merl")


def test_what_is_too_large_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "huge.binary"
    with path.open("wb") as file:  # sparse: it takes no space
        file.write(struct.pack("<3i", 500, 500, 500))
        file.truncate(12 + 24 * 500**3)
    with pytest.raises(bc.LimitError):
        bc.read(path)


@pytest.mark.parametrize(
    "head",
    [
        b"",
        b"ASTM\n" + b"x" * 100,
        b"Source  Measured\nSymmetry  PlaneSymmetrical\n",
        b'{"model": "lambert"}',
        b"tensor_file\x00" + bytes(100),
        b"\x89HDF\r\n\x1a\n" + bytes(100),
        bytes(100),
        b"<?xml version='1.0'?>",
        struct.pack("<3i", 90, 90, 180) + b"text where numbers should be: " * 50,
        struct.pack("<3i", 90, 90, 180) + np.random.default_rng(0).bytes(4000),
    ],
)
def test_others_are_not_taken_for_it(head: bytes) -> None:
    assert not MerlFormat().sniff(head)


def test_an_own_head_is_known() -> None:
    numbers = np.where(np.arange(500) % 3, 1e-3, -1.0)
    for head in (numbers, np.zeros(500), np.full(500, -1.0), np.r_[np.nan, numbers]):
        assert MerlFormat().sniff((struct.pack("<3i", 90, 90, 180) + head.tobytes())[:4096])
    assert MerlFormat().sniff(struct.pack("<3i", 90, 90, 180))


def read_or_refusal(path: Path) -> bc.Brdf | bc.FileFormatError:
    try:
        return bc.read(path, format="merl")
    except bc.FileFormatError as error:
        return error


@given(data=st.binary(max_size=64), dims=st.tuples(*[st.integers(-3, 5)] * 3), extra=st.integers(-9, 9))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_read_or_refused(
    data: bytes, dims: tuple[int, int, int], extra: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.binary"
    size = max(0, 24 * int(np.prod(dims)) + extra)
    path.write_bytes(struct.pack("<3i", *dims) + (data * (size // max(len(data), 1) + 1))[:size])
    found = read_or_refusal(path)
    if isinstance(found, bc.Brdf):
        assert np.isfinite(found.evaluate(0.3, 0.4, 1.0)).all()
    else:
        assert "fuzz.binary" in found.detail
        assert found.context["offset"] >= 0


def test_a_header_in_another_order_is_read_as_the_database_s_reader_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its reader looks at the product of the three numbers only: 180 90 90 is 90 x 90 x 180 to it."""
    monkeypatch.setattr("brdfcore.formats.merl.MERL_SHAPE", (3, 4, 6))
    numbers = np.random.default_rng(2).uniform(0, 500, (3, 72)).astype("<f8").tobytes()
    for name, header in (("usual", (3, 4, 6)), ("turned", (6, 3, 4))):
        (tmp_path / f"{name}.binary").write_bytes(struct.pack("<3i", *header) + numbers)
    usual, turned = (bc.read(tmp_path / f"{n}.binary") for n in ("usual", "turned"))
    assert turned.id == usual.id  # type: ignore[attr-defined]
    assert any("6 x 3 x 4" in s and "read as 3 x 4 x 6" in s for s in turned.report["warnings"])
    declared = bc.read(tmp_path / "turned.binary", header="declared")
    assert declared.values.shape == (6, 3, 4, 3)  # type: ignore[attr-defined]
    assert any("read as 6 x 3 x 4 (header='declared')" in s for s in declared.report["warnings"])


def test_float32_numbers_are_told(tmp_path: Path) -> None:
    path = tmp_path / "f4.binary"
    path.write_bytes(struct.pack("<3i", 3, 4, 6) + np.full(216, 0.3, "<f4").tobytes())
    with pytest.raises(bc.FileFormatError, match="float32"):
        bc.read(path, format="merl")
