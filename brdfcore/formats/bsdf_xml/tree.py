"""Tensor trees of rank 3: braces around eight branches, or around a grid of values; read and written.

The first axis is (1 - sin theta_i)/2, of which only the half below 1/2 is used; the others are the square of the
outgoing direction (`tables.patch_grid.square`), turned so that the mirror direction lies on the axis x. Branch n takes
the upper half of axis k where bit k of n is set; a grid's first axis is the slowest. Values in 1/sr.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.formats.bsdf_xml.document import MAX_NUMBERS, Element, bad, floats, words_of

Float64Array = npt.NDArray[np.float64]

#: Deepest tree, as a power of two along each axis: 128 x 256 x 256 cells.
DEEPEST = 8
_PLACE, _BRACE = re.compile(r"[^\s,]"), re.compile(r"[{}]")
#: A tree: an array of a grid's values, or its eight branches.
_Tree = Float64Array | list[Any]


def values_of(element: Element, file: str) -> Float64Array:
    """(R, 2R, 2R) values by rising sin(theta_i), x, y of the text of a ScatteringData."""
    tree, depth = _Parser(element, file).parse()
    depth = max(depth, 1)
    side = 2**depth
    grid = np.empty((side, side, side))
    _fill(grid, tree)
    return grid[: side // 2][::-1].copy()


class _Parser:
    """Braces and numbers, left to right; a grid's numbers are counted before they are made."""

    def __init__(self, element: Element, file: str) -> None:
        self.element, self.file, self.text = element, file, element.text
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
        if level > DEEPEST:
            raise self.bad(f"a tree deeper than {DEEPEST} levels", f"at most {2**DEEPEST} cells an axis")
        self._take("{")
        if self._next() == "{":
            branches, depth = [], 0
            for _ in range(8):
                branch, below = self._node(level + 1)
                branches.append(branch)
                depth = max(depth, below + 1)
            self._take("}")
            return branches, depth
        end = _BRACE.search(self.text, self.at)
        part = self.text[self.at : end.start() if end else len(self.text)]
        count = words_of(part)
        size = next((k for k in range(DEEPEST - level + 1) if 8**k == count), None)
        self.read += count
        if size is None or self.read > MAX_NUMBERS:
            raise self.bad(
                f"a grid of {count} values", f"1, 8, 64, ..., at most {2**DEEPEST} cells an axis, {MAX_NUMBERS} in all"
            )
        self.at += len(part)
        self._take("}")
        values = floats(part, self.element, self.file)
        return values.reshape((2**size,) * 3), size


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
