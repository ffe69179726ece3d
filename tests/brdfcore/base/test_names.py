"""The types of names and what the names stand for agree."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import brdfcore as bc
from brdfcore import names
from brdfcore.harmonics.targets import TARGETS
from brdfcore.harmonics.windows import WINDOWS
from brdfcore.plot.lighting import SURROUNDINGS
from brdfcore.plot.rendering import MEDIA_TYPES
from brdfcore.plot.slices import POINTS_MAX
from brdfcore.tables.base.sampled import INTERPOLATIONS


@pytest.mark.parametrize(
    ("kind", "meant"),
    [
        (names.Target, TARGETS),
        (names.Window, WINDOWS),
        (names.Lighting, SURROUNDINGS),
        (names.View, POINTS_MAX),
        (names.Interpolation, INTERPOLATIONS),
        (names.PictureFormat, MEDIA_TYPES),
    ],
)
def test_each_name_means_something(kind: Any, meant: Any) -> None:
    assert names.choices(kind) == tuple(meant)


def test_public_and_light() -> None:
    assert bc.names.choices(bc.names.Window)[0] == "none"
    program = (
        "import sys, brdfcore as bc; bc.names.Window; print(*(m for m in sys.modules if m.startswith('brdfcore')))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) <= {"brdfcore", "brdfcore.version", "brdfcore.names"}
