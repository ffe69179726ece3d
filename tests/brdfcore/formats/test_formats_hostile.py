"""Every registered format against damaged and malicious files, in a process whose memory is watched."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.registry import FORMATS
from brdfcore.formats.base.foreign import FOREIGN
from tests.support.format_examples import example
from tests.support.tiers import first_fast


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A valid file of each format, side by side."""
    folder = tmp_path_factory.mktemp("examples")
    return {name: example(name, folder) for name in bc.formats()}


#: Formats read in one process, and files for each of the several hundred that are made of its example;
#: `python -m tests.support.hostile NAME FOLDER 0 1` reads them all.
@pytest.mark.parametrize(
    ("names", "files"), first_fast((list(bc.formats()), 30), *(([name], 120) for name in bc.formats()))
)
def test_hostile_files(names: list[str], files: int, examples: dict[str, Path]) -> None:
    """Each is read or refused with an error that names file and place, in a second, in 200 MB beside what was there."""
    folder = str(examples[names[0]].parent)
    command = [sys.executable, "-m", "tests.support.hostile", ",".join(names), folder, str(files), "1"]
    root = Path(__file__).parents[3]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, cwd=root, env={**os.environ, "PYTHONPATH": str(root)}
    )
    assert done.returncode == 0, done.stderr[-2_000:]
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith('{"wrong"')]
    assert len(lines) == len(names)
    for name, found in zip(names, lines, strict=True):
        assert not found["wrong"], "\n".join([name, *found["wrong"][:20]])
        assert found["refused"] + found["read"] >= files, name
        assert found["refused"] >= files // 3, (name, found)
        seconds, label = found["slowest"]
        assert seconds <= 1.0, f"{name}, {label}: {seconds:.2f} s of processor time until it was refused"
        megabytes, label = found["largest"]
        assert megabytes <= 200, f"{name}, {label}: {megabytes:.0f} MB"


@pytest.mark.parametrize("name", bc.formats())
def test_examples_are_told_apart_by_content(name: str, examples: dict[str, Path], tmp_path: Path) -> None:
    other = tmp_path / "no-extension"
    other.write_bytes(examples[name].read_bytes())
    assert bc.sniff(other) == name
    head = other.read_bytes()[:16_384]
    # columns of numbers are the last resort: what else is text may look like them
    assert {n for n in FORMATS.names() if FORMATS.load(n)().sniff(head)} - {"csv"} == {name} - {"csv"}


_CELLS = np.random.default_rng(1).uniform(0, 500, 900)
HEADS = {
    "axf": (b"\x89HDF\r\n\x1a\n" + bytes(200) + b"com.xrite.Materials", "AxF"),
    "netcdf": (b"CDF\x01\0\0", "netCDF"),
    "netcdf4": (b"\x89HDF\r\n\x1a\n" + bytes(200) + b"_NCProperties", "netCDF"),
    "hdf": (b"\x89HDF\r\n\x1a\n" + bytes(200), "no table of this project"),
    "matlab": (b"MATLAB 7.3 MAT-file, Platform: GLNXA64", "MATLAB 7.3"),
    "swapped": (struct.pack(">3i", 90, 90, 180) + _CELLS.astype(">f8").tobytes(), "bytes swapped"),
    "float32": (struct.pack("<3i", 90, 90, 180) + _CELLS.astype("<f4").tobytes(), "float32"),
    "swapped32": (struct.pack(">3i", 90, 90, 180) + _CELLS.astype(">f4").tobytes(), "float32 with its bytes swapped"),
    "xml": (b"<?xml version='1.0'?><scene/>", "XML file"),
    "radiance": (b"#?RADIANCE\nFORMAT=BSDF_RBFmesh\n\n", "scattering interpolant"),
    "pbrt": (b"SCATFUN\x01\x00\x00", "Fourier"),
    "speos": (b"OPTIS - Coated surface file v5.0\n0\n", "Speos"),
    "fred": (b"# made\ntype bsdf_data\nformat angles=deg bsdf=value scale=1\n10 0\n", "FRED"),
    "lighttools": (b"#comment\nSymmetry Asymmetrical\nAOI 0 10 20\n", "LightTools"),
    "pab": (b'#sample_name "x"\n#datapoints_in_file 4\n#intheta 30\n0 0 0.1\n', "goniophotometer"),
    "ior": (b"# refractiveindex.info\nREFERENCES: |\n    x\nDATA:\n", "optical constants"),
    "xomp": (b'{"metadata": {}, "materialProperties": {"brdfUris": ["a.xompt"]}}', "brdfUris"),
    "emp": (b'{"metadata": {}, "electromagneticProperties": []}', "without a BRDF"),
    "gzip": (b"\x1f\x8b\x08\x00", "gunzip"),
    "zip": (b"PK\x03\x04", "unzip"),
    "png": (b"\x89PNG\r\n", "picture"),
    "npy": (b"\x93NUMPY\x01\x00", "numpy"),
}


@pytest.mark.parametrize("head", HEADS)
def test_kinds_of_file_that_are_not_read_are_named(head: str, tmp_path: Path) -> None:
    data, said = HEADS[head]
    path = tmp_path / "file.bsdf"
    path.write_bytes(data)
    with pytest.raises(bc.FileFormatError, match=said) as caught:
        bc.read(path)
    assert caught.value.code == "format_not_read"
    assert caught.value.context["got"] in {kind.name for kind in FOREIGN}
    assert caught.value.context["hint"] in caught.value.detail
