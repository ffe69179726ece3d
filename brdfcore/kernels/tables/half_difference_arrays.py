"""The look-ups of `half_difference` and `lobe_grid` over the array-API standard: any library, with derivatives.

Coordinates are those of `kernels.tables.half_coordinates` and `kernels.tables.lobe_grid`. Nodes are numbers in units:

    values (n_h, n_d, n_p, C)  1/sr, but for guide and K
    guide_h, guide_d           exponents of 2
    map_h, map_d, map_p        node positions

and answers are NaN outside the plain domain (from angles), 0 below the horizon (from vectors).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from brdfcore.kernels.tables.array_steps import (
    Pair,
    along,
    at_least,
    at_most,
    beside,
    cell,
    in_domain,
    index_type,
    limits,
    pair_of_angles,
    root,
    taken,
    trilinear,
    unit_vectors,
)

#: Exponents that `_power` answers to.
_MOST_EXPONENT = 126


@dataclass(frozen=True)
class HalfSettings:
    """What a table is beside its nodes.

    lobe        coordinates of `lobe_grid`; else those of `half_difference`.
    centre      what u is taken about: 0 the half vector, 1 the mirror direction, 2 the light (lobe only).
    octaves_u, octaves_w  (first, last, steps an octave) of guide and map over u and w.
    steps_z     of the map of z, a unit; as the kernels have it, a little short of a whole number.
    factor      k0 .. k5 of K.
    """

    lobe: bool
    centre: int
    octaves_u: tuple[int, int, int]
    octaves_w: tuple[int, int, int]
    steps_z: float
    factor: tuple[float, ...]
    bilateral: bool
    reciprocal: bool


def from_angles(
    xp: Any, theta_i: Any, theta_o: Any, delta_phi: Any, nodes: dict[str, Any], settings: HalfSettings
) -> Any:
    """f_r (N, C) at angles (N,)."""
    inside, a, b, c = in_domain(xp, theta_i, theta_o, delta_phi)
    p = pair_of_angles(xp, a, b, c)
    u, w, x, up = (_lobe if settings.lobe else _half)(xp, p, settings.centre)
    z = _diamond(xp, up, x, p.backward, settings)
    f = _look_up(xp, u, w, z, _growth(xp, p.cos_i, p.cos_o, settings.factor), nodes, settings)
    return xp.where(inside[:, None], f, xp.full_like(f, xp.nan))


def from_vectors(xp: Any, wi: Any, wo: Any, nodes: dict[str, Any], settings: HalfSettings) -> Any:
    """f_r (N, C) of vectors (N, 3)."""
    v = unit_vectors(xp, wi, wo)
    (ix, iy, iz), oz, apart = v.wi, v.wo[2], v.difference[2]
    hx, hy, _ = v.difference if settings.centre == 2 else v.sum
    across, total = hx * hx + hy * hy, iz + oz
    chord = apart * apart + across
    u = 0.25 * chord if settings.centre else across * (1 / total) ** 2
    if settings.lobe:
        w = iz / (1 + root(xp, ix * ix + iy * iy))
        x = apart + 0.5 * iz * chord if settings.centre else hx * ix + hy * iy
    else:
        w = at_most(xp, 0.25 * (total * total + across), 1.0)
        x = apart * xp.sqrt(w)
    cross = ix * hy - iy * hx
    z = _diamond(xp, xp.abs(cross), x, cross < 0, settings)
    f = _look_up(xp, u, w, z, _growth(xp, iz, oz, settings.factor), nodes, settings)
    f = xp.where(v.above[:, None], f, xp.zeros_like(f))
    return xp.where(v.usable[:, None], f, xp.full_like(f, xp.nan))


def _half(xp: Any, p: Pair, mirror: int) -> tuple[Any, Any, Any, Any]:
    """u, w, and what is along and across for z, in half/difference coordinates."""
    s = 0.5 * (p.cos_i + p.cos_o)
    tan_b, cos_a, product = p.sin_b / p.cos_b, s / p.cos_b, p.sin_i * p.sin_o
    near = product * p.cos_half**2
    w = at_most(xp, cos_a * cos_a + near, 1.0)
    u = p.sin_b**2 + near if mirror else tan_b**2 + product * (p.cos_half * (1 / s)) ** 2
    return u, w, (p.sin_i + p.sin_o) * tan_b * xp.sqrt(w), 2 * product * (p.sin_half * p.cos_half)


def _lobe(xp: Any, p: Pair, centre: int) -> tuple[Any, Any, Any, Any]:
    """As `_half`, in the coordinates of `lobe_grid`."""
    near = p.sin_half if centre == 2 else p.cos_half
    if centre:
        u = p.sin_b**2 + p.sin_i * p.sin_o * near**2
        x = p.sin_b * p.cos_b + p.cos_i * p.sin_o * near**2
    else:
        s = 0.5 * (p.cos_i + p.cos_o)
        u = (p.sin_b / p.cos_b) ** 2 + p.sin_i * p.sin_o * (near * (1 / s)) ** 2
        x = p.sin_b * (s / p.cos_b) + p.sin_o * near**2
    return u, p.cos_i / (1 + p.sin_i), x, p.sin_o * (p.sin_half * p.cos_half)


def _diamond(xp: Any, up: Any, x: Any, backward: Any, settings: HalfSettings) -> Any:
    """z of an azimuth whose sine is `up` and whose cosine is x, up to a common factor; 0/0 is 90 degrees."""
    up = at_least(xp, up, 0.0)
    both = xp.abs(x) + up
    some = both > limits(xp, both).least
    one = xp.ones_like(both)
    # a product: a quotient's derivative begins with the divisor's square, and ends in inf times 0
    z = xp.where(some, up * (1 / xp.where(some, both, one)), one)
    if settings.lobe or not settings.reciprocal:
        z = xp.where(x < 0, 2 - z, z)
    return z if settings.bilateral else xp.where(backward, -z, z)


def _growth(xp: Any, cos_i: Any, cos_o: Any, k: tuple[float, ...]) -> Any:
    """K = (k0 c_i + k1 c_o + k2) / (k3 c_i c_o + k4 (c_i + c_o) + k5)."""
    if k[3] and not (k[2] or k[4] or k[5]):  # c_i c_o at the horizon has no square in float32
        return (k[0] / k[3]) / cos_o + (k[1] / k[3]) / cos_i
    return (k[0] * cos_i + k[1] * cos_o + k[2]) / (k[3] * cos_i * cos_o + k[4] * (cos_i + cos_o) + k[5])


def _look_up(xp: Any, u: Any, w: Any, z: Any, k: Any, nodes: dict[str, Any], settings: HalfSettings) -> Any:
    values, shift = nodes["values"], 0.0 if settings.bilateral else 2.0
    step, part = _step(xp, u, settings.octaves_u)
    exponent = along(xp, nodes["guide_h"], step, part)
    places = [along(xp, nodes["map_h"], step, part)]
    step, part = _step(xp, w, settings.octaves_w)
    exponent = exponent + along(xp, nodes["guide_d"], step, part)
    places.append(along(xp, nodes["map_d"], step, part))
    step, part = cell(xp, (z + shift) * settings.steps_z, nodes["map_p"].shape[0])
    places.append(along(xp, nodes["map_p"], step, part))
    cells = [cell(xp, place, n) for place, n in zip(places, values.shape[:3])]
    found = trilinear(xp, values, *zip(*cells))
    return found * (_power(xp, exponent) * k)[:, None]


def _step(xp: Any, x: Any, octaves: tuple[int, int, int]) -> tuple[Any, Any]:
    """Step of a map that is uniform within octaves, and the part of it: a floating point number's own bits."""
    first, last, steps = octaves
    x = at_most(xp, at_least(xp, x, 2.0**first), 2.0**last)
    octave = xp.clip(xp.floor(xp.log2(x)) - first, 0.0, float(last - first - 1))
    octave = xp.astype(octave, index_type(xp))
    # from a table, as powers by a library are not exact; where the logarithm is off by one, at an octave's ends, the
    # part is as far below 0 or above 1
    scale = taken(xp, _powers(xp, x, 1 - last, -first), (last - first - 1) - octave)
    step, part = cell(xp, (x * scale - 1) * float(steps), steps + 1)
    return step + octave * steps, part


def _power(xp: Any, exponent: Any) -> Any:
    """2^exponent, |exponent| <= 126: the whole part exactly, as its product with ln 2 would round."""
    whole = xp.clip(xp.floor(exponent + 0.5), -float(_MOST_EXPONENT), float(_MOST_EXPONENT))
    powers = _powers(xp, exponent, -_MOST_EXPONENT, _MOST_EXPONENT)
    scale = taken(xp, powers, xp.astype(whole, index_type(xp)) + _MOST_EXPONENT)
    return scale * xp.exp((exponent - whole) * float(np.log(2)))


def _powers(xp: Any, like: Any, first: int, last: int) -> Any:
    """2^first .. 2^last."""
    return xp.asarray([2.0**k for k in range(first, last + 1)], **beside(xp, like))
