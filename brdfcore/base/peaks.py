"""Peaks of f_r over the outgoing hemisphere, wherever they are: a scan, and a search about each local maximum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI

Float64Array = npt.NDArray[np.float64]
#: f_r of (theta_i, theta_o, delta_phi), each (n,), summed over channels: (n,).
Scalar = Callable[[Float64Array, Float64Array, Float64Array], Float64Array]

#: Cells of the scan, in theta_o over a quarter turn and delta_phi over half a turn: 2 degrees. Each is looked at in
#: FINER^2 places, 2/3 of a degree apart.
_POLAR, _AZIMUTHS, FINER = 45, 90, 3
#: Width, rad, of the narrowest lobe without tails that this finds, if its energy is that of a Lambertian of a tenth:
#: exp(-(r/w)^2) stands out at the .6 degrees that the nearest place may be away. Narrower ones may be missed.
FOUND_FROM = 0.0035
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


def smooth_elsewhere(b: Any) -> bool:
    """Whether a BRDF can't have a lobe narrower than a degree away from the mirror direction and the light: of what
    only answers nothing is known."""
    return bool(b._analytic or b._smooth_elsewhere)


def peaks(
    f: Scalar, theta_i: float, *, bilateral: bool, finer: int = FINER, smooth: Scalar | None = None
) -> Float64Array:
    """(k, 2), k <= `MOST`: theta_o and delta_phi of the peaks of f_r cos theta_o away from mirror direction and light.

    Found are lobes that stand out of their surroundings: those of `FOUND_FROM`, and narrower ones with long tails. With
    `finer` = 1 each cell of 2 degrees is looked at once, which does for what has no lobe narrower than a degree there;
    `smooth` is such a part, added to f.
    """
    azimuths = _AZIMUTHS * (1 if bilateral else 2)
    theta = (np.arange(_POLAR * finer) + 0.5) * (HALF_PI / (_POLAR * finer))
    phi = (np.arange(azimuths * finer) + 0.5) * (np.pi / (_AZIMUTHS * finer))
    at_theta, at_phi = _blocks(np.repeat(theta, phi.size), finer), _blocks(np.tile(phi, theta.size), finer)
    looked_at = _weighed(f, theta_i, at_theta.reshape(-1), at_phi.reshape(-1)).reshape(at_theta.shape)
    highest = looked_at.argmax(axis=1)[:, None]
    values, at_theta, at_phi = (
        np.take_along_axis(x, highest, axis=1).reshape(_POLAR, azimuths) for x in (looked_at, at_theta, at_phi)
    )
    if smooth is not None:
        values = values + _weighed(smooth, theta_i, at_theta.reshape(-1), at_phi.reshape(-1)).reshape(values.shape)
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
    if not high.any():
        return np.zeros((0, 2))
    order = np.argsort(-values[high])[:MOST]
    whole = f if smooth is None else lambda *angles: f(*angles) + smooth(*angles)
    return _climbed(whole, theta_i, at_theta[high][order], at_phi[high][order])


def changes_beside(f: Scalar, theta_i: float) -> bool:
    """Whether f_r has a lobe about the light: it differs by more than a tenth between 1e-9 and .05 rad from it."""
    r = np.geomspace(1e-9, 0.05, 40)
    inwards = -1.0 if theta_i > 0.1 else 1.0
    values = f(np.full(r.size, theta_i), np.clip(theta_i + inwards * r, 0.0, HALF_PI), np.zeros(r.size))
    size = np.abs(values[np.isfinite(values)])
    return bool(size.size and size.max() - size.min() > _BESIDE * size.max())


def _blocks(x: Float64Array, finer: int) -> Float64Array:
    """Of a grid, flat, its cells: (cells, finer^2)."""
    return x.reshape(_POLAR, finer, -1, finer).transpose(0, 2, 1, 3).reshape(-1, finer * finer)


def _weighed(f: Scalar, theta_i: float, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    values = np.abs(f(np.full(theta_o.size, theta_i), theta_o, delta_phi)) * np.cos(theta_o)
    return np.where(np.isfinite(values), values, 0.0)


def _climbed(f: Scalar, theta_i: float, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    """The maxima next to the given directions, all of them at once, by a search on shrinking 3 x 3 grids."""
    step = np.full(theta_o.size, HALF_PI / (_POLAR * FINER))
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
