"""Learn how far a table is off, cell by cell, from fresh directions, and calibrate it on others.

Relative errors are alike within a cell: their 95 % quantile over a few dozen directions drawn in it is the half-width
there. Held-out directions, over the hemisphere and where the light goes, then set one factor for each range of theta_i,
so that 95 % of their errors are within (split-conformal prediction: H. Papadopoulos, K. Proedrou, V. Vovk, A.
Gammerman, "Inductive Confidence Machines for Regression", ECML 2002, DOI 10.1007/3-540-36755-1_29).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.errors import InputError
from brdfcore.tables.base.error_cells import EDGES, cells
from brdfcore.tables.base.local_error import HELD_LEVEL, PART_LEVEL, LocalError, calibrated, fitting, made_of, quantile
from brdfcore.tables.base.table import Table

Float64Array = npt.NDArray[np.float64]
Angles = tuple[Float64Array, Float64Array, Float64Array]

#: Directions in each cell; and held out in each range of theta_i: over the hemisphere, in each of its parts, and by
#: energy out of a pool.
_EACH, _HELD, _POOL = 48, 400, 1_600
_RANGE_PARTS = 4
#: A knot this near the end of a range, rad, counts for both.
_NEAR_BY = 0.01
#: Most values drawn in the cells, and most terms summed for them: fewer directions with many channels or slow sums.
_MOST_VALUES, _MOST_SUMS, _LEAST_EACH, _LEAST = 2_500_000, 20_000_000_000, 20, 3_600
#: Distances to the mirror direction and to the light between which energy is sought, rad.
_NEAR, _FAR = 1e-5, 1.5
_SEED = 20_261_201


def with_uncertainty(table: Table, source: Brdf) -> Table:
    """`table` with its `local_error` against `source`, so that `uncertainty` answers.

    The source's own uncertainty is added in squares. Where it has none, being a table that was made without, `table`
    gets none either. A table that learnt its own while it was built keeps it.
    """
    if table.local_error is not None:
        return table
    rng = np.random.default_rng(_SEED)
    slow = max(getattr(b, "size", 0) for b in (source, table))  # terms of an expansion
    level, wide = fitting(table.nbytes, len(table.channels), by_half=table.OFF_BY_HALF_VECTOR)
    most = min(_MOST_VALUES // len(table.channels), max(_MOST_SUMS // max(slow, 1), _LEAST))
    while level > 0 and cells(level).count * _LEAST_EACH > most and not table.OFF_BY_HALF_VECTOR:
        level, wide = level - 1, 1
    c = cells(level)
    held = int(np.clip(most // (12 * len(EDGES)), 40, _HELD))
    each = int(np.clip(most // c.count, _LEAST_EACH, _EACH))
    angles = c.draw(each, rng)
    try:
        own = np.asarray(source.uncertainty(*angles), np.float64)
    except InputError:
        return table
    values, error = _errors(table, source, angles)
    learnt = made_of(level, wide, values, error, each)
    factor = []
    for k in range(len(EDGES) - 1):
        spread, lit = _held_out(source, k, rng, held)
        parts = _ratios(learnt, table, source, spread).reshape(spread[0].size // held, -1)
        wanted = [quantile(parts[:, :, None], PART_LEVEL).max()]
        wanted += [
            quantile(r.reshape(1, -1, 1), HELD_LEVEL).item() for r in (parts, _ratios(learnt, table, source, lit))
        ]
        factor.append(max(wanted))
    relative = own / (np.abs(values) + learnt.arrays["floors"]) / learnt.arrays["factors"] if own.any() else None
    table.local_error = calibrated(learnt, np.asarray(factor), np.repeat(np.arange(c.count), each), relative)
    return table


def _errors(table: Table, source: Brdf, angles: Angles) -> tuple[Float64Array, Float64Array]:
    """(values of `table`, how far they are off), float64."""
    values = np.asarray(table.evaluate(*angles), np.float64)
    with np.errstate(invalid="ignore"):
        error = np.abs(source.evaluate(*angles) - values)
    return values, np.where(np.isfinite(error), error, np.inf)


def _ratios(learnt: LocalError, table: Table, source: Brdf, angles: Angles) -> Float64Array:
    """Error over half-width at held-out directions, (n, channels)."""
    values, error = _errors(table, source, angles)
    width = np.empty_like(values)
    learnt.half_widths(*angles, values, width)
    return np.divide(error, width, out=np.where(error > 0, np.inf, 0.0), where=width > 0)


def _held_out(source: Brdf, k: int, rng: np.random.Generator, held: int) -> tuple[Angles, Angles]:
    """Directions with theta_i in range k of `EDGES`: viewers uniform over the hemisphere, `held` in each part of the
    range and at each knot of the source in it, where an error has its peaks; and as f_r cos(theta_o)."""
    inner = np.linspace(EDGES[k], EDGES[k + 1], _RANGE_PARTS + 1)
    knots = np.asarray(getattr(source, "incidence_knots", ()), np.float64)
    knots = np.clip(knots[(knots >= inner[0] - _NEAR_BY) & (knots <= inner[-1] + _NEAR_BY)], inner[0], inner[-1])
    low, high = (np.repeat(np.concatenate([x, knots]), held) for x in (inner[:-1], inner[1:]))
    n = low.size
    flat = low + rng.random(n) * (high - low), np.arccos(rng.random(n)), rng.uniform(-np.pi, np.pi, n)
    theta_i = EDGES[k] + rng.random(_POOL) * (EDGES[k + 1] - EDGES[k])
    cosine, turn = rng.random(_POOL), rng.uniform(-np.pi, np.pi, _POOL)
    theta_o, delta_phi = np.arccos(cosine), turn
    # two thirds about an axis in the plane of incidence, at the mirror direction (delta_phi = pi) or at the light
    kind = rng.integers(0, 3, _POOL)
    away = np.exp(rng.uniform(np.log(_NEAR), np.log(_FAR), _POOL))
    x = np.cos(away) * np.sin(theta_i) + np.sin(away) * np.cos(turn) * np.cos(theta_i)
    y = np.sin(away) * np.sin(turn)
    z = np.cos(away) * np.cos(theta_i) - np.sin(away) * np.cos(turn) * np.sin(theta_i)
    about = (kind > 0) & (z > 0)
    theta_o = np.where(about, np.arctan2(np.hypot(x, y), z), theta_o)
    azimuth = np.arctan2(y, x)
    delta_phi = np.where(about, np.where(kind == 1, np.pi - azimuth, azimuth), delta_phi)
    theta_o = np.minimum(theta_o, HALF_PI)
    density = np.full(_POOL, 1 / (2 * np.pi))
    for axis in (np.pi, 0.0):
        chord = np.sin(0.5 * (theta_i - theta_o)) ** 2
        chord = chord + np.sin(theta_i) * np.sin(theta_o) * np.sin(0.5 * (delta_phi - axis)) ** 2
        distance = np.clip(2 * np.arcsin(np.sqrt(np.minimum(chord, 1))), _NEAR, None)
        lobe = 1 / (2 * np.pi * np.sin(np.minimum(distance, _FAR)) * distance * np.log(_FAR / _NEAR))
        density += np.where(distance < _FAR, lobe, 0.0)
    energy = np.abs(source.evaluate(theta_i, theta_o, delta_phi)).sum(axis=1) * np.cos(theta_o) / density
    energy = np.where(np.isfinite(energy) & ((kind == 0) | about), energy, 0.0)
    if not energy.sum() > 0:
        return flat, flat
    pick = rng.choice(_POOL, held, p=energy / energy.sum())
    return flat, (theta_i[pick], theta_o[pick], delta_phi[pick])
