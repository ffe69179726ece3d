"""What a smooth fit leaves of measurements, given back around them: inverse-distance weights of compact support.

    f(x) += sum_k w_k r_k / (1 + sum_k w_k),   w_k = ((R_k - d_k)_+ / d_k)^2

d_k is the largest difference of the coordinates of x and x_k (`coordinates`): at x_k the whole of r_k is given back,
beyond R_k of every measurement nothing (R. Franke, G. Nielson, "Smooth interpolation of large sets of scattered data",
Int. J. Numer. Methods Eng. 15, 1980, DOI 10.1002/nme.1620151110; the 1 lets it fade). Measurements are found by a
lattice of buckets over the first three coordinates.
"""

from __future__ import annotations

import numpy as np

from brdfcore.kernels.machine.jit import inline, kernel, on_one_thread, prange

#: Buckets along theta_i, theta_o and the chord between the directions.
BUCKETS = 32
_PER_RADIAN = BUCKETS / (np.pi / 2)
_PER_CHORD = BUCKETS / 2.0
_HALF_PI = np.pi / 2
#: Closer than this a pair of directions is the measured one.
_SAME = 1e-12
#: Share of all weights that changes no digit.
_NEGLIGIBLE = 1e-16


@inline
def coordinates(theta_i, theta_o, delta_phi):
    """theta_i, theta_o, the chords from wi and from its mirror image to wo, sin theta_i sin theta_o sin delta_phi."""
    i, o = min(np.float64(theta_i), _HALF_PI), min(np.float64(theta_o), _HALF_PI)
    across = np.sin(i) * np.sin(o)
    apart = np.sin(0.5 * (i - o)) ** 2
    half = 0.5 * np.float64(delta_phi)
    s, c = np.sin(half), np.cos(half)
    return i, o, 2 * np.sqrt(apart + across * s * s), 2 * np.sqrt(apart + across * c * c), 2 * across * s * c


@inline
def _bucket(x, scale):
    return min(max(int(x * scale), 0), BUCKETS - 1)


@on_one_thread
def coordinates_of(angles, out):
    """Coordinates of angles (n, 3) into out (n, 5)."""
    for k in range(angles.shape[0]):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = coordinates(angles[k, 0], angles[k, 1], angles[k, 2])
    return 0


@on_one_thread
def buckets_of(points, reach, starts, members, fill):
    """Count the members of bucket n into starts[n + 1]; or `fill` them in from starts[n], which moves to its end."""
    for k in range(points.shape[0]):
        r = reach[k]
        for a in range(_bucket(points[k, 0] - r, _PER_RADIAN), _bucket(points[k, 0] + r, _PER_RADIAN) + 1):
            for b in range(_bucket(points[k, 1] - r, _PER_RADIAN), _bucket(points[k, 1] + r, _PER_RADIAN) + 1):
                for c in range(_bucket(points[k, 2] - r, _PER_CHORD), _bucket(points[k, 2] + r, _PER_CHORD) + 1):
                    n = (a * BUCKETS + b) * BUCKETS + c
                    if fill:
                        members[starts[n]] = k
                        starts[n] += 1
                    else:
                        starts[n + 1] += 1
    return 0


@inline
def _weight(i, o, near, mirror, side, points, k, r, two_sided):
    """w_k of a pair of directions; most are out of reach in the first coordinate."""
    d = abs(i - points[k, 0])
    if d >= r:
        return 0.0
    d = max(d, abs(o - points[k, 1]))
    if d >= r:
        return 0.0
    d = max(d, max(abs(near - points[k, 2]), abs(mirror - points[k, 3])))
    if two_sided:
        d = max(d, abs(side - points[k, 4]))
    if d >= r:
        return 0.0
    d = max(d, _SAME)
    return ((r - d) / d) ** 2


@kernel
def add_residuals(theta_i, theta_o, delta_phi, out, starts, members, points, reach, residuals, two_sided, lowest):
    """Give the residuals (k, channels) back to values (n, channels), which stay at or above `lowest`."""
    channels = out.shape[1]
    for n in prange(theta_i.size):
        i, o, near, mirror, side = coordinates(theta_i[n], theta_o[n], delta_phi[n])
        place = (_bucket(i, _PER_RADIAN) * BUCKETS + _bucket(o, _PER_RADIAN)) * BUCKETS + _bucket(near, _PER_CHORD)
        first, last = starts[place], starts[place + 1]
        total = 1.0
        for m in range(first, last):
            k = members[m]
            total += _weight(i, o, near, mirror, side, points, k, reach[k], two_sided)
        if total > 1.0:
            for m in range(first, last):
                k = members[m]
                w = _weight(i, o, near, mirror, side, points, k, reach[k], two_sided)
                if w > _NEGLIGIBLE * total:  # at a measured 0 the value is 0, not what others weigh there
                    w /= total
                    for s in range(channels):
                        out[n, s] += w * residuals[k, s]
            for s in range(channels):
                out[n, s] = max(out[n, s], lowest)
    return 0
