"""Kernels under threads, forks, spawns and unwritable folders, on every threading layer that is installed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pytest

from tests.support.tiers import first_fast

ROOT = Path(__file__).parents[3]


def start(name: str, *arguments: str, root: Path = ROOT, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tests.support.children", name, *arguments],
        cwd=root,
        env={**os.environ, "BRDF_THREADS": "", **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(child: subprocess.Popen[str], timeout: float = 240) -> dict[str, Any]:
    out, err = child.communicate(timeout=timeout)
    assert child.returncode == 0, f"ended with {child.returncode}: {err[-2000:]}"
    answer: dict[str, Any] = json.loads(out.splitlines()[-1])
    return answer


def installed_layers() -> list[str]:
    """Threading layers that numba can load here; `workqueue` is part of numba, the others need a library."""
    from brdfcore.kernels.machine import jit  # noqa: F401  (loads libtbb from its package)

    layers = ["workqueue"]
    for layer, module in (("omp", "omppool"), ("tbb", "tbbpool")):
        try:
            __import__(f"numba.np.ufunc.{module}")
        except ImportError:
            continue
        layers.append(layer)
    return layers


def test_the_tbb_package_is_found() -> None:
    try:
        version("tbb")
    except PackageNotFoundError:
        pytest.skip("the tbb package is not installed on this platform")
    assert "tbb" in installed_layers()


def test_without_the_tbb_package_another_layer_serves() -> None:
    others = [layer for layer in installed_layers() if layer != "tbb"]
    answer = finish(start("threads_without_tbb", "1", NUMBA_THREADING_LAYER="default"))
    assert answer["layer"] == others[-1]  # OpenMP where it is
    assert answer["wrong"] == 0


@pytest.mark.parametrize(("layer", "seconds"), first_fast(("tbb", 1), ("tbb", 12), ("omp", 12), ("workqueue", 12)))
def test_eight_threads(layer: str, seconds: int) -> None:
    if layer not in installed_layers():
        pytest.skip(f"the library of the {layer} layer is not installed")
    answer = finish(start("threads", str(seconds), NUMBA_THREADING_LAYER=layer), timeout=seconds + 120)
    assert answer["layer"] == layer
    assert answer["wrong"] == 0
    assert min(answer["calls"]) > 0, f"a thread never got through on {layer}: {answer}"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
@pytest.mark.parametrize("layer", first_fast("omp", "tbb", "workqueue"))
def test_forked_child_answers(layer: str) -> None:
    if layer not in installed_layers():
        pytest.skip(f"the library of the {layer} layer is not installed")
    assert finish(start("fork", NUMBA_THREADING_LAYER=layer)) == {"layer": layer, "same": True, "threads_in_child": 1}


def test_spawned_child_answers() -> None:
    assert finish(start("spawn")) == {"same": True, "exitcode": 0}


@pytest.mark.parametrize("temporary", first_fast("unwritable", "writable"))
def test_unwritable_home_and_package(tmp_path: Path, temporary: str) -> None:
    """Blocked by files where folders would have to be: that stops root as well, permissions would not."""
    root = tmp_path / "installed"
    for package in ("brdfcore", "tests"):
        shutil.copytree(ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__"))
    for room in (root / "brdfcore" / "kernels").iterdir():
        if room.is_dir():
            (room / "__pycache__").write_text("in the way")
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    blocked = {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null", "PYTHONDONTWRITEBYTECODE": "1"}
    blocked["NUMBA_CACHE_DIR"] = ""  # none, whatever the tests themselves run with
    if temporary == "unwritable":
        (scratch / f"brdfcore-kernels-{os.getuid()}").write_text("in the way")
    answer = finish(start("evaluate_once", root=root, **blocked, TMPDIR=str(scratch)))
    if temporary == "writable":
        assert Path(answer["cache"]).is_relative_to(scratch), answer
        assert list(Path(answer["cache"]).glob("*.nbc")), "nothing was cached"
    else:
        assert answer["cache"] is None, answer
    assert answer["sum"] == finish(start("evaluate_once"))["sum"]
