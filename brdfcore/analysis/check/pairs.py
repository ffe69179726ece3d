"""Differences between values of pairs of directions, summed over seeded draws: what symmetry and sign checks share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.check.findings import Worst
from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray
from brdfcore.base.directions import mixture

Float64Array = npt.NDArray[np.float64]
#: (f, theta_i, theta_o, delta_phi) -> what is misplaced of each value, (n, channels), >= 0, and the value beside it.
Misplaced = Callable[[FloatArray, Float64Array, Float64Array, Float64Array], tuple[FloatArray, FloatArray]]

#: Values evaluated at a time.
_CHUNK = 1 << 18
#: Worst pairs named, and the angle, radians, by which two of them have to differ somewhere.
_NAMED, _APART = 3, np.radians(5.0)
#: Pairs of each piece from which the named ones are chosen.
_KEPT = 64


@dataclass(frozen=True, slots=True)
class Sums:
    """Bihemispherical means of one quantity, (channels,): int q c_i c_o dwi dwo / pi, with standard errors.

    relative  the mean over that of |f|, nan where that is 0.
    count     values at which the quantity is not 0, of `values`; `not_finite` of them were left out of everything.
    """

    mean: Float64Array
    error: Float64Array
    relative: Float64Array
    count: int
    not_finite: int
    values: int
    worst: list[Worst]


def misplaced(b: Brdf, quantity: Misplaced, describe: str, *, directions: int, seed: int) -> Sums:
    """Sums of `quantity` over `directions` draws of `directions.mixture`.

    The worst pairs are those with the largest quantity x c_i c_o, as light meets them; `describe` is their text, with
    {f} and {g} for the value and the one beside it.
    """
    drawn = mixture(directions, seed)
    used = drawn.weight > 0
    theta_i, theta_o, delta_phi = (x[used] for x in (drawn.theta_i, drawn.theta_o, drawn.delta_phi))
    weight = drawn.weight[used] / np.pi
    channels = len(b.channels)
    first, second, size = (np.zeros(channels) for _ in range(3))
    count = not_finite = 0
    candidates: list[tuple[float, int, int, float, float]] = []
    step = max(_CHUNK // channels, 1)
    for start in range(0, weight.size, step):
        part = np.s_[start : start + step]
        angles = theta_i[part], theta_o[part], delta_phi[part]
        f = b.evaluate(*angles)
        q, beside = quantity(f, *angles)
        good = np.isfinite(q) & np.isfinite(f)
        not_finite += int(good.size - good.sum())
        q, f = np.where(good, q, 0.0), np.where(good, f, 0.0)
        w = weight[part, None]
        first += (w * q).sum(axis=0)
        second += ((w * q) ** 2).sum(axis=0)
        size += (w * np.abs(f)).sum(axis=0)
        count += int(np.count_nonzero(q))
        score = q * (np.cos(angles[0]) * np.cos(angles[1]))[:, None]
        channel, best = score.argmax(axis=1), score.max(axis=1)
        for k in np.argsort(-best)[:_KEPT].tolist():
            if best[k] > 0:
                c = int(channel[k])
                candidates.append((float(best[k]), start + k, c, float(f[k, c]), float(beside[k, c])))
    n = directions
    mean = first / n
    error = np.sqrt(np.maximum(second / n - mean**2, 0.0) / n)
    relative = np.divide(mean, size / n, out=np.full(channels, np.nan), where=size > 0)
    worst = _apart(candidates, theta_i, theta_o, delta_phi, b.channels.labels(), describe)
    return Sums(mean, error, relative, count, not_finite, weight.size * channels, worst)


def difference(a: Brdf, b: Brdf, *, directions: int, seed: int) -> tuple[float, float, float, float]:
    """(L1 of b against a, its standard error, misplaced reflectance of the worst channel, share of values that differ).

    L1 is relative to int |f| c_i c_o of `a`, channels summed: a source with negative values has it too.
    """
    drawn = mixture(directions, seed)
    used = drawn.weight > 0
    angles = [x[used] for x in (drawn.theta_i, drawn.theta_o, drawn.delta_phi)]
    weight = drawn.weight[used]
    change, size = np.zeros(weight.size), np.zeros(weight.size)
    by_channel, differ = np.zeros(len(a.channels)), 0
    step = max(_CHUNK // len(a.channels), 1)
    for start in range(0, weight.size, step):
        part = np.s_[start : start + step]
        f, g = (m.evaluate(*(x[part] for x in angles)) for m in (a, b))
        good = np.isfinite(f) & np.isfinite(g)
        with np.errstate(invalid="ignore"):  # of values that are left out
            e = np.where(good, np.abs(g - f), 0.0)
        change[part], size[part] = e.sum(axis=1), np.where(good, np.abs(f), 0.0).sum(axis=1)
        by_channel += weight[part] @ e
        differ += int(np.count_nonzero(e))
    total = float(weight @ size)
    share = differ / (weight.size * len(a.channels))
    if total == 0:
        return 0.0, 0.0, 0.0, share
    l1 = float(weight @ change) / total
    error = float(np.sqrt(np.sum((weight * (change - l1 * size)) ** 2))) / total
    return l1, error, float(by_channel.max()) / directions / np.pi, share


def _apart(
    candidates: list[tuple[float, int, int, float, float]],
    theta_i: Float64Array,
    theta_o: Float64Array,
    delta_phi: Float64Array,
    labels: list[str],
    describe: str,
) -> list[Worst]:
    """The worst of the candidates that differ by `_APART` in some angle; a swapped pair is the same pair."""
    chosen: list[tuple[float, float, float]] = []
    named: list[Worst] = []
    for _, k, c, f, g in sorted(candidates, reverse=True):
        here = float(theta_i[k]), float(theta_o[k]), abs(float(delta_phi[k]))
        swapped = here[1], here[0], here[2]
        if any(max(abs(a - b) for a, b in zip(p, q)) < _APART for p in chosen for q in (here, swapped)):
            continue
        chosen.append(here)
        degrees = [round(float(np.degrees(x)), 4) for x in (theta_i[k], theta_o[k], delta_phi[k])]
        text = f"{labels[c]}: {describe.format(f=f'{f:.4g}', g=f'{g:.4g}')}"
        named.append(Worst(degrees[0], degrees[1], degrees[2], labels[c], text))
        if len(named) == _NAMED:
            break
    return named
