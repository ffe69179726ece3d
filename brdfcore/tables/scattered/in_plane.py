"""Measurements in the plane of incidence only: what is assumed of f out of it, chosen by what they show within it.

Half/difference coordinates of the plane, theta_h = |theta_o - theta_i|/2 and theta_d = (theta_i + theta_o)/2 on the
mirror side, reach every pair of directions out of it, but f is a function of three angles. Assumed may be

    f          f is one of theta_h and theta_d: exact for diffuse reflection, too much for a metal at grazing angles.
    f_cos_cos  f cos(theta_i) cos(theta_o) is: a microfacet lobe D(theta_h) F(theta_d)/(4 cos cos) without shadowing.
    power      f (cos(theta_i) cos(theta_o))^p is, p in [0, 1] fitted: between those two, as shadowing makes it.
    lobe       f is one of the angle between wo and the mirror direction, and of theta_i.

Fitted and chosen is what the measurements separate best under into a product of a function of each coordinate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]

ASSUMED = ("f", "f_cos_cos", "power", "lobe")
#: Powers p that are tried; the lobe has to separate this much better, since less follows from physics.
_POWERS, _BETTER = tuple(k / 20 for k in range(21)), 0.7
#: Assumptions that separate within this factor of the best, or of this misfit, are not ruled out.
_FACTOR, _NO_BETTER = 3.0, 0.02
#: Knots of the two functions of a product; share of the largest value below which the logarithm tells of noise.
_KNOTS, _LEAST = (14, 6), 1e-5


def off_mirror(theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    """Angle between wo and the mirror image of wi, rad: 0 at theta_o = theta_i, delta_phi = pi."""
    square = np.sin(0.5 * (theta_i - theta_o)) ** 2
    square = square + np.sin(theta_i) * np.sin(theta_o) * np.cos(0.5 * delta_phi) ** 2
    return np.asarray(2 * np.arcsin(np.sqrt(np.clip(square, 0, 1))))


class Plane(NamedTuple):
    """An assumption: its name, and the power p of cos(theta_i) cos(theta_o)."""

    name: str
    power: float


def assumption(angles: Float64Array, values: Float64Array, asked: str = "auto") -> Plane:
    """What fits measurements at `angles` (n, 3) in the plane with `values` (n, channels) best, or what is `asked`."""
    if asked in ("f", "f_cos_cos"):
        return Plane(asked, float(asked == "f_cos_cos"))
    if asked == "lobe":
        return Plane("lobe", 0.0)
    found = misfits(angles, values)
    power = min(_POWERS, key=lambda p: found[p])
    if asked == "auto" and found["lobe"] < _BETTER * found[power]:
        return Plane("lobe", 0.0)
    return Plane({0.0: "f", 1.0: "f_cos_cos"}.get(power, "power"), float(power))


def misfits(angles: Float64Array, values: Float64Array) -> dict[float | str, float]:
    """{power or "lobe": rms difference in ln f from the best product, weighted cos(theta_o)}, of the channels' mean;
    all equal where fewer than 24 values stand above the noise."""
    f = values.mean(axis=1)
    used = f > _LEAST * float(f.max())
    if used.sum() < 24:
        return dict.fromkeys((*_POWERS, "lobe"), 1.0)
    theta_i, theta_o, delta_phi = angles[used].T
    log, weight = np.log(f[used]), np.cos(theta_o)
    signed = np.where(np.cos(delta_phi) <= 0, theta_o, -theta_o)
    halves = 0.5 * np.abs(signed - theta_i), 0.5 * np.abs(signed + theta_i)
    cosines = np.log(np.maximum(np.cos(theta_i), 1e-3) * np.maximum(np.cos(theta_o), 1e-3))
    found: dict[float | str, float] = {p: _misfit(log + p * cosines, *halves, weight) for p in _POWERS}
    found["lobe"] = _misfit(log, 0.5 * off_mirror(theta_i, theta_o, delta_phi), theta_i, weight)
    return found


def not_ruled_out(found: dict[float | str, float], chosen: Plane) -> list[Plane]:
    """Of `misfits`, the assumptions that the measurements leave open: `chosen`, the lobe and the outermost powers."""
    own: float | str = "lobe" if chosen.name == "lobe" else chosen.power
    limit = _FACTOR * max(min(found.values()), _NO_BETTER)
    open_ = {k for k, misfit in found.items() if misfit <= limit} | {own}
    powers = [k for k in open_ if not isinstance(k, str)]
    tried = {own, *(k for k in open_ if k == "lobe"), *((min(powers), max(powers)) if powers else ())}
    return [Plane("lobe", 0.0) if isinstance(k, str) else Plane("power", k) for k in sorted(tried, key=str)]


def _misfit(log: Float64Array, lobe: Float64Array, level: Float64Array, weight: Float64Array) -> float:
    scaled = np.arcsinh(lobe / max(float(np.quantile(lobe, 0.1)), 1e-3))
    columns = np.concatenate([_hats(scaled, _KNOTS[0]), _hats(level, _KNOTS[1])[:, 1:]], axis=1)
    root = np.sqrt(weight)[:, None]
    found = np.linalg.lstsq(columns * root, log * root[:, 0], rcond=1e-8)[0]
    return float(np.sqrt(weight @ (columns @ found - log) ** 2 / weight.sum()))


def _hats(x: Float64Array, n: int) -> Float64Array:
    """Piecewise linear functions of x on n even knots over its range, (points, n)."""
    low, high = float(x.min()), float(x.max())
    place = (x - low) / max(high - low, 1e-12) * (n - 1)
    return np.asarray(np.maximum(1 - np.abs(place[:, None] - np.arange(n)), 0))
