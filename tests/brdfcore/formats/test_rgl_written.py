"""RGL files written from tables that no longer have their file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.formats.rgl.tensor_file import decode, encode
from brdfcore.tables.vndf_warp import VndfWarp
from tests.brdfcore.formats.test_rgl import angles, needs_files, put
from tests.support.rgl_synthetic import fields_of, published_value


@pytest.mark.parametrize("wavelengths", [0, 5])
@pytest.mark.parametrize("jacobian", [1, 0])
@pytest.mark.parametrize("way", ["arrays", "table file", "tabulate"])
def test_a_table_without_its_file_is_written(tmp_path: Path, way: str, jacobian: int, wavelengths: int) -> None:
    fields = fields_of(wavelengths=wavelengths, normals=(7, 9), samples=3)
    fields["jacobian"][0] = jacobian
    b = bc.read(put(tmp_path, fields))
    assert isinstance(b, VndfWarp)
    if way == "arrays":
        other: Any = VndfWarp.from_arrays(b.to_arrays(), b.attributes(), b.channels, b.flags)
    elif way == "table file":
        b.save(tmp_path / "b.h5")
        other = bc.open_table(tmp_path / "b.h5")
    else:
        other = bc.tabulate(b, "vndf_warp")
    assert other._auxiliary is None
    bc.write(other, tmp_path / "written.bsdf", "rgl")
    again = bc.read(tmp_path / "written.bsdf")
    assert again.channels == b.channels
    # the density of visible normals is normalised once more, in float32
    assert np.allclose(again.evaluate(*angles()), b.evaluate(*angles()), rtol=2e-5, atol=0)
    assert np.median(np.abs(again.evaluate(*angles()) / b.evaluate(*angles()) - 1)) < 5e-7
    expected = published_value(
        {n: f.array for n, f in decode((tmp_path / "written.bsdf").read_bytes(), "x").fields.items()}, *angles()
    )
    assert np.allclose(again.evaluate(*angles()), expected, rtol=2e-6, atol=0)
    bc.write(again, tmp_path / "again.bsdf")
    assert (tmp_path / "again.bsdf").read_bytes() == (tmp_path / "written.bsdf").read_bytes()


@pytest.mark.parametrize("path", needs_files[:2])
def test_a_table_of_a_real_file_has_the_files_luminance(path: Path, tmp_path: Path) -> None:
    b = bc.read(path)
    assert isinstance(b, VndfWarp)
    bare = VndfWarp.from_arrays(b.to_arrays(), b.attributes(), b.channels, b.flags)
    bc.write(bare, tmp_path / "bare.bsdf")
    made, own = (decode(p.read_bytes(), p.name).fields for p in (tmp_path / "bare.bsdf", path))
    assert set(made) >= set(own)
    for name in ("rgb", "theta_i", "sigma", "ndf", "phi_i", "jacobian", "version"):
        assert np.array_equal(made[name].array, own[name].array), name
    for name in ("luminance", "vndf"):
        size = np.abs(own[name].array).max()
        mine, theirs = made[name].array, own[name].array
        if name == "vndf":  # each slice is normalised: here by its integral, in the file by its sum
            mine = mine * (theirs.sum(axis=(2, 3), keepdims=True) / mine.sum(axis=(2, 3), keepdims=True))
        assert np.abs(mine - theirs).max() <= 2e-6 * size, name


def test_valid_bits_are_counted_and_ignored(tmp_path: Path) -> None:
    fields = fields_of()
    whole = tmp_path / "whole.bsdf"
    whole.write_bytes(encode(fields))
    fields["valid"] = fields["valid"].copy()
    fields["valid"][0] = 0b01111110
    marked = tmp_path / "marked.bsdf"
    marked.write_bytes(encode(fields))
    a, b = bc.read(whole), bc.read(marked)
    bits = a.report["found"]["valid bits"]
    assert bits["set"] == bits["of"]
    assert b.report["found"]["valid bits"] == {"set": bits["of"] - 2, "of": bits["of"]}
    assert "ignored on purpose" in b.report["conventions"]["valid"]
    assert np.array_equal(a.evaluate(0.3, 0.4, 2.0), b.evaluate(0.3, 0.4, 2.0))
