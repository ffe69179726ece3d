"""What a SOURCE may be beside a file and a model: a sum; and what is refused before it hangs."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.cli import arguments
from brdfcore.cli.make import may_write


def test_a_sum_of_models(tmp_path: Path) -> None:
    b = arguments.load("lambert:reflectance=0.3+ggx:roughness=0.2,ior=1.5+phong:specular=1e-1")
    lobes = bc.model("ggx", roughness=0.2, ior=1.5), bc.model("phong", specular=0.1)
    parts = [bc.model("lambert", reflectance=0.3), *lobes]
    angles = np.random.default_rng(1).random((3, 50))
    wanted = parts[0] + parts[1] + parts[2]
    assert np.array_equal(b.evaluate(*angles), wanted.evaluate(*angles))
    assert not b.energy_conserving
    bc.write(b, tmp_path / "sum.json")
    again = bc.read(tmp_path / "sum.json")
    assert np.array_equal(again.evaluate(*angles), wanted.evaluate(*angles))
    assert arguments.load("lambert:reflectance=1e+0").evaluate(0.1, 0.2, 0.3)[0] == 1 / np.pi
    for bad in ("lambert+nothing", "lambert+", "lambert:reflectance=0.3+ggx:roughnes=1"):
        with pytest.raises(bc.BrdfError):
            arguments.load(bad)


def test_special_files_are_refused(tmp_path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no FIFOs")
    fifo, circle = tmp_path / "pipe.csv", tmp_path / "circle.csv"
    os.mkfifo(fifo)
    circle.symlink_to(circle)
    with pytest.raises(bc.StorageError, match="no regular file"):
        arguments.load(str(fifo))
    with pytest.raises(bc.StorageError, match="circle"):
        arguments.load(str(circle))
    for force in (False, True):
        with pytest.raises(bc.StorageError, match="no regular file"):
            may_write(fifo, force)
    assert fifo.is_fifo()


def test_reading_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.json").write_text('{"model": "lambert"}')
    monkeypatch.setattr("brdfcore.formats.io.files.read", lambda *_: time.sleep(20))
    monkeypatch.setenv(arguments.READ_SECONDS, "0.2")
    with pytest.raises(bc.LimitError, match="not read within"):
        arguments.load(str(tmp_path / "a.json"))
    monkeypatch.setenv(arguments.READ_SECONDS, "soon")
    with pytest.raises(bc.InputError, match="expected seconds"):
        arguments.load(str(tmp_path / "a.json"))
