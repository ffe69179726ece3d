"""A text table read the shortest way, to check the reader against: Python's csv module, columns by number."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import numpy.typing as npt


def rows(path: Path) -> npt.NDArray[np.float64]:
    """Every line that is numbers only, in order, (n, columns)."""
    found = []
    with path.open(newline="") as file:
        for cells in csv.reader(file):
            try:
                found.append([float(c) for c in cells])
            except ValueError:
                continue
    return np.array([row for row in found if len(row) == max(map(len, found))])


def in_project(table: npt.NDArray[np.float64]) -> list[tuple[float, float, float, tuple[float, ...]]]:
    """Rows of theta_i, signed theta_o, values in degrees as (theta_i, |theta_o|, delta_phi, values): mirror at plus."""
    return [(row[0], abs(row[1]), 180.0 if row[1] >= 0 else 0.0, tuple(row[2:])) for row in table.tolist()]
