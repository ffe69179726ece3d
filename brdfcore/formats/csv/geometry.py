"""Other coordinates of a pair of directions than polar angles: half and difference angles, vectors.

Half and difference angles (S. Rusinkiewicz, A new change of variables for efficient BRDF representation, 1998, DOI
10.1007/978-3-7091-6453-2_2): h = (wi + wo)/|wi + wo| at theta_h, wi at (theta_d, phi_d) about h, phi_d = 0 away from
the normal. Vectors leave the surface, z along its normal. Both say where the mirror direction is: delta_phi = pi.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.base.geometry import angles_from_vectors
from brdfcore.formats.base.text_rows import TextFile

Float64Array = npt.NDArray[np.float64]

HALF = ("theta_h", "theta_d", "phi_d")
VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
#: A vector may miss the length 1 by this much, printed digits; a direction may pass the horizon by this, rad.
_LENGTH, _SLACK = 1e-2, 1e-6


class Turned(NamedTuple):
    """theta_i, theta_o, delta_phi (k,) rad of rows `kept` (k,) of a table; sentences about them."""

    angles: tuple[Float64Array, Float64Array, Float64Array]
    kept: npt.NDArray[np.intp]
    done: list[str]


def from_half(text: TextFile, columns: Float64Array, lines: npt.NDArray[np.int64]) -> Turned:
    """Of theta_h, theta_d, phi_d (n, 3) rad; rows with a direction below the horizon are left out and counted."""
    _finite(text, columns, lines, HALF)
    h, d, p = columns.T
    x, y, z = np.sin(d) * np.cos(p), np.sin(d) * np.sin(p), np.cos(d)
    directions = [
        np.stack([np.cos(h) * side * x + np.sin(h) * z, side * y, np.cos(h) * z - np.sin(h) * side * x], axis=1)
        for side in (1.0, -1.0)
    ]
    return _above(text, angles_from_vectors(*directions), lines)


def from_vectors(text: TextFile, columns: Float64Array, lines: npt.NDArray[np.int64]) -> Turned:
    """Of wi, wo (n, 6). All wi below the surface are directions of travel, and turned round."""
    _finite(text, columns, lines, VECTORS)
    wi, wo = columns[:, :3], columns[:, 3:]
    for name, w in (("wi", wi), ("wo", wo)):
        length = np.linalg.norm(w, axis=1)
        for row in np.flatnonzero(np.abs(length - 1) > _LENGTH)[:1]:
            raise text.bad(int(lines[row]), name, f"a vector of length {length[row]:.4g}", "unit vectors")
    done = []
    if len(wi) and (wi[:, 2] <= 0).all() and (wi[:, 2] < 0).any():
        wi = -wi
        done.append("wi points into the surface in every row, the direction in which light travels: turned round")
    found = _above(text, angles_from_vectors(wi, wo), lines)
    return found._replace(done=[*done, *found.done])


def _finite(text: TextFile, columns: Float64Array, lines: npt.NDArray[np.int64], names: tuple[str, ...]) -> None:
    bad = ~np.isfinite(columns)
    for row, column in np.argwhere(bad)[:1]:
        raise text.bad(int(lines[row]), names[column], f"{columns[row, column]:g}", "a finite number")


def _above(
    text: TextFile, angles: tuple[Float64Array, Float64Array, Float64Array], lines: npt.NDArray[np.int64]
) -> Turned:
    theta_i, theta_o, delta_phi = angles
    above = np.maximum(theta_i, theta_o) <= HALF_PI + _SLACK
    done = []
    if not above.all():
        at = int(lines[np.flatnonzero(~above)[0]])
        done.append(f"{int((~above).sum())} rows with a direction below the horizon left out; the first: line {at}")
    if not above.any():
        raise text.bad(int(lines[0]), "rows", "all have a direction below the horizon", "rows above it")
    kept = np.flatnonzero(above)
    return Turned((theta_i[kept], theta_o[kept], delta_phi[kept]), kept, done)
