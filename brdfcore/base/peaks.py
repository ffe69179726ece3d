"""Peaks of f_r over the outgoing hemisphere, wherever they are: a scan, and a search about each local maximum."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI

Float64Array = npt.NDArray[np.float64]
#: f_r of (theta_i, theta_o, delta_phi), each (n,), summed over channels: (n,).
Scalar = Callable[[Float64Array, Float64Array, Float64Array], Float64Array]

#: Steps of the scan, in theta_o over a quarter turn and delta_phi over half a turn: 2 degrees.
_POLAR, _AZIMUTHS = 45, 90
#: A local maximum counts as a peak where it is this many times the mean of the points three steps away.
_PROMINENCE = 2.0
#: Peaks kept, the highest first.
MOST = 4
#: A maximum this close to the mirror direction or the light, rad, is theirs: those are looked at in any case.
_KNOWN = float(np.radians(4.0))
#: Share of its largest value by which f_r may change beside the light without a lobe there.
_BESIDE = 0.1
#: Halvings of the step of the search: from a degree to 1e-9 rad.
_HALVINGS = 24


def peaks(f: Scalar, theta_i: float, *, bilateral: bool) -> Float64Array:
    """(k, 2), k <= `MOST`: theta_o and delta_phi of the peaks of f_r cos theta_o away from mirror direction and light.

    Found are lobes that stand out of their surroundings on a grid of 2 degrees: those a degree wide, and narrower ones
    with long tails. A lobe narrower than the grid and without tails is not.
    """
    azimuths = _AZIMUTHS * (1 if bilateral else 2)
    theta = np.linspace(0.5, _POLAR - 0.5, _POLAR) * (HALF_PI / _POLAR)
    phi = np.linspace(0.5, azimuths - 0.5, azimuths) * (np.pi / _AZIMUTHS)
    at_theta, at_phi = np.meshgrid(theta, phi, indexing="ij")
    values = _weighed(f, theta_i, at_theta.reshape(-1), at_phi.reshape(-1)).reshape(_POLAR, azimuths)
    mode = "symmetric" if bilateral else "wrap"
    wide = np.pad(np.pad(values, ((3, 3), (0, 0)), mode="symmetric"), ((0, 0), (3, 3)), mode=mode)  # type: ignore[call-overload]
    shifted = [wide[3 + i : 3 + i + _POLAR, 3 + j : 3 + j + azimuths] for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    around = [wide[3 + i : 3 + i + _POLAR, 3 + j : 3 + j + azimuths] for i in (-3, 0, 3) for j in (-3, 0, 3) if i or j]
    high = (values >= np.max(shifted, axis=0)) & (values > _PROMINENCE * np.mean(around, axis=0))
    for centre in (0.0, np.pi):
        half = np.sin(0.5 * (at_theta - theta_i)) ** 2 + np.sin(at_theta) * np.sin(theta_i) * (
            np.sin(0.5 * (at_phi - centre)) ** 2
        )
        high &= half > np.sin(0.5 * _KNOWN) ** 2
    found = np.argwhere(high)
    if not found.size:
        return np.zeros((0, 2))
    found = found[np.argsort(-values[high])[:MOST]]
    return _climbed(f, theta_i, theta[found[:, 0]], phi[found[:, 1]])


def changes_beside(f: Scalar, theta_i: float) -> bool:
    """Whether f_r has a lobe about the light: it differs by more than a tenth between 1e-9 and .05 rad from it."""
    r = np.geomspace(1e-9, 0.05, 40)
    inwards = -1.0 if theta_i > 0.1 else 1.0
    values = f(np.full(r.size, theta_i), np.clip(theta_i + inwards * r, 0.0, HALF_PI), np.zeros(r.size))
    size = np.abs(values[np.isfinite(values)])
    return bool(size.size and size.max() - size.min() > _BESIDE * size.max())


def _weighed(f: Scalar, theta_i: float, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    values = np.abs(f(np.full(theta_o.size, theta_i), theta_o, delta_phi)) * np.cos(theta_o)
    return np.where(np.isfinite(values), values, 0.0)


def _climbed(f: Scalar, theta_i: float, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    """The maxima next to the given directions, all of them at once, by a search on shrinking 3 x 3 grids."""
    step = np.full(theta_o.size, HALF_PI / _POLAR)
    offsets = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)], np.float64)
    for _ in range(3 * _HALVINGS):
        theta = np.clip(theta_o[:, None] + step[:, None] * offsets[:, 0], 0.0, HALF_PI)
        phi = delta_phi[:, None] + (step / np.maximum(np.sin(theta_o), 1e-3))[:, None] * offsets[:, 1]
        values = _weighed(f, theta_i, theta.reshape(-1), phi.reshape(-1)).reshape(theta.shape)
        # a plateau stays where it is
        best = np.where(values.max(axis=1) > values[:, 4], values.argmax(axis=1), 4)
        row = np.arange(theta_o.size)
        theta_o, delta_phi = theta[row, best], phi[row, best]
        step = np.where(best == 4, 0.5 * step, step)
        if (step < 1e-9).all():
            break
    return np.stack([theta_o, np.mod(delta_phi + np.pi, 2 * np.pi) - np.pi], axis=1)
