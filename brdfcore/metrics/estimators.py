"""Ratios of integrals and quantiles from random draws, each with its confidence interval."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import FloatArray

Float64Array = npt.NDArray[np.float64]

#: Two-sided 95 % of a normal distribution.
Z95 = 1.959964
LEVELS = {"p50": 0.5, "p95": 0.95, "p99": 0.99, "p999": 0.999}


class Estimate(NamedTuple):
    """A value and its standard error; nan, nan where it has no meaning."""

    value: float
    stderr: float


NOTHING = Estimate(float("nan"), float("nan"))


def ratio(weight: Float64Array, numerator: Float64Array, denominator: Float64Array) -> Estimate:
    """R = sum w a / sum w b of independent draws, (n,) each; `NOTHING` where sum w b is not positive:
    measured by a reference that is nothing or less, no ratio says anything.

    Standard error sqrt(sum w^2 (a - R b)^2) / |sum w b|: the linearised ratio estimator (W. G. Cochran, "Sampling
    Techniques", 3rd ed. 1977, section 6.4). Its bias is of order 1/n.
    """
    total = float(weight @ denominator)
    if not total > 0:
        return NOTHING
    value = float(weight @ numerator) / total
    return Estimate(value, float(np.sqrt(np.sum((weight * (numerator - value * denominator)) ** 2))) / abs(total))


def honest_ratio(weight: Float64Array, numerator: Float64Array, denominator: Float64Array) -> Estimate:
    """`ratio`, with a standard error that a few heavy draws cannot make small.

    What the heaviest draw changes is counted three times more, in squares: among many of like weight that is nothing;
    where one or two draws hold what was found of a lobe, others like them may have been missed.
    """
    found = ratio(weight, numerator, denominator)
    total = float(weight @ denominator)
    if total == 0:
        return found
    heaviest = float(np.abs(weight * (numerator - found.value * denominator)).max()) / abs(total)
    return Estimate(found.value, math.hypot(found.stderr, 3**0.5 * heaviest))


def root(squared: Estimate) -> Estimate:
    """sqrt of an estimate, standard error by the delta method, s / (2 sqrt R); at 0 it is 0."""
    value = float(np.sqrt(squared.value)) if squared.value >= 0 else float("nan")
    return Estimate(value, squared.stderr / (2 * value) if value > 0 else squared.stderr)


def quantiles(values: FloatArray, draws: int) -> tuple[dict[str, float], dict[str, list[float]]]:
    """p50, p95, p99, p999 and max of `values`, unweighted, and 95 % intervals; changes the order of `values`.

    The interval of level p runs between the order statistics at p -+ 1.96 sqrt(p (1-p)/draws), whatever the
    distribution (H. A. David, H. N. Nagaraja, "Order Statistics", 3rd ed. 2003, section 7.1). `draws` is the number of
    independent ones: values of several channels at one pair of directions are not. A largest value has no interval.
    """
    if not values.size:
        return dict.fromkeys([*LEVELS, "max"], float("nan")), {name: [float("nan")] * 2 for name in LEVELS}
    levels = np.array(list(LEVELS.values()))
    off = Z95 * np.sqrt(levels * (1 - levels) / max(draws, 1))
    wanted = np.clip(np.concatenate([levels, levels - off, levels + off]), 0, 1)
    largest = float(values.max())
    found = np.quantile(values, wanted, overwrite_input=True).reshape(3, -1).astype(float)
    middle = {name: float(x) for name, x in zip(LEVELS, found[0])}
    return {**middle, "max": largest}, {n: [float(a), float(b)] for n, a, b in zip(LEVELS, found[1], found[2])}


def log_ratios(f: FloatArray, g: FloatArray, floor: float) -> FloatArray:
    """|ln((g+d)/(f+d))| of every value with f >= 0 and g >= 0, flat; none without a floor d."""
    usable = (f >= 0) & (g >= 0) if floor > 0 else np.zeros(f.shape, np.bool_)
    ratios: FloatArray = np.abs(np.log((g[usable] + floor) / (f[usable] + floor)))
    return ratios


def log_differences(f: FloatArray, g: FloatArray, cos_i: Float64Array) -> FloatArray:
    """ln(1 + g c_i) - ln(1 + f c_i), (n, channels); nan where 1 + f c_i is not positive."""
    with np.errstate(invalid="ignore", divide="ignore"):
        difference: FloatArray = np.log1p(g * cos_i[:, None]) - np.log1p(f * cos_i[:, None])
    return difference


def cube_root_differences(f: FloatArray, g: FloatArray, cos_i: Float64Array) -> FloatArray:
    """(g c_i)^(1/3) - (f c_i)^(1/3), (n, channels); negative values have negative roots."""
    difference: FloatArray = np.cbrt(g * cos_i[:, None]) - np.cbrt(f * cos_i[:, None])
    return difference
