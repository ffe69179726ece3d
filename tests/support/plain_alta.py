"""ALTA text read row by row, and geometries put into its coordinates as its documentation defines them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np


def plain_alta(path: Path) -> list[tuple[float, float, float, float]]:
    """(theta_i, theta_o, delta_phi, f) of ISOTROPIC_TL_TV_PROJ_DPHI and f cos, radians, without the horizon."""
    found = []
    for line in path.read_text().splitlines():
        if line.startswith("#") or not line.strip():
            continue
        theta_l, along, across, value = (float(x) for x in line.split())
        theta_v = math.sqrt(along * along + across * across)
        if math.cos(theta_v) > 1e-3:
            found.append((theta_l, theta_v, math.atan2(across, along), value / math.cos(theta_v)))
    return found


def coordinates(name: str, theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
    """The columns of a parametrisation; the light at azimuth 0, the view at delta_phi."""
    light = np.stack([np.sin(theta_i), 0 * theta_i, np.cos(theta_i)], axis=1)
    view = np.stack([np.sin(theta_o) * np.cos(delta_phi), np.sin(theta_o) * np.sin(delta_phi), np.cos(theta_o)], axis=1)
    if name == "ISOTROPIC_TV_TL_DPHI":
        return np.stack([theta_o, theta_i, -delta_phi], axis=1)
    if name == "ISOTROPIC_TL_TV_PROJ_DPHI":
        return np.stack([theta_i, theta_o * np.cos(delta_phi), theta_o * np.sin(delta_phi)], axis=1)
    if name == "SPHERICAL_TL_PL_TV_PV":
        return np.stack([theta_i, 0 * theta_i, theta_o, delta_phi], axis=1)
    if name == "CARTESIAN":
        return np.concatenate([view, light], axis=1)
    half = light + view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    theta_h, phi_h = np.arccos(half[:, 2]), np.arctan2(half[:, 1], half[:, 0])
    # V turned back by -phi_h about z, then by -theta_h about y
    x = np.cos(phi_h) * view[:, 0] + np.sin(phi_h) * view[:, 1]
    y = -np.sin(phi_h) * view[:, 0] + np.cos(phi_h) * view[:, 1]
    z = view[:, 2]
    x, z = np.cos(theta_h) * x - np.sin(theta_h) * z, np.sin(theta_h) * x + np.cos(theta_h) * z
    theta_d, phi_d = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    if name == "RUSIN_TH_TD_PD":
        return np.stack([theta_h, theta_d, phi_d], axis=1)
    return np.stack([theta_h, phi_h, theta_d, phi_d], axis=1)
