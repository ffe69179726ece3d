"""Oren and Nayar's rough diffuse surface in float32; formulas as in `models.oren_nayar`, signature and bits as in
`lobe_kernel`.

numbers (C, 4): c1, c2, c3, inter, as `models.oren_nayar` forms them. Error: 2e-5 of max(f, 1e-2 rho/pi), as terms of
opposite sign and of the size rho/pi cancel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from brdfcore.kernels.machine.elementary import ONE, TWO, ZERO, elementwise, select, sin
from brdfcore.kernels.machine.jit import inline
from brdfcore.kernels.machine.vectorised import store
from brdfcore.kernels.models import lobe_blocks as rows
from brdfcore.kernels.models.lobe_blocks import read
from brdfcore.kernels.models.lobe_kernel import Float32Array, Rows, lobe_kernel, lobe_twin

THREE, TWO_OVER_PI = np.float32(3), np.float32(2 / np.pi)


@elementwise
def rough_diffuse(
    cos_i, cos_o, sin_i, sin_o, theta_i, theta_o, horizon_i, horizon_o, sin2_to_mirror, sin2_to_retro, c1, c2, c3, inter
):
    """max(0, L1 + rho L2) of `models.oren_nayar`; cos phi and 1 - |cos phi| from the smaller of the two sines."""
    first_larger = theta_i > theta_o
    alpha, beta = select(first_larger, theta_i, theta_o), select(first_larger, theta_o, theta_i)
    sin_alpha, sin_beta = select(first_larger, sin_i, sin_o), select(first_larger, sin_o, sin_i)
    cos_alpha, cos_beta = select(first_larger, cos_i, cos_o), select(first_larger, cos_o, cos_i)
    beta_to_horizon = select(first_larger, horizon_o, horizon_i)
    toward = sin2_to_retro < sin2_to_mirror
    less = TWO * select(toward, sin2_to_retro, sin2_to_mirror)  # 1 - |cos phi|
    cos_phi = select(toward, ONE - less, less - ONE)
    # sin alpha - (2 beta/pi)^3: near the horizon as 1 - (2 beta/pi)^3 less 1 - sin alpha, with 2 beta/pi = 1 - x
    x, y = beta_to_horizon * TWO_OVER_PI, beta * TWO_OVER_PI
    grazing = x * (THREE - x * (THREE - x)) - cos_alpha * cos_alpha / (ONE + sin_alpha)
    away = select(beta < ONE, sin_alpha - y * y * y, grazing)
    angles = select(toward, sin_alpha, away)
    product = alpha * TWO_OVER_PI * y  # 4 alpha beta/pi^2
    aside = ((product * product) * less) * ((sin_i + sin_o) / (cos_i + cos_o))
    total = c1 + c2 * (cos_phi * (sin_beta / cos_beta) * angles)
    total = (total + c3 * aside) + inter * (ONE - cos_phi * (y * y))
    return select(total > ZERO, total, ZERO)


@inline
def _prepare(scratch, count):
    for k in range(count):
        sin_r = sin(read(scratch, rows.HALF_TO_RETRO + k))
        store(scratch, rows.SIN2_TO_RETRO + k, sin_r * sin_r)


@inline
def _fill(scratch, count, numbers, variant):
    c1, c2, c3, inter = numbers[0], numbers[1], numbers[2], numbers[3]
    for k in range(count):
        value = rough_diffuse(
            read(scratch, rows.COS_I + k),
            read(scratch, rows.COS_O + k),
            read(scratch, rows.SIN_I + k),
            read(scratch, rows.SIN_O + k),
            read(scratch, rows.THETA_I + k),
            read(scratch, rows.THETA_O + k),
            read(scratch, rows.HORIZON_I + k),
            read(scratch, rows.HORIZON_O + k),
            read(scratch, rows.SIN2_TO_MIRROR + k),
            read(scratch, rows.SIN2_TO_RETRO + k),
            c1, c2, c3, inter,
        )  # fmt: skip
        store(scratch, rows.ROOT + k, ONE)
        store(scratch, rows.MIDDLE + k, value)


def _values(g: Rows, numbers: Float32Array, variant: int) -> tuple[Any, Any]:
    sin_r = sin(g.half_to_retro)
    middle = rough_diffuse(
        g.cos_i, g.cos_o, g.sin_i, g.sin_o, g.theta_i, g.theta_o, g.horizon_i, g.horizon_o, g.sin2_to_mirror,
        sin_r * sin_r, *numbers,
    )  # fmt: skip
    return np.ones_like(g.cos_i), middle


oren_nayar, oren_nayar_numpy = lobe_kernel(_fill, _prepare), lobe_twin(_values)
