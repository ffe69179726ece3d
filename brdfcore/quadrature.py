"""Nodes and weights: composite Gauss-Legendre and a hemisphere rule graded towards the mirror direction."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from brdfcore.geometry import horizon_theta_h, outgoing_from_half

Float64Array = npt.NDArray[np.float64]

#: theta_h / horizon at the panel edges of `hemisphere_rule`: from a lobe of roughness 1e-5 to the horizon.
_GRADED = np.concatenate([[0.0], np.geomspace(1e-6, 1.0, 13)])


@lru_cache(maxsize=32)
def _gauss(n: int) -> tuple[Float64Array, Float64Array]:
    x, w = np.polynomial.legendre.leggauss(n)
    x.flags.writeable = w.flags.writeable = False
    return x, w


def gauss_legendre(n: int, start: float = 0.0, stop: float = 1.0) -> tuple[Float64Array, Float64Array]:
    """n-point Gauss-Legendre nodes and weights on [start, stop]."""
    x, w = _gauss(n)
    return 0.5 * (stop - start) * (x + 1) + start, 0.5 * (stop - start) * w


def composite(edges: npt.ArrayLike, n: int) -> tuple[Float64Array, Float64Array]:
    """n-point Gauss-Legendre on each panel between consecutive `edges`; nodes ascending.

    Panels of at most 64 points: one rule of 12,000 points does not finish in numpy.
    """
    e = np.asarray(edges, dtype=np.float64)
    x, w = _gauss(n)
    width = np.diff(e)
    nodes = e[:-1, None] + 0.5 * width[:, None] * (x + 1)
    return nodes.reshape(-1), (0.5 * width[:, None] * w).reshape(-1)


def hemisphere_rule(
    theta_i: float, *, points: int = 12, azimuths: int = 64, bilateral: bool = False
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Quadrature over the outgoing hemisphere: (theta_o, delta_phi, weight), flat float64 arrays.

    sum_k weight_k f(theta_i, theta_o_k, delta_phi_k) cos(theta_o_k) ~ int f cos_o dwo, with dwo = 4 (wi.h) dwh.
    Integrated over the half vector: Gauss-Legendre in theta_h on panels whose widths grow geometrically from
    1e-6 of the horizon, so a lobe of any roughness above 1e-5 is resolved, up to the exact horizon for
    that azimuth; equal steps in phi_h (periodic). A bilateral source is integrated over half the circle.
    The mirror direction itself is the pole of the rule: symmetric lobes converge in one azimuth.
    """
    if bilateral:
        phi_h, w_half = composite(np.linspace(0.0, np.pi, 5), max(azimuths // 8, 2))
        w_phi = w_half + w_half
    else:
        phi_h = (np.arange(azimuths, dtype=np.float64) + 0.5) * (2 * np.pi / azimuths)
        w_phi = np.full(azimuths, 2 * np.pi / azimuths, dtype=np.float64)
    u, w_u = composite(_GRADED, points)
    limit = horizon_theta_h(theta_i, phi_h)
    theta_h = (limit[:, None] * u).reshape(-1)
    phi = np.repeat(phi_h, u.size)
    theta_o, delta_phi, dot = outgoing_from_half(theta_i, theta_h, phi)
    weight = (w_phi[:, None] * limit[:, None] * w_u).reshape(-1) * np.sin(theta_h) * 4 * dot
    # the last node before the horizon may land past it by rounding
    return np.minimum(theta_o, np.pi / 2), delta_phi, weight
