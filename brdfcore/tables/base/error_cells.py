"""Cells of pairs of directions in which the error of a table is alike: by theta_i, theta_o, and the distance to the
mirror direction or to the light, whichever is nearer.

A lobe is narrow around one of these two, an error grows towards either horizon, and a table cut at an angle differs on
both sides of it. Distances are in octaves, or parts of them, so that a lobe of any width is resolved.

A table whose own coordinates are the half vector's (`vndf_warp`) is off where they are: `half_cells`, by theta_i,
theta_h and its azimuth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI
from brdfcore.base.geometry import horizon_theta_h, outgoing_from_half

Float64Array = npt.NDArray[np.float64]

#: Uniform steps of a polar angle, of which edges are multiples: `kernels.tables.local_error.STEPS`.
STEPS = 1_024
#: Inner edges of the cells of theta_i in which the coverage is held, degrees: nearer each other towards both ends.
INCIDENCES = (
    *(0.3, 0.8, 1.4, 2.3, 3.5, 5, 7, 9, 12, 15, 18, 21, 24, 28, 32, 36, 40, 44, 48, 52, 56, 59, 62, 65, 67.5, 70),
    *(72, 74, 76, 77.5, 79, 80.5, 82, 83, 84, 85.2, 86.5, 87.5, 88.5, 89.2, 89.7),
)  # fmt: skip
_INNER_I = (1, 3, 7, 13, 20, 28, 36, 44, 52, 59, 65, 70, 74, 77.5, 80.5, 83, 85, 86.5, 87.7, 88.5, 89.2, 89.7)
_INNER_O = (3, 20, 44, 59, 70, 77.5, 80.5, 83, 85, 86.5, 87.7, 88.5, 89.2, 89.7)
#: (inner edges of theta_i, of theta_o, degrees; octaves of the squared distance below 1; cells an octave of it, 2^n).
_LEVELS: tuple[tuple[tuple[float, ...], tuple[float, ...], int, int], ...] = (
    ((20, 52, 74, 85), (28, 59, 80.5), 10, -1),
    ((3, 20, 44, 65, 77.5, 83, 86.5, 88.5, 89.7), (20, 44, 65, 77.5, 83, 86.5, 88.5, 89.5), 16, -1),
    ((3, 13, 28, 44, 59, 70, 77.5, 83, 86.5, 88.5, 89.7), (20, 44, 65, 77.5, 83, 86.5, 88.5, 89.5), 16, 0),
    (
        (1, 5, 13, 24, 36, 48, 59, 67, 74, 79, 83, 86.5, 88.5, 89.7),
        (20, 44, 59, 70, 77.5, 83, 86.5, 88.5, 89.5),
        16,
        0,
    ),
    (_INNER_I, _INNER_O, 16, 0),
    (_INNER_I, _INNER_O, 20, 1),
)
#: Inner edges of theta_i, degrees, of cells by half vector, and how many of theta_h the levels after those have.
_HALF_I, _HALF_H = (15, 30, 45, 60, 74, 84), (32, 64, 128, 256, 512)
#: Levels by distance, and of all.
BY_DISTANCE = len(_LEVELS)
LEVELS = BY_DISTANCE + len(_HALF_H)
#: Quarters of half a turn of the half vector's azimuth from wi.
_EIGHTHS = 4
_FRACTION_BITS = 23
#: Draws of a half vector for a direction above the horizon.
_TRIES = 8
#: Octaves of the squared distance that the nearest cell is drawn from, below its own.
_NEAREST = 8


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of one level.

    map_i, map_o  uint8 (STEPS,)  cell of each step of theta_i, theta_o
    bases         int32 (n_i n_o + 1,)  number of the cell 2 k + side = 0 of each pair of them; the last: of all cells
    low, high     int32 (cells,)  bits of the float32 of the squared distance, from, to
    place         int32 (cells, 3)  cells of theta_i and theta_o, side: 1 the mirror direction, 0 the light
    """

    map_i: npt.NDArray[np.uint8]
    map_o: npt.NDArray[np.uint8]
    edges_i: Float64Array
    edges_o: Float64Array
    bases: npt.NDArray[np.int32]
    shift: int
    first: int
    low: npt.NDArray[np.int64]
    high: npt.NDArray[np.int64]
    place: npt.NDArray[np.int32]

    @property
    def count(self) -> int:
        return int(self.bases[-1])

    @property
    def kernels(self) -> Any:
        """The module whose kernels find these cells."""
        from brdfcore.kernels.tables import local_error

        return local_error

    @cached_property
    def found_by(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.int32], Any]:
        """What `kernels.tables.local_error` finds a cell by."""
        from brdfcore.kernels.tables.local_error import CellScale

        rows = self.map_i.astype(np.int32) * np.int32(len(self.edges_o) - 1)
        return rows, self.map_o.astype(np.int32), self.bases, CellScale(np.int32(self.shift), np.int32(self.first))

    def numbers(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> npt.NDArray[np.int32]:
        """The cell of each pair of directions, (n,); |delta_phi| <= 3 pi."""
        out = np.empty(theta_i.size, np.int32)
        self.kernels.numbers(theta_i.size, theta_i, theta_o, delta_phi, out, *self.found_by)
        return out

    def draw(self, each: int, rng: np.random.Generator) -> tuple[Float64Array, Float64Array, Float64Array]:
        """`each` pairs of directions in every cell, (cells each,): theta_i, theta_o, delta_phi, both signs of it."""
        i, o, side = (np.repeat(column, each) for column in self.place.T)
        low, high = np.repeat(self.low, each), np.repeat(self.high, each)
        bits = (low + rng.random(low.size) * (high - low)).astype(np.int32)
        square = bits.view(np.float32).astype(np.float64)
        away = 2 * np.arcsin(0.5 * np.sqrt(np.minimum(square, 2)))
        # the two polar angles differ by no more than the distance, and by its cosine where that has no preference
        (from_i, to_i), (from_o, to_o) = ((e[k], e[k + 1]) for e, k in ((self.edges_i, i), (self.edges_o, o)))
        from_i, to_i = np.clip(from_o - away, from_i, to_i), np.clip(to_o + away, from_i, to_i)
        theta_i = from_i + rng.random(i.size) * (to_i - from_i)
        ends = [np.arccos(np.clip((edge - theta_i) / away, -1, 1)) for edge in (from_o, to_o)]
        theta_o = theta_i + away * np.cos(ends[0] + rng.random(i.size) * (ends[1] - ends[0]))
        theta_o = np.clip(theta_o, from_o, to_o)
        apart = 4 * np.sin(0.5 * (theta_i - theta_o)) ** 2
        across = np.maximum(np.sin(theta_i) * np.sin(theta_o), 1e-300)
        # at a distance that these two angles do not reach: the nearest that they do
        y = 2 * np.arcsin(0.5 * np.sqrt(np.clip((square - apart) / across, 0, 2)))
        turn = np.where(side == 1, np.pi - y, y)
        return theta_i, theta_o, turn * rng.choice([-1.0, 1.0], turn.size)


@dataclass(frozen=True, eq=False)
class HalfCells(Cells):
    """Cells by half vector: number (theta_i, theta_h, azimuth), theta_h in equal steps of sqrt(tan(theta_h / 2)).

    low, high are empty, place[:, 1] is the cell of theta_h and place[:, 2] the eighth of a turn.
    """

    @property
    def kernels(self) -> Any:
        from brdfcore.kernels.tables import local_error_half

        return local_error_half

    @cached_property
    def found_by(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.int32], Any]:
        from brdfcore.kernels.tables.local_error_half import HalfCells as Scale

        rows = self.map_i.astype(np.int32) * np.int32(_EIGHTHS * self.shift)
        scale = Scale(np.float32(self.shift), np.int32(self.shift - 1))
        return rows, self.map_o.astype(np.int32), self.bases, scale

    def draw(self, each: int, rng: np.random.Generator) -> tuple[Float64Array, Float64Array, Float64Array]:
        """As `Cells.draw`; where a half vector leads below the horizon, another, and at last the horizon's."""
        i, h, eighth = (np.repeat(column, each) for column in self.place.T)
        theta_i, theta_o, turn = (np.empty(i.size) for _ in range(3))
        left = np.arange(i.size)
        for k in range(_TRIES):
            low, high = self.edges_i[i[left]], self.edges_i[i[left] + 1]
            theta_i[left] = low + rng.random(left.size) * (high - low)
            theta_h = 2 * np.arctan(((h[left] + rng.random(left.size)) / self.shift) ** 2)
            phi_h = (eighth[left] + rng.random(left.size)) * (np.pi / _EIGHTHS)
            if k == _TRIES - 1:
                theta_h = np.minimum(theta_h, 0.999 * horizon_theta_h(theta_i[left], phi_h))
            theta_o[left], turn[left], _ = outgoing_from_half(theta_i[left], theta_h, phi_h)
            left = left[~(theta_o[left] < HALF_PI)]
        return theta_i, np.minimum(theta_o, HALF_PI), turn * rng.choice([-1.0, 1.0], turn.size)


def steps_of(edges: tuple[float, ...]) -> npt.NDArray[np.int64]:
    """Inner edges in degrees as steps, with both ends."""
    return np.concatenate([[0], np.rint(np.asarray(edges) / 90 * STEPS), [STEPS]]).astype(np.int64)


def map_of(edges: tuple[float, ...]) -> npt.NDArray[np.uint8]:
    """Number of the cell of each step."""
    return np.repeat(np.arange(len(edges) + 1, dtype=np.uint8), np.diff(steps_of(edges)))


#: Ends of the ranges of theta_i in which the coverage is held, rad, both horizons included.
EDGES = steps_of(INCIDENCES) / STEPS * HALF_PI


def mean_by_incidence(level: int, by_incidence: Float64Array) -> Float64Array:
    """The mean of a factor by range of theta_i over the theta_i of each cell, (cells,)."""
    c = cells(level)
    factor = by_incidence[map_of(INCIDENCES)]
    means = np.bincount(c.map_i, factor) / np.bincount(c.map_i)
    return np.asarray(means[c.place[:, 0]])


@cache
def cells(level: int) -> Cells:
    """The cells of `level`: by distance from 0 (some hundred) to some thousand; by half vector from `BY_DISTANCE`."""
    if level >= BY_DISTANCE:
        return _half_cells(_HALF_H[level - BY_DISTANCE])
    inner_i, inner_o, octaves, part = _LEVELS[level]
    edges_i, edges_o = (steps_of(e) / STEPS * HALF_PI for e in (inner_i, inner_o))
    shift = _FRACTION_BITS - part
    first = int(np.float32(2.0**-octaves).view(np.int32)) >> shift
    bases, low, high, place, count = [], [], [], [], 0
    for i in range(len(edges_i) - 1):
        for o in range(len(edges_o) - 1):
            gap = max(edges_i[i] - edges_o[o + 1], edges_o[o] - edges_i[i + 1], 0.0)
            nearest = 4 * np.sin(0.5 * gap) ** 2 * (1 - 1e-3)  # the kernel's sine is good to 2e-4
            farthest = 2 * (1 - np.cos(edges_i[i + 1]) * np.cos(edges_o[o + 1])) * (1 + 1e-3)
            ends = [max((int(np.float32(x).view(np.int32)) >> shift) - first, 0) for x in (nearest, farthest)]
            bases.append(count - 2 * ends[0])
            for k in range(ends[0], ends[1] + 1):
                for side in (0, 1):
                    # the nearest cell goes on to distance 0
                    low.append((k + first << shift) - (0 if k else _NEAREST << _FRACTION_BITS))
                    high.append(k + first + 1 << shift)
                    place.append((i, o, side))
            count += 2 * (ends[1] - ends[0] + 1)
    tables = np.array([*bases, count], np.int32), np.array(low), np.array(high), np.array(place, np.int32)
    return Cells(map_of(inner_i), map_of(inner_o), edges_i, edges_o, tables[0], shift, first, *tables[1:])


def _half_cells(count: int) -> HalfCells:
    edges_i = steps_of(_HALF_I) / STEPS * HALF_PI
    i, h, eighth = np.meshgrid(*(np.arange(n) for n in (len(edges_i) - 1, count, _EIGHTHS)), indexing="ij")
    place = np.stack([i, h, eighth], axis=-1).reshape(-1, 3).astype(np.int32)
    none, bases = np.zeros(0, np.int64), np.array([len(place)], np.int32)
    whole = np.zeros(STEPS, np.uint8)
    return HalfCells(map_of(_HALF_I), whole, edges_i, np.zeros(0), bases, count, 0, none, none, place)
