"""Every way to write a file, with a fault at each call of the system in turn: a clear error, and the old file whole."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base import atomic
from brdfcore.base.channels import MAX_CHANNELS
from tests.support.faults import ERRORS, faults
from tests.support.rgl_synthetic import fields_of

OLD = b"what stood there before"


def _table() -> bc.Table:
    return bc.tabulate(bc.model("lambert", reflectance=[0.2, 0.4, 0.6]), "angle_grid", shape=(4, 4, 5))


def _scattered(folder: Path) -> bc.Brdf:
    rows = [f"{i},{o},{d},{0.1 + 0.001 * i}" for i in (0, 30, 60) for o in (0, 20, 40, 60) for d in (0, 90, 180)]
    path = folder / "source.csv"
    path.write_text("theta_i_deg,theta_o_deg,delta_phi_deg,f_r_value\n" + "\n".join(rows) + "\n")
    return bc.read(path)


def _rgl(folder: Path) -> bc.Brdf:
    from brdfcore.formats.rgl.tensor_file import encode

    path = folder / "source.bsdf"
    path.write_bytes(encode(fields_of()))
    return bc.read(path)


#: Way to write -> (name of the file, what makes a call that writes it). All bytes go through `write_file`.
WAYS: dict[str, tuple[str, Callable[[Path], Callable[[Path], Any]]]] = {
    "save": ("a.h5", lambda _: _table().save),
    "model": ("a.json", lambda _: lambda path: bc.write(bc.model("ggx", roughness=0.3), path)),
    "csv": ("a.csv", lambda folder: (lambda b: lambda path: bc.write(b, path))(_scattered(folder))),
    "astm": ("a.astm", lambda folder: (lambda b: lambda path: bc.write(b, path))(_scattered(folder))),
    "rgl": ("a.bsdf", lambda folder: (lambda b: lambda path: bc.write(b, path, "rgl"))(_rgl(folder))),
    "openmaterial": ("a.xompt", lambda folder: (lambda b: lambda path: bc.write(b, path))(_scattered(folder))),
    "convert": ("a.csv", lambda folder: (lambda b: lambda path: bc.convert(b, path))(_scattered(folder))),
    "report": ("a.md", lambda _: bc.report({"white": bc.model("lambert")}, seconds=1).write),
}


def _quietly(call: Callable[[Path], Any], path: Path) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return call(path)


@pytest.mark.parametrize("way", ["save", "model"])
def test_a_fault_at_each_call(way: str, tmp_path: Path) -> None:
    _every_fault(way, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["csv", "astm", "rgl", "openmaterial", "convert", "report"])
def test_a_fault_at_each_call_of_slow_ways(way: str, tmp_path: Path) -> None:
    _every_fault(way, tmp_path)


def _every_fault(way: str, tmp_path: Path) -> None:
    name, make = WAYS[way]
    call, folder = make(tmp_path), tmp_path / "out"
    folder.mkdir()
    path = folder / name
    with faults(folder) as counted:
        _quietly(call, path)
    new = path.read_bytes()
    assert {"mkdir", "write", "fsync", "replace"} <= set(counted.calls)
    for at in range(len(counted.calls)):
        for error in ERRORS:
            path.write_bytes(OLD)
            with faults(folder, at, error), pytest.raises(bc.StorageError) as caught:
                _quietly(call, path)
            assert str(path) in caught.value.detail
            assert os.strerror(error) in caught.value.detail
            renamed = "replace" in counted.calls[:at]  # only the flush of the folder comes after it
            assert path.read_bytes() == (new if renamed else OLD), counted.calls[at]
            assert (caught.value.code == "not_flushed") == renamed
            assert os.listdir(folder) == [name]


def test_what_cannot_be_read_again_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "good.h5"
    table = _table()
    table.save(path)
    old = path.read_bytes()
    table.metadata["text"] = "x" * 17_000_000
    with pytest.raises(bc.LimitError, match="not written"):
        table.save(path)
    assert path.read_bytes() == old
    assert os.listdir(tmp_path) == ["good.h5"]


def test_writer_and_reader_share_the_limit_of_channels(tmp_path: Path) -> None:
    with pytest.raises(bc.LimitError, match=str(MAX_CHANNELS)):
        bc.model("lambert", reflectance=[0.5] * (MAX_CHANNELS + 1))
    rng = np.random.default_rng(3)
    most = {k: rng.random(MAX_CHANNELS).tolist() for k in ("diffuse", "specular", "roughness")}
    b = bc.model("cook_torrance", **{k: [x / 3 for x in v] for k, v in most.items()})
    bc.write(b, tmp_path / "wide.json")
    assert len(bc.read(tmp_path / "wide.json").channels) == MAX_CHANNELS


def test_a_special_file_is_not_replaced(tmp_path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no FIFOs")
    fifo = tmp_path / "pipe.h5"
    os.mkfifo(fifo)
    with pytest.raises(bc.StorageError, match="no regular file"):
        _table().save(fifo)
    assert fifo.is_fifo()


def test_leftovers_of_processes_that_are_gone_are_removed(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    host = atomic.host()
    dead, living = (tmp_path / f".a.json.{host}.{pid}.00.tmp" for pid in (gone.pid, os.getpid()))
    for folder in (dead, living):
        folder.mkdir()
        (folder / "a.json").touch()
    atomic.write_file(tmp_path / "a.json", b"{}")
    assert not dead.exists()
    assert living.exists()
