"""How long measured files take to read: `python -m tests.benchmarks.reading [--files ptfe cayman]`, processor seconds.

Each is read twice; the second time is said, when kernels are compiled and modules loaded, and the wall's beside it,
which is longer on a busy machine. `off`: the largest relative difference of a look-up at a row of the file from its
value.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

import brdfcore as bc
from tests.benchmarks.holdout import FILES
from tests.shared import FOLDER

READ: dict[str, tuple[Path, dict[str, Any]]] = {
    **{name: (path, options or {}) for name, (path, options) in FILES.items()},
    "scan_2d": (FOLDER / "data/inplane/scan_2d.csv", {"angles": "deg", "quantity": "pi_f"}),
    "retro_3m": (FOLDER / "data/alta/retro-3M-jaune.dat", {}),
    "lidar": (FOLDER / "data/openmaterial/example_material_lidar_brdf.xompt", {}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", nargs="*", default=list(READ), choices=list(READ))
    given = parser.parse_args()
    for name in given.files:
        path, options = READ[name]
        bc.read(path, **options)
        start, wall = time.process_time(), time.perf_counter()
        b: Any = bc.read(path, **options)
        seconds, wall = time.process_time() - start, time.perf_counter() - wall
        off = np.abs(b.evaluate(*b.angles.T) - b.measured) / np.maximum(np.abs(b.measured), 1e-12 * b.measured.max())
        print(
            f"{name:12} {len(b.angles):5} rows, {len(b.channels):2} channels: {seconds:5.2f} s ({wall:.2f} s by "
            f"the wall), smoothed {b.report['smoothed']['rows']}, off {off.max():.2g}",
            flush=True,
        )


if __name__ == "__main__":
    main()
