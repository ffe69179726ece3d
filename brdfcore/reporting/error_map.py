"""Where a candidate is wrong: its error over the half and difference angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf

Array = npt.NDArray[np.float64]

#: Cells of theta_h and theta_d, and directions of phi_d averaged in each.
CELLS, AZIMUTHS = (90, 60), 24


@dataclass(frozen=True)
class ErrorMap:
    """mean |f' - f| / (mean f + d) over phi_d and channels, at cell centres (n_h, n_d), d = albedo/pi; nan where
    nothing is above the horizon. theta_h, theta_d: cell edges, radians; theta_h is finer towards 0 (sqrt)."""

    theta_h: Array
    theta_d: Array
    error: Array


def error_map(reference: Brdf, candidate: Brdf) -> ErrorMap:
    """Relative error over (theta_h, theta_d), averaged over phi_d.

    wi and wo are h turned by theta_d either way (Rusinkiewicz 1998): with h in the plane of x and z,
    w = cos theta_d h +- sin theta_d (cos phi_d t + sin phi_d y), t perpendicular to h in that plane.
    """
    edges_h = np.pi / 2 * np.linspace(0, 1, CELLS[0] + 1) ** 2
    edges_d = np.pi / 2 * np.linspace(0, 1, CELLS[1] + 1)
    theta_h, theta_d = (0.5 * (x[1:] + x[:-1]) for x in (edges_h, edges_d))
    phi_d = np.pi * (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS
    h, d, p = np.meshgrid(theta_h, theta_d, phi_d, indexing="ij")
    along = np.stack([np.sin(h), np.zeros_like(h), np.cos(h)], axis=-1) * np.cos(d)[..., None]
    across = np.stack([np.cos(h) * np.cos(p), np.sin(p), -np.sin(h) * np.cos(p)], axis=-1) * np.sin(d)[..., None]
    wi, wo = along + across, along - across
    above = (wi[..., 2] > 0) & (wo[..., 2] > 0)
    sums = np.zeros((2, *h.shape))
    f, g = (b.evaluate_vectors(wi[above], wo[above]) for b in (reference, candidate))
    with np.errstate(over="ignore", invalid="ignore"):
        sums[0, above], sums[1, above] = np.abs(g - f).sum(axis=-1), np.abs(f).sum(axis=-1)
    wrong, there = sums.sum(axis=-1)
    # beside a matt surface of this albedo: what is much darker than that can't be seen to be wrong
    floor = max(float(np.mean(reference.albedo(0.0) - reference.delta_reflectance(0.0))), 0.0) / np.pi
    count = above.sum(axis=-1) * len(reference.channels)
    beside = there + floor * count
    error = np.divide(wrong, beside, out=np.full(there.shape, np.nan), where=beside > 0)
    return ErrorMap(edges_h, edges_d, error)
