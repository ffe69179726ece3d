"""Look-ups about the centre of a lobe: distance and azimuth from it, and theta_i; guides, maps, half-precision nodes.

Three coordinates of a pair of directions, without inverse trigonometry. With A = (theta_i + theta_o)/2,
B = (theta_i - theta_o)/2, S = (c_i + c_o)/2 = cos A cos B, and C, D the cosine and sine of delta_phi/2:

    centre     u                                          X (and Y = s_o C D), up to a common factor
    HALF       tan^2 theta_h = tan^2 B + s_i s_o C^2/S^2  sin B cos A + s_o C^2
    MIRROR     sin^2(r/2)    = sin^2 B + s_i s_o C^2      sin B cos B + c_i s_o C^2     r from the mirror direction
    LIGHT      sin^2(r/2)    = sin^2 B + s_i s_o D^2      sin B cos B + c_i s_o D^2     r from the light

All sums of u are of positive terms. z is the diamond angle of (X, |Y|), in [0, 2]: of the half vector's azimuth from
the light, or of the viewer's about the centre, from the direction of the normal; with the sign of sin delta_phi where
the table is not bilateral. w = c_i/(1 + s_i) = tan((pi/2 - theta_i)/2), in (0, 1]: linear in theta_i at the normal, and
in the elevation at the horizon.

The light's angle is a coordinate of its own, so that each incidence has its nodes, the normal and the horizon are faces
of the lattice, and a slice at the normal has one value for all azimuths. Loops, maps and guides are those of
`kernels.tables.half_difference`, over other coordinates and with other steps: 16 to the octave, of u from 2^-56 to 2^12
(lobes from 1e-8 up), of w from 2^-20.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.geometry import outgoing_from_half
from brdfcore.kernels.machine.jit import inline, kernel, with_names
from brdfcore.kernels.machine.vectorised import fma, fused_sin
from brdfcore.kernels.tables import half_coordinates, half_difference
from brdfcore.kernels.tables.half_coordinates import HORIZON_COS, HalfScale, half_scale

Float64Array = npt.NDArray[np.float64]

#: The centres, as `HalfScale.mirror` holds them.
HALF, MIRROR, LIGHT = 0, 1, 2
#: u below 2^FIRST_U and above 2^LAST_U is one point each of the guide; steps an octave. The same for w, to 1.
FIRST_U, LAST_U, STEPS_U = -56, 12, 16
FIRST_W, LAST_W, STEPS_W = -20, 0, 16
_U_SHIFT, _W_SHIFT = 23 - 4, 23 - 4

_factor, _diamond = half_coordinates._factor, half_coordinates._diamond


def lobe_scale(
    shape: tuple[int, int, int],
    steps_z: int,
    guide: tuple[float, float],
    factor: tuple[float, ...],
    centre: int,
    value: float,
    bilateral: bool,
    dtype: npt.DTypeLike,
) -> HalfScale:
    """As `half_difference.table_scale`; `centre`: HALF, MIRROR or LIGHT."""
    table = (
        *guide, *((n - 1) / half_difference.WORDS for n in shape), steps_z * half_difference.SHORT,
        0 if bilateral else 2, value * half_difference._HALF_SCALE, 2.0**-_U_SHIFT, 2.0**-_W_SHIFT,
    )  # fmt: skip
    return half_scale(factor, float(centre), table, dtype)  # type: ignore[arg-type]


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
    near = sin_half if scale.mirror > scale.one else cos_half
    s = half * (cos_i + cos_o)
    # about h the differences are divided: by cos A on the way to X, by S on the way to u
    about_h = scale.mirror == zero
    cos_a = s / cos_b
    across = near / s if about_h else near
    along = sin_b / cos_b if about_h else sin_b
    u = fma(sin_i * sin_o * across, across, along * along)
    x = fma(sin_o * near, near if about_h else cos_i * near, sin_b * (cos_a if about_h else cos_b))
    w = cos_i / (scale.one + sin_i)
    # sin(delta_phi) < 0; past half a turn its sign turns, past a whole one again
    backward = ((c < zero) ^ over) ^ (abs(c) > scale.turn)
    z = _diamond(sin_o * (sin_half * cos_half), x, backward, scale, bilateral, False)
    return inside, u, w, z, _factor(cos_i, cos_o, scale)


@inline
def from_vectors(ix, iy, iz, ox, oy, oz, scale, bilateral, reciprocal):
    """usable, above the horizon, u, w, z and K of a pair of vectors, which are normalised here.

    Not usable: NaN, infinite, zero, or of a length whose square leaves [1e-12, 1e12]. With d the difference of wo from
    the centre, u = |d|^2/4 and X = (o_z - i_z) + i_z |d|^2/2, which near the centre loses no digit.
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
    light = scale.mirror > scale.one
    about_h = scale.mirror == scale.zero
    hx = ox - ix if light else ox + ix
    hy = oy - iy if light else oy + iy
    across = fma(hx, hx, hy * hy)
    apart = cos_o - cos_i
    chord = fma(apart, apart, across)
    inverse = scale.one / (cos_i + cos_o)
    u = across * inverse * inverse if about_h else scale.quarter * chord
    x = fma(hx, ix, hy * iy) if about_h else fma(scale.half * cos_i, chord, apart)
    sin_i = np.sqrt(fma(ix, ix, iy * iy))
    cross = ix * oy - iy * ox
    z = _diamond(abs(cross), x, cross < scale.zero, scale, bilateral, False)
    return usable, above, u, cos_i / (scale.one + sin_i), z, _factor(cos_i, cos_o, scale)


def coordinates_numpy(
    theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, bilateral: bool, reciprocal: bool, centre: int = 0
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(u, w, z) by library functions in float64: the twin of `from_angles`, and what tables are built with."""
    a, b = (np.minimum(np.asarray(t, np.float64), HALF_PI) for t in (theta_i, theta_o))
    c = np.asarray(delta_phi, np.float64)
    sin_half, cos_half = np.abs(np.sin(0.5 * c)), np.abs(np.cos(0.5 * c))
    near = sin_half if centre == LIGHT else cos_half
    sin_b, cos_b = np.sin(0.5 * (a - b)), np.cos(0.5 * (a - b))
    cos_i = np.maximum(np.cos(a), HORIZON_COS)
    if centre == HALF:
        cos_a = np.maximum(np.cos(0.5 * (a + b)), HORIZON_COS)
        u = (sin_b / cos_b) ** 2 + np.sin(a) * np.sin(b) * (near / (cos_a * cos_b)) ** 2
        x = sin_b * cos_a + np.sin(b) * near**2
    else:
        u = sin_b**2 + np.sin(a) * np.sin(b) * near**2
        x = sin_b * cos_b + cos_i * np.sin(b) * near**2
    y = np.sin(b) * sin_half * cos_half
    both = np.abs(x) + y
    z = np.divide(y, both, out=np.ones_like(y), where=both > 0)
    z = np.where(x >= 0, z, 2 - z)
    if not bilateral:
        z = np.where(np.sin(c) < 0, -z, z)
    return u, cos_i / (1 + np.sin(a)), z


def angles_of(
    u: Float64Array, w: Float64Array, z: Float64Array, centre: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(theta_i, theta_o, delta_phi) of coordinates (u, w, z); theta_o beyond pi/2 is below the horizon."""
    theta_i = HALF_PI - 2 * np.arctan(w)
    size = np.abs(z)
    folded = np.where(size <= 1, size, 2 - size)
    phi = np.arctan2(folded, 1 - folded)
    phi = np.where(size <= 1, phi, np.pi - phi)
    if centre == HALF:
        theta_o, delta_phi, _ = outgoing_from_half(theta_i, np.arctan(np.sqrt(u)), phi)
    else:
        sin_half = np.sqrt(np.minimum(u, 1.0))
        r = 2 * np.arcsin(sin_half)
        inwards, across, out = np.sin(r) * np.cos(phi), np.sin(r) * np.sin(phi), np.cos(r)
        x = np.sin(theta_i) * out - np.cos(theta_i) * inwards
        theta_o = np.arctan2(np.hypot(x, across), np.cos(theta_i) * out + np.sin(theta_i) * inwards)
        # about the mirror direction, at the azimuth pi: pi - atan2 turns the same way
        delta_phi = np.arctan2(across, x if centre == LIGHT else -x)
    return theta_i, theta_o, np.where(z < 0, -np.abs(delta_phi), np.abs(delta_phi))


def grid_u() -> Float64Array:
    """u of the nodes of guide and map: the first stands for all below, the last for all above."""
    return half_difference._grid(FIRST_U, LAST_U, STEPS_U)


def grid_w() -> Float64Array:
    """w of the nodes of its map, up to 1."""
    return half_difference._grid(FIRST_W, LAST_W, STEPS_W)


_names = {
    **vars(half_difference), "__name__": __name__, "from_angles": from_angles, "from_vectors": from_vectors,
    "coordinates_numpy": coordinates_numpy, "grid_u": grid_u, "grid_w": grid_w,
    "_U_FIRST": (127 + FIRST_U) << 23, "_U_LAST": (LAST_U - FIRST_U) << 23, "_U_SHIFT": _U_SHIFT,
    "_W_FIRST": (127 + FIRST_W) << 23, "_W_LAST": (LAST_W - FIRST_W) << 23, "_W_SHIFT": _W_SHIFT,
}  # fmt: skip
_names["_place"] = inline(with_names(half_difference._place.py_func, _names))

angles_one, angles_three, angles_many, vectors_one, vectors_three, vectors_many = (
    kernel(with_names(k.python, _names))
    for k in (
        half_difference.angles_one, half_difference.angles_three, half_difference.angles_many,
        half_difference.vectors_one, half_difference.vectors_three, half_difference.vectors_many,
    )
)  # fmt: skip
lobe_numpy = with_names(half_difference.half_numpy, _names)
