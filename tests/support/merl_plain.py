"""MERL files read and looked up plainly, from the format's description alone: what the project's reader is held to."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

SCALES = (1 / 1500, 1.15 / 1500, 1.66 / 1500)


def read_plainly(path: Path) -> np.ndarray:
    """f_r (n_h, n_d, n_p, 3), float64; invalid cells negative."""
    dims = np.fromfile(path, "<i4", 3)
    planes = np.fromfile(path, "<f8", offset=12).reshape(3, *dims)
    return np.stack([plane * scale for plane, scale in zip(planes, SCALES)], axis=-1)


def cell_of(theta_i: float, theta_o: float, delta_phi: float, shape: tuple[int, ...]) -> tuple[int, int, int]:
    """The cell of one pair of directions: vectors turned about the normal, then about y, the floor of the angles."""
    wi = [math.sin(theta_i), 0.0, math.cos(theta_i)]
    wo = [math.sin(theta_o) * math.cos(delta_phi), math.sin(theta_o) * math.sin(delta_phi), math.cos(theta_o)]
    half = [a + b for a, b in zip(wi, wo)]
    theta_h = math.atan2(math.hypot(half[0], half[1]), half[2])
    phi_h = math.atan2(half[1], half[0])
    x = wi[0] * math.cos(phi_h) + wi[1] * math.sin(phi_h)
    y = wi[1] * math.cos(phi_h) - wi[0] * math.sin(phi_h)
    x, z = x * math.cos(theta_h) - wi[2] * math.sin(theta_h), x * math.sin(theta_h) + wi[2] * math.cos(theta_h)
    theta_d = math.atan2(math.hypot(x, y), z)
    phi_d = math.atan2(y, x) % math.pi
    h = int(math.sqrt(theta_h / (math.pi / 2)) * shape[0])
    d = int(theta_d / (math.pi / 2) * shape[1])
    return min(h, shape[0] - 1), min(d, shape[1] - 1), int(phi_d / math.pi * shape[2]) % shape[2]
