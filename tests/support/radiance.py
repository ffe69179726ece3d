"""What Radiance itself says of a BSDF file, through pyradiance, in a process of its own for each: the library keeps
what it loaded by name, and a process that loads many of them may end without a word."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

_ASK = """
import json, sys
import pyradiance.bsdf as bsdf
given = json.loads(sys.argv[1])
seen = bsdf.load_file(given["file"])
# all reflection: diffuse, specular and what lies between
hemi = [bsdf.direct_hemi(seen, float(theta), 10.0, 1 | 4 | 8) for theta in given["theta"]]
pairs = [float(bsdf.query(seen, *map(float, pair))[1]) for pair in given["pairs"]]
print(json.dumps({"hemi": hemi, "pairs": pairs}))
sys.stdout.flush()
import os
os._exit(0)
"""

needs_radiance = pytest.mark.skipif(find_spec("pyradiance") is None, reason="pyradiance is not installed")


def asked(file: Path, theta: Sequence[float] = (), pairs: Sequence[Sequence[float]] = ()) -> dict[str, Any]:
    """`hemi`: directional-hemispherical reflectance at each theta (degrees; above 90 from below); `pairs`: the value
    at each (theta_i, phi_i, theta_o, phi_o) in degrees."""
    given = json.dumps({"file": str(file), "theta": [float(x) for x in theta], "pairs": [list(p) for p in pairs]})
    done = subprocess.run([sys.executable, "-c", _ASK, given], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-500:]
    found: dict[str, Any] = json.loads(done.stdout)
    return found
