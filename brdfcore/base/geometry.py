"""Changes of variable between angles, vectors and the half vector, in forms that don't cancel.

Every function takes flat float64 arrays that `conventions` has checked. See `conventions` for the frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI, PI_HI, PI_LO

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PairGeometry:
    """What microfacet and lobe models read of a pair of directions; flat float64 arrays.

    cos_i, cos_o  cosines to the normal, >= 0.
    tan2_h        tan^2 theta_h, theta_h between the normal and the half vector h.
    cos_d         cos theta_d = wi.h = wo.h.
    sin2_d        sin^2 theta_d: 1 - cos theta_d = sin2_d/(1 + cos_d) keeps its digits near retro-reflection.
    one_minus_rv  1 - r.v, r the mirror image of wi about the normal and v = wo: 0 at the mirror direction.
    sin_i, sin_o  sines to the normal.
    cos_delta_phi cosine of the azimuth difference; 1 where a direction is the normal and it has no meaning.
    """

    cos_i: Float64Array
    cos_o: Float64Array
    sin_i: Float64Array
    sin_o: Float64Array
    tan2_h: Float64Array
    cos_d: Float64Array
    sin2_d: Float64Array
    one_minus_rv: Float64Array
    cos_delta_phi: Float64Array


def pair_from_angles(theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> PairGeometry:
    """Pair geometry from angles in radians.

    With d = theta_i - theta_o, e = |delta_phi| - pi, S = cos_i + cos_o:
    tan^2 theta_h = tan^2(d/2) + 4 (sin_i/S)(sin_o/S) sin^2(e/2), 1 - r.v = 2 sin^2(d/2) + 2 sin_i sin_o sin^2(e/2),
    cos theta_d = (S/2) sqrt(1 + tan^2 theta_h), sin^2 theta_d = sin^2(d/2) + sin_i sin_o sin^2(delta_phi/2).

    All terms are positive, so nothing cancels near the mirror direction; the result is the same bits with
    the directions swapped and does not depend on delta_phi at theta = 0. sin_i + sin_o cos(delta_phi), the
    form in most texts, loses ten digits at a roughness of 1e-6.
    """
    theta_i = np.minimum(theta_i, HALF_PI)  # float32's pi/2 means pi/2
    theta_o = np.minimum(theta_o, HALF_PI)
    cos_i, cos_o, sin_i, sin_o = np.cos(theta_i), np.cos(theta_o), np.sin(theta_i), np.sin(theta_o)
    to_mirror, to_retro = _azimuths(delta_phi)
    half_d = 0.5 * (theta_i - theta_o)
    total = cos_i + cos_o
    with np.errstate(under="ignore"):  # the square of an angle below 1e-154 is 0, as good as any
        sin2_half_d = np.sin(half_d) ** 2
        sin2_e = np.sin(0.5 * to_mirror) ** 2
        tan2_h = np.tan(half_d) ** 2 + 4 * (sin_i / total) * (sin_o / total) * sin2_e
        sin2_d = sin2_half_d + sin_i * sin_o * np.sin(0.5 * to_retro) ** 2
        one_minus_rv = 2 * sin2_half_d + 2 * sin_i * sin_o * sin2_e
    return PairGeometry(
        cos_i=cos_i,
        cos_o=cos_o,
        sin_i=sin_i,
        sin_o=sin_o,
        tan2_h=tan2_h,
        cos_d=np.minimum(0.5 * total * np.sqrt(1 + tan2_h), 1.0),  # rounding may pass 1 by an ulp
        sin2_d=sin2_d,
        one_minus_rv=one_minus_rv,
        cos_delta_phi=np.cos(to_retro),
    )


def _azimuths(delta_phi: Float64Array) -> tuple[Float64Array, Float64Array]:
    """delta_phi's signed distances to the nearest odd and even multiple of pi, to full relative precision.

    Both are formed from the fmod, which is exact: |delta_phi| rounded into [-pi, pi] first would lose the distance
    of, say, pi (1 + eps) to pi, and at grazing incidence tan^2 theta_h is that distance over cos theta, squared.
    """
    size = np.abs(delta_phi)
    rest = np.fmod(size, 2 * PI_HI)
    turns = np.rint((size - rest) / (2 * PI_HI))
    turns = np.where(turns < 2.0**52, turns, 0.0)  # beyond, neighbouring floats are turns apart: no angle is meant
    to_mirror = (rest - PI_HI) - (2 * turns + 1) * PI_LO
    to_retro = np.where(rest <= PI_HI, rest - 2 * turns * PI_LO, (rest - 2 * PI_HI) - (2 * turns + 2) * PI_LO)
    return to_mirror, to_retro


def pair_from_vectors(wi: Float64Array, wo: Float64Array) -> PairGeometry:
    """Pair geometry of the directions of vectors (n, 3) with z > 0, of lengths from 1/2 to 4.

    tan^2 theta_h = (H_x^2 + H_y^2)/H_z^2 with H = wi + wo, cos theta_d = |H|/2, sin theta_d = |wi - wo|/2;
    1 - r.v = |r - wo|^2/2 with r = (-wi_x, -wi_y, wi_z). Each is a sum of squares of plain sums.

    No float vector has length exactly 1. Beside the mirror direction H_x and H_y are as small as the rounding of a unit
    vector, so what rounding takes is carried and added after the sum.
    """
    (wi, rest_i), (wo, rest_o) = _unit(wi), _unit(wo)
    h = (wi + wo) + (rest_i + rest_o)
    difference = (wi - wo) + (rest_i - rest_o)
    # A smaller z would overflow 1/z^2; the float64 angle nearest the horizon has cos theta = 6e-17.
    cos_i, cos_o = (np.maximum(w[:, 2] + r[:, 2], 1e-100) for w, r in ((wi, rest_i), (wo, rest_o)))
    h_z = cos_i + cos_o
    h_xy = np.hypot(h[:, 0], h[:, 1])
    rho_i, rho_o = np.hypot(wi[:, 0], wi[:, 1]), np.hypot(wo[:, 0], wo[:, 1])
    with np.errstate(under="ignore"):  # squares of components below 1e-154 are 0, as good as any
        dot_xy = wi[:, 0] * wo[:, 0] + wi[:, 1] * wo[:, 1]
        product = rho_i * rho_o
        # at the pole delta_phi has no meaning and whatever multiplies it is 0
        cos_delta_phi = np.divide(dot_xy, product, out=np.ones_like(dot_xy), where=product > 0)
        return PairGeometry(
            cos_i=cos_i,
            cos_o=cos_o,
            sin_i=rho_i,
            sin_o=rho_o,
            tan2_h=(h_xy / h_z) ** 2,
            cos_d=np.minimum(0.5 * np.hypot(h_xy, h_z), 1.0),
            sin2_d=0.25 * (difference**2).sum(axis=1),
            one_minus_rv=0.5 * (h_xy**2 + difference[:, 2] ** 2),
            cos_delta_phi=np.clip(cos_delta_phi, -1, 1),
        )


def _unit(w: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(u, r) of vectors (n, 3): w/|w| = u + r to some 1e-31, u its float64.

    |w|^2 is summed with the rounding errors of squares (Dekker 1971, doi:10.1007/BF01397083) and sums (Knuth's two-sum)
    carried along, and 1/|w| made of it by a step of Newton.
    """
    with np.errstate(under="ignore"):
        squares, lost_in_squares = _product(w, w)
        high, lost = np.zeros(w.shape[0]), lost_in_squares.sum(axis=1)
        for term in np.sort(squares, axis=1).T[::-1]:
            new = high + term
            lost += term - (new - high)  # exact: the sum so far is the larger
            high = new
        scale = 1 / np.sqrt(high)
        square, lost_in_square = _product(scale, scale)
        one, lost_in_one = _product(high, square)
        left = (1 - one) - lost_in_one - (high * lost_in_square + lost * square)
        unit, lost_in_unit = _product(w, scale[:, None])
        return unit, lost_in_unit + w * (0.5 * scale * left)[:, None]


def _product(a: Float64Array, b: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(a b rounded, what rounding took), of numbers far from the ends of float64."""
    product: Float64Array = a * b
    (a_high, a_low), (b_high, b_low) = _halves(a), _halves(b)
    lost: Float64Array = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, lost


def _halves(x: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Two numbers of 26 bits whose sum is x."""
    big = x * 134217729.0  # 2^27 + 1
    high = big - (big - x)
    return high, x - high


def angles_from_vectors(wi: Float64Array, wo: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(theta_i, theta_o, delta_phi) of vectors (n, 3) of any length; delta_phi in [-pi, pi].

    atan2 throughout: acos(z) is wrong by 100 % at theta = 1e-8. theta lies in [0, pi].
    """
    theta_i = np.arctan2(np.hypot(wi[:, 0], wi[:, 1]), wi[:, 2])
    theta_o = np.arctan2(np.hypot(wo[:, 0], wo[:, 1]), wo[:, 2])
    cross = wi[:, 0] * wo[:, 1] - wi[:, 1] * wo[:, 0]
    dot = wi[:, 0] * wo[:, 0] + wi[:, 1] * wo[:, 1]
    return theta_i, theta_o, np.arctan2(cross, dot)


def vectors_from_angles(
    theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Unit vectors (..., 3) of a pair of directions, wi in the half plane phi = 0."""
    theta_i, theta_o, delta_phi = np.broadcast_arrays(theta_i, theta_o, delta_phi)
    zero = np.zeros_like(theta_i)
    wi = np.stack([np.sin(theta_i), zero, np.cos(theta_i)], axis=-1)
    sin_o = np.sin(theta_o)
    wo = np.stack([sin_o * np.cos(delta_phi), sin_o * np.sin(delta_phi), np.cos(theta_o)], axis=-1)
    return wi, wo


def reflect(w: Float64Array) -> Float64Array:
    """Mirror image of `w` (..., 3) about the normal: (-x, -y, z), exactly."""
    mirrored: Float64Array = w * np.array([-1.0, -1.0, 1.0])
    return mirrored


def horizon_theta_h(theta_i: Float64Array | float, phi_h: Float64Array) -> Float64Array:
    """Largest theta_h whose mirrored direction is above the horizon, for azimuth phi_h from wi; in (0, pi/2].

    wo = 2 (wi.h) h - wi has z = cos_i cos(2 theta_h) + sin_i sin(2 theta_h) cos(phi_h), which is 0 at
    2 theta_h = atan2(cos_i, -sin_i cos(phi_h)).
    """
    limit: Float64Array = 0.5 * np.arctan2(np.cos(theta_i), -np.sin(theta_i) * np.cos(phi_h))
    return limit


def outgoing_from_half(
    theta_i: Float64Array | float, theta_h: Float64Array, phi_h: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(theta_o, delta_phi, wi.h) of wo = 2 (wi.h) h - wi, with h at (theta_h, phi_h), phi_h from wi.

    wo's z = cos_i cos(2 theta_h) + sin_i sin(2 theta_h) cos(phi_h): the form whose zero is `horizon_theta_h`.
    delta_phi has the sign of sin(phi_h).
    """
    sin_i, cos_i = np.sin(theta_i), np.cos(theta_i)
    sin_h, cos_h, cos_p = np.sin(theta_h), np.cos(theta_h), np.cos(phi_h)
    dot = sin_i * sin_h * cos_p + cos_i * cos_h
    x = 2 * dot * sin_h * cos_p - sin_i
    y = 2 * dot * sin_h * np.sin(phi_h)
    z = cos_i * np.cos(2 * theta_h) + sin_i * np.sin(2 * theta_h) * cos_p
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x), dot
