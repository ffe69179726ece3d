"""The real files that may lie beside the project; tests that need them are skipped, with the reason, without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "shared"
RGL = FOLDER / "data" / "rgl"
REFERENCE = FOLDER / "reference" / "rgl_mitsuba.npz"

needs_shared = pytest.mark.skipif(not REFERENCE.exists(), reason=f"the real files are not at {FOLDER}")


def rgl_names() -> list[str]:
    """Names of the ten measured materials, "paper_white" and so on."""
    return sorted(p.name.removesuffix("_rgb.bsdf") for p in RGL.glob("*.bsdf"))


def rgl_path(name: str) -> Path:
    return RGL / f"{name}_rgb.bsdf"


def rgl_reference(name: str) -> tuple[Any, Any, Any, Any]:
    """(theta_i, theta_o, delta_phi, f_r (4000, 3)); the first half near the mirror lobe."""
    with np.load(REFERENCE) as data:
        return data["theta_i"], data["theta_o"], data["delta_phi"], data[next(k for k in data if name in k)]
