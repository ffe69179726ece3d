"""Small RGL files made for tests, and a slow float64 evaluation of the published definition."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Fields = dict[str, npt.NDArray[Any]]


def fields_of(
    *, thetas: int = 3, normals: tuple[int, int] = (6, 5), samples: int = 4, wavelengths: int = 0, seed: int = 1
) -> Fields:
    """Fields of an isotropic file in the order of the real ones, random but well-formed; 0 wavelengths is RGB."""
    rng = np.random.default_rng(seed)
    n_y, n_x = normals
    channels = wavelengths or 3
    theta_i = np.linspace(0, np.float32(np.pi / 2), thetas).astype(np.float32)
    bits = thetas * samples * samples
    fields: Fields = {
        "version": np.array([1, 0], np.uint32),
        "description": np.frombuffer("synthetic, märchenhaft".encode(), np.uint8),
        "phi_i": np.zeros(1, np.float32),
        "theta_i": theta_i,
        "sigma": np.tile(np.linspace(1, 0.3, 7, dtype=np.float32), (2, 1)),
        "ndf": np.tile(np.linspace(3, 0, 9, dtype=np.float32), (2, 1)),
        "vndf": rng.uniform(0.1, 1, (1, thetas, n_y, n_x)).astype(np.float32),
        "luminance": rng.uniform(0, 1, (1, thetas, samples, samples)).astype(np.float32),
    }
    values = rng.uniform(0.05, 1, (1, thetas, channels, samples, samples)).astype(np.float32)
    if wavelengths:
        fields["wavelengths"] = np.linspace(400, 700, wavelengths, dtype=np.float32)
    fields["spectra" if wavelengths else "rgb"] = values
    fields["jacobian"] = np.ones(1, np.uint8)
    fields["valid"] = np.full(-(-bits // 8), 255, np.uint8)
    return fields


def identity_fields() -> Fields:
    """A file whose f_r cos(theta_o) is (u(theta_h), u(phi_h), 1): constant densities make the warp the identity, and
    two samples an axis hold a linear function exactly."""
    fields = fields_of(thetas=2, normals=(3, 3), samples=2)
    fields["vndf"] = np.ones_like(fields["vndf"])
    x, y = np.meshgrid([0.0, 1.0], [0.0, 1.0])
    fields["rgb"] = np.tile(np.stack([x, y, np.ones((2, 2))]), (1, 2, 1, 1, 1)).astype(np.float32)
    fields["jacobian"] = np.zeros(1, np.uint8)
    return fields


def published_value(
    fields: Mapping[str, npt.NDArray[Any]],
    theta_i: npt.NDArray[np.float64],
    theta_o: npt.NDArray[np.float64],
    delta_phi: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """f_r (n, C) by the definition of Dupuy and Jakob (2018), one point at a time, in float64 throughout."""
    values = fields["spectra" if "wavelengths" in fields else "rgb"][0].astype(np.float64)
    density = fields["vndf"][0].astype(np.float64)
    n_y, n_x = density.shape[1:]
    row_cell = 0.5 * (density[:, :, 1:] + density[:, :, :-1]) / (n_x - 1)
    column_cell = 0.5 * (row_cell.sum(2)[:, 1:] + row_cell.sum(2)[:, :-1]) / (n_y - 1)
    nodes = fields["theta_i"].astype(np.float64)
    ndf, sigma = (fields[n].astype(np.float64) for n in ("ndf", "sigma"))
    out = np.empty((theta_i.size, values.shape[1]))

    def place(u: float, n: int) -> tuple[int, float]:
        x = min(max(u, 0.0), 1.0) * (n - 1)
        i = min(int(x), n - 2)
        return i, x - i

    def bilinear(table: npt.NDArray[np.float64], u: float, v: float) -> npt.NDArray[np.float64]:
        i, s = place(u, table.shape[-1])
        j, t = place(v, table.shape[-2])
        low = table[..., j, i] * (1 - s) + table[..., j, i + 1] * s
        high = table[..., j + 1, i] * (1 - s) + table[..., j + 1, i + 1] * s
        return np.asarray(low * (1 - t) + high * t)

    for n, (a, b, c) in enumerate(zip(theta_i, theta_o, delta_phi, strict=True)):
        wi = np.array([np.sin(a), 0, np.cos(a)])
        wo = np.array([np.sin(b) * np.cos(c), np.sin(b) * np.sin(c), np.cos(b)])
        h = wi + wo
        u = np.sqrt(2 / np.pi * np.arctan2(np.hypot(h[0], h[1]), h[2]))
        v = (np.arctan2(h[1], h[0]) + np.pi) / (2 * np.pi)
        k = min(max(int(np.searchsorted(nodes, a)) - 1, 0), nodes.size - 2)
        w = min(max((a - nodes[k]) / (nodes[k + 1] - nodes[k]), 0.0), 1.0)
        i, s = place(u, n_x)
        j, t = place(v, n_y)
        conditional = marginal = weight = 0.0
        whole = 0.0
        for m, share in ((k, 1 - w), (k + 1, w)):
            total = column_cell[m].sum()
            rows = row_cell[m].sum(1)
            for line, part in ((j, 1 - t), (j + 1, t)):
                d = density[m, line]
                inner = row_cell[m, line, :i].sum() + s * (d[i] + 0.5 * s * (d[i + 1] - d[i])) / (n_x - 1)
                conditional += share * part * inner / total
                whole += share * part * rows[line] / total
            inner = column_cell[m, :j].sum() + t * (rows[j] + 0.5 * t * (rows[j + 1] - rows[j])) / (n_y - 1)
            marginal += share * inner / total
            weight += share
        square = (conditional / whole, marginal)
        sample = bilinear(values[k], *square) * (1 - w) + bilinear(values[k + 1], *square) * w
        if fields["jacobian"][0]:
            sample = sample * bilinear(ndf, u, v) / (4 * bilinear(sigma, np.sqrt(2 * a / np.pi), 0.5))
        out[n] = sample / np.cos(b)
    return out
