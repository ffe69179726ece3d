"""A lit sphere as numbers: the radiance that an orthographic camera sees of each point of it.

Under surroundings of radiance L each point integrates f_r L cos theta_i over the hemisphere. The camera looks along
-z, so that turning a point about z turns the light with it: for one theta_o all azimuths together are a circular
convolution of L with the lobe, and a picture costs as many evaluations as it has polar angles, not pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.quadrature import hemisphere_rule
from brdfcore.plot.lighting import WHITE, Radiance, surroundings

Array = npt.NDArray[np.float64]
#: A named lighting, or the directions (k, 3) of equal distant lamps; x right, y up, z towards the viewer.
Light = str | npt.ArrayLike

PIXELS_MIN, PIXELS_MAX, LAMPS_MAX = 16, 2048, 64
#: Rows of directions from the viewer's axis to its opposite, and columns around it: cells of two degrees.
_ROWS, _COLUMNS = 90, 180
#: Polar angles of the viewer. The limb itself, where measured f_r may be unbounded, takes that of 87.5 degrees: a
#: thousandth of the radius.
_TILTS, _LIMB = 72, np.radians(87.5)
#: tan theta_h of the bump about the mirror direction that is integrated on nodes graded towards it: 4 degrees, so that
#: what is left is smooth over two cells; and the nodes of that rule.
_BUMP, _POINTS, _AZIMUTHS = 0.07, 6, 32
#: Samples a pixel along each side, for lamps and for mirror images.
_SUBPIXELS = 3
#: Radius at which a mirror shows a lamp, which has none, radians.
LAMP_RADIUS = np.radians(2.0)


class Lit(NamedTuple):
    """A picture in numbers: linear, (size, size, channels), first row on top, 0 around the sphere; the share of each
    pixel that the sphere covers, (size, size); how many values of f_r were not finite and counted as 0."""

    radiance: Array
    coverage: Array
    not_finite: int


def render_sphere(b: Brdf, size: int = 256, light: Light = "studio", *, channel: str | float | None = None) -> Array:
    """Radiance of a lit sphere, linear, (size, size, channels), float64; first row on top, 0 around the sphere.

    b        any material; its mirror part shows the light itself. f_r is not clamped: a pixel may be negative.
    size     pixels, the diameter of the sphere, 16 to 2048; its edge is anti-aliased by area.
    light    "studio" (soft boxes in a room), "sky" (overcast), or directions (k, 3) of at most 64 equal distant lamps,
             x right, y up, z towards the viewer. Scaled so that a white Lambertian sphere has at most 0.9.
    channel  one only, by name, wavelength or position.

    Surroundings are seen with a resolution of two degrees, by mirror parts exactly; below one degree lobes do not get
    sharper. Raises `InputError` for a size or light that is none, `UnknownNameError` for the channel.
    """
    weights = np.eye(len(b.channels))
    return lit(b, size, light, weights if channel is None else weights[:, [b.channels.find(channel)]]).radiance


def lit(b: Brdf, size: int, light: Light, weights: Array) -> Lit:
    """As `render_sphere`, of the channels @ `weights`, (channels, k)."""
    if isinstance(size, bool) or not isinstance(size, (int, np.integer)) or not PIXELS_MIN <= size <= PIXELS_MAX:
        expected = f"a whole number of pixels from {PIXELS_MIN} to {PIXELS_MAX}"
        raise InputError("bad_size", f"size = {str(size)[:40]}: expected {expected}", where="size", expected=expected)
    if isinstance(light, str):
        around, lamps = surroundings(light), None
        values, bad = _smooth(b, around, weights, int(size))
    else:
        lamps = _lamps(light)
        around, bad = _discs(lamps), 0
        values = np.zeros((int(size), int(size), weights.shape[1]))
    mirror = _mirror(b, weights) if b.has_delta else None
    for first, last in _bands(int(size)) if mirror is not None or lamps is not None else ():
        x, y = _centres(int(size), _SUBPIXELS, first, last)
        samples = np.zeros((x.size, weights.shape[1]))
        if lamps is not None:
            bad += _add_lamps(samples, b, lamps, weights, x, y)
        if mirror is not None:
            samples += _mirrored(mirror, around, x, y)
        each = samples.reshape(last - first, _SUBPIXELS, int(size), _SUBPIXELS, -1)
        values[first:last] += each.mean(axis=(1, 3))
    covered = _coverage(int(size))
    return Lit(values * covered[..., None], covered, bad)


def _bands(size: int) -> Iterator[tuple[int, int]]:
    """Rows of pixels that are sampled at a time: some 200,000 samples, whatever the size."""
    rows = max(1, 200_000 // (size * _SUBPIXELS**2))
    for first in range(0, size, rows):
        yield first, min(first + rows, size)


def _centres(size: int, each: int, first: int, last: int) -> tuple[Array, Array]:
    """x and y of the centres of size*each squares a side, in the pixel rows first to last, those off the sphere moved
    to its edge; flat."""
    along = (np.arange(size * each) + 0.5) / (size * each) * 2 - 1
    x, y = (a.ravel() for a in np.meshgrid(along, -along[first * each : last * each]))
    outside = np.maximum(np.hypot(x, y), 1.0)
    return x / outside, y / outside


def _coverage(size: int) -> Array:
    """Share of each pixel inside the circle: the distance to its edge, in pixels, from -1/2 to 1/2."""
    along = (np.arange(size) + 0.5) / size * 2 - 1
    return np.clip((1 - np.hypot(along[None, :], along[:, None])) * size / 2 + 0.5, 0.0, 1.0)


# ---- surroundings ---------------------------------------------------------------------------------------------


def _smooth(b: Brdf, around: Radiance, weights: Array, size: int) -> tuple[Array, int]:
    """Radiance of the regular part, (size, size, k), and how many values were not finite."""
    spectrum = np.fft.rfft(around(_grid()).astype(np.float32), axis=1)
    seen = np.empty((_TILTS, weights.shape[1], _COLUMNS))
    bad = 0
    for k, rule in enumerate(_rules(b.bilateral)):
        kernel, missing = _kernel(b, rule, weights)
        bad += missing
        # a correlation about the viewer's axis: sum over rows of conj(K) L, one product a frequency
        seen[k] = np.fft.irfft((np.conj(np.fft.rfft(kernel, axis=2)) * spectrum).sum(axis=1), n=_COLUMNS, axis=1)
    x, y = _centres(size, 1, 0, size)
    theta = np.arcsin(np.minimum(np.hypot(x, y), 1.0))
    row = np.clip(theta / conventions.HALF_PI * _TILTS - 0.5, 0.0, _TILTS - 1.0)
    column = np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi) * _COLUMNS
    return _bilinear(seen.transpose(0, 2, 1), row, column).reshape(size, size, -1), bad


class _Rule(NamedTuple):
    """Where f_r is needed for one tilt, and to which cell of the surroundings each value goes with which weight.

    The first `cells.size` angles are the cells themselves, weighted by 1 - bump; the rest are nodes graded towards the
    mirror direction, weighted by the bump and shared among the four cells around each: `places`, `parts` (4, n).
    """

    tilt: float
    theta_i: Array
    delta_phi: Array
    cells: npt.NDArray[np.intp]
    share: Array
    places: npt.NDArray[np.intp]
    parts: Array


@cache
def _rules(bilateral: bool) -> list[_Rule]:
    """One rule a tilt; the same for every material (some 20 MB, kept)."""
    return [
        _rule(float(tilt), bilateral)
        for tilt in np.minimum((np.arange(_TILTS) + 0.5) * conventions.HALF_PI / _TILTS, _LIMB)
    ]


def _rule(tilt: float, bilateral: bool) -> _Rule:
    grid, normal = _grid(), np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    cosine = grid @ normal
    row, column = np.nonzero(cosine > 0)
    if bilateral:  # the other half is its mirror image
        upper = column <= _COLUMNS // 2
        row, column = row[upper], column[upper]
    cell, cos_cell = grid[row, column], cosine[row, column]
    # the light's parts along e1, the viewer's own azimuth, and -e2 = -n x e1 = y
    along = -np.cos(tilt) * cell[:, 0] + np.sin(tilt) * cell[:, 2]
    theta_cell = np.minimum(np.arctan2(np.hypot(along, cell[:, 1]), cos_cell), conventions.HALF_PI)
    delta_cell = np.arctan2(cell[:, 1], along)
    solid = np.sin((row + 0.5) * np.pi / _ROWS) * (np.pi / _ROWS) * (2 * np.pi / _COLUMNS)
    share = (1 - _bump(theta_cell, tilt, delta_cell)) * cos_cell * solid
    if bilateral:
        share = np.where((column > 0) & (column < _COLUMNS // 2), 2.0, 1.0) * share

    theta, delta, weight = hemisphere_rule(tilt, points=_POINTS, azimuths=_AZIMUTHS, bilateral=bilateral)
    bump = _bump(theta, tilt, delta)
    near = bump > 1e-4  # a ten-thousandth of the value at the mirror direction: nothing that shows
    theta, delta, weight = theta[near], delta[near], weight[near] * bump[near] * np.cos(theta[near])
    inward, y, up = np.sin(theta) * np.cos(delta), np.sin(theta) * np.sin(delta), np.cos(theta)
    x, z = -np.cos(tilt) * inward + np.sin(tilt) * up, np.sin(tilt) * inward + np.cos(tilt) * up
    rows = np.clip(np.arctan2(np.hypot(x, y), z) / np.pi * _ROWS - 0.5, 0.0, _ROWS - 1.0)
    columns = np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi) * _COLUMNS
    r, c = np.minimum(rows.astype(np.intp), _ROWS - 2), columns.astype(np.intp)
    dr, dc = rows - r, columns - c
    places = [(r + i) * _COLUMNS + (c + j) % _COLUMNS for i in (0, 1) for j in (0, 1)]
    parts = [weight * wr * wc for wr in (1 - dr, dr) for wc in (1 - dc, dc)]
    thetas = np.concatenate([theta_cell, np.minimum(theta, conventions.HALF_PI)])
    deltas = np.concatenate([delta_cell, delta])
    return _Rule(tilt, thetas, deltas, row * _COLUMNS + column, share, np.stack(places), np.stack(parts))


def _kernel(b: Brdf, rule: _Rule, weights: Array) -> tuple[npt.NDArray[np.float32], int]:
    """What each cell of the surroundings weighs for a point tilted towards +x, (k, rows, columns)."""
    f = b.evaluate(rule.theta_i, rule.tilt, rule.delta_phi)
    finite = np.isfinite(f)
    bad = 0 if finite.all() else int((~finite).sum())
    f = (f if bad == 0 else np.where(finite, f, 0.0)) @ weights
    kernel = np.empty((weights.shape[1], _ROWS * _COLUMNS))
    count = rule.cells.size
    for k in range(weights.shape[1]):
        kernel[k] = np.bincount(rule.places.ravel(), (rule.parts * f[count:, k]).ravel(), _ROWS * _COLUMNS)
        kernel[k, rule.cells] += f[:count, k] * rule.share
    made = kernel.reshape(-1, _ROWS, _COLUMNS)
    if b.bilateral:  # one half was evaluated, with the weight of both: make it even in azimuth
        made[:, :, 1:] = 0.5 * (made[:, :, 1:] + made[:, :, :0:-1])
    return made.astype(np.float32), bad


def _bump(theta: Array, tilt: float, delta: Array) -> Array:
    """exp(-(tan theta_h/_BUMP)^2): 1 in the mirror direction, 0 far from it."""
    x, y, z = np.sin(theta) * np.cos(delta) + np.sin(tilt), np.sin(theta) * np.sin(delta), np.cos(theta) + np.cos(tilt)
    return np.asarray(np.exp(-(x * x + y * y) / (z * _BUMP) ** 2))


def _bilinear(table: Array, row: Array, column: Array) -> Array:
    """table (rows, columns, k), periodic in columns, at fractional places (n,) -> (n, k)."""
    r, c = np.minimum(row.astype(np.intp), table.shape[0] - 2), column.astype(np.intp) % table.shape[1]
    dr, dc, after = (row - r)[:, None], (column - np.floor(column))[:, None], (c + 1) % table.shape[1]
    upper = table[r, c] * (1 - dc) + table[r, after] * dc
    lower = table[r + 1, c] * (1 - dc) + table[r + 1, after] * dc
    return np.asarray(upper * (1 - dr) + lower * dr)


@cache
def _grid() -> Array:
    """Directions of the cells of the surroundings, (rows, columns, 3)."""
    psi, chi = (np.arange(_ROWS) + 0.5) * np.pi / _ROWS, np.arange(_COLUMNS) * 2 * np.pi / _COLUMNS
    return _directions(psi[:, None], chi[None, :])


def _directions(psi: Array, chi: Array) -> Array:
    """Unit vectors at an angle psi from +z, azimuth chi from +x."""
    x, y, z = np.broadcast_arrays(np.sin(psi) * np.cos(chi), np.sin(psi) * np.sin(chi), np.cos(psi))
    return np.stack([x, y, z], axis=-1)


# ---- lamps, and mirror parts ----------------------------------------------------------------------------------


def _lamps(light: npt.ArrayLike) -> Array:
    """Directions as unit vectors (k, 3)."""
    given = np.atleast_2d(conventions.as_float("light", light)).astype(np.float64)
    if given.ndim != 2 or given.shape[1] != 3 or not 1 <= given.shape[0] <= LAMPS_MAX:
        expected = f"1 to {LAMPS_MAX} directions of shape (k, 3), or the name of a lighting"
        raise InputError(
            "bad_option", f"light: expected {expected}; got an array of shape {given.shape}",
            where="light", got=list(given.shape), expected=expected,
        )  # fmt: skip
    return conventions.flatten_vectors(given, given).wi


def _add_lamps(samples: Array, b: Brdf, lamps: Array, weights: Array, x: Array, y: Array) -> int:
    """Add the radiance under lamps, each of irradiance pi WHITE/k on a surface that faces it, to samples (n, k); how
    many values were not finite."""
    local, cosines = _local(x, y, lamps)
    viewer, bad = local[-1], 0
    for wi, cosine in zip(local[:-1], cosines):
        lit_up = (cosine > 0) & (viewer[:, 2] > 0)
        f = b.evaluate_vectors(wi[lit_up], viewer[lit_up])
        finite = np.isfinite(f)
        bad += int((~finite).sum())
        samples[lit_up] += (np.where(finite, f, 0.0) @ weights) * cosine[lit_up, None] * (np.pi * WHITE / len(lamps))
    return bad


def _local(x: Array, y: Array, lamps: Array) -> tuple[list[Array], list[Array]]:
    """Each lamp, and last the viewer, in the frames of the points; and the cosines of the lamps."""
    theta = np.minimum(np.arcsin(np.minimum(np.hypot(x, y), 1.0)), _LIMB)
    azimuth = np.arctan2(y, x)
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(azimuth), np.sin(azimuth)
    e1 = np.stack([-ct * ca, -ct * sa, st], axis=1)
    n = np.stack([st * ca, st * sa, ct], axis=1)
    e2 = np.stack([sa, -ca, np.zeros_like(sa)], axis=1)  # n x e1
    frames = [np.stack([e1 @ d, e2 @ d, n @ d], axis=1) for d in (*lamps, np.array([0.0, 0.0, 1.0]))]
    return frames, [f[:, 2] for f in frames[:-1]]


def _mirror(b: Brdf, weights: Array) -> tuple[Array, Array]:
    """Polar angles, and what the perfect mirror part reflects at each, (n,) and (n, k)."""
    nodes = np.linspace(0.0, conventions.HALF_PI, 361)
    return nodes, b.delta_reflectance(nodes) @ weights


def _mirrored(mirror: tuple[Array, Array], around: Radiance, x: Array, y: Array) -> Array:
    """Radiance of the perfect mirror part: the light in the reflected direction, (n, k)."""
    theta = np.arcsin(np.minimum(np.hypot(x, y), 1.0))
    share = np.stack([np.interp(theta, mirror[0], row) for row in mirror[1].T], axis=1)
    return np.asarray(share * around(_directions(2 * theta, np.arctan2(y, x)))[:, None])


def _discs(lamps: Array) -> Radiance:
    """What a mirror shows of lamps: discs of `LAMP_RADIUS`, as bright as their light on so little space."""
    radiance = np.pi * WHITE / len(lamps) / (2 * np.pi * (1 - np.cos(LAMP_RADIUS)))

    def around(towards: Array) -> Array:
        seen = sum((np.linalg.norm(towards - lamp, axis=-1) < 2 * np.sin(LAMP_RADIUS / 2)) for lamp in lamps)
        return np.asarray(radiance * np.asarray(seen, np.float64))

    return around
