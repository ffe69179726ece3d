"""Klems matrices: the patches of their bases, and the isotropic part of a matrix.

A basis divides the hemisphere into rings of theta, and each ring into even patches of azimuth, the first centred at
azimuth 0 (J. H. Klems, ASHRAE Transactions 100(1), 1994). The azimuth of an incident patch is that of the direction in
which light travels, so that a mirror reflects patch k into patch k: our delta_phi is the outgoing azimuth minus the
incident one, plus pi.

What a name stands for has changed: Radiance of 2015 has 73 patches in "LBNL/Klems Half" and edges of 46 and 66 degrees
in the quarter, that of 2022 has 77, and 45 and 63, whatever the file says under these names. A file's own definition is
believed here; the names alone mean Radiance's of 2022, which are also what is written.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.formats.bsdf_xml.document import Element, bad, numbers

Float64Array = npt.NDArray[np.float64]

#: Most rings, patches a ring, and cells of azimuth that rings together divide a turn into.
_MOST_RINGS, _MOST_PATCHES, _MOST_CELLS = 90, 360, 8_192


class Basis(NamedTuple):
    """Edges of the rings in degrees, (rings + 1,), and the number of patches of each."""

    name: str
    edges: tuple[float, ...]
    patches: tuple[int, ...]

    @property
    def size(self) -> int:
        return sum(self.patches)

    @property
    def starts(self) -> list[int]:
        """The first patch of each ring."""
        return [sum(self.patches[:k]) for k in range(len(self.patches))]

    @property
    def omega(self) -> Float64Array:
        """Projected solid angle of a patch of each ring."""
        c2 = np.cos(np.radians(self.edges)) ** 2
        return np.asarray(np.pi * (c2[:-1] - c2[1:]) / np.array(self.patches))


BASES = {
    "full": Basis(
        "LBNL/Klems Full",
        (0, 5, 15, 25, 35, 45, 55, 65, 75, 90),
        (1, 8, 16, 20, 24, 24, 24, 16, 12),
    ),
    "half": Basis("LBNL/Klems Half", (0, 6.5, 19.5, 32.5, 45.5, 58.5, 71.5, 90), (1, 8, 12, 16, 20, 12, 8)),
    "quarter": Basis("LBNL/Klems Quarter", (0, 9, 27, 45, 63, 90), (1, 8, 12, 12, 8)),
}


def lattice(n: int, m: int) -> int:
    """Differences of azimuth that patches of rings of n and m have; 1 at the pole, which has no azimuth."""
    return 1 if 1 in (n, m) else math.lcm(n, m)


def cells_of(inner: Basis, outer: Basis) -> int:
    """Even cells of a turn, of which those differences of all pairs of rings are edges and middles."""
    return 2 * math.lcm(*(lattice(n, m) for n in inner.patches for m in outer.patches))


def bases_of(definition: Element, file: str) -> dict[str, Basis]:
    """Bases by their names in lower case: those that a file defines, and the usual ones by name alone."""
    found = {basis.name.lower(): basis for basis in BASES.values()}
    for element in definition.all("AngleBasis"):
        name = element.words("AngleBasisName")
        if name.lower() in found and not element.all("AngleBasisBlock"):
            continue
        edges, patches = [0.0], list[int]()
        for block in element.all("AngleBasisBlock"):
            bounds = block.first("ThetaBounds")
            upper, lower = (bounds.first(n) if bounds else None for n in ("UpperTheta", "LowerTheta"))
            turns = block.first("nPhis")
            if upper is None or turns is None:
                raise bad(file, "AngleBasisBlock", block.line, "no UpperTheta or nPhis", "both")
            edge, (n,) = float(numbers(upper, file, 1)[0]), numbers(turns, file, 1)
            if lower is not None and abs(float(numbers(lower, file, 1)[0]) - edges[-1]) > 1e-3:
                raise bad(file, "LowerTheta", lower.line, f"not {edges[-1]:g}", "where the ring before ends")
            if not edges[-1] < edge <= 90 or n != int(n) or not 1 <= n <= _MOST_PATCHES or len(patches) >= _MOST_RINGS:
                raise bad(file, "AngleBasisBlock", block.line, f"to {edge:g} degrees, {n:g} patches", "rising rings")
            edges.append(edge)
            patches.append(int(n))
        if not patches or edges[-1] != 90 or (1 in patches[1:]):
            raise bad(file, "AngleBasis", element.line, f"{name[:40]!r} does not cover 0 to 90 degrees", "a basis")
        found[name.lower()] = Basis(name[:60], tuple(edges), tuple(patches))
        if cells_of(found[name.lower()], found[name.lower()]) > _MOST_CELLS:
            raise bad(file, "nPhis", element.line, "patches that have no common division", "e.g. 1, 8, 16, 24")
    return found


def isotropic_part(matrix: Float64Array, inner: Basis, outer: Basis) -> tuple[Float64Array, float]:
    """(values (I, O, N, C), L1 that they lose) of matrices (C, incident patches, outgoing patches).

    Of the patches of a pair of rings with one difference of azimuth the mean; cell n of N covers delta_phi from n to
    n + 1 times 2 pi/N and has the value of the difference nearest to it.
    """
    count = cells_of(inner, outer)
    values = np.empty((len(inner.patches), len(outer.patches), count, len(matrix)))
    lost = whole = 0.0
    centres = np.arange(count) + 0.5
    for a, (n, start) in enumerate(zip(inner.patches, inner.starts, strict=True)):
        for b, (m, first) in enumerate(zip(outer.patches, outer.starts, strict=True)):
            part = matrix[:, start : start + n, first : first + m]
            steps = lattice(n, m)
            turn = np.arange(m)[None, :] * (steps // m if steps > 1 else 0)
            turn = np.mod(turn - np.arange(n)[:, None] * (steps // n if steps > 1 else 0), steps)
            means = np.stack([_group_means(turn.reshape(-1), c.reshape(-1), steps) for c in part], axis=1)
            weight = inner.omega[a] * outer.omega[b]
            lost += weight * float(np.abs(part - np.moveaxis(means[turn], -1, 0)).sum())
            whole += weight * float(np.abs(part).sum())
            nearest = np.mod(np.floor(centres * steps / count + 0.5), steps).astype(np.int64)
            values[a, b] = np.roll(means[nearest], count // 2, axis=0)
    return values, lost / whole if whole > 0 else 0.0


def _group_means(group: npt.NDArray[np.int64], values: Float64Array, count: int) -> Float64Array:
    """Mean of each group's values, to the bit where they are equal."""
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, group, values)
    np.maximum.at(high, group, values)
    return np.where(low == high, low, np.bincount(group, values, count) / np.bincount(group, minlength=count))
