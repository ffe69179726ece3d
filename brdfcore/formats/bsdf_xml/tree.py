"""Tensor trees: braces around 2^rank branches, or around a grid of values; rank 3 read and written, rank 4 averaged.

The first axis is (1 - sin theta_i)/2, of which only the half below 1/2 is used; the others are the square of the
outgoing direction (`tables.patch_grid.square`), turned so that the mirror direction lies on the axis x. Branch n takes
the upper half of axis k where bit k of n is set; a grid's first axis is the slowest. Values in 1/sr. At rank 4 the
first two axes are that square of the direction in which light travels, the others that of the outgoing one, not turned.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.formats.bsdf_xml.document import MAX_NUMBERS, Element, bad, floats, words_of
from brdfcore.tables.patch_grid import disk, square

Float64Array = npt.NDArray[np.float64]

#: Deepest tree, as a power of two along each axis: 128 x 256 x 256 cells.
DEEPEST = 8
#: Deepest tree of rank 4, and fewest rotations that its mean is taken over.
_DEEPEST_4, _ROTATIONS = 6, 32
_PLACE, _BRACE = re.compile(r"[^\s,]"), re.compile(r"[{}]")
#: A tree: an array of a grid's values, or its branches.
_Tree = Float64Array | list[Any]


def values_of(element: Element, file: str) -> Float64Array:
    """(R, 2R, 2R) values by rising sin(theta_i), x, y of the text of a ScatteringData."""
    tree, depth = _Parser(element, file).parse()
    depth = max(depth, 1)
    side = 2**depth
    grid = np.empty((side, side, side))
    _fill(grid, tree)
    return grid[: side // 2][::-1].copy()


def mean_over_rotation(element: Element, file: str) -> tuple[Float64Array, float]:
    """((R, 2R, 2R) values as `values_of` has them, L1 loss) of a tree of rank 4: its mean over rotations of the sample,
    at the centres of the cells, and sum |f - mean| / sum |mean| weighted by projected solid angle."""
    tree, depth = _Parser(element, file, rank=4).parse()
    side = 2 ** max(depth, 1)
    count = max(side, _ROTATIONS)
    turns = (np.arange(count)[:, None] + 0.5) * (2 * np.pi / count)
    centres = (np.arange(side) + 0.5) / side
    length, azimuth = disk(*(x.reshape(1, -1) for x in np.meshgrid(centres, centres, indexing="ij")))
    values, lost, whole = np.empty((side // 2, side, side)), 0.0, 0.0
    for k in range(side // 2):
        rho = (k + 0.5) / (side // 2)
        light = square(np.full(turns.shape, rho), turns + np.pi)
        places = [*light, *square(np.broadcast_to(length, (count, side * side)), azimuth + turns)]
        at = np.stack([np.broadcast_to(p, (count, side * side)).reshape(-1) for p in places])
        found = np.empty(at.shape[1])
        _look_up(tree, at, np.arange(at.shape[1]), found)
        seen = found.reshape(count, -1)
        mean = seen.mean(axis=0)
        values[k] = mean.reshape(side, side)
        lost += rho * float(np.abs(seen - mean).mean(axis=0).sum())
        whole += rho * float(np.abs(mean).sum())
    return values, lost / whole if whole > 0 else 0.0


def _look_up(tree: _Tree, at: Float64Array, rows: npt.NDArray[np.intp], out: Float64Array) -> None:
    """The tree's values at places `at` (rank, n) within it, to `out[rows]`."""
    if isinstance(tree, list):
        upper = at >= 0.5
        branch = (upper << np.arange(len(at))[:, None]).sum(axis=0)
        inside = 2 * at - upper
        for n in np.unique(branch).tolist():
            here = branch == n
            _look_up(tree[n], inside[:, here], rows[here], out)
        return
    size = tree.shape[0]
    out[rows] = tree[tuple(np.clip((at * size).astype(np.intp), 0, size - 1))]


class _Parser:
    """Braces and numbers, left to right; a grid's numbers are counted before they are made."""

    def __init__(self, element: Element, file: str, rank: int = 3) -> None:
        self.element, self.file, self.text, self.rank = element, file, element.text, rank
        self.deepest = DEEPEST if rank == 3 else _DEEPEST_4
        self.at, self.read = 0, 0

    def bad(self, got: str, expected: str) -> Exception:
        return bad(self.file, "ScatteringData", self.element.line, got, expected)

    def parse(self) -> tuple[_Tree, int]:
        tree = self._node(0)
        if self._next():
            raise self.bad(f"{self.text[self.at : self.at + 20]!r} after the tree", "the end of the data")
        return tree

    def _next(self) -> str:
        """The next character that is no blank and no comma; "" at the end."""
        found = _PLACE.search(self.text, self.at)
        self.at = found.start() if found else len(self.text)
        return found[0] if found else ""

    def _take(self, brace: str) -> None:
        if self._next() != brace:
            raise self.bad(f"{self.text[self.at : self.at + 20]!r}", f"a brace {brace}")
        self.at += 1

    def _node(self, level: int) -> tuple[_Tree, int]:
        """A tree and how deep it goes below here."""
        if level > self.deepest:
            raise self.bad(f"a tree deeper than {self.deepest} levels", f"at most {2**self.deepest} cells an axis")
        self._take("{")
        if self._next() == "{":
            branches, depth = [], 0
            for _ in range(2**self.rank):
                branch, below = self._node(level + 1)
                branches.append(branch)
                depth = max(depth, below + 1)
            self._take("}")
            return branches, depth
        end = _BRACE.search(self.text, self.at)
        part = self.text[self.at : end.start() if end else len(self.text)]
        count = words_of(part)
        size = next((k for k in range(self.deepest - level + 1) if 2 ** (self.rank * k) == count), None)
        self.read += count
        if size is None or self.read > MAX_NUMBERS:
            raise self.bad(
                f"a grid of {count} values",
                f"1, {2**self.rank}, {4**self.rank}, ... to {2**self.deepest} cells an axis, {MAX_NUMBERS} in all",
            )
        self.at += len(part)
        self._take("}")
        values = floats(part, self.element, self.file)
        return values.reshape((2**size,) * self.rank), size


def _fill(grid: Float64Array, tree: _Tree) -> None:
    """Write a tree into a cube of cells as fine as it or finer."""
    if isinstance(tree, list):
        half = grid.shape[0] // 2
        for n, branch in enumerate(tree):
            low = [half if n >> k & 1 else 0 for k in range(3)]
            _fill(grid[low[0] : low[0] + half, low[1] : low[1] + half, low[2] : low[2] + half], branch)
        return
    times = grid.shape[0] // tree.shape[0]
    grid[...] = tree.repeat(times, 0).repeat(times, 1).repeat(times, 2)


def composed(values: Float64Array) -> str:
    """The text of a tree of (R, 2R, 2R) values, R a power of two; what is constant within a branch is one value."""
    lines: list[str] = []
    cube = values[::-1]

    def write(part: Float64Array, level: int) -> None:
        indent = " " * level
        if part.min() == part.max():
            lines.append(f"{indent}{{ {float(part.flat[0])!r} }}")
            return
        if part.shape[0] <= 4 and not _constant_octant(part):
            rows = (" ".join(map(repr, row)) for row in part.reshape(-1, part.shape[2]).tolist())
            lines.append(indent + "{ " + f"\n{indent}  ".join(rows) + " }")
            return
        lines.append(indent + "{")
        for n in range(8):
            write(_octant(part, n), level + 1)
        lines.append(indent + "}")

    lines.append("{")
    for n in range(8):
        if n & 1:  # the half of the first axis that is not used
            lines.append(" { 0.0 }")
        else:
            half = values.shape[0]
            y, z = (half if n >> k & 1 else 0 for k in (1, 2))
            write(cube[:, y : y + half, z : z + half], 1)
    lines.append("}")
    return "\n".join(lines)


def _octant(part: Float64Array, n: int) -> Float64Array:
    half = part.shape[0] // 2
    a, b, c = (half if n >> k & 1 else 0 for k in range(3))
    return part[a : a + half, b : b + half, c : c + half]


def _constant_octant(part: Float64Array) -> bool:
    if part.shape[0] == 1:
        return False
    return any(o.size > 1 and o.min() == o.max() for o in (_octant(part, n) for n in range(8)))
