"""Speos and Zemax text files read number by number, as their definitions say; shares nothing with the readers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple


class PlainSpeos(NamedTuple):
    incidences: list[float]
    percent: list[float]
    theta: list[float]
    phi: list[float]
    tables: list[list[list[float]]]  # [incidence][theta][phi]

    def reflectance(self, k: int) -> float:
        """(1/pi) sum v cos sin dtheta dphi, trapezoidal."""
        total = 0.0
        for i in range(len(self.theta) - 1):
            for j in range(len(self.phi) - 1):
                step = math.radians(self.theta[i + 1] - self.theta[i]) * math.radians(self.phi[j + 1] - self.phi[j])
                corners = [
                    self.tables[k][a][b] * math.sin(math.radians(self.theta[a])) * math.cos(math.radians(self.theta[a]))
                    for a in (i, i + 1)
                    for b in (j, j + 1)
                ]
                total += step * sum(corners) / 4
        return total / math.pi


def plain_speos(path: Path) -> PlainSpeos:
    """One rotation, reflection, a one-line description."""
    lines = path.read_text().splitlines()
    count, incidences, at = int(lines[10]), [float(x) for x in lines[11].split()], 14
    waves = int(lines[at])
    percent = [float(lines[at + 1 + k].split()[1]) for k in range(waves)]
    at += 1 + waves
    tables, theta, phi = [], [], []
    for _ in range(count):
        n = int(lines[at].split()[0])
        phi = [float(x) for x in lines[at + 1].split()]
        rows = [[float(x) for x in lines[at + 2 + k].split()] for k in range(n)]
        theta = [row[0] for row in rows]
        tables.append([row[1:] for row in rows])
        at += 2 + n
    return PlainSpeos(incidences, percent, theta, phi, tables)


class PlainZemax(NamedTuple):
    tis: list[float]
    incidences: list[float]
    azimuth: list[float]
    radial: list[float]
    tables: list[list[list[float]]]  # [incidence][azimuth][radial]

    def at(self, k: int, azimuth: float, radial: float) -> float:
        """Bilinear, 0 beyond the last radial; degrees."""
        if radial > self.radial[-1]:
            return 0.0
        a, u = _cell(azimuth, self.azimuth)
        r, v = _cell(radial, self.radial)
        t = self.tables[k]
        low = t[a][r] + v * (t[a][r + 1] - t[a][r])
        high = t[a + 1][r] + v * (t[a + 1][r + 1] - t[a + 1][r])
        return low + u * (high - low)


def _cell(x: float, nodes: list[float]) -> tuple[int, float]:
    k = 0
    while k < len(nodes) - 2 and x >= nodes[k + 1]:
        k += 1
    return k, (x - nodes[k]) / (nodes[k + 1] - nodes[k])


def plain_zemax(path: Path) -> PlainZemax:
    """Plane-symmetrical, one rotation, one channel."""
    lines = [x for x in path.read_text().splitlines() if x.strip() and not x.startswith("#")]
    axes = [[float(x) for x in lines[k].split()] for k in (7, 9, 11)]
    tis, tables, at = [], [], 14
    for _ in axes[0]:
        tis.append(float(lines[at].split()[1]))
        tables.append([[float(x) for x in line.split()] for line in lines[at + 1 : at + 1 + len(axes[1])]])
        at += 1 + len(axes[1])
    return PlainZemax(tis, *axes, tables)


def about_mirror(theta_i: float, theta: float, phi: float) -> tuple[float, float]:
    """(azimuth, radial) of a Zemax file, degrees, of a Speos direction (mirror at phi 0)."""
    a, t, p = (math.radians(x) for x in (theta_i, theta, phi))
    x, y, z = math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t)
    along, out = x * math.cos(a) - z * math.sin(a), x * math.sin(a) + z * math.cos(a)
    azimuth = (180 + math.degrees(math.atan2(y, along))) % 360
    return (360 - azimuth if azimuth > 180 else azimuth), math.degrees(math.acos(min(1.0, out)))
