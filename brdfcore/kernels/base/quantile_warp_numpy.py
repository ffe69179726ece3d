"""The twin of `quantile_warp.draw`: the same tables by library functions, in float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.kernels.base.quantile_warp import RISE, TIP


def draw(
    wi: FloatArray,
    u: FloatArray,
    azimuth: npt.NDArray[np.float32],
    polar: npt.NDArray[np.float32],
    mass: npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """(wo, density) of unit wi (n, 3) with z > 0 and u (n, 2); tables in their shapes."""
    wi, u = np.asarray(wi, np.float64), np.asarray(u, np.float64)
    theta_i, turn = np.arctan2(np.hypot(wi[:, 0], wi[:, 1]), wi[:, 2]), np.arctan2(wi[:, 1], wi[:, 0])
    k, w = _cell(1 - (1 - np.sin(theta_i)) ** 0.25, polar.shape[0] - 1)
    signed = 2 * u[:, 1] - 1
    i, at_v = _cell(0.5 + 0.5 * np.sign(signed) * (1 - np.sqrt(1 - np.abs(signed))), polar.shape[1] - 1)
    last, first = TIP + RISE, u[:, 0]
    near = first < 0.5 * TIP + 0.25 * RISE
    x = np.where(near, (np.sqrt(TIP**2 + 4 * RISE * first) - TIP) / (2 * RISE), 1 - np.sqrt((1 - first) / last))
    j, at_t = _cell(x, polar.shape[2] - 3)
    slopes = np.where(near, TIP + 2 * RISE * x, 2 * last * (1 - x)) * 2 * np.sqrt(1 - np.abs(signed))
    ends = [_mixed(azimuth, w, k, i + a) for a in (0, 1)]
    rows = [[_mixed(polar, w, k, i + a, j + b) for a in (0, 1)] for b in range(4)]
    zeta = [a * (1 - at_v) + b * at_v for a, b in rows]
    widths = np.diff(zeta, axis=0)
    left, right = (widths[a] * mass[j + 1].astype(np.float64) / mass[j + a] for a in (0, 2))
    upward = left <= right
    ratio = np.maximum(2 * widths[1] / np.maximum(np.minimum(left, right), 1e-9 * widths[1]) - 1, 1)
    c = ratio ** (1 / 16)
    x = np.where(upward, at_t, 1 - at_t)
    t = 1 + x * (c - 1)
    even = ratio < 1 + 1e-9
    share = np.where(even, x, (t**16 - 1) / np.where(even, 1, ratio - 1))
    slope = np.where(even, 1, 16 * (c - 1) * t**15 / np.where(even, 1, ratio - 1))
    at_zeta = zeta[1] + widths[1] * np.where(upward, share, 1 - share)
    phi = ends[0] * (1 - at_v) + ends[1] * at_v
    edge = np.sin(0.25 * np.arctan2(np.cos(theta_i), -np.sin(theta_i) * np.cos(phi))) ** 2
    theta_h = 2 * np.arcsin(np.sqrt(np.maximum(at_zeta, 0) * edge))
    s = np.sin(theta_h)
    h = np.stack([s * np.cos(phi + turn), s * np.sin(phi + turn), np.cos(theta_h)], axis=-1)
    dot = (h * wi).sum(axis=-1)
    area = (ends[1] - ends[0]) * (polar.shape[1] - 1) * widths[1] * slope * (polar.shape[2] - 3)
    return 2 * dot[:, None] * h - wi, slopes / (area * 8 * edge * dot)


def _cell(place: FloatArray, last: int) -> tuple[npt.NDArray[np.intp], FloatArray]:
    x = np.clip(place, 0, 1) * last
    i = np.minimum(x.astype(np.intp), last - 1)
    return i, x - i


def _mixed(table: npt.NDArray[np.float32], w: FloatArray, k: npt.NDArray[np.intp], *rest: Any) -> FloatArray:
    low, high = (table[(k + step, *rest)].astype(np.float64) for step in (0, 1))
    return np.asarray(low + (high - low) * w)
