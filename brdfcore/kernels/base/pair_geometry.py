"""Pair geometry in float32 from angles of either dtype: `geometry.pair_from_angles` for the fast kernels.

Every difference that is small beside the mirror direction, retro-reflection or the horizon is formed in the dtype of
the input, where it is exact or nearly so, and rounded to float32 once: theta_i - theta_o, pi/2 - theta, the distances
of delta_phi to pi and to 0 (modulo 2 pi). So float32 holds a lobe of any width, as far as the angles given do.

Elementwise functions, see `elementary`: they stand in compiled loops and run on numpy arrays.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import DELTA_PHI_DIRECT, HALF_PI, PI_HI, PI_LO
from brdfcore.kernels.machine.elementary import FOUR, HALF, ONE, TWO, elementwise, select, sin, single

#: cos of the float64 nearest pi/2, the horizon. float32's pi/2 lies beyond it and means the same direction.
HORIZON_COS = 6.123233995736766e-17


class AngleConstants(NamedTuple):
    """Constants of `split`, in the dtype of the angles: pi and pi/2 in two parts each, limits of the domain."""

    zero: Any
    half: Any
    pi: Any
    pi_low: Any
    two_pi: Any
    two_pi_low: Any
    half_pi: Any
    half_pi_low: Any
    horizon: Any
    theta_max: Any
    delta_phi_max: Any


def angle_constants(dtype: npt.DTypeLike) -> AngleConstants:
    """The constants for angles of float32 or float64."""
    number: Any = np.dtype(dtype).type
    pi, half_pi = float(number(PI_HI)), float(number(HALF_PI))
    pi_low, half_pi_low = (PI_HI - pi) + PI_LO, (HALF_PI - half_pi) + 0.5 * PI_LO
    values = (0, 0.5, pi, pi_low, 2 * pi, 2 * pi_low, half_pi, half_pi_low, HORIZON_COS, HALF_PI, DELTA_PHI_DIRECT)
    return AngleConstants(*(number(v) for v in values))


@elementwise
def split(theta_i, theta_o, delta_phi, s):
    """What float32 can carry of one pair of angles; `s` an `AngleConstants` of their dtype.

    Returns (inside, theta_i, theta_o, pi/2 - theta_i, pi/2 - theta_o, (theta_i - theta_o)/2, and the halves of
    delta_phi's distances to an odd and to an even multiple of pi). Outside the domain all are those of theta = 0.
    """
    # a comparison with NaN is false, so NaN is outside
    inside = (theta_i >= s.zero) & (theta_i <= s.theta_max) & (theta_o >= s.zero) & (theta_o <= s.theta_max)
    inside = inside & (abs(delta_phi) <= s.delta_phi_max)
    a = select(inside, theta_i, s.zero)
    b = select(inside, theta_o, s.zero)
    size = select(inside, abs(delta_phi), s.zero)
    # float32's pi/2 is past the horizon: taken as the horizon, also in the difference of the angles
    from_horizon_i = (s.half_pi - a) + s.half_pi_low
    from_horizon_o = (s.half_pi - b) + s.half_pi_low
    past_i, past_o = from_horizon_i - s.horizon, from_horizon_o - s.horizon
    past_i, past_o = select(past_i < s.zero, past_i, s.zero), select(past_o < s.zero, past_o, s.zero)
    from_horizon_i = select(from_horizon_i > s.horizon, from_horizon_i, s.horizon)
    from_horizon_o = select(from_horizon_o > s.horizon, from_horizon_o, s.horizon)
    half_d = s.half * ((a - b) + (past_i - past_o))
    # |delta_phi| <= 3 pi: one turn at most, and differences of numbers within a factor 2 are exact
    turned = size >= s.two_pi
    rest = select(turned, size - s.two_pi, size)
    low = select(turned, s.two_pi_low, s.zero)
    to_mirror = (rest - s.pi) - (low + s.pi_low)
    to_retro = select(rest <= s.pi, rest - low, (rest - s.two_pi) - (low + s.two_pi_low))
    return (
        inside,
        single(a),
        single(b),
        single(from_horizon_i),
        single(from_horizon_o),
        single(half_d),
        single(s.half * to_mirror),
        single(s.half * to_retro),
    )


@elementwise
def half_vector(theta_i, theta_o, from_horizon_i, from_horizon_o, half_d, half_to_mirror):
    """(cos_i, cos_o, sin_i, sin_o, tan^2 theta_h, sin^2(d/2), sin^2(e/2)), all terms positive.

    With d = theta_i - theta_o, e = |delta_phi| - pi and S = cos_i + cos_o:
    tan^2 theta_h = tan^2(d/2) + 4 sin_i sin_o sin^2(e/2)/S^2.
    """
    cos_i, cos_o = sin(from_horizon_i), sin(from_horizon_o)  # of the complement: relative accuracy at the horizon
    sin_i, sin_o = sin(theta_i), sin(theta_o)
    sin_d, sin_e = sin(half_d), sin(half_to_mirror)
    sin2_d, sin2_e = sin_d * sin_d, sin_e * sin_e
    total = cos_i + cos_o
    tan2_h = sin2_d / (ONE - sin2_d) + (FOUR * (sin_i * sin_o) * sin2_e) / (total * total)  # |d/2| <= pi/4
    return cos_i, cos_o, sin_i, sin_o, tan2_h, sin2_d, sin2_e


@elementwise
def difference_angle(cos_i, cos_o, sin_i, sin_o, tan2_h, sin2_half_d, half_to_retro):
    """(cos theta_d, sin^2 theta_d) of theta_d between either direction and the half vector."""
    cos_d = HALF * (cos_i + cos_o) * np.sqrt(ONE + tan2_h)
    sin_r = sin(half_to_retro)
    return select(cos_d < ONE, cos_d, ONE), sin2_half_d + (sin_i * sin_o) * (sin_r * sin_r)


@elementwise
def one_minus_rv(sin_i, sin_o, sin2_half_d, sin2_e):
    """1 - r.v, r the mirror image of wi about the normal and v = wo."""
    return TWO * sin2_half_d + (TWO * (sin_i * sin_o)) * sin2_e
