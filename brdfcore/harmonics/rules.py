"""Where a BRDF is sampled to be projected: Gauss-Legendre in cos theta, uniform in delta_phi; finer about a lobe.

A plain rule is one product of nodes. A graded rule has, for each theta_i, panels in theta_o that shrink towards the
mirror angle, and panels in delta_phi that shrink towards pi (and 0, for a peak in retro-reflection): a lobe far
narrower than the degree resolves still has to be integrated for its coefficients to be right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.quadrature import gauss_legendre

Float64Array = npt.NDArray[np.float64]

#: theta_i at which the width of a lobe is looked for, degrees.
_PROBES = (1.0, 20.0, 40.0, 60.0, 75.0, 85.0)
#: Growth of graded panels: a lobe that falls like a power is resolved by their nodes to 1e-4 and better.
_GROWTH = 3.0
#: Nodes of a panel beside those for its waves, and the largest panel.
_BASE, _LARGEST = 10.0, 64
#: Half-widths below this are not told apart from a delta: float64 angles near pi/2 are 2e-16 apart.
_NARROWEST = 1e-9


@dataclass(frozen=True)
class Rule:
    """`nodes` along cos theta, `azimuths` on the whole circle; graded if the mirror `width` is given.

    density scales the panels of a graded rule; `retro`: half-width of a peak in retro-reflection. `bilateral`:
    delta_phi over half the circle.
    """

    lmax: int
    nodes: int
    azimuths: int
    bilateral: bool
    width: float | None = None
    retro: float = 1.0
    density: float = 1.0

    @property
    def graded(self) -> bool:
        return self.width is not None

    def coarser(self, factor: float = 0.75) -> Rule:
        """The rule to compare with: fewer nodes, still enough for products of two functions of degree lmax."""
        return replace(
            self,
            nodes=max(int(self.nodes * factor), self.lmax + 2),
            azimuths=max(2 * int(self.azimuths * factor / 2), 2 * self.lmax + 2),
            density=self.density * factor,
        )

    def finer(self, factor: float = 1.4) -> Rule:
        azimuths = 2 * int(self.azimuths * factor / 2)
        return replace(self, nodes=int(self.nodes * factor), azimuths=azimuths, density=self.density * factor)

    def outer(self) -> tuple[Float64Array, Float64Array]:
        """cos theta_i and weights of dx on [0, 1]."""
        return gauss_legendre(self.nodes)

    def inner(self, theta_i: float) -> tuple[Float64Array, Float64Array]:
        """theta_o and weights of sin(theta_o) dtheta_o of a graded rule."""
        width = min(self.width or 1.0, self.retro)
        theta, w = self._panels(_edges(0.0, np.pi / 2, theta_i, width))
        return theta, w * np.sin(theta)

    def azimuth(self) -> tuple[Float64Array, Float64Array]:
        """delta_phi and weights whose sum is 1: means over the circle, by symmetry from half of it if bilateral."""
        if self.width is None:
            half = self.azimuths // 2
            if self.bilateral:
                phi, w = np.pi * np.arange(half + 1) / half, np.full(half + 1, 1 / half)
                w[[0, -1]] *= 0.5
                return phi, w
            return np.pi * np.arange(2 * half) / half, np.full(2 * half, 0.5 / half)
        retro = _edges(0.0, np.pi / 2, 0.0, self.retro)
        mirror = _edges(np.pi / 2, np.pi, np.pi, self.width)
        phi, w = self._panels(np.concatenate([retro, mirror[1:]]))
        if not self.bilateral:
            phi, w = np.concatenate([phi, 2 * np.pi - phi[::-1]]), np.concatenate([w, w[::-1]])
        return phi, w / w.sum()

    def _panels(self, edges: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Gauss-Legendre on panels between `edges`, each with nodes for waves cos(2 lmax theta) and some more."""
        found = []
        for low, high in zip(edges[:-1].tolist(), edges[1:].tolist()):
            # n nodes integrate exp(i k x) over [-1, 1] to rounding from about n = k/2 + 8; here k = lmax (high - low)
            n = self.density * (_BASE + 0.6 * self.lmax * (high - low))
            parts = max(int(np.ceil(n / _LARGEST)), 1)
            for k in range(parts):
                step = (high - low) / parts
                found.append(gauss_legendre(max(int(np.ceil(n / parts)), 4), low + k * step, low + (k + 1) * step))
        return np.concatenate([x for x, _ in found]), np.concatenate([w for _, w in found])

    @property
    def evaluations(self) -> int:
        """About how often the source is evaluated."""
        across = self.inner(0.8)[0].size if self.graded else self.nodes
        return self.nodes * across * self.azimuth()[0].size


def rule_for(b: Brdf, lmax: int) -> Rule:
    """A rule for all products of degree lmax and the narrowest lobe of `b`."""
    nodes = int(1.25 * lmax) + 24
    azimuths = 2 * (int(1.25 * lmax) + 8)
    mirror, retro = lobe_widths(b)
    plain = Rule(lmax, nodes, azimuths, b.bilateral)
    # a lobe whose half-width spans six nodes needs no grading
    if min(mirror, retro) >= 3 * np.pi / nodes:
        return plain
    return replace(plain, width=max(mirror, _NARROWEST), retro=max(retro, _NARROWEST))


def lobe_widths(b: Brdf) -> tuple[float, float]:
    """Half-widths at half maximum, radians, of the narrowest peaks in the mirror direction and in retro-reflection.

    Looked for at six theta_i towards the normal and towards the horizon; 1 if f falls to half nowhere.
    """
    distance = np.geomspace(1e-8, 1.0, 97)
    narrowest = []
    for azimuth in (np.pi, 0.0):
        found = 1.0
        for degrees in _PROBES:
            theta_i = np.radians(degrees)
            peak = np.abs(b.evaluate(theta_i, theta_i, azimuth)).max()
            for side in (-1.0, 1.0):
                theta_o = theta_i + side * distance
                inside = (theta_o >= 0) & (theta_o <= np.pi / 2)
                f = np.abs(b.evaluate(theta_i, theta_o[inside], azimuth)).max(axis=-1)
                below = np.flatnonzero(f < 0.5 * peak)
                if below.size:
                    found = min(found, float(distance[inside][below[0]]))
        narrowest.append(found)
    # near the normal a mirror lobe is a retro lobe too: what is as wide as that one is it
    mirror, retro = narrowest
    return mirror, retro


def _edges(start: float, stop: float, at: float, width: float) -> Float64Array:
    """Panel edges from start to stop: `width` from `at`, then growing by `_GROWTH`."""
    found = [start, at, stop]
    for end in (start, stop):
        distance = width
        # the last panel is no sliver
        while distance < 0.7 * abs(end - at):
            found.append(at + float(np.sign(end - at)) * distance)
            distance *= _GROWTH
    return np.unique(found)
