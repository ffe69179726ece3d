"""f where a coordinate degenerates: at the normal, where azimuth has no meaning, and at the horizon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.check.findings import Worst
from brdfcore.base.brdf import Brdf
from brdfcore.base.quadrature import composite

Float64Array = npt.NDArray[np.float64]

#: Panels over theta from the normal: a lobe of roughness 1e-6 or more is resolved.
_FROM_NORMAL = 0.5 * np.pi * np.concatenate([[0.0], np.geomspace(1e-6, 1.0, 13)])
_AZIMUTHS = 32
#: Azimuths begin here: no multiple of a node's spacing, so that a table is met between its nodes.
_FIRST_AZIMUTH = 0.0123
#: The fixed angle and the azimuths, degrees, of the rays towards the horizon.
_FIXED, _TURNS = (0.0, 30.0, 60.0, 80.0, 85.0), (0.0, 45.0, 90.0, 135.0, 180.0)
#: Distances from the horizon, degrees, between which the growth of f cos is measured.
_NEAR, _FAR = 1e-6, 1e-3
#: f cos pi below which growth carries no light.
_NOTHING = 1e-9


def azimuth_dependence(b: Brdf) -> tuple[Float64Array, Float64Array, list[Worst]]:
    """(int |f - its mean over delta_phi| cos dw with one direction along the normal, its error, the worst directions).

    The larger of theta_i = 0 and theta_o = 0, (channels,); the error is half the difference between the two halves of
    the azimuths.
    """
    theta, w = composite(_FROM_NORMAL, 6)
    delta_phi = _FIRST_AZIMUTH + np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)
    weight = 2 * np.pi * w * np.sin(theta) * np.cos(theta)
    labels = b.channels.labels()
    found: list[tuple[Float64Array, Float64Array]] = []
    named: list[tuple[float, Worst]] = []
    for normal_is_light in (True, False):
        f = _evaluated(b, normal_is_light, np.zeros(1), theta[:, None], delta_phi)
        off = np.abs(f - f.mean(axis=1, keepdims=True))
        off[off <= 8 * np.finfo(np.float64).eps * np.abs(f)] = 0.0  # the mean's own rounding
        halves = [np.einsum("i,ijc->c", weight, off[:, k::2]) / (0.5 * _AZIMUTHS) for k in (0, 1)]
        found.append((0.5 * (halves[0] + halves[1]), 0.5 * np.abs(halves[0] - halves[1])))
        score = np.where(np.isfinite(off), off, np.inf) * np.cos(theta)[:, None, None]
        i, j, c = (int(x) for x in np.unravel_index(int(score.argmax()), score.shape))
        other, turn = (round(float(np.degrees(x)), 4) for x in (theta[i], delta_phi[j]))
        text = f"f = {f[i, j, c]:.4g}, its mean over delta_phi {f[i, :, c].mean():.4g}"
        named.append((float(score[i, j, c]), _worst(normal_is_light, 0.0, other, turn, labels[c], text)))
    values, errors = (np.stack(x) for x in zip(*found))
    which = values.argmax(axis=0)
    named.sort(key=lambda p: -p[0])
    worst = [place for score, place in named if score > 0.1 * named[0][0]]
    return np.take_along_axis(values, which[None], 0)[0], np.take_along_axis(errors, which[None], 0)[0], worst


@dataclass(frozen=True, slots=True)
class Growth:
    """What happens towards 90 degrees.

    power        largest p with f cos ~ 1/cos^p between a thousandth and a millionth of a degree from the horizon.
    last_degree  reflectance that leaves within a degree of the horizon, worst theta_i, (channels,); `error` of it.
    not_finite   values at exactly 90 degrees that are not finite.
    """

    power: float
    last_degree: Float64Array
    error: float
    not_finite: int
    worst: list[Worst]


def horizon(b: Brdf) -> Growth:
    """f cos_o for theta_o -> 90 degrees at fixed theta_i, and f cos_i for theta_i -> 90 at fixed theta_o."""
    fixed, turns = np.radians(_FIXED)[:, None], np.radians(_TURNS)
    labels = b.channels.labels()
    power, worst = 0.0, []
    for towards_viewer in (True, False):
        scaled = []
        for distance in (_NEAR, _FAR):
            moving = np.radians([90.0 - distance])
            f = _evaluated(b, towards_viewer, fixed, moving, turns)
            scaled.append(np.pi * np.abs(f) * np.cos(moving))
        near, far = scaled
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            p = np.log(near / far) / np.log(_FAR / _NEAR)
        p = np.where(near > _NOTHING, np.where(np.isfinite(p), p, np.inf), 0.0)
        i, j, c = (int(x) for x in np.unravel_index(int(p.argmax()), p.shape))
        if p[i, j, c] > power:
            power = float(p[i, j, c])
            text = f"pi f cos = {far[i, j, c]:.3g} and {near[i, j, c]:.3g}, {_FAR:g} and {_NEAR:g} degrees before"
            worst = [_worst(towards_viewer, _FIXED[i], 90.0, _TURNS[j], labels[c], text)]
    not_finite, where = _at_the_horizon(b)
    last, error = _last_degree(b)
    # growth that is no more than rounding names no direction
    return Growth(power, last, error, not_finite, [*where, *(worst if power > 0.01 else [])][:3])


def _at_the_horizon(b: Brdf) -> tuple[int, list[Worst]]:
    """Values at exactly 90 degrees, of one direction and of both, that are not finite, and the first of them."""
    other = np.radians([*_FIXED, 90.0])
    turns = np.radians(_TURNS)
    count, named = 0, []
    for light in (True, False):
        bad = np.argwhere(~np.isfinite(_evaluated(b, light, np.array([np.pi / 2]), other[:, None], turns)))
        count += len(bad)
        for i, j, c in bad[:1].tolist():
            label = b.channels.labels()[c]
            named.append(_worst(light, 90.0, [*_FIXED, 90.0][i], _TURNS[j], label, "not finite"))
    return count, named


def _evaluated(
    b: Brdf, first_is_light: bool, first: Float64Array, second: Float64Array, delta_phi: Float64Array
) -> Float64Array:
    """f with the light at `first` and the viewer at `second`, or the other way round; float64."""
    theta_i, theta_o = (first, second) if first_is_light else (second, first)
    return b.evaluate(theta_i, theta_o, delta_phi).astype(np.float64)


def _worst(first_is_light: bool, first: float, second: float, delta_phi: float, channel: str, text: str) -> Worst:
    theta_i, theta_o = (first, second) if first_is_light else (second, first)
    return Worst(theta_i, theta_o, delta_phi, channel, f"{channel}: {text}")


def _last_degree(b: Brdf) -> tuple[Float64Array, float]:
    """(int f cos_o dwo over theta_o in [89, 90] degrees, worst of the fixed theta_i, (channels,); its error).

    Panels shrink towards the horizon and towards delta_phi = pi; the error is the change from 4 to 6 nodes on each.
    """
    found = []
    for n in (4, 6):
        below, w = composite(np.radians(np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 5)])), n)
        off, w_off = composite(np.pi * np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 9)]), n)
        delta_phi, w_phi = np.concatenate([np.pi - off, np.pi + off]), np.tile(w_off, 2)
        theta_o = 0.5 * np.pi - below
        f = b.evaluate(np.radians(_FIXED)[:, None, None], theta_o[:, None], delta_phi).astype(np.float64)
        found.append(np.einsum("ijkc,j,k->ic", f, w * np.sin(theta_o) * np.cos(theta_o), w_phi))
    return found[1].max(axis=0), float(np.abs(found[1] - found[0]).max())
