"""Half/difference coordinates of a pair of directions, from angles and from vectors, without inverse trigonometry.

With A = (theta_i + theta_o)/2, B = (theta_i - theta_o)/2, S = (c_i + c_o)/2 = cos A cos B:

    u = tan^2 theta_h = tan^2 B + s_i s_o cos^2(delta_phi/2) / S^2          = (H_x^2 + H_y^2)/H_z^2   in [0, inf)
    w = cos^2 theta_d = S^2 (1 + u)                                         = |H|^2/4                 in [0, 1]
    tan phi_d = s_i s_o |sin delta_phi| / (cos theta_d (c_o - c_i)),        c_o - c_i = 2 sin A sin B
    z = diamond angle of phi_d                                                                        in [0, 2]

The diamond angle |sin|/(|sin| + |cos|), continued by 2 - z past 90 degrees, replaces phi_d: monotone, no arctangent.
z is folded to [0, 1] for a reciprocal table (swapping the directions turns phi_d into pi - phi_d) and carries the
sign of sin(delta_phi), in [-2, 2], for one that is not bilateral.

For lobes around the mirror direction itself, as Phong's, u = sin^2 B + s_i s_o cos^2(delta_phi/2) = sin^2(angle/2),
the angle between viewer and mirror direction, takes the place of tan^2 theta_h (`mirror`): such a lobe has one width
along it and many along theta_h.

Every function comes with the factor K = (k0 c_i + k1 c_o + k2) / (k3 c_i c_o + k4 (c_i + c_o) + k5).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI, FloatArray
from brdfcore.kernels.machine.jit import inline
from brdfcore.kernels.machine.vectorised import fma, fused_sin

Float64Array = npt.NDArray[np.float64]

#: cos of the float64 nearest pi/2: the horizon, where cosines end.
HORIZON_COS = 6.123233995736766e-17
#: |v|^2 of the vectors that the kernels normalise themselves; others are scaled by the caller.
LEAST_NORM2, MOST_NORM2 = 1e-12, 1e12


class HalfScale(NamedTuple):
    """Constants of a look-up in the dtype of the angles; those of the coordinates first, then those of the table."""

    zero: Any
    quarter: Any
    half: Any
    one: Any
    two: Any
    half_pi: Any
    half_pi_low: Any
    pi: Any
    pi_low: Any
    turn: Any
    theta_max: Any
    delta_phi_max: Any
    horizon_cos: Any
    least_norm2: Any
    most_norm2: Any
    mirror: Any
    k0: Any
    k1: Any
    k2: Any
    k3: Any
    k4: Any
    k5: Any
    guide_low: Any
    guide_step: Any
    step_h: Any
    step_d: Any
    step_p: Any
    steps_z: Any
    shift_z: Any
    value: Any
    part_u: Any
    part_w: Any


def half_scale(factor: tuple[float, ...], mirror: bool, table: tuple[float, ...], dtype: npt.DTypeLike) -> HalfScale:
    """Constants for the coefficients k0 .. k5 of K, the kind of u, and those of the `table`."""
    number: Any = np.dtype(dtype).type
    hi_half, hi = number(HALF_PI), number(np.pi)
    double = number is np.float64
    values = (
        0, 0.25, 0.5, 1, 2, hi_half, HALF_PI - float(hi_half) + (6.123233995736766e-17 if double else 0),
        hi, np.pi - float(hi) + (1.2246467991473532e-16 if double else 0), 2 * np.pi,
        HALF_PI, DELTA_PHI_DIRECT, HORIZON_COS, LEAST_NORM2, MOST_NORM2, float(mirror), *factor, *table,
    )  # fmt: skip
    return HalfScale(*(number(v) for v in values))


@inline
def _factor(cos_i, cos_o, scale):
    above = fma(scale.k0, cos_i, fma(scale.k1, cos_o, scale.k2))
    return above / fma(scale.k3, cos_i * cos_o, fma(scale.k4, cos_i + cos_o, scale.k5))


@inline
def _diamond(up, along, backward, scale, bilateral, reciprocal):
    """z of phi_d, its sine and cosine as `up` >= 0 and `along`; 0/0 is 90 degrees (phi_d has no meaning there)."""
    both = abs(along) + up
    z = up / both if both > scale.zero else scale.one
    # folds as selections, not branches: a loop with branches in it is compiled twice or not as vectors at all
    z = scale.two - z if (along < scale.zero) & (not reciprocal) else z
    return -z if backward & (not bilateral) else z


@inline
def from_angles(theta_i, theta_o, delta_phi, scale, bilateral, reciprocal):
    """inside, u, w, z and K of one pair of directions; outside the plain domain, those of (0, 0, 0)."""
    zero = scale.zero
    half = scale.half
    # a comparison with NaN is false, so NaN counts as outside
    inside = (theta_i >= zero) & (theta_i <= scale.theta_max) & (theta_o >= zero) & (theta_o <= scale.theta_max)
    inside = inside & (abs(delta_phi) <= scale.delta_phi_max)
    a = theta_i if inside else zero
    b = theta_o if inside else zero
    c = delta_phi if inside else zero
    turned = abs(c)
    over = turned > scale.pi
    turned = abs(scale.turn - turned) if over else turned
    # angles from the horizon keep the cosines' relative accuracy there; they end at the float64 horizon
    from_i = (scale.half_pi - a) + scale.half_pi_low
    from_o = (scale.half_pi - b) + scale.half_pi_low
    from_i = from_i if from_i > scale.horizon_cos else scale.horizon_cos
    from_o = from_o if from_o > scale.horizon_cos else scale.horizon_cos
    cos_i = fused_sin(from_i)
    cos_o = fused_sin(from_o)
    sin_i = fused_sin(a)
    sin_o = fused_sin(b)
    apart = half * (a - b)
    sin_b = fused_sin(apart)
    cos_b = fused_sin(scale.half_pi - abs(apart))
    sin_half = fused_sin(half * turned)
    cos_half = fused_sin(half * ((scale.pi - turned) + scale.pi_low))
    s = half * (cos_i + cos_o)
    inverse = scale.one / (cos_b * s)
    tan_b = sin_b * s * inverse
    ratio = cos_half * cos_b * inverse
    product = sin_i * sin_o
    u = fma(product * ratio, ratio, tan_b * tan_b)
    w = fma(s * s, u, s * s)
    w = w if w < scale.one else scale.one
    u = u if scale.mirror == zero else fma(product * cos_half, cos_half, sin_b * sin_b)
    up = scale.two * product * (sin_half * cos_half)
    up = up if up > zero else zero
    along = (sin_i + sin_o) * tan_b * np.sqrt(w)
    # sin(delta_phi) < 0; past half a turn its sign turns, past a whole one again
    backward = ((c < zero) ^ over) ^ (abs(c) > scale.turn)
    return inside, u, w, _diamond(up, along, backward, scale, bilateral, reciprocal), _factor(cos_i, cos_o, scale)


@inline
def from_vectors(ix, iy, iz, ox, oy, oz, scale, bilateral, reciprocal):
    """usable, above the horizon, u, w, z and K of a pair of vectors, which are normalised here.

    Not usable: NaN, infinite, zero, or of a length whose square leaves [1e-12, 1e12].
    """
    norm_i = fma(ix, ix, fma(iy, iy, iz * iz))
    norm_o = fma(ox, ox, fma(oy, oy, oz * oz))
    usable = (norm_i >= scale.least_norm2) & (norm_i <= scale.most_norm2)
    usable = usable & (norm_o >= scale.least_norm2) & (norm_o <= scale.most_norm2)
    above = usable & (iz > scale.zero) & (oz > scale.zero)
    unit_i = scale.one / np.sqrt(norm_i) if above else scale.zero
    unit_o = scale.one / np.sqrt(norm_o) if above else scale.zero
    cos_i = iz * unit_i if above else scale.one
    cos_o = oz * unit_o if above else scale.one
    ix = ix * unit_i if above else scale.zero
    iy = iy * unit_i if above else scale.zero
    ox = ox * unit_o if above else scale.zero
    oy = oy * unit_o if above else scale.zero
    cos_i = cos_i if cos_i > scale.horizon_cos else scale.horizon_cos
    cos_o = cos_o if cos_o > scale.horizon_cos else scale.horizon_cos
    hx = ix + ox
    hy = iy + oy
    hz = cos_i + cos_o
    across = fma(hx, hx, hy * hy)
    inverse = scale.one / hz
    u = across * inverse * inverse
    w = scale.quarter * fma(hz, hz, across)
    w = w if w < scale.one else scale.one
    cross = ix * oy - iy * ox
    apart = cos_o - cos_i
    u = u if scale.mirror == scale.zero else scale.quarter * fma(apart, apart, across)
    along = apart * np.sqrt(w)
    z = _diamond(abs(cross), along, cross < scale.zero, scale, bilateral, reciprocal)
    return usable, above, u, w, z, _factor(cos_i, cos_o, scale)


def coordinates_numpy(
    theta_i: FloatArray,
    theta_o: FloatArray,
    delta_phi: FloatArray,
    bilateral: bool,
    reciprocal: bool,
    mirror: int = 0,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(u, w, z) by library functions in float64: the twin of `from_angles`, and what tables are built with."""
    a, b = (np.minimum(np.asarray(t, np.float64), HALF_PI) for t in (theta_i, theta_o))
    c = np.asarray(delta_phi, np.float64)
    sin_half, cos_half = np.abs(np.sin(0.5 * c)), np.abs(np.cos(0.5 * c))
    sin_b, cos_b = np.sin(0.5 * (a - b)), np.cos(0.5 * (a - b))
    s = np.maximum(np.cos(0.5 * (a + b)), HORIZON_COS) * cos_b
    product = np.sin(a) * np.sin(b)
    u = (sin_b / cos_b) ** 2 + product * (cos_half / s) ** 2
    w = np.minimum(s**2 * (1 + u), 1)
    if mirror:
        u = sin_b**2 + product * cos_half**2
    up = 2 * product * sin_half * cos_half
    along = 2 * np.sin(0.5 * (a + b)) * sin_b * np.sqrt(w)
    both = np.abs(along) + up
    z = np.divide(up, both, out=np.ones_like(up), where=both > 0)
    if not reciprocal:
        z = np.where(along >= 0, z, 2 - z)
    if not bilateral:
        z = np.where(np.sin(c) < 0, -z, z)
    return u, w, z
