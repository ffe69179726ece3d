"""Half and difference angles and look-ups at them in numpy, by library functions in float64: the twins of
`kernels.tables.half_angle`, whose lattice this is, and what tables on it are built and described with."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.kernels.base.pair_geometry import HORIZON_COS
from brdfcore.kernels.tables.interpolation import tricubic_numpy


def half_angles(
    theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """(theta_h, theta_d, phi_d), phi_d in [0, pi)."""
    a, b = (np.minimum(np.asarray(t, np.float64), HALF_PI) for t in (theta_i, theta_o))
    c = np.asarray(delta_phi, np.float64)
    sin_half, cos_half = np.sin(0.5 * c), np.cos(0.5 * c)
    sin_b, cos_b = np.sin(0.5 * (a - b)), np.cos(0.5 * (a - b))
    total = np.maximum(np.cos(0.5 * (a + b)), HORIZON_COS) * cos_b
    product = np.sin(a) * np.sin(b)
    t2 = (sin_b / cos_b) ** 2 + product * (cos_half / total) ** 2
    cos_d = np.minimum(total * np.sqrt(1 + t2), 1)
    theta_d = 2 * np.arctan2(np.sqrt(np.minimum(sin_b**2 + product * sin_half**2, 1)), 1 + cos_d)
    up, along = -2 * product * sin_half * cos_half, 2 * np.sin(0.5 * (a + b)) * sin_b * cos_d
    phi_d = np.arctan2(up, along)
    phi_d = np.where(phi_d < 0, phi_d + np.pi, phi_d)
    return np.arctan(np.sqrt(t2)), theta_d, np.where(phi_d >= np.pi, 0.0, phi_d)


def indices_numpy(
    theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, shape: tuple[int, int, int], shift: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Fractional indices of directions inside the domain, float64."""
    theta_h, theta_d, phi_d = half_angles(theta_i, theta_o, delta_phi)
    n_h, n_d, n_p = shape
    h = np.clip(n_h * np.sqrt(theta_h / HALF_PI) - shift, 0, n_h - 1)
    d = np.clip(theta_d * (n_d / HALF_PI) - shift, 0, n_d - 1)
    p = phi_d * (n_p / np.pi) - shift
    p = np.where(p < 0, p + n_p, p)
    return h, d, np.where(p >= n_p, 0.0, p)


def nearest_numpy(h: FloatArray, d: FloatArray, p: FloatArray, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Entries of `values` (n_h, n_d, n_p, ...) at the nodes nearest to fractional indices."""
    i, j, l = (np.floor(x + 0.5).astype(np.int64) for x in (h, d, p))  # noqa: E741
    return np.asarray(values[i, j, l % values.shape[2]])


def linear_numpy(h: FloatArray, d: FloatArray, p: FloatArray, values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Trilinear values (n, channels) of `values` (n_h, n_d, n_p, channels) at fractional indices, float64."""
    (i, u), (j, v) = (_cell_numpy(x, n) for x, n in zip((h, d), values.shape))
    l = np.floor(p).astype(np.int64)  # noqa: E741
    w = p - l
    found = np.zeros((h.size, values.shape[-1]))
    for corner in range(8):
        up_h, up_d, up_p = corner >> 2, corner >> 1 & 1, corner & 1
        weight = (u if up_h else 1 - u) * (v if up_d else 1 - v) * (w if up_p else 1 - w)
        found += weight[:, None] * values[i + up_h, j + up_d, (l + up_p) % values.shape[2]]
    return found


def cubic_numpy(h: FloatArray, d: FloatArray, p: FloatArray, values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Monotone cubic values (n, channels) of `values` (n_h, n_d, n_p, channels) at fractional indices, float64."""
    n_h, n_d, n_p, channels = values.shape

    def even(position: FloatArray, n: int, step: int) -> tuple[Any, ...]:
        k, t = _cell_numpy(position, n)
        offsets = (np.maximum(k - 1, 0), k, k + 1, np.minimum(k + 2, n - 1))
        return (*(o * step for o in offsets), t, False, k + 2 == n)

    l = np.floor(p).astype(np.int64)  # noqa: E741
    z = (*((l + o) % n_p for o in (-1, 0, 1, 2)), p - l, False, False)
    found = tricubic_numpy(values.reshape(-1, channels), even(h, n_h, n_d * n_p), even(d, n_d, n_p), z, np.float64)
    return np.asarray(found)


def _cell_numpy(position: FloatArray, nodes: int) -> tuple[npt.NDArray[np.int64], FloatArray]:
    cell = np.minimum(np.floor(position), nodes - 2)
    return cell.astype(np.int64), position - cell
