"""Microfacet lobes in float32: f = base + factor D V F of n pairs of angles; formulas as in `models.base.microfacet`.

`microfacet` is the kernel, `microfacet_numpy` its twin of the same signature and bits. Arguments, C channels:

    theta_i, theta_o, delta_phi  (n,) of one float dtype
    out                          (n C,), flat, of that dtype
    constants                    `pair_geometry.angle_constants` of that dtype
    ends                         (C, 2) of that dtype: factor (the distribution's scale in it) and base
    numbers                      float32 (C, 9): roughness m, the distribution's number, 7 `fresnel_numbers`
    distribution, masking, form  int64, from DISTRIBUTIONS, MASKING and `fresnel_terms.FRESNEL`

Error: 1.4e-5 of max(f, 1e-6 of the peak), ggx 3e-6, at any roughness; but up to 1e-3 of f just outside the critical
angle of total internal reflection, where F is 1 less a square root.

Returned: the number of inputs outside the plain domain (theta outside [0, pi/2] of its type, |delta_phi| > 3 pi, NaN);
such points get the value at theta = 0.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray
from brdfcore.kernels.base.pair_geometry import AngleConstants, difference_angle, half_vector, split
from brdfcore.kernels.machine.elementary import FOUR, HALF, ONE, atan, elementwise, exp, log1p, select, smith_excess
from brdfcore.kernels.machine.jit import inline, kernel, prange
from brdfcore.kernels.machine.vectorised import store
from brdfcore.kernels.models import fresnel_terms
from brdfcore.kernels.models import lobe_blocks as rows
from brdfcore.kernels.models.lobe_blocks import BLOCK, CHUNK, fill_geometry, interleave, read, result, store_result

DISTRIBUTIONS = {"beckmann": 0, "ggx": 1, "blinn": 2, "gaussian": 3}
MASKING = {"vgroove": 0, "none": 1, "smith_ggx": 2, "smith_ggx_separable": 3, "smith_beckmann": 4}
HALF_PI = np.float32(np.pi / 2)
QUARTER = np.float32(0.25)


def microfacet_numbers(
    m: npt.NDArray[np.float64],
    distribution: str,
    fresnel: tuple[str, npt.NDArray[np.complex128] | None, npt.NDArray[np.float64]],
    channels: int,
) -> npt.NDArray[np.float32]:
    """`numbers` of roughness m (channels,) or (1,) and `fresnel` = (kind, ior, exterior_ior)."""
    first = rows.per_channel([m, _distribution_number(distribution, m)], channels)
    second = np.broadcast_to(fresnel_terms.fresnel_numbers(*fresnel), (channels, fresnel_terms.FRESNEL_NUMBERS))
    return np.concatenate([first, second], axis=1)


def microfacet_choices(distribution: str, masking: str, fresnel: str) -> tuple[int, int, int]:
    """`distribution`, `masking` and `form` by name; "smith" is the height-correlated one of the distribution."""
    masking = f"smith_{distribution}" if masking == "smith" else masking
    return DISTRIBUTIONS[distribution], MASKING[masking], fresnel_terms.FRESNEL[fresnel]


def _distribution_number(distribution: str, m: npt.NDArray[np.float64]) -> Any:
    """What the root of `distribution` reads beside t^2, formed in float64 once a model; see the roots below."""
    if distribution == "beckmann":
        return -0.5 / (m * m)
    if distribution == "ggx":
        return m * m
    if distribution == "blinn":
        return 0.25 * math.log(2) / np.log1p(-2 * np.sin(0.5 * m) ** 2)
    return 1 / (math.sqrt(2) * m)


# ---- roots: D = scale root^2 -------------------------------------------------------------------------


@elementwise
def beckmann_root(t2, number):
    """(1 + t^2) exp(-t^2/(2 m^2)); t^2 <= 3e32 in float32, so the first factor is finite where the second is 0."""
    return (ONE + t2) * exp(t2 * number)


@elementwise
def ggx_root(t2, m, m2):
    """m (1 + t^2)/(t^2 + m^2)."""
    return m * (ONE + t2) / (t2 + m2)


@elementwise
def blinn_root(t2, number):
    """(1 + t^2)^(-N/4)."""
    return exp(log1p(t2) * number)


@elementwise
def gaussian_root(t2, number):
    """exp(-(theta_h/m)^2/2)."""
    t = np.sqrt(t2)
    steep = t > ONE
    theta = atan(select(steep, ONE / select(steep, t, ONE), t))
    u = select(steep, HALF_PI - theta, theta) * number
    return exp(-(u * u))


# ---- visibility V = G/(4 cos_i cos_o) ----------------------------------------------------------------


@elementwise
def unmasked(cos_i, cos_o):
    """G = 1."""
    return QUARTER / (cos_i * cos_o)


@elementwise
def vgroove(cos_i, cos_o, t2):
    """min(1/(4 cos_i cos_o), 1/(S (1 + t^2) max(cos_i, cos_o))), as the larger of the two denominators."""
    larger = select(cos_i > cos_o, cos_i, cos_o)
    free = FOUR * (cos_i * cos_o)
    masked = (cos_i + cos_o) * (ONE + t2) * larger
    return ONE / select(free > masked, free, masked)


@elementwise
def smith_ggx(cos_i, cos_o, sin_i, sin_o, m):
    """Height-correlated: 1/(2 (cos_o r_i + cos_i r_o)), r = sqrt(cos^2 + m^2 sin^2)."""
    slope_i, slope_o = m * sin_i, m * sin_o
    r_i, r_o = np.sqrt(cos_i * cos_i + slope_i * slope_i), np.sqrt(cos_o * cos_o + slope_o * slope_o)
    return HALF / (cos_o * r_i + cos_i * r_o)


@elementwise
def smith_ggx_separable(cos_i, cos_o, sin_i, sin_o, m):
    """G1(wi) G1(wo)/(4 cos_i cos_o) = 1/((cos_i + r_i)(cos_o + r_o))."""
    slope_i, slope_o = m * sin_i, m * sin_o
    r_i, r_o = np.sqrt(cos_i * cos_i + slope_i * slope_i), np.sqrt(cos_o * cos_o + slope_o * slope_o)
    return ONE / ((cos_i + r_i) * (cos_o + r_o))


@elementwise
def smith_beckmann(cos_i, cos_o, sin_i, sin_o, m):
    """Height-correlated: 1/(2 (cos_o q_i + cos_i q_o)), q = cos + m sin `smith_excess`(cos/(m sin))."""
    slope_i, slope_o = m * sin_i, m * sin_o
    q_i = cos_i + slope_i * smith_excess(cos_i / slope_i)
    q_o = cos_o + slope_o * smith_excess(cos_o / slope_o)
    return HALF / (cos_o * q_i + cos_i * q_o)


# ---- loops over a block ------------------------------------------------------------------------------


@elementwise
def _cosines_and_sines(scratch, k):
    return (
        read(scratch, rows.COS_I + k),
        read(scratch, rows.COS_O + k),
        read(scratch, rows.SIN_I + k),
        read(scratch, rows.SIN_O + k),
    )


@inline
def _fill_difference_angle(scratch, count):
    for k in range(count):
        cos_i, cos_o, sin_i, sin_o = _cosines_and_sines(scratch, k)
        tan2_h, sin2_half_d = read(scratch, rows.TAN2_H + k), read(scratch, rows.SIN2_HALF_D + k)
        to_retro = read(scratch, rows.HALF_TO_RETRO + k)
        cos_d, sin2_d = difference_angle(cos_i, cos_o, sin_i, sin_o, tan2_h, sin2_half_d, to_retro)
        store(scratch, rows.COS_D + k, cos_d)
        store(scratch, rows.SIN2_D + k, sin2_d)


@inline
def _fill_root(scratch, count, distribution, m, number):
    if distribution == 0:
        for k in range(count):
            store(scratch, rows.ROOT + k, beckmann_root(read(scratch, rows.TAN2_H + k), number))
    elif distribution == 1:
        for k in range(count):
            store(scratch, rows.ROOT + k, ggx_root(read(scratch, rows.TAN2_H + k), m, number))
    elif distribution == 2:
        for k in range(count):
            store(scratch, rows.ROOT + k, blinn_root(read(scratch, rows.TAN2_H + k), number))
    else:
        for k in range(count):
            store(scratch, rows.ROOT + k, gaussian_root(read(scratch, rows.TAN2_H + k), number))


@inline
def _fill_fresnel(scratch, count, form, a):
    """F of a block; `a` the channel's numbers."""
    a0, a1, a2, a3, a4, a5 = a[2], a[3], a[4], a[5], a[6], a[7]
    if form == 0:
        for k in range(count):
            store(scratch, rows.FRESNEL + k, ONE)
    elif form == 1:
        for k in range(count):
            cos_d, sin2_d = read(scratch, rows.COS_D + k), read(scratch, rows.SIN2_D + k)
            store(scratch, rows.FRESNEL + k, fresnel_terms.conductor(cos_d, sin2_d, a0, a1, a2, a3, a4, a5))
    elif form == 2:
        for k in range(count):
            cos_d, sin2_d = read(scratch, rows.COS_D + k), read(scratch, rows.SIN2_D + k)
            store(scratch, rows.FRESNEL + k, fresnel_terms.schlick(cos_d, sin2_d, a0, a1))
    else:
        for k in range(count):
            cos_d, sin2_d = read(scratch, rows.COS_D + k), read(scratch, rows.SIN2_D + k)
            store(scratch, rows.FRESNEL + k, fresnel_terms.conductor_approximate(cos_d, sin2_d, a0, a1, a2))


@inline
def _fill_middle(scratch, count, masking, m):
    """V F of a block."""
    if masking == 0:
        for k in range(count):
            cos_i, cos_o, _, _ = _cosines_and_sines(scratch, k)
            v = vgroove(cos_i, cos_o, read(scratch, rows.TAN2_H + k))
            store(scratch, rows.MIDDLE + k, v * read(scratch, rows.FRESNEL + k))
    elif masking == 1:
        for k in range(count):
            cos_i, cos_o, _, _ = _cosines_and_sines(scratch, k)
            store(scratch, rows.MIDDLE + k, unmasked(cos_i, cos_o) * read(scratch, rows.FRESNEL + k))
    elif masking == 2:
        for k in range(count):
            cos_i, cos_o, sin_i, sin_o = _cosines_and_sines(scratch, k)
            v = smith_ggx(cos_i, cos_o, sin_i, sin_o, m)
            store(scratch, rows.MIDDLE + k, v * read(scratch, rows.FRESNEL + k))
    elif masking == 3:
        for k in range(count):
            cos_i, cos_o, sin_i, sin_o = _cosines_and_sines(scratch, k)
            v = smith_ggx_separable(cos_i, cos_o, sin_i, sin_o, m)
            store(scratch, rows.MIDDLE + k, v * read(scratch, rows.FRESNEL + k))
    else:
        for k in range(count):
            cos_i, cos_o, sin_i, sin_o = _cosines_and_sines(scratch, k)
            v = smith_beckmann(cos_i, cos_o, sin_i, sin_o, m)
            store(scratch, rows.MIDDLE + k, v * read(scratch, rows.FRESNEL + k))


@inline
def _chunk(theta_i, theta_o, delta_phi, out, constants, ends, numbers, distribution, masking, form, start, stop):
    scratch = np.empty(rows.SCRATCH, np.float32)
    row = np.empty(3 * BLOCK, out.dtype)
    channels = numbers.shape[0]
    outside = np.int64(0)
    for first in range(start, stop, BLOCK):
        count = min(stop - first, BLOCK)
        outside += fill_geometry(theta_i, theta_o, delta_phi, first, count, constants, scratch)
        if form > 0:
            _fill_difference_angle(scratch, count)
        for c in range(channels):
            m = numbers[c, 0]
            if c == 0 or m != numbers[c - 1, 0]:
                _fill_root(scratch, count, distribution, m, numbers[c, 1])
            _fill_fresnel(scratch, count, form, numbers[c])
            _fill_middle(scratch, count, masking, m)
            store_result(scratch, row, out, first, count, c, channels, ends[c, 0], ends[c, 1])
        if channels == 3:
            interleave(row, out, first, count)
    return outside


@kernel
def microfacet(theta_i, theta_o, delta_phi, out, constants, ends, numbers, distribution, masking, form):
    """See the module's head."""
    outside = np.int64(0)
    for part in prange((theta_i.size + CHUNK - 1) // CHUNK):
        outside += _chunk(
            theta_i, theta_o, delta_phi, out, constants, ends, numbers, distribution, masking, form,
            part * CHUNK, min(part * CHUNK + CHUNK, theta_i.size),
        )  # fmt: skip
    return outside


def microfacet_numpy(
    theta_i: FloatArray,
    theta_o: FloatArray,
    delta_phi: FloatArray,
    out: FloatArray,
    constants: AngleConstants,
    ends: FloatArray,
    numbers: npt.NDArray[np.float32],
    distribution: int,
    masking: int,
    form: int,
) -> int:
    """The twin of `microfacet`: the same elementwise functions on whole arrays."""
    values = out.reshape(theta_i.size, -1)
    # a quotient or product past float32 on the side that `select` drops is no error
    with np.errstate(all="ignore"):
        inside, a, b, horizon_i, horizon_o, half_d, to_mirror, to_retro = split(theta_i, theta_o, delta_phi, constants)
        cos_i, cos_o, sin_i, sin_o, t2, sin2_half_d, _ = half_vector(a, b, horizon_i, horizon_o, half_d, to_mirror)
        cos_d, sin2_d = difference_angle(cos_i, cos_o, sin_i, sin_o, t2, sin2_half_d, to_retro)
        for c, (m, number, *rest) in enumerate(numbers):
            roots: dict[int, Any] = {0: beckmann_root, 2: blinn_root, 3: gaussian_root}
            root = ggx_root(t2, m, number) if distribution == 1 else roots[distribution](t2, number)
            if masking == 0:
                visible = vgroove(cos_i, cos_o, t2)
            elif masking == 1:
                visible = unmasked(cos_i, cos_o)
            else:
                smith: Any = {2: smith_ggx, 3: smith_ggx_separable, 4: smith_beckmann}[masking]
                visible = smith(cos_i, cos_o, sin_i, sin_o, m)
            fresnel: Any = ONE
            if form == 1:
                fresnel = fresnel_terms.conductor(cos_d, sin2_d, *rest[:6])
            elif form == 2:
                fresnel = fresnel_terms.schlick(cos_d, sin2_d, *rest[:2])
            elif form == 3:
                fresnel = fresnel_terms.conductor_approximate(cos_d, sin2_d, *rest[:3])
            values[:, c] = result(root, visible * fresnel, ends[c, 0], ends[c, 1])
    return int(np.count_nonzero(~inside))
