"""`fit`: the analytic model that stands for a material, and what it loses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from brdfcore.analysis.fit.families import BASES, FAMILIES, Family, families
from brdfcore.analysis.fit.intervals import Estimated, estimates
from brdfcore.analysis.fit.losses import LOSSES, Loss, Rows
from brdfcore.analysis.fit.solve import Solver, State
from brdfcore.analysis.fit.terms import terms_of
from brdfcore.base.brdf import Brdf
from brdfcore.base.catalogue import model_from_json
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.errors import InputError, LimitError
from brdfcore.base.parameters import shown
from brdfcore.metrics.comparison import WHOLE, Comparison, compare, energy_draws
from brdfcore.metrics.estimators import honest_ratio
from brdfcore.metrics.lobes import Lobes
from brdfcore.tables.scattered.table import Scattered, merged

#: Directions that a function is fitted on, and those, of another seed, that `Fit.l1` is measured on.
_DIRECTIONS, _MEASURED = 4_000, 20_000
#: Every so many rows for the search of starts.
_COARSE = 3
#: Values, rows times channels, and lobes that are taken at most: seconds.
_MOST_VALUES, MOST_LOBES = 4_000_000, 3
#: Starts that are followed a little way, and of those to the end.
_STARTS, _FOLLOWED = 6, 2
#: More lobes have to bring the loss down to this share; below the other there is nothing to bring down.
_WORTH, _NOTHING_LEFT = 0.9, 1e-9

Range = tuple[float, float]


class Fit(Brdf):
    """A fitted model: a Brdf like any other, exact between the directions that it was fitted on.

    terms        list of {"model", "parameters"} and, where a model's own bounds leave no other way, "factor":
                 f is their sum. `bc.write(fit, "paint.json")` writes them.
    estimates    every parameter with its standard error, 95 % interval, and what cannot be told (`Estimated`).
    correlated   pairs of parameters that the data cannot tell apart: (one, other, correlation), |correlation| > .95.
    condition    condition number of the problem, columns scaled to length 1.
    loss, value  what was made small, and its value.
    l1, l1_stderr  share of the reflected energy that the model misplaces: on directions that it was not fitted on; of
                 measured points, over these, without error bar.
    angles       what it was fitted for, {"light": [from, to], "view": [from, to]} in radians.

    >>> found = bc.fit(bc.model("ward", roughness=0.2, specular=0.5), "ward", 1)
    >>> [(e.name, e.why) for e in found.estimates]
    [('diffuse value', 'at its bound'), ('specular value', ''), ('roughness', '')]
    """

    terms: list[dict[str, Any]]
    estimates: list[Estimated]
    correlated: list[tuple[str, str, float]]
    condition: float
    loss: str
    value: float
    l1: float
    l1_stderr: float
    angles: dict[str, list[float]]

    def __init__(self, source: Brdf, terms: Sequence[Mapping[str, Any]], channels: Channels) -> None:
        super().__init__()
        self.source, self.terms = source, [dict(t) for t in terms]
        self.model = model_from_json(self.terms[0] if len(self.terms) == 1 else {"sum": self.terms})
        self.channels = channels
        self.bilateral, self.reciprocal, self.non_negative = True, self.model.reciprocal, True
        self.energy_conserving = self.model.energy_conserving
        self._analytic = True
        self.metadata = {"fit": self.terms}

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = self.model.evaluate(theta_i, theta_o, delta_phi)
        return True

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = 0.0  # of the formula, as of any model; what it loses against its source is `l1`
        return True

    @cached_property
    def comparison(self) -> Comparison:
        """Every error measure against the source, by angle of incidence too (`bc.compare`)."""
        return compare(self.source, self)

    def to_json(self) -> dict[str, Any]:
        """JSON-ready: the model, and all that is stated of it."""
        return {
            "terms": self.terms,
            "loss": {"name": self.loss, "value": self.value},
            "l1": self.l1,
            "l1_stderr": None if self.l1_stderr != self.l1_stderr else self.l1_stderr,
            "condition": self.condition if np.isfinite(self.condition) else None,
            "estimates": [e.to_json() for e in self.estimates],
            "correlated": [{"one": a, "other": b, "correlation": c} for a, b, c in self.correlated],
            "angles": self.angles,
            "remarks": self.remarks,
        }

    @property
    def remarks(self) -> list[str]:
        """When not to use the fit, sentences."""
        said = ["the perfect mirror part is not in the model"] if self.source.has_delta else []
        if self.l1 > 0.1:
            said.append(f"{self.l1:.0%} of the reflected energy is in the wrong place: use a table where that is seen")
        named = [e.name for e in self.estimates if e.why]
        if named:
            said.append(f"no interval, the data do not tell: {', '.join(named)}")
        return said


def fit(
    b: Brdf,
    model: str = "auto",
    lobes: int | str = "auto",
    loss: str = "auto",
    *,
    base: str = "lambert",
    angles: Mapping[str, Range] | None = None,
    seed: int = 20_261_201,
) -> Fit:
    """The analytic model nearest to `b`: a diffuse base and up to three lobes, with what it loses.

    Parameters
    ----------
    model : "auto", or a name of `FAMILIES`: ggx, cook_torrance (Beckmann or Blinn), ward, phong, blinn_phong. Roughness
        or exponent, and the index where the model has one, are free and shared by the channels; diffuse and specular
        are one a channel, >= 0.
    lobes : 0 to 3, or "auto": the fewest within a tenth of the best loss.
    loss : see `losses.Loss`. "auto" is "energy" of a function; of measurements "relative", as their noise is in
        proportion to the value.
    base : "lambert", or "oren_nayar" with a free sigma.
    angles : {"light": (from, to), "view": (from, to)}, radians, what a scene sees; all by default.

    A function is fitted on 4,000 directions drawn where its energy is (`metrics.lobes`); measured geometries are fitted
    as points, repeats averaged, not through their table. No start values: the weights are found exactly, the shapes on
    a grid of decades and by Levenberg's steps from the best of them.

    A perfect mirror part is left out, as by `evaluate`. Raises `InputError` for names that are none, a range that is
    empty and a source of negative energy, `LimitError` for too many values.

    >>> found = bc.fit(bc.model("ggx", roughness=0.2, diffuse=0.1, specular=0.5), "ggx", 1)
    >>> round(found.terms[0]["parameters"]["roughness"], 6), found.l1 < 1e-8
    (0.2, True)
    """
    counts = _checked(model, lobes, loss, base)
    ranges = {"light": WHOLE, "view": WHOLE, **_ranges(angles)}
    measured = isinstance(b, Scattered)
    rows = _points(b, ranges) if isinstance(b, Scattered) else drawn_rows(b, _DIRECTIONS, seed, ranges)
    if rows.values.size > _MOST_VALUES:
        raise LimitError(
            "too_large", f"{rows.values.shape[0]} directions of {rows.values.shape[1]} channels: at most "
            f"{_MOST_VALUES} values are fitted", where="b", got=rows.values.size, limit=_MOST_VALUES,
        )  # fmt: skip
    if rows.values.any() and not (np.isfinite(rows.values).all() and rows.energy > 0):
        said = "the source has no energy to fit: its values are not finite, or sum to no positive number"
        raise InputError("no_energy", said, where="b", expected="a positive, finite reflectance")
    chosen = loss if loss != "auto" else "relative" if measured else "energy"
    if not rows.values.any():
        return _nothing(b, chosen, ranges)
    state = search(rows, chosen, families(model), counts, base)
    return _stated(b, rows, chosen, state, ranges, seed)


def _checked(model: str, lobes: int | str, loss: str, base: str) -> list[int]:
    families(model)
    for name, value, known in (("loss", loss, ("auto", *LOSSES)), ("base", base, BASES)):
        if value not in known:
            expected = "one of " + ", ".join(known)
            said = f"{name} = {value!r}: expected {expected}"
            raise InputError("bad_option", said, where=name, got=value, expected=expected)
    if lobes == "auto":
        return list(range(1, MOST_LOBES + 1))
    if isinstance(lobes, bool) or not isinstance(lobes, int) or not 0 <= lobes <= MOST_LOBES:
        said = f"lobes = {lobes!r}: expected 'auto', or 0 to {MOST_LOBES}"
        raise InputError("bad_option", said, where="lobes", got=lobes, expected=f"'auto', 0 to {MOST_LOBES}")
    return [lobes]


def _ranges(angles: Mapping[str, Range] | None) -> dict[str, Range]:
    found: dict[str, Range] = {}
    for name, pair in (angles or {}).items():
        try:
            low, high = (float(x) for x in pair)
        except (TypeError, ValueError):
            low, high = math.nan, math.nan
        if name not in ("light", "view") or not 0 <= low < min(high, HALF_PI):
            expected = "light or view: (from, to), 0 <= from < to <= pi/2, radians"
            said = f"angles: {name} = {shown(pair)}: expected {expected}"
            raise InputError("bad_range", said, where=name, got=shown(pair), expected=expected)
        found[name] = (low, high)
    return found


def drawn_rows(b: Brdf, directions: int, seed: int, ranges: Mapping[str, Range]) -> Rows:
    """Draws where the energy of `b` is, within the ranges."""
    drawn = energy_draws(Lobes([b], seed), directions, seed, ranges["light"], ranges["view"])
    used = drawn.weight > 0
    if not used.any():
        raise InputError("range_empty", "angles: no direction is within", where="angles", expected="0 <= from < to")
    found = (drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used])
    return Rows(found, np.asarray(b.evaluate(*found), np.float64), drawn.weight[used] / used.size)


def _points(b: Scattered, ranges: Mapping[str, Range]) -> Rows:
    """Measured geometries, repeats averaged; weighed by their cosines."""
    angles, values, _ = merged(b.angles, b.measured, b.bilateral)
    used = np.ones(len(angles), bool)
    for k, name in enumerate(("light", "view")):
        used &= (angles[:, k] >= ranges[name][0]) & (angles[:, k] <= ranges[name][1])
    if not used.any():
        raise InputError("range_empty", "angles: no measured geometry is within", where="angles")
    angles, values = angles[used], values[used]
    weight = np.cos(angles[:, 0]) * np.cos(angles[:, 1])
    theta_i, theta_o, delta_phi = (np.ascontiguousarray(a) for a in angles.T)
    return Rows((theta_i, theta_o, delta_phi), values, weight / weight.sum())


def search(rows: Rows, loss: str, among: Sequence[Family], counts: Sequence[int], base: str) -> State:
    """The best state of `counts` lobes; of several counts the fewest within a tenth of the best loss."""
    solver = Solver(rows, loss)
    few = slice(None, None, _COARSE if rows.weight.size > 1_000 else 1)
    theta_i, theta_o, delta_phi = (a[few] for a in rows.angles)
    coarse = Solver(Rows((theta_i, theta_o, delta_phi), rows.values[few], rows.weight[few]), loss)
    found: list[State] = []
    for count in range(min(max(counts), 1), max(counts) + 1):  # more lobes grow from fewer
        about = found[-1] if found and count > 1 else None
        if count == 1 and len({f.model for f in among}) > 1:  # the grid tells too little of which model it will be
            each = [[f for f in among if f.model == name] for name in FAMILIES]
            starts = [s for own in each if own for s in coarse.starts(own, 1, base, 2, None)]
        else:
            starts = coarse.starts(among, count, base, _STARTS, about)
        followed = sorted((coarse.polished(s, 12, 1e-3) for s in starts), key=lambda s: s.loss)[:_FOLLOWED]
        found.append(min((solver.polished(s) for s in followed), key=lambda s: s.loss))
        if found[-1].loss < _NOTHING_LEFT:
            break
    allowed = [s for s in found if len(s.lobes) in counts] or found[-1:]
    best = min(s.loss for s in allowed)
    return next(s for s in allowed if s.loss <= max(best / _WORTH, _NOTHING_LEFT))


def _nothing(b: Brdf, loss: str, ranges: Mapping[str, Range]) -> Fit:
    """Of a source that is 0 everywhere, a perfect mirror part aside."""
    black = {"model": "lambert", "parameters": {"reflectance": [0.0] * len(b.channels)}}
    made = Fit(b, [black], b.channels)
    made.loss, made.value, made.l1, made.l1_stderr = loss, 0.0, 0.0, 0.0
    made.estimates, made.correlated, made.condition = [], [], 1.0
    made.angles = _shown(ranges)
    return made


def _shown(ranges: Mapping[str, Range]) -> dict[str, list[float]]:
    return {name: [float(low), min(float(high), HALF_PI)] for name, (low, high) in ranges.items()}


def _stated(b: Brdf, rows: Rows, loss: str, state: State, ranges: Mapping[str, Range], seed: int) -> Fit:
    made = Fit(b, terms_of(state), b.channels)
    made.loss, made.value = loss, state.loss
    made.estimates, made.correlated, made.condition = estimates(rows, loss, state, b.channels.labels())
    made.angles = _shown(ranges)
    if isinstance(b, Scattered):
        made.l1, made.l1_stderr = (
            Loss("energy", rows).value(np.asarray(made.evaluate(*rows.angles), np.float64)),
            float("nan"),
        )
    else:
        other = drawn_rows(b, _MEASURED, seed + 1, ranges)
        g = made.evaluate(*other.angles)
        error = honest_ratio(other.weight, np.abs(g - other.values).sum(axis=1), other.values.sum(axis=1))
        made.l1, made.l1_stderr = error.value, error.stderr
    return made
