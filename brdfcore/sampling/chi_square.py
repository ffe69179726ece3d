"""Whether directions were drawn with the density that is said: Pearson's chi-square test."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf

Float64Array = npt.NDArray[np.float64]


def chi_square(b: Brdf, wi: Float64Array, draws: int, wo: Float64Array) -> tuple[float, int]:
    """(statistic, degrees of freedom) of half of the draws against the integral of `pdf` over cells of the half vector:
    12 quantiles of the other half along its polar angle, 10 turns, 96 x 16 points each; the rest is one cell."""
    unit = wi / np.linalg.norm(wi)
    x = np.array([unit[0], unit[1], 0.0])
    x = x / np.linalg.norm(x)
    y = np.array([-x[1], x[0], 0.0])

    def half(w: Float64Array) -> tuple[Float64Array, Float64Array]:
        h = w + unit
        h /= np.linalg.norm(h, axis=-1, keepdims=True)
        # the square of the sine of half the angle: even in solid angle
        return 0.5 * (h @ x) ** 2 / (1 + h[..., 2]) + 0.5 * (h @ y) ** 2 / (1 + h[..., 2]), np.arctan2(h @ y, h @ x)

    z, phi = half(wo)
    edges = np.concatenate([[0.0], np.quantile(z[: len(z) // 2], np.linspace(0, 1, 13)[1:-1])])
    edges = np.unique(edges)
    turns = np.linspace(-np.pi, np.pi, 11)
    found = np.histogram2d(z[len(z) // 2 :], phi[len(z) // 2 :], [edges, turns])[0]
    g, around = (np.arange(96) + 0.5) / 96, (np.arange(16) + 0.5) / 16
    # a cell that spans decades is walked in steps that grow with z, its points weighed by them
    spans = (edges[:-1] > 0) & (edges[1:] > 2 * edges[:-1])
    low, growth = np.maximum(edges[:-1, None], 1e-300), np.log(edges[1:, None] / np.maximum(edges[:-1, None], 1e-300))
    even = edges[:-1, None] + np.diff(edges)[:, None] * g
    at_z = np.where(spans[:, None], low * np.exp(growth * g), even)
    share = np.where(spans[:, None], at_z * growth / np.diff(edges)[:, None], 1.0) + 0 * g
    at_z[0], share[0] = edges[1] * g**4, 4 * g**3  # the first begins at 0, and a lobe's tip may be far smaller
    at_z = at_z.reshape(-1)
    at_p = (turns[:-1, None] + np.diff(turns)[:, None] * around).reshape(-1)
    zz, pp = np.meshgrid(at_z, at_p, indexing="ij")
    s = 2 * np.sqrt(zz * (1 - zz))
    h = s[..., None] * (np.cos(pp)[..., None] * x + np.sin(pp)[..., None] * y) + (1 - 2 * zz)[..., None] * [0, 0, 1.0]
    dot = h @ unit
    w = 2 * dot[..., None] * h - unit
    density = np.zeros(zz.shape)
    above = (dot > 0) & (w[..., 2] > 0)
    density[above] = b.pdf(unit, w[above]) * 8 * dot[above]
    cells = (edges.size - 1, g.size, turns.size - 1, around.size)
    areas = np.diff(edges)[:, None] * np.diff(turns)[None]
    expected = np.einsum("ikjl,ik->ij", density.reshape(cells), share) / (g.size * around.size) * areas
    expected *= draws / len(wo)
    total = len(z) - len(z) // 2
    expected *= total  # of those drawn from the regular part
    # cells across an edge of the density (the horizon) are integrated badly: they are left out with the small ones
    smooth = (density.reshape(cells).min(axis=(1, 3)) > 0) & (expected > 20)
    left = total - expected[smooth].sum(), total - found[smooth].sum()
    statistic = float((((found - expected) ** 2)[smooth] / expected[smooth]).sum())
    if left[0] > 20:
        statistic += float((left[1] - left[0]) ** 2 / left[0])
    return statistic, int(smooth.sum())
