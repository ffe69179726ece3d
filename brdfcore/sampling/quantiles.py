"""Tables of quantiles of any material's lobes, for `kernels.base.quantile_warp` to draw through.

g = f cos theta_o 4 (wi.h) 2 horizon is the energy over (phi, zeta), channels averaged; a small even part is added, so
that wherever f may be, some draws are. Its integrals over zeta and phi are inverted at even places.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.geometry import outgoing_from_half

if TYPE_CHECKING:
    from brdfcore.base.brdf import Brdf

Float64Array = npt.NDArray[np.float64]

#: Angles of incidence; cells along the azimuth and, given it, along zeta.
INCIDENCES, AZIMUTHS, POLAR = 33, 64, 80
#: Part of the energy that is drawn as from a Lambertian.
EVEN = 0.004
#: Nodes of the azimuth from wi, over half a turn, that g is found at.
_TURNS = 33
#: Edges of its cells in zeta: 8 a decade from 1e-18, which is a lobe of 1e-9 rad; and even ones.
_EDGES = np.unique(np.concatenate([[0.0], np.geomspace(1e-18, 1.0, 145), np.linspace(0, 1, 33)]))
#: The last angle of incidence is this far above the horizon, rad.
_GRAZING = 1e-4
#: Values evaluated at once.
_CHUNK = 1 << 19


@dataclass(frozen=True)
class QuantileSampler:
    """azimuth (K, M + 1), polar (K, M + 1, N + 3): as the kernels take them. regular (K,): directional reflectance of
    the regular part at the K angles of incidence, mean of the channels, even in 1 - (1 - sin theta_i)^(1/4)."""

    azimuth: npt.NDArray[np.float32]
    polar: npt.NDArray[np.float32]
    regular: Float64Array

    @cached_property
    def _scales(self) -> dict[np.dtype[Any], Any]:
        from brdfcore.kernels.base.quantile_warp import quantile_scale

        k, m, n = self.polar.shape
        return {np.dtype(t): quantile_scale(k, m - 1, n - 3, t) for t in (np.float32, np.float64)}

    @cached_property
    def _flat(self) -> tuple[npt.NDArray[np.float32], ...]:
        return self.azimuth.reshape(-1), self.polar.reshape(-1), mass_ratios()

    def draw(self, wi: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
        """(wo (n, 3), density (n,), whether all could be read) of wi (n, 3) and u (n, 2), contiguous and of one type;
        wo is the normal and the density 0 where wi has z <= 0."""
        from brdfcore.kernels.base import quantile_warp

        wo, density = np.empty_like(wi), np.empty(len(wi), wi.dtype)
        scale = self._scales[wi.dtype]
        outside = quantile_warp.draw(
            len(wi), wi.reshape(-1), u.reshape(-1), *self._flat, wo.reshape(-1), density, scale
        )
        return wo, density, not outside

    def angles(self, wi: FloatArray, wo: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """theta_i, theta_o, delta_phi, (n,) each."""
        from brdfcore.kernels.base import quantile_warp

        found = [np.empty(len(wi), wi.dtype) for _ in range(3)]
        quantile_warp.angles(len(wi), wi.reshape(-1), wo.reshape(-1), *found, self._scales[wi.dtype])
        return found[0], found[1], found[2]

    def weigh(self, values: FloatArray, wo: FloatArray, density: FloatArray) -> None:
        """values (n, channels) of f_r times cos theta_o / density, in place."""
        from brdfcore.kernels.base import quantile_warp

        scale = self._scales[wo.dtype]
        quantile_warp.weigh(len(wo), values.reshape(-1), wo.reshape(-1), density, values.shape[1], scale)

    def density(self, wi: FloatArray, wo: FloatArray) -> FloatArray:
        """Density, 1/sr, of directions (n, 3)."""
        from brdfcore.kernels.base import quantile_warp

        out = np.empty(len(wi), wi.dtype)
        scale = self._scales[wi.dtype]
        quantile_warp.density(len(wi), wi.reshape(-1), wo.reshape(-1), *self._flat, out, scale)
        return out

    def regular_reflectance(self, sin_i: Float64Array) -> Float64Array:
        """Mean of the channels at angles of incidence of these sines."""
        y = 1 - np.clip(1 - sin_i, 0, 1) ** 0.25
        return np.interp(y, np.linspace(0, 1, self.regular.size), self.regular)


def _places() -> Float64Array:
    """u1 at the nodes of a row."""
    from brdfcore.kernels.base.quantile_warp import RISE, TIP

    x = np.linspace(0, 1, POLAR + 1)
    return np.where(x <= 0.5, TIP * x + RISE * x * x, 1 - (TIP + RISE) * (1 - x) ** 2)


def cell_masses() -> npt.NDArray[np.float32]:
    """(N + 2,): u1 of the cells of a row, and of the mirrored ones at its ends."""
    return np.pad(np.diff(_places()), 1, mode="edge").astype(np.float32)


def mass_ratios() -> npt.NDArray[np.float32]:
    """(N, 2), flat: u1 of a cell over that of the one before it, and over that of the one after."""
    mass = cell_masses().astype(np.float64)
    return np.stack([mass[1:-1] / mass[:-2], mass[1:-1] / mass[2:]], axis=1).astype(np.float32).reshape(-1)


def make_sampler(b: Brdf) -> QuantileSampler:
    """The sampler of `b`, from some 200,000 of its values."""
    y = np.linspace(0, 1, INCIDENCES)
    theta_i = np.minimum(np.arcsin(np.clip(1 - (1 - y) ** 4, 0, 1)), HALF_PI - _GRAZING)
    turns = _turns(theta_i, b.bilateral)
    energy, even = _energy(b, theta_i, turns)
    width, across = np.diff(_EDGES), np.gradient(turns, axis=1)
    across[:, [0, -1]] *= 0.5
    sides = 2.0 if b.bilateral else 1.0
    regular = sides * np.einsum("ktz,z,kt->k", energy, width, across)
    # of a Lambertian that reflects everything `even` integrates to 1
    energy += EVEN * np.where(regular > 0, regular, 1.0)[:, None, None] * even
    sums = np.concatenate([np.zeros((*energy.shape[:2], 1)), np.cumsum(energy * width, axis=2)], axis=2)
    u1 = _places()
    given = np.stack([[np.interp(u1 * s[-1], s, _EDGES) for s in of] for of in sums])
    azimuth = np.stack([_azimuths(t, total, b.bilateral) for t, total in zip(turns, sums[:, :, -1])])
    polar = np.empty((*azimuth.shape, POLAR + 1))
    for k, t in enumerate(turns):
        at = np.abs(azimuth[k]) if b.bilateral else azimuth[k]
        i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
        part = ((at - t[i]) / (t[i + 1] - t[i]))[:, None]
        polar[k] = given[k, i] * (1 - part) + given[k, i + 1] * part
    ends = (-polar[..., 1:2], 2 - polar[..., -2:-1])
    polar = np.concatenate([ends[0], polar, ends[1]], axis=-1)
    return QuantileSampler(azimuth.astype(np.float32), polar.astype(np.float32), regular)


def _turns(theta_i: Float64Array, bilateral: bool) -> Float64Array:
    """(K, turns): azimuths from wi that g is found at. Half of them even, half about pi/2 within cos theta_i of it,
    where the horizon of a grazing theta_i turns from far to near."""
    fine = np.linspace(0, np.pi, 4001)
    width = np.maximum(np.cos(theta_i), 1e-3)[:, None]
    near = np.arctan((fine - HALF_PI) / width)
    place = fine / np.pi + (near - near[:, :1]) / (near[:, -1:] - near[:, :1])
    half = np.stack([np.interp(np.linspace(0, 2, _TURNS), p, fine) for p in place])
    half[:, 0], half[:, -1] = 0.0, np.pi
    return half if bilateral else np.concatenate([-half[:, :0:-1], half], axis=1)


def _energy(b: Brdf, theta_i: Float64Array, turns: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(g, that of f = 1/pi), each (K, turns, cells), at the middles of the cells."""
    middle = 0.5 * (_EDGES[1:] + _EDGES[:-1])
    at_i, phi = theta_i[:, None, None], turns[:, :, None]
    edge = np.sin(0.25 * np.arctan2(np.cos(at_i), -np.sin(at_i) * np.cos(phi))) ** 2
    theta_h = 2 * np.arcsin(np.sqrt(edge * middle))
    angles = np.broadcast_arrays(at_i, theta_h, phi)
    theta_o, delta_phi, dot = outgoing_from_half(*angles)
    theta_o = np.minimum(theta_o, HALF_PI)
    flat = [np.ascontiguousarray(x).reshape(-1) for x in (angles[0], theta_o, delta_phi)]
    f = np.empty(flat[0].size)
    step = max(_CHUNK // len(b.channels), 1)
    for start in range(0, f.size, step):
        piece = [x[start : start + step] for x in flat]
        f[start : start + step] = b.evaluate(*piece).mean(axis=1)
    f = np.where(np.isfinite(f), np.maximum(f, 0), 0).reshape(theta_h.shape)
    factor = np.cos(theta_o) * (8 * edge) * dot
    return f * factor, factor / np.pi


def _azimuths(turns: Float64Array, density: Float64Array, bilateral: bool) -> Float64Array:
    """phi at M + 1 even places of the integral of a density linear between `turns`."""
    fine = np.interp(np.linspace(0, turns.size - 1, 16 * (turns.size - 1) + 1), np.arange(turns.size), turns)
    d = np.interp(fine, turns, density)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (d[1:] + d[:-1]) * np.diff(fine))])
    v = np.linspace(-1, 1, AZIMUTHS + 1)
    u2 = 1 - (1 - np.abs(v)) ** 2
    if not bilateral:
        whole: Float64Array = np.interp((0.5 + 0.5 * np.sign(v) * u2) * sums[-1], sums, fine)
        return whole
    half: Float64Array = np.interp(u2 * sums[-1], sums, fine)
    return np.where(v < 0, -half, half)
