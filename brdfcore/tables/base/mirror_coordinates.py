"""Coordinates about the mirror direction of wi: azimuth and angular distance, those of goniometer files."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]

#: Distances are spaced evenly below this, rad, and geometrically above; half the finest lobe that such a table is for.
INNER = 0.002
#: Cosines below this count as this much where slices are weighed by them: 2.9 degrees above the horizon.
LEAST_COSINE = 0.05
#: Rounding of a direction that lies in the horizon, in its cosine.
HORIZON_SLACK = 1e-9


def about_mirror(
    theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """(azimuth in [-pi, pi], distance) of wo about the mirror direction of wi.

    In the frame of S, e0 towards the normal and e1 = S x e0: with e = delta_phi - pi,
    x = sin(theta_i - theta_o) + 2 c_i s_o sin^2(e/2), y = -s_o sin e,
    z = cos(theta_i - theta_o) - 2 s_i s_o sin^2(e/2): the sums cancel nowhere near the mirror direction, where
    c_i s_o cos(delta_phi) + s_i c_o would.
    """
    s_i, c_i = np.sin(theta_i), np.cos(theta_i)
    s_o = np.sin(theta_o)
    e = np.where(delta_phi < 0, delta_phi + np.pi, delta_phi - np.pi)
    turn = 2 * np.sin(0.5 * e) ** 2
    x = np.sin(theta_i - theta_o) + c_i * s_o * turn
    y = -s_o * np.sin(e)
    z = np.cos(theta_i - theta_o) - s_i * s_o * turn
    return np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)


def node_directions(
    theta_i: Float64Array, azimuth: Float64Array, radial: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """The inverse of `about_mirror` at every node, each (K, A, R); theta_o up to pi, delta_phi in [-pi, pi]."""
    i, a, r = np.meshgrid(theta_i, azimuth, radial, indexing="ij")
    along, across, out = np.sin(r) * np.cos(a), np.sin(r) * np.sin(a), np.cos(r)
    x = np.cos(i) * along - np.sin(i) * out
    z = np.sin(i) * along + np.cos(i) * out
    theta_o = np.arctan2(np.hypot(x, across), z)
    # where wo is the normal, or wi is, up to rounding, delta_phi has no meaning
    delta_phi = np.where(theta_o > 1e-12, np.arctan2(across, x), 0.0)
    return i, theta_o, delta_phi


def above_horizon(
    theta_i: Float64Array, azimuth: Float64Array, radial: Float64Array, *, inset: float = -HORIZON_SLACK
) -> npt.NDArray[np.bool_]:
    """(K, A, R): whether a node's wo is above the horizon by `inset`, rad; by default it may lie in it."""
    return np.asarray(np.cos(node_directions(theta_i, azimuth, radial)[1]) >= np.sin(inset))


def default_nodes(shape: tuple[int, int, int], bilateral: bool) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Nodes of theta_i, azimuth and distance: theta_i denser towards the horizon, distance towards 0."""
    n_i, n_a, n_r = shape
    u = np.linspace(0, 1, n_i)
    theta_i = np.radians(89.0) * (1.6 * u - 0.6 * u**2.5)
    azimuth = np.linspace(0, np.pi if bilateral else 2 * np.pi, n_a)
    radial = INNER * np.sinh(np.linspace(0, np.arcsinh(np.pi / INNER), n_r))
    radial[-1] = np.pi
    return theta_i, azimuth, radial


def slice_cosines(theta_i: Float64Array, azimuth: Float64Array, radial: Float64Array) -> Float64Array:
    """c_i c_o of the direction at (azimuth, radial) about the mirror direction of theta_i, each at least the least."""
    c_i, s_i = np.cos(theta_i), np.sin(theta_i)
    c_o = c_i * np.cos(radial) + s_i * np.sin(radial) * np.cos(azimuth)
    return np.asarray(np.maximum(c_i, LEAST_COSINE) * np.maximum(c_o, LEAST_COSINE))
