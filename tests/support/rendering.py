"""Mitsuba 3 in a process of its own: with some versions of LLVM its compiler ends the process that it runs in."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

_TRIAL = """
import drjit as dr, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
dr.eval(mi.warp.square_to_cosine_hemisphere(mi.Point2f(dr.linspace(mi.Float, 0, 1, 100), 0.3)))
dr.sync_thread()
"""


@cache
def unusable() -> str:
    """Why there is no llvm variant of Mitsuba here; "" if there is."""
    if find_spec("mitsuba") is None:
        return "the mitsuba extra is not installed"
    done = subprocess.run([sys.executable, "-c", _TRIAL], capture_output=True, text=True, check=False, timeout=120)
    return (
        "" if done.returncode == 0 else f"Mitsuba's llvm variants do not run with the LLVM here: {done.stderr[-120:]}"
    )


def run(code: str, *arguments: str | Path, timeout: float = 300) -> str:
    """What `code` printed, in an interpreter of its own; AssertionError with its complaint if it failed."""
    done: Any = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True, text=True, check=False, timeout=timeout, env=dict(os.environ),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return str(done.stdout)
