"""Any material in the adaptive parameterisation: its own distribution of normals, and its values at the warped nodes.

J. Dupuy, W. Jakob, ACM Trans. Graph. 37(6), 2018, DOI 10.1145/3272127.3275059, find the distribution of normals from
f at retro-reflection. That is next to nothing for many a material whose f is not, and what divides by it explodes; here
it is the mean of f cos theta_i cos theta_o over all incidences at one theta_h, with an even part added. It only places
the samples and is divided out again: whatever it is, the table interpolates f.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.errors import InputError
from brdfcore.base.geometry import outgoing_from_half

Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

#: Share of the distribution of normals that is even over the hemisphere: samples where the profile has all but none.
EVEN = 0.04
#: Nodes of the distribution of normals and of the projected area: twice and four times those of the database's files.
NORMALS, AREAS = 256, 512
#: Nodes of the density of visible normals, azimuth and polar angle. It places samples and is linear between its nodes,
#: exactly invertible: more of them change the errors by less than a tenth. Few samples do with fewer.
DENSITY = (32, 64)
#: Samples an axis at 26 angles of incidence of three channels: 2 MB as a file.
_SAMPLES, _INCIDENCES = 64, 26
#: theta_i, degrees, and azimuths of the profile.
_PROFILE, _AZIMUTHS = np.linspace(4.0, 80.0, 20), 9
#: The horizon is looked up this far above itself, rad: f may be a finite quotient by the horizon's cosine there.
_ABOVE = 1e-6
#: Relative density where no normal is visible: all of a row may be, and is divided by.
_LEAST_DENSITY = 1e-6
#: Values evaluated at once.
_CHUNK = 1 << 19
#: Largest table that is built, bytes.
MOST_BYTES = 2**31


@dataclass(frozen=True)
class WarpShape:
    """Angles of incidence; samples an axis; nodes of the visible normals' density along azimuth and polar angle."""

    incidences: int
    samples: int
    azimuths: int = DENSITY[0]
    polar: int = DENSITY[1]

    def table_bytes(self, channels: int) -> int:
        """Bytes of a table's arrays, but for those that do not grow with it."""
        slice_bytes = 4 * channels * self.samples**2 + 8 * self.azimuths * (self.polar + 1)
        return self.incidences * slice_bytes + 4 * (NORMALS + AREAS)

    def file_bytes(self, channels: int) -> int:
        """Bytes of an RGL file: beside the samples it has their luminance, and profiles twice."""
        slice_bytes = 4 * (channels + 1) * self.samples**2 + 4 * self.azimuths * self.polar + self.samples**2 // 8
        return self.incidences * slice_bytes + 8 * (NORMALS + AREAS) + 1024


def shape_within(nbytes: float, channels: int, *, file: bool) -> WarpShape:
    """The shape of at most so many bytes, as a table or as a `file`: angles of incidence grow more slowly than samples.

    `InputError` where less than 8 samples an axis would be left.
    """
    best = None
    for samples in range(8, 1025):
        shape = WarpShape(
            max(8, round(_INCIDENCES * (samples / _SAMPLES) ** 0.5)),
            samples,
            min(DENSITY[0], samples),
            min(DENSITY[1], 2 * samples),
        )
        least = (shape.file_bytes if file else shape.table_bytes)(channels)
        if least > nbytes:
            break
        best = shape
    if best is None:
        raise InputError(
            "too_small",
            f"max_bytes = {nbytes:g}: a vndf_warp of {channels} channel(s) takes {least} bytes at least",
            where="max_bytes",
            got=nbytes,
            expected=f">= {least}",
        )
    return best


def checked_shape(shape: tuple[int, ...], channels: int) -> WarpShape:
    """`shape` as (theta_i, samples) or with the density's nodes (azimuth, polar angle) after them."""
    if len(shape) not in (2, 4) or min(shape) < 2:
        expected = "(theta_i, samples an axis), or these and the visible normals' nodes (azimuth, polar), each >= 2"
        raise InputError("bad_shape", f"shape = {list(shape)}: expected {expected}", where="shape", got=list(shape))
    made = WarpShape(*shape)
    if made.table_bytes(channels) > MOST_BYTES:
        said = f"shape = {list(shape)}: {made.table_bytes(channels)} bytes; at most {MOST_BYTES} are built"
        raise InputError("bad_shape", said, where="shape", got=list(shape), expected=f"at most {MOST_BYTES} bytes")
    return made


def fit(source: Brdf, shape: WarpShape) -> dict[str, Float32Array]:
    """theta_i, sigma, ndf, vndf and spectra as `VndfWarp.from_densities` takes them.

    spectra = f cos theta_o 4 sigma / ndf at the half vectors of even places in the warped square; behind the horizon
    the value at the horizon goes on, so that cells across it interpolate what is above. Raises `InputError` where a
    value of the source is not finite, or where it has no regular part above 0.
    """
    u = np.linspace(0, 1, NORMALS)
    ndf = _distribution(source, HALF_PI * u * u)
    v = np.linspace(0, 1, AREAS)
    sigma = _projected_area(HALF_PI * v * v, HALF_PI * u * u, ndf).astype(np.float32)
    ndf32 = ndf.astype(np.float32)
    theta_i = incidence_nodes(shape.incidences, getattr(source, "incidence_knots", ()))
    density = _visible(theta_i, np.interp(np.linspace(0, 1, shape.polar), u, ndf), shape)
    at_u, at_v = _inverted(density.astype(np.float64), shape.samples)
    theta_h, phi_h = HALF_PI * at_u**2, (2 * at_v - 1) * np.pi
    at_i = np.broadcast_to(theta_i[:, None, None].astype(np.float64), at_u.shape)
    theta_o, delta_phi, _ = outgoing_from_half(at_i, theta_h, phi_h)
    theta_o = np.minimum(theta_o, HALF_PI - _ABOVE)
    area = np.interp(np.sqrt(theta_i * (2 / np.pi)), v, sigma)
    factor = np.cos(theta_o) * 4 * area[:, None, None] / np.interp(at_u, u, ndf32)
    values = _values(source, np.minimum(at_i, HALF_PI), theta_o, delta_phi)
    with np.errstate(over="ignore", invalid="ignore"):
        spectra = (values * factor[..., None]).astype(np.float32)
    if not np.isfinite(spectra).all():
        k = tuple(int(n) for n in np.argwhere(~np.isfinite(spectra))[0])
        place = [float(np.degrees(x[k[:3]])) for x in (at_i, theta_o, delta_phi)]
        got = float(values[k])
        said = f"the source is {got:g} at theta_i, theta_o, delta_phi = {place[0]:.4g}, {place[1]:.4g}, {place[2]:.4g} "
        raise InputError("not_finite", f"{said}degrees: a table holds finite values", where="source", got=str(got))
    return {
        "theta_i": theta_i,
        "sigma": sigma,
        "ndf": ndf32,
        "vndf": density,
        "spectra": np.ascontiguousarray(np.moveaxis(spectra, -1, 1)),
    }


def incidence_nodes(n: int, knots: npt.ArrayLike = ()) -> Float32Array:
    """About n angles of incidence, 0 and pi/2 among them, even in y = 1 - (1 - sin theta_i)^(1/4).

    y grows as theta_i at the normal and as the root of the distance to the horizon, where lobes change faster and
    faster. `knots` of the source, between which it is linear, are nodes as well.
    """
    inner = [float(t) for t in np.ravel(np.asarray(knots, np.float64)) if 1e-3 < t < HALF_PI - 1e-3]
    if len(inner) > n:
        inner = []
    ends = np.array(sorted({0.0, *inner, HALF_PI}))
    y = 1 - (1 - np.sin(ends)) ** 0.25
    parts = []
    for low, high in pairwise(y):
        steps = max(1, round((n - 1) * float(high - low)))
        parts.append(low + (high - low) * np.arange(steps) / steps)
    placed = np.concatenate([*parts, [1.0]])
    nodes: Float32Array = np.arcsin(np.clip(1 - (1 - placed) ** 4, 0, 1)).astype(np.float32)
    return nodes


def _distribution(source: Brdf, polar: Float64Array) -> Float64Array:
    """D at polar angles, 1/sr, of unit projected area: (1 - EVEN) of the profile, EVEN / pi everywhere.

    The profile is sum f c_i c_o w / sum w over incidences and azimuths, w = c_i s_i c_o: the weight of a direction is 0
    where it passes below the horizon, without which the profile would jump there.
    """
    turns = _AZIMUTHS if source.bilateral else 2 * _AZIMUTHS - 2
    phi = np.linspace(0, np.pi, turns) if source.bilateral else 2 * np.pi * np.arange(turns) / turns - np.pi
    theta_h, theta_i, phi_h = np.broadcast_arrays(polar[:, None, None], np.radians(_PROFILE)[:, None], phi)
    theta_o, delta_phi, dot = outgoing_from_half(theta_i, theta_h, phi_h)
    seen = (theta_o < HALF_PI - 1e-3) & (dot > 0)
    f = np.zeros(theta_h.shape)
    # in magnitude: noise about 0 is light that may be looked up as well
    f[seen] = np.abs(_values(source, theta_i[seen], theta_o[seen], delta_phi[seen])).mean(axis=-1)
    if not np.isfinite(f).all():
        raise InputError(
            "not_finite", "the source is not finite everywhere: a table holds finite values", where="source"
        )
    cosines = np.maximum(np.cos(theta_o), 0) * np.cos(theta_i)
    weight = seen * np.sin(theta_i) * cosines
    total = weight.sum(axis=(1, 2))
    profile = np.divide((f * cosines * weight).sum(axis=(1, 2)), total, out=np.zeros_like(total), where=total > 0)
    area = 2 * np.pi * float(np.trapezoid(profile * np.sin(polar) * np.cos(polar), polar))
    if not area > 0:
        raise InputError(
            "no_regular_part",
            "the source reflects nothing but in a mirror, or nothing at all: there is no lobe to place samples in",
            where="source",
            expected="a regular part above 0",
        )
    ndf: Float64Array = (1 - EVEN) / area * profile + EVEN / np.pi
    return ndf


def _projected_area(theta: Float64Array, polar: Float64Array, ndf: Float64Array) -> Float64Array:
    """sigma(theta) = int D max(0, w.m) dm. The azimuths' part is 2 (p c + s sin p) of c = cos cos, s = sin sin, with
    p = acos(-c/s) where a normal of that polar angle turns invisible, else pi."""
    c, s = (np.multiply.outer(g(theta), g(polar)) for g in (np.cos, np.sin))
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.where(c >= s, np.pi, np.arccos(np.clip(-c / s, -1, 1)))
    area: Float64Array = np.trapezoid(2 * (p * c + s * np.sin(p)) * (ndf * np.sin(polar)), polar, axis=1)
    return area


def _visible(theta_i: Float32Array, ndf: Float64Array, shape: WarpShape) -> Float32Array:
    """Density of visible normals over the unit square (K, azimuth, polar angle), of mean about 1."""
    u, phi = np.linspace(0, 1, shape.polar), np.pi * np.linspace(-1, 1, shape.azimuths)
    polar = HALF_PI * u * u
    c, s = (np.multiply.outer(g(theta_i.astype(np.float64)), g(polar))[:, None] for g in (np.cos, np.sin))
    density = np.maximum(c + s * np.cos(phi)[:, None], 0) * (ndf * u * np.sin(polar))
    mean = density.mean(axis=(1, 2), keepdims=True)
    return np.asarray(density / mean + _LEAST_DENSITY, np.float32)


def _inverted(density: Float64Array, samples: int) -> tuple[Float64Array, Float64Array]:
    """(u, v), each (K, N, N): where the cumulative bilinear density is at even places; rows along v."""
    slices, n_y, n_x = density.shape
    places = np.linspace(0, 1, samples)
    at_u, at_v = np.empty((2, slices, samples, samples))
    for k in range(slices):
        along = _running(density[k])
        lines = along[:, -1]
        across = _running(lines[None])[0]
        row, v = _solved(across[None], lines[None], places[None] * across[-1])
        row, v = row[0], v[0][:, None]
        at_v[k] = (row[:, None] + v) / (n_y - 1)
        mixed = density[k][row] * (1 - v) + density[k][row + 1] * v
        sums = along[row] * (1 - v) + along[row + 1] * v
        column, u = _solved(sums, mixed, places * sums[:, -1:])
        at_u[k] = (column + u) / (n_x - 1)
    return at_u, at_v


def _running(density: Float64Array) -> Float64Array:
    """Trapezoidal integral along the last axis over [0, 1], 0 at its first node."""
    steps = 0.5 * (density[:, 1:] + density[:, :-1]) / (density.shape[1] - 1)
    return np.concatenate([np.zeros((density.shape[0], 1)), np.cumsum(steps, axis=1)], axis=1)


def _solved(
    sums: Float64Array, density: Float64Array, wanted: Float64Array
) -> tuple[npt.NDArray[np.intp], Float64Array]:
    """Cell and place in it of `wanted` (rows, n) on running integrals (rows, nodes) of a density linear between nodes:
    x of a x + (b - a) x^2/2 = rest, as 2 rest / (a + sqrt(a^2 + 2 (b - a) rest))."""
    n = sums.shape[1]
    cell = np.stack([np.searchsorted(s, w, side="right") for s, w in zip(sums, wanted)]) - 1
    cell = np.clip(cell, 0, n - 2)
    row = np.arange(sums.shape[0])[:, None]
    a, b = density[row, cell], density[row, cell + 1]
    rest = (wanted - sums[row, cell]) * (n - 1)
    root = np.sqrt(np.maximum(a * a + 2 * (b - a) * rest, 0))
    return cell, np.clip(2 * rest / np.maximum(a + root, 1e-300), 0, 1)


def _values(source: Brdf, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
    """f_r at angles of one shape, + (channels,), a few at a time."""
    flat = [np.ascontiguousarray(x).reshape(-1) for x in (theta_i, theta_o, delta_phi)]
    out = np.empty((flat[0].size, len(source.channels)))
    step = max(_CHUNK // len(source.channels), 1)
    for start in range(0, len(out), step):
        piece = [x[start : start + step] for x in flat]
        out[start : start + step] = source.evaluate(*piece)
    return out.reshape(*theta_i.shape, -1)
