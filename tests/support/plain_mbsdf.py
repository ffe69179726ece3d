"""An MBSDF file read and looked up as its definition says, one direction at a time; shares nothing with the reader."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple


class Plain(NamedTuple):
    """One block: N, M, channels and the numbers in file order."""

    theta: int
    phi: int
    channels: int
    numbers: tuple[float, ...]

    def at(self, i: int, o: int, p: int) -> tuple[float, ...]:
        """The cell's numbers, one a channel."""
        start = self.channels * (i * self.theta * self.phi + o * self.phi + p)
        return self.numbers[start : start + self.channels]

    def looked_up(self, theta_i: float, theta_o: float, delta_phi: float) -> list[float]:
        """f as a texture with clamped, linear look-up at normalised coordinates gives it; angles in radians."""
        phi = math.fmod(abs(delta_phi), 2 * math.pi)
        phi = 2 * math.pi - phi if phi > math.pi else phi
        axes = [
            _two(theta_i * 2 / math.pi, self.theta),
            _two(theta_o * 2 / math.pi, self.theta),
            _two(phi / math.pi, self.phi),
        ]
        found = [0.0] * self.channels
        for i, u in axes[0]:
            for o, v in axes[1]:
                for p, w in axes[2]:
                    found = [a + u * v * w * b for a, b in zip(found, self.at(i, o, p), strict=True)]
        return found


def _two(position: float, count: int) -> tuple[tuple[int, float], tuple[int, float]]:
    x = position * count - 0.5
    low = math.floor(x)
    share = x - low
    return (min(max(low, 0), count - 1), 1 - share), (min(max(low + 1, 0), count - 1), share)


def plain(data: bytes, key: bytes = b"MBSDF_DATA_REFLECTION=\n") -> Plain:
    """The block that follows `key`."""
    at = data.index(key) + len(key)
    kind, theta, phi = struct.unpack_from("<3I", data, at)
    channels = 3 if kind else 1
    return Plain(theta, phi, channels, struct.unpack_from(f"<{channels * theta * theta * phi}f", data, at + 12))
