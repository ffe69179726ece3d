"""Klems matrices and tensor trees read and looked up as Radiance's source defines them, one pair at a time."""

from __future__ import annotations

import math
import re
from typing import Any

FULL = [(0, 1), (5, 8), (15, 16), (25, 20), (35, 24), (45, 24), (55, 24), (65, 16), (75, 12), (90, 0)]
HALF = [(0, 1), (6.5, 8), (19.5, 12), (32.5, 16), (45.5, 20), (58.5, 12), (71.5, 8), (90, 0)]
QUARTER = [(0, 1), (9, 8), (27, 12), (45, 12), (63, 8), (90, 0)]


def blocks(text: str) -> dict[tuple[str, str], str]:
    """{(wavelength, direction): the text of its ScatteringData}."""
    found = {}
    for data in re.findall(r"<WavelengthData>(.*?)</WavelengthData>", text, re.DOTALL):
        wave = re.search(r"<Wavelength [^>]*>(.*?)</Wavelength>", data)[1]  # type: ignore[index]
        for block in re.findall(r"<WavelengthDataBlock>(.*?)</WavelengthDataBlock>", data, re.DOTALL):
            side = re.search(r"<WavelengthDataDirection>(.*?)<", block)[1].strip()  # type: ignore[index]
            found[wave, side] = re.search(r"<ScatteringData>(.*?)</ScatteringData>", block, re.DOTALL)[1]  # type: ignore[index]
    return found


class Matrix:
    """Columns are incident, rows outgoing patches."""

    def __init__(self, text: str, basis: list[tuple[float, int]]) -> None:
        self.basis = basis
        self.patches = [(ring, k) for ring, (_, n) in enumerate(basis[:-1]) for k in range(n)]
        numbers = [float(x) for x in text.replace(",", " ").split()]
        n = len(self.patches)
        assert len(numbers) == n * n
        self.rows = [numbers[k * n : (k + 1) * n] for k in range(n)]

    def solid_angle(self, patch: int) -> float:
        ring, _ = self.patches[patch]
        (low, n), (high, _) = self.basis[ring], self.basis[ring + 1]
        return math.pi * (math.cos(math.radians(low)) ** 2 - math.cos(math.radians(high)) ** 2) / n

    def reflectance(self, incident: int) -> float:
        return sum(self.rows[o][incident] * self.solid_angle(o) for o in range(len(self.patches)))

    def centre(self, patch: int) -> tuple[float, float]:
        """(theta, phi) in degrees."""
        ring, k = self.patches[patch]
        theta = 0.0 if ring == 0 else 0.5 * (self.basis[ring][0] + self.basis[ring + 1][0])
        return theta, 360 * k / self.basis[ring][1]

    def own_geometries(self) -> dict[tuple[float, float, float], list[float]]:
        """{(theta_i, theta_o, delta_phi) in degrees: the values of all pairs of patches that have it}."""
        found: dict[tuple[float, float, float], list[float]] = {}
        for i in range(len(self.patches)):
            for o in range(len(self.patches)):
                (ti, pi), (to, po) = self.centre(i), self.centre(o)
                turn = 0.0 if 0.0 in (ti, to) else round((po - pi + 180) % 360, 6) % 360
                found.setdefault((ti, to, turn), []).append(self.rows[o][i])
        return found


def tree(text: str) -> Any:
    """Nested lists of eight branches; a grid is ("grid", side, numbers)."""
    tokens = re.findall(r"[{}]|[^\s,{}]+", text)
    at = 0

    def node() -> Any:
        nonlocal at
        assert tokens[at] == "{"
        at += 1
        if tokens[at] == "{":
            branches = [node() for _ in range(8)]
        else:
            numbers = []
            while tokens[at] != "}":
                numbers.append(float(tokens[at]))
                at += 1
            branches = ("grid", round(len(numbers) ** (1 / 3)), numbers)
        assert tokens[at] == "}"
        at += 1
        return branches

    return node()


def looked_up(root: Any, theta_i: float, theta_o: float, delta_phi: float) -> float:
    """The value of a rank-3 tree; angles in radians."""
    azimuth = delta_phi - math.pi  # the mirror direction lies on the axis x
    x, y = math.sin(theta_o) * math.cos(azimuth), math.sin(theta_o) * math.sin(azimuth)
    r, phi = math.hypot(x, y), math.atan2(y, x)
    if phi < -math.pi / 4:
        phi += 2 * math.pi
    if phi < math.pi / 4:
        a, b = r, phi * r / (math.pi / 4)
    elif phi < 3 * math.pi / 4:
        a, b = -(phi - math.pi / 2) * r / (math.pi / 4), r
    elif phi < 5 * math.pi / 4:
        a, b = -r, (phi - math.pi) * -r / (math.pi / 4)
    else:
        a, b = -(phi - 3 * math.pi / 2) * -r / (math.pi / 4), -r
    place = [0.5 - 1e-9 - 0.5 * math.sin(theta_i), (a + 1) / 2, (b + 1) / 2]
    while isinstance(root, list):
        n = 0
        for k in range(3):
            place[k] *= 2
            if place[k] >= 1:
                n |= 1 << k
                place[k] -= 1
        root = root[n]
    _, side, numbers = root
    i, j, k = (min(int(p * side), side - 1) for p in place)
    return numbers[(i * side + j) * side + k]
