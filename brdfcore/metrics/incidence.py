"""Error by angle of incidence: what light from one angle meets, which a mean over all angles hides."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.geometry import outgoing_from_half, pair_from_angles
from brdfcore.metrics.estimators import Estimate, honest_ratio
from brdfcore.metrics.lobes import Lobes

Float64Array = npt.NDArray[np.float64]
Range = tuple[float, float]

#: theta_i of the rows, degrees.
INCIDENCES = (0.0, 0.5, 1.0, 2.0, 5.0, *(float(t) for t in range(10, 80, 10)), 75.0, 80.0, 85.0, 88.0, 89.0, 89.9)
#: And between them: a table may have nodes at whole degrees, and be exact there only.
BETWEEN = (7.3, 14.7, 25.3, 36.1, 44.6, 56.2, 63.7, 72.4, 77.6, 82.7, 86.6)
#: What a tolerance bounds: L1 and albedo from 0 to LAST, and GRAZING_FACTOR times it up to GRAZING, degrees.
LAST, GRAZING, GRAZING_FACTOR = 85.0, 89.0, 4.0
#: Below this angle, degrees, f_r cos theta_o of both is averaged over the azimuth of the half vector, at AZIMUTHS of
#: them: at the normal it is delta_phi and no coordinate, but real files vary with it.
POLE, AZIMUTHS = 5.0, 24
#: Draws of a row; those near the pole are evaluated AZIMUTHS times. Values of all rows together.
_DRAWS, _POLE_DRAWS, _MOST_VALUES = 5_000, 1_500, 12_000_000
#: Albedos of channels below this share of the channels' mean are taken for that much where errors are relative.
_LEAST_CHANNEL = 0.1
#: An error counts as known if its standard error is at most this share of it, or of the tolerance it is held to.
KNOWN = 0.2


@dataclass(frozen=True)
class _Row:
    theta_i: float
    angles: tuple[Float64Array, Float64Array, Float64Array]
    weight: Float64Array
    turns: int
    #: (n, channels): the reference as drawn; averaged over the turns
    plain: Float64Array
    f: Float64Array


class Incidences:
    """One reference, drawn for and evaluated once; `rows` measures candidates against it.

    The draws follow the reference's lobes (`metrics.lobes`), and with a third of their density every width about the
    mirror direction and the light, so that a candidate's own are found as well.
    """

    def __init__(
        self,
        reference: Brdf,
        channels: Channels,
        lobes: Lobes,
        *,
        light: Range,
        view: Range,
        seed: int,
        draws: int = _DRAWS,
    ) -> None:
        self._rows: list[_Row] = []
        stated = _within(light)
        self._stated = len(stated)
        low, high = stated[0], stated[-1]
        between = [t for t in map(math.radians, BETWEEN) if low < t < high]
        angles = stated + (between or ([0.5 * (low + high)] if low < high else []))
        share = _MOST_VALUES / (len(angles) * len(channels) * max(_DRAWS, _POLE_DRAWS * AZIMUTHS))
        share = min(share, draws / _DRAWS)
        for k, theta in enumerate(angles):
            pole = math.degrees(theta) < POLE - 1e-9
            n = max(int(min(share, 1.0) * (_POLE_DRAWS if pole else _DRAWS)), 50)
            drawn = lobes.draw(np.full(n, theta), np.random.default_rng([seed, 2, k]))
            inside = (drawn.weight > 0) & (drawn.theta_o >= view[0]) & (drawn.theta_o <= view[1])
            # those left out keep their place in the mean: a weight of 0
            theta_o, delta_phi = np.where(inside, drawn.theta_o, 0.0), np.where(inside, drawn.delta_phi, 0.0)
            turns = AZIMUTHS if pole else 1
            at = _turned(theta, theta_o, delta_phi) if pole else (np.full(n, theta), theta_o, delta_phi)
            weight = np.where(inside, drawn.weight, 0.0)
            self._rows.append(_Row(theta, at, weight, turns, *_mean(reference, at, turns)))

    @property
    def theta_i(self) -> list[float]:
        return [r.theta_i for r in self._rows[: self._stated]]

    def rows(self, candidate: Brdf) -> list[dict[str, Any]]:
        """{theta_i, l1, l1_stderr, albedo_ratio, albedo_error} of each angle of `INCIDENCES`.

        l1            int |f'-f| c_o dwo / int f c_o dwo, channels summed; below `POLE` degrees of the means over the
                      azimuth of the half vector. Nan where a value is not finite; where the reference reflects
                      nothing 0, or infinite if the candidate does.
        l1_stderr     one sigma, wider where few draws carry the sum (`estimators.honest_ratio`).
        albedo_ratio  int f' c_o dwo / int f c_o dwo of each channel, on the same draws.
        albedo_error  the largest |a' - a| of the channels, each over its own albedo a or a tenth of the channels' mean,
                      whichever is more: a channel that reflects next to nothing has no ratio worth the name.
        """
        return self._measured(candidate, self._rows[: self._stated])

    def between(self, candidate: Brdf) -> list[dict[str, Any]]:
        """The same at angles between those: no table's nodes are there."""
        return self._measured(candidate, self._rows[self._stated :])

    def _measured(self, candidate: Brdf, rows: Sequence[_Row]) -> list[dict[str, Any]]:
        found = []
        for row in rows:
            plain, mean = _mean(candidate, row.angles, row.turns)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                f, g = np.broadcast_arrays(row.f, mean)
                error, ratio = _compared(row.weight, f, g, np.abs(g - f))
                if row.turns > 1:
                    error, ratio = _bounded(error, ratio, row, plain)
            if not f.any():  # nothing can be misplaced, but something may be added
                error = Estimate(0.0 if not g.any() else math.inf, 0.0)
            found.append(
                {
                    "theta_i": row.theta_i,
                    "l1": error.value,
                    "l1_stderr": error.stderr,
                    "albedo_ratio": [float(x) for x in ratio],
                    "albedo_error": _albedo_error(row.weight @ f, ratio),
                }
            )
        return found


def _bounded(error: Estimate, ratio: Float64Array, row: _Row, plain: Float64Array) -> tuple[Estimate, Float64Array]:
    """The error of means over the azimuth, held between what it can't pass.

    It is at least the difference of the albedos and at most L1 itself. Draws follow the lobes, not the rings that these
    become in the mean: a lobe that is none about the half vector, as at the light, is found by the bounds.
    """
    f, g = np.broadcast_arrays(row.plain, plain)
    moved, energy = _compared(row.weight, f, g, g - f)
    if abs(moved.value) - 4 * moved.stderr > error.value:
        return Estimate(abs(moved.value), moved.stderr), energy
    most, energy = _compared(row.weight, f, g, np.abs(g - f))
    if most.stderr < error.stderr and most.value < error.value + 3 * error.stderr:
        return most, energy
    return error, ratio


def _compared(
    weight: Float64Array, f: Float64Array, g: Float64Array, apart: Float64Array
) -> tuple[Estimate, Float64Array]:
    """sum w apart / sum w f, channels summed, and sum w g / sum w f of each channel."""
    energy = weight @ f
    ratio = np.where(energy != 0, (weight @ g) / energy, np.nan)
    return honest_ratio(weight, apart.sum(axis=1), f.sum(axis=1)), ratio


def _albedo_error(energy: Float64Array, ratio: Float64Array) -> float:
    least = _LEAST_CHANNEL * float(np.mean(np.abs(energy)))
    if not energy.any():
        return 0.0
    size = np.abs(energy)
    with np.errstate(invalid="ignore"):
        off = np.where(size > 0, np.abs(ratio - 1) * size, 0.0) / np.maximum(size, least)
    return float(off.max())  # nan where a value is not finite


def _within(light: Range) -> list[float]:
    """`INCIDENCES` inside the range of light, radians, and the range's own ends where it has any."""
    low, high = light
    inside = [math.radians(t) for t in INCIDENCES if low <= math.radians(t) <= high]
    ends = [t for t in light if 0 < t < HALF_PI - 1e-9]
    return sorted({*inside, *ends}) or [0.5 * (low + min(high, HALF_PI))]


def _turned(
    theta: float, theta_o: Float64Array, delta_phi: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """`AZIMUTHS` directions for each: the half vector turned about the normal, (AZIMUTHS n,) each."""
    pair = pair_from_angles(np.full(theta_o.size, theta), theta_o, delta_phi)
    theta_h = np.arctan(np.sqrt(pair.tan2_h))
    x = np.sin(theta) + np.sin(theta_o) * np.cos(delta_phi)
    turn = np.arctan2(np.sin(theta_o) * np.sin(delta_phi), x)
    steps = 2 * np.pi * (np.arange(AZIMUTHS)[:, None]) / AZIMUTHS
    o, d, _ = outgoing_from_half(theta, theta_h[None, :], turn[None, :] + steps)
    o[0], d[0] = theta_o, delta_phi  # itself, to the last digit
    return np.full(o.size, theta), o.reshape(-1), d.reshape(-1)


def _mean(
    b: Brdf, angles: tuple[Float64Array, Float64Array, Float64Array], turns: int
) -> tuple[Float64Array, Float64Array]:
    """f_r at the first turn, and the mean of f_r cos theta_o over the turns, over cos theta_o of the first."""
    theta_i, theta_o, delta_phi = angles
    above = theta_o < HALF_PI
    f = b.evaluate(theta_i, np.where(above, theta_o, 0.0), delta_phi).astype(np.float64, copy=False)
    if turns == 1:
        return f, f
    # light, not f: near the horizon f may grow like 1/cos theta_o, and its mean would be that of one direction
    cosines = np.where(above, np.cos(theta_o), 0.0)
    mean = (f * cosines[:, None]).reshape(turns, -1, f.shape[1]).mean(axis=0)
    first = slice(0, mean.shape[0])
    return f[first], np.asarray(mean / np.maximum(cosines[first], 1e-300)[:, None])


def floored(rows: Sequence[dict[str, Any]], bias: Mapping[str, list[float]]) -> float:
    """Raise the rows' L1 to what the albedos' quadrature leaves no doubt of, and return the most that was missed.

    L1 is never below |a' - a|/a: misplaced energy is at least what is missing. Where the draws found less, beyond the
    errors of both, they missed a lobe: the row's L1 becomes the difference, and its standard error as large.
    """
    missed = 0.0
    for theta, difference, off in zip(bias["theta_i"], bias["bias"], bias["error"]):
        for row in rows:
            if abs(row["theta_i"] - theta) > 1e-9 or not math.isfinite(difference):
                continue
            least = abs(difference) - off
            if least > row["l1"] + 5 * row["l1_stderr"]:
                missed = max(missed, least - row["l1"])
                row["l1"] = row["l1_stderr"] = least
    return missed


def known(rows: Sequence[Mapping[str, Any]], tolerance: float = 0.0) -> bool:
    """Whether every standard error up to `GRAZING` is at most `KNOWN` of the error, or of the `tolerance`."""
    last = max(math.radians(GRAZING), min((r["theta_i"] for r in rows), default=0.0)) + 1e-9
    found = [(r["l1"], r["l1_stderr"]) for r in rows if r["theta_i"] <= last]
    return all(l1 is not None and stderr is not None and stderr <= KNOWN * max(l1, tolerance) for l1, stderr in found)


def worst(rows: Sequence[Mapping[str, Any]], tolerance: float | None = None) -> float:
    """What a tolerance bounds: the largest of L1 and albedo error up to `LAST` degrees, and of both over
    `GRAZING_FACTOR` up to `GRAZING`; where the angles are all beyond, of those.

    Infinite where a value is not finite; with a `tolerance` also where the errors are not `known` well enough for it.
    """
    if tolerance is not None and not known(rows, tolerance):
        return math.inf
    degrees = [math.degrees(r["theta_i"]) for r in rows]
    last = max(LAST, min(degrees, default=0.0))
    found = 0.0
    for t, row in zip(degrees, rows):
        if t > max(GRAZING, last) + 1e-9:
            continue
        pair = [math.inf if row[k] is None or math.isnan(row[k]) else row[k] for k in ("l1", "albedo_error")]
        error = max(pair)
        found = max(found, error if t <= last + 1e-9 else error / GRAZING_FACTOR)
    return found
