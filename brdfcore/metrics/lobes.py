"""Directions drawn where two BRDFs have their energy: about the mirror direction, the light and every peak found.

A lobe may be of any width. So distances from a centre are drawn by decades: rings of equal width in the logarithm of
t, each ring a part of the mixture, from 1e-10 to the whole hemisphere. The shares of the rings follow where a first set
of draws found energy; a third stays spread over all, for what those draws missed. The density of all parts is known at
every draw (the balance heuristic: E. Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997, section
9.2; shares by one step of cross entropy: O. Cappe et al., "Adaptive importance sampling in general mixture classes",
Stat. Comput. 18, 2008, DOI 10.1007/s11222-008-9059-x).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.geometry import outgoing_from_half, pair_from_angles
from brdfcore.base.peaks import FOUND_FROM, MOST, peaks, smooth_elsewhere

Float64Array = npt.NDArray[np.float64]

#: ln t of the first ring's inner edge, rings, and their width: three a decade.
_FIRST, _RINGS, _WIDTH = np.log(1e-10), 37, np.log(10.0) / 3
#: Edges of the ranges of theta_i that have shares of their own, degrees.
_BANDS = np.radians([3.0, 15.0, 35.0, 55.0, 72.5, 82.5, 86.5, 88.5, 89.5])
#: theta_i, degrees, at which peaks are looked for; between them they are taken to move along the shorter way.
_SEARCHED = (1.0, 12.0, 25.0, 40.0, 55.0, 67.0, 77.0, 85.0, 89.0)
#: Shares before anything is known: cosine-distributed; about h = n; the mirror direction; the light; all peaks.
_COSINE, _PRIOR = 0.4, (0.24, 0.12, 0.16, 0.08)
#: Share of those that stays, and draws of the first set.
_STAYS, _PILOT = 0.35, 30_000
#: Peaks at neighbouring theta_i this close, rad, are one.
_SAME = float(np.radians(30.0))


@dataclass(frozen=True)
class Drawn:
    """wo of given wi; all (n,). weight cos theta_o / p(wo | wi), 0 below the horizon; part: 0 cosine, else a centre."""

    theta_i: Float64Array
    theta_o: Float64Array
    delta_phi: Float64Array
    weight: Float64Array
    part: npt.NDArray[np.intp]


class Lobes:
    """Where `brdfs` have their energy, and draws from it."""

    def __init__(self, brdfs: Sequence[Brdf], seed: int) -> None:
        # an expansion in waves has what it was made of, only wider, and its look-ups are slow: the first BRDF leads
        self._brdfs = [b for k, b in enumerate(brdfs) if k == 0 or not b._smooth_elsewhere]
        self._smooth = [b for b in self._brdfs if smooth_elsewhere(b)]
        self._rough = [b for b in self._brdfs if not smooth_elsewhere(b)]
        self._bilateral = all(b.bilateral for b in brdfs)
        self._nodes = np.radians(_SEARCHED)
        self._tracks = self._followed([self._peaks(t) for t in self._nodes])
        self._extra = self._tracks.shape[1]
        prior = np.zeros((_BANDS.size + 1, 1 + (3 + self._extra) * _RINGS))
        parts = [*_PRIOR[:3], *([_PRIOR[3] / max(self._extra, 1)] * self._extra)]
        prior[:, 0] = _COSINE
        prior[:, 1:] = np.repeat(parts, _RINGS) / _RINGS
        self._shares = prior / prior.sum(axis=1, keepdims=True)
        self._adapt(np.random.default_rng([seed, 1]))

    # ---- peaks --------------------------------------------------------------------------------

    @property
    def found_from(self) -> float:
        """rad; a lobe away from mirror direction and light that is narrower, and without tails, may have been missed;
        0 where what the BRDFs are leaves no room for one."""
        return FOUND_FROM if self._rough else 0.0

    def _total(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        """Sum over the BRDFs of |f|, channels added."""
        return _sum_of(self._brdfs, theta_i, theta_o, delta_phi)

    def _peaks(self, theta_i: float) -> Float64Array:
        rough, smooth = (partial(_sum_of, some) if some else None for some in (self._rough, self._smooth))
        if rough is None:
            assert smooth is not None
            return peaks(smooth, theta_i, bilateral=self._bilateral, finer=1)
        return peaks(rough, theta_i, bilateral=self._bilateral, smooth=smooth)

    def _followed(self, found: Sequence[Float64Array]) -> Float64Array:
        """(intervals, slots, 2, 3): unit vectors of each peak at both ends of an interval of theta_i."""
        pairs: list[list[tuple[Float64Array, Float64Array]]] = []
        vectors = [_vectors(p[:, 0], p[:, 1]) for p in found]
        if self._bilateral:  # the other side has the same
            vectors = [np.concatenate([v, v * [1, -1, 1]])[: 2 * MOST] for v in vectors]
        for low, high in pairwise(vectors):
            free, both = list(range(len(high))), []
            for v in low:
                nearest = max(free, key=lambda k: float(high[k] @ v), default=None)
                if nearest is not None and float(high[nearest] @ v) > np.cos(_SAME):
                    free.remove(nearest)
                    both.append((v, high[nearest]))
                else:
                    both.append((v, v))
            both += [(high[k], high[k]) for k in free]
            pairs.append(both)
        slots = max((len(p) for p in pairs), default=0)
        tracks = np.zeros((len(pairs), slots, 2, 3))
        tracks[..., 2] = 1.0
        for k, both in enumerate(pairs):
            for s, (a, b) in enumerate(both):
                tracks[k, s] = a, b
        return tracks

    def _centres(self, theta_i: Float64Array) -> Float64Array:
        """(n, slots, 3): unit vectors of the peaks at theta_i."""
        k = np.clip(np.searchsorted(self._nodes, theta_i) - 1, 0, self._nodes.size - 2)
        part = np.clip((theta_i - self._nodes[k]) / (self._nodes[k + 1] - self._nodes[k]), 0, 1)[:, None, None]
        v = (1 - part) * self._tracks[k, :, 0] + part * self._tracks[k, :, 1]
        return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))

    # ---- draws --------------------------------------------------------------------------------

    def _adapt(self, rng: np.random.Generator) -> None:
        """Shares of one step towards the density of |f| cos theta_o, in each band."""
        edges = np.concatenate([[0.0], _BANDS, [HALF_PI]])
        bands = _BANDS.size + 1
        band = np.arange(_PILOT) % bands
        theta_i = edges[band] + rng.random(_PILOT) * (edges[band + 1] - edges[band])
        drawn = self.draw(theta_i, rng)
        used = drawn.weight > 0
        band, theta_i = band[used], theta_i[used]
        found, density = self._components(theta_i, drawn.theta_o[used], drawn.delta_phi[used])
        energy = self._total(theta_i, drawn.theta_o[used], drawn.delta_phi[used]) * drawn.weight[used]
        energy = np.where(np.isfinite(energy), energy, 0.0)
        total = np.bincount(band, energy, bands)
        adapted = np.zeros_like(self._shares)
        for component, part in found:
            np.add.at(adapted, (band, component), energy * part / density)
        there = total > 0
        self._found = adapted.sum(axis=0) / max(float(total.sum()), 1e-300)
        adapted[there] /= total[there, None]
        adapted[~there] = self._shares[~there]
        self._shares = _STAYS * self._shares + (1 - _STAYS) * adapted
        self._shares /= self._shares.sum(axis=1, keepdims=True)

    def energy_within(self, centre: int, t: Float64Array) -> Float64Array:
        """Share of a centre's energy within t of it, rising from 0 to 1, smoothed over an octave; (n,).

        Centres: 0 the normal for the half vector (t = tan theta_h), 1 the mirror direction and 2 the light (sin r/2).
        """
        rings = self._found[1 + centre * _RINGS : 1 + (centre + 1) * _RINGS]
        rings = np.convolve(np.pad(rings, 1, mode="edge"), [0.25, 0.5, 0.25], "valid")
        within = np.concatenate([[0.0], np.cumsum(rings)]) / max(float(rings.sum()), 1e-300)
        return np.interp(np.log(np.maximum(t, 1e-30)), _FIRST + _WIDTH * np.arange(_RINGS + 1), within)

    def draw(self, theta_i: Float64Array, rng: np.random.Generator) -> Drawn:
        """One wo for each theta_i."""
        n = theta_i.size
        band = np.searchsorted(_BANDS, theta_i, side="right")
        component = np.empty(n, np.intp)
        chosen, along, turn = rng.random(n), rng.random(n), rng.uniform(-np.pi, np.pi, n)
        for b in np.unique(band):
            of = band == b
            component[of] = np.minimum(
                np.searchsorted(np.cumsum(self._shares[b]), chosen[of]), self._shares.shape[1] - 1
            )
        centre = np.where(component == 0, 0, 1 + (component - 1) // _RINGS)
        t = np.exp(_FIRST + _WIDTH * ((component - 1) % _RINGS + along))
        theta_o, delta_phi = np.arcsin(np.sqrt(along)), turn.copy()
        of = centre == 1
        theta_o[of], delta_phi[of], _ = outgoing_from_half(theta_i[of], np.arctan(t[of]), turn[of])
        r = 2 * np.arctan(t)
        for c, at in ((2, np.pi), (3, 0.0)):
            of = centre == c
            theta_o[of], delta_phi[of] = _about(theta_i[of], r[of], turn[of], at)
        at_peak = self._centres(theta_i) if self._extra else None
        if at_peak is not None:
            for s in range(self._extra):
                of = centre == 4 + s
                v = at_peak[of, s]
                polar, azimuth = np.arctan2(np.hypot(v[:, 0], v[:, 1]), v[:, 2]), np.arctan2(v[:, 1], v[:, 0])
                theta_o[of], delta_phi[of] = _about(polar, r[of], turn[of], azimuth)
        below = ~(theta_o < HALF_PI)
        theta_o = np.where(below, 0.0, theta_o)
        weight = np.where(below, 0.0, np.cos(theta_o) / self._components(theta_i, theta_o, delta_phi, at_peak)[1])
        return Drawn(theta_i, theta_o, delta_phi, weight, centre)

    def density(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> Float64Array:
        """p(wo | wi), 1/sr, of all parts together."""
        return self._components(theta_i, theta_o, delta_phi)[1]

    def _components(
        self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array, at_peak: Float64Array | None = None
    ) -> tuple[list[tuple[npt.NDArray[np.intp], Float64Array]], Float64Array]:
        """[(component, its share times its density)] of the one ring of each centre that a direction is in; the sum.

        A ring of share a, even in ln t and turn: a/(2 pi W) over t/(1+t^2)^(3/2) for h = (1, t) and dwo = 4 (wo.h) dwh;
        over 4 t^2/(1+t^2)^2 for t = tan(r/2), r the angle from the centre.
        """
        band = np.searchsorted(_BANDS, theta_i, side="right")
        pair = pair_from_angles(theta_i, theta_o, delta_phi)
        even = 1 / (2 * np.pi * _WIDTH)
        sin2 = [np.clip(0.5 * pair.one_minus_rv, 0, 1), pair.sin2_d]
        if self._extra:
            wo = _vectors(theta_o, delta_phi)
            apart = wo[:, None] - (self._centres(theta_i) if at_peak is None else at_peak)
            sin2 += list(0.25 * (apart**2).sum(axis=-1).T)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            rings = [(pair.tan2_h, even * (1 + pair.tan2_h) ** 1.5 / pair.tan2_h / (4 * pair.cos_d))]
            for s in sin2:
                t2 = s / np.maximum(1 - s, 1e-300)
                rings.append((t2, even * 0.25 * (1 + t2) ** 2 / t2))
        zero = np.zeros(theta_i.size, np.intp)
        found = [(zero, self._shares[band, zero] * pair.cos_o / np.pi)]
        for k, (t2, jacobian) in enumerate(rings):
            with np.errstate(divide="ignore", invalid="ignore"):
                ring = np.floor((0.5 * np.log(t2) - _FIRST) / _WIDTH)
            inside = (ring >= 0) & (ring < _RINGS)
            component = 1 + k * _RINGS + np.where(inside, ring, 0).astype(np.intp)
            found.append((component, np.where(inside, self._shares[band, component] * jacobian, 0.0)))
        return found, np.sum([part for _, part in found], axis=0)


def _sum_of(
    brdfs: Sequence[Brdf], theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array
) -> Float64Array:
    with np.errstate(over="ignore", invalid="ignore"):
        total = sum(np.abs(b.evaluate(theta_i, theta_o, delta_phi)).sum(axis=1) for b in brdfs)
    return np.asarray(total, np.float64)


def _vectors(theta: Float64Array, phi: Float64Array) -> Float64Array:
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _about(
    polar: Float64Array, r: Float64Array, turn: Float64Array, azimuth: Float64Array | float
) -> tuple[Float64Array, Float64Array]:
    """(theta_o, delta_phi) at the angle r from a centre, `turn` about it; delta_phi keeps its digits near 0."""
    along, across, out = np.sin(r) * np.cos(turn), np.sin(r) * np.sin(turn), np.cos(r)
    x = np.sin(polar) * out + np.cos(polar) * along
    z = np.cos(polar) * out - np.sin(polar) * along
    return np.arctan2(np.hypot(x, across), z), np.arctan2(across, x) + azimuth
