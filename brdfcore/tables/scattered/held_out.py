"""How far predictions between measurements are off: each geometry predicted from the others, in five parts.

From it follow whether what a fit leaves of measurements is given back (`residuals`), and the half-widths of a table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.base.status import Status
from brdfcore.tables.base.error_cells import EDGES, cells
from brdfcore.tables.base.local_error import LEVEL, LocalError, calibrated, encoded, fitting, quantile
from brdfcore.tables.scattered.coverage import Coverage
from brdfcore.tables.scattered.fit import ALL_AT_ONCE, Predictor, relative_errors
from brdfcore.tables.scattered.residuals import LONGEST_REACH, Residuals

Float64Array = npt.NDArray[np.float64]

_PARTS, _SEED = 5, 20_261_202
#: Geometries predicted where there are too many for five parts, and neighbours of each whose residuals are used.
_MOST, _AROUND = 2_000, 16
#: Neighbours whose mean error a half-width goes by, places in each cell, and geometries that calibrate an incidence.
_NEIGHBOURS, _EACH, _CALIBRATE = 10, 3, 160
#: Level of the cells: finer ones than measurements lie are of no use.
_FINEST = 3
#: |f_r| below which an error no longer falls with it, relative to the median and to the mean.
_FLOORS = 0.03, 1e-3
#: Residuals are given back unless predictions become worse by this factor: 1.12 where they are noise alone.
_WORSE = 1.03
#: 1.4826 medians of sizes are a standard deviation.
_DEVIATION = 1.4826
#: Farther than this from its file, relative, a value is not the file's; farther than so many deviations it is no noise.
OFF, _BEYOND_NOISE = 0.02, 3.0


@dataclass(frozen=True)
class HeldOut:
    """Of geometries `rows` of all: f_r predicted from the others, without and with their residuals, (k, channels);
    distance (k,) to the nearest of the others."""

    rows: npt.NDArray[np.intp]
    smooth: Float64Array
    exact: Float64Array
    distance: Float64Array
    gives_back: bool

    @property
    def predicted(self) -> Float64Array:
        return self.exact if self.gives_back else self.smooth


def held_out(predictor: Predictor, angles: Float64Array, values: Float64Array, coverage: Coverage) -> HeldOut | None:
    """Each geometry of `angles` (n, 3), `values` (n, channels) predicted from those of other parts; None if too few.

    predictor   of all of them: with one factorisation the others follow from it.
    """
    n = len(angles)
    order = np.random.default_rng(_SEED).permutation(n)
    parts = np.array_split(order, _PARTS) if n <= ALL_AT_ONCE else [order[: min(_MOST, n // _PARTS)]]
    rows, smooth, exact, distance = [], [], [], []
    lowest = min(0.0, float(values.min()))
    for part in parts:
        kept = np.setdiff1d(order, part)
        near = Coverage(angles[kept], coverage.gap, coverage.bilateral).neighbours(angles[part], _AROUND)
        around = kept[np.unique(near[1])]
        try:
            if predictor.radial is not None:
                found, there = predictor.without(part, around)
            else:
                others = Predictor(
                    angles[kept], values[kept], coverage.bilateral, coverage.in_plane, predictor.settings
                )
                found, there = others.at(*angles[part].T), others.at(*angles[around].T)
        except (np.linalg.LinAlgError, ValueError):  # fewer than the basis needs, or too regular
            return None
        given = found.copy()
        every = np.ones(len(around), np.bool_)
        back = Residuals.of(angles[around], values[around] - there, every, min(coverage.gap, LONGEST_REACH))
        theta_i, theta_o, delta_phi = np.ascontiguousarray(angles[part].T)
        back.add_to(theta_i, theta_o, delta_phi, given, two_sided=not coverage.bilateral, lowest=lowest)
        rows.append(part)
        smooth.append(found)
        exact.append(given)
        distance.append(near[0][:, 0])
    where = np.concatenate(rows)
    both = np.concatenate(smooth), np.concatenate(exact)
    errors = [float(relative_errors(values[where], f).mean()) for f in both]
    return HeldOut(where, *both, np.concatenate(distance), errors[1] <= _WORSE * errors[0])


def given_back(found: HeldOut | None, values: Float64Array, left: Float64Array) -> npt.NDArray[np.bool_]:
    """Which geometries get back what the lattice left of them, (n,): `left` (n, channels) of `values`.

    All that are off in any channel, where predictions of what was held out do not suffer by it: the file's values then
    come back to rounding. Else, the residuals being noise, only those that are beyond it.
    """
    if found is not None and found.gives_back:
        return np.asarray((left != 0).any(axis=1))
    off = np.abs(left).sum(axis=1) / np.maximum(np.abs(values).sum(axis=1), 1e-300)
    return np.asarray(off > max(OFF, _BEYOND_NOISE * _DEVIATION * float(np.median(off))))


def half_widths(
    found: HeldOut,
    values: Float64Array,
    group: npt.NDArray[np.intp],
    coverage: Coverage,
    nbytes: int,
    instrument: Float64Array | None,
    apart: Callable[[Float64Array], Float64Array] | None = None,
) -> LocalError:
    """Half-widths by cell from the errors of its nearest geometries, larger the farther they are than those were.

    values      (rows, channels) of the file, repeats as they are: the noise of one row is part of its error
    group       (rows,) number of its geometry, of `coverage`
    instrument  (geometries, channels) half-widths that the file states, added in squares
    apart       how far what may be assumed is apart at angles (n, 3), relative to |f|, (n,), added in squares
    """
    predicted = found.predicted
    place = np.full(len(coverage.angles), -1)
    place[found.rows] = np.arange(len(found.rows))
    row = place[group]  # of each row of the file, its geometry among those that were predicted
    values, row = values[row >= 0], row[row >= 0]
    repeats = np.bincount(row)[:, None]
    deviation = np.abs(values - predicted[row])
    error = np.zeros_like(predicted)
    np.add.at(error, row, deviation)
    error /= repeats
    size = np.abs(values)
    floors = np.maximum(_FLOORS[0] * np.median(size, axis=0), np.maximum(_FLOORS[1] * size.mean(axis=0), 1e-30))
    relative = error / (np.abs(predicted) + floors)
    factors = np.median(relative, axis=0)
    factors = np.where(factors > 0, factors, relative.mean(axis=0) + 1e-300)
    factors = factors / factors.mean()
    relative = relative / factors
    level = min(fitting(nbytes, 1)[0], _FINEST)
    c = cells(level)
    known = Coverage(coverage.angles[found.rows], coverage.gap, coverage.bilateral)
    at = known.angles
    drawn = np.stack(c.draw(_EACH, np.random.default_rng(_SEED)), axis=1)
    # a cell is what was measured in it; one without, what is drawn there
    cell = np.concatenate([c.numbers(*np.ascontiguousarray(at.T)), np.repeat(np.arange(c.count), _EACH)])
    measured = np.bincount(cell[: len(at)], minlength=c.count) > 0
    used = np.concatenate([np.ones(len(at), np.bool_), np.repeat(~measured, _EACH)])
    cell, places = cell[used], np.concatenate([at, drawn])[used]
    near = known.neighbours(places, _NEIGHBOURS)[1]
    # without the largest: beside a spike that no neighbour predicts, not everything is as wrong
    spread = np.sort(relative.mean(axis=1)[near], axis=1)[:, :-1].mean(axis=1)
    typical = np.median(found.distance[near], axis=1)
    spread = spread * np.maximum(coverage.neighbours(places, 1)[0][:, 0] / np.maximum(typical, 1e-9), 1)
    spread = np.where(coverage.status(*places.T) == Status.FILLED, np.maximum(spread, 1), spread)
    arrays = {
        "codes": encoded((np.bincount(cell, spread) / np.bincount(cell))[:, None]),
        "by_incidence": np.ones(len(EDGES) - 1, np.float32),
        "floors": floors.astype(np.float32),
        "factors": factors.astype(np.float32),
    }
    learnt = LocalError(level, arrays)
    width = np.empty_like(predicted)
    theta_i, theta_o, delta_phi = np.ascontiguousarray(at.T)
    learnt.half_widths(theta_i, theta_o, delta_phi, np.ascontiguousarray(predicted), width)
    ratio = np.divide(deviation, width[row], out=np.zeros_like(deviation), where=width[row] > 0)
    factor = []
    for middle in 0.5 * (EDGES[1:] + EDGES[:-1]):
        nearest = np.argsort(np.abs(at[row, 0] - middle), kind="stable")[:_CALIBRATE]
        factor.append(quantile(ratio[nearest].reshape(1, -1, 1), LEVEL).item())
    own: Float64Array | None = None
    if instrument is not None:
        stated = instrument[found.rows] / (np.abs(predicted) + floors) / factors
        own = stated[known.nearest(*places.T)]
    if apart is not None:  # of whole cells: what was measured in one says nothing of its other azimuths
        cell = np.repeat(np.arange(c.count), _EACH)
        stated_there = 0.0 if instrument is None else stated[known.nearest(*drawn.T)]
        own = np.hypot(stated_there, apart(drawn)[:, None] / factors)
    return calibrated(learnt, np.asarray(factor), cell, own)
