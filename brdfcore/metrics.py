"""Error measures between two BRDFs, and what data claims: each has a name, a formula and a source.

f is the reference, f' the candidate; all integrals are over pairs of directions of the upper hemisphere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.brdf import Brdf, Channels
from brdfcore.conventions import FloatArray
from brdfcore.directions import DirectionSet, cosine_pairs, mixture

Float64Array = npt.NDArray[np.float64]

#: theta_i of the albedo bias, degrees.
BIAS_ANGLES = (0.0, 30.0, 60.0, 80.0, 85.0, 89.0, 89.9)
#: A symmetry of data holds if its L1 defect is below this. Measured materials that were made symmetric have defects of
#: 5e-7 to 1.3e-5 left in their tables; ones that are not reciprocal have .02 and more; the errors asked of a table
#: begin at 1e-3.
FLAG_DEFECT = 1e-4
#: An albedo may pass 1 by this much before energy counts as not conserved: quadrature.
ALBEDO_SLACK = 1e-6
#: Values evaluated at a time by `compare`: memory stays below 300 MB with 195 channels, and one channel on the
#: default number of directions is one piece.
_CHUNK = 1 << 19
#: Angles at which the delta parts are compared, beside BIAS_ANGLES: none of them a node of a table.
_DELTA_ANGLES = 4_096


@dataclass(frozen=True)
class Comparison:
    """How far `candidate` is from `reference`, without their delta parts.

    l1            int |f'-f| c_i c_o / int f c_i c_o ("misplaced energy"), channels summed; nan if f has no energy, or
                  where a value is not finite.
    l1_stderr     its standard error: the estimate is random.
    rel_l2        sqrt(int (f'-f)^2 c_i c_o / int f^2 c_i c_o).
    albedo_bias   {"theta_i": radians, "bias": (albedo' - albedo)/albedo, worst channel's}, deltas left out.
    log_ratio     p50, p95, p99, p999, max of |ln((f'+d)/(f+d))|, d = 1e-6 x mean albedo / pi, over all draws with
                  f' >= 0 and f >= 0; the albedo is estimated from the first 2^19 values.
    regular       whether the reference has a regular part at all (one that is not 0 everywhere).
    negatives, nan  values of the candidate below 0, or not a number, among `values`.
    delta         largest |delta_reflectance' - delta_reflectance| over theta_i, at 4,096 seeded angles and the bias's.
    directions, seed  the set measured on.
    """

    l1: float
    l1_stderr: float
    rel_l2: float
    albedo_bias: dict[str, list[float]]
    log_ratio: dict[str, float]
    negatives: int
    nan: int
    values: int
    delta: float
    regular: bool
    directions: int
    seed: int

    def to_json(self) -> dict[str, Any]:
        """JSON-ready; what is not finite becomes null."""
        return {k: _finite(v) for k, v in asdict(self).items()}


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, Mapping):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return value


def compare(reference: Brdf, candidate: Brdf, *, directions: int = 200_000, seed: int = 20_261_122) -> Comparison:
    """Every measure at once, on `directions` seeded draws of `directions.mixture`.

    Evaluated in pieces of half a million values. Raises `InputError` if the channels differ and neither is single, or
    `directions` is no number of draws.
    """
    channels = len(Channels.common(reference.channels, candidate.channels))
    drawn = mixture(directions, seed)
    used = drawn.weight > 0
    angles = (drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used])
    weight = drawn.weight[used]
    sums = np.zeros((4, weight.size))  # of each pair over its channels: |g - f|, f, (g - f)^2, f^2
    ratios = np.empty(weight.size * channels, np.float32)
    floor, kept, negatives, nan = 0.0, 0, 0, 0
    step = max(_CHUNK // channels, 1)
    for start in range(0, weight.size, step):
        piece = slice(start, start + step)
        f, g = np.broadcast_arrays(*(b.evaluate(*(x[piece] for x in angles)) for b in (reference, candidate)))
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is counted, not warned of
            if start == 0:
                floor = _floor(weight[piece], f)
            e = np.abs(g - f)
            sums[:, piece] = e.sum(axis=1), f.sum(axis=1), (e * e).sum(axis=1), (f * f).sum(axis=1)
            found = _log_ratios(f, g, floor)
            ratios[kept : kept + found.size] = found
        kept += found.size
        negatives += int((g < 0).sum())
        nan += int(np.isnan(g).sum())
    with np.errstate(over="ignore", invalid="ignore"):
        value, error = _l1(weight, sums[0], sums[1])
        energy = float(weight @ sums[3])
    log_ratio = _quantiles(ratios[:kept])
    del ratios  # the largest array, before the albedos need theirs
    return Comparison(
        l1=value,
        l1_stderr=error,
        rel_l2=float(np.sqrt(float(weight @ sums[2]) / energy)) if energy > 0 else float("nan"),
        albedo_bias=albedo_bias(reference, candidate),
        log_ratio=log_ratio,
        negatives=negatives,
        nan=nan,
        values=weight.size * channels,
        delta=_delta_difference(reference, candidate),
        regular=energy != 0,  # nan, where the reference is not finite, is not nothing
        directions=directions,
        seed=seed,
    )


def _l1(weight: Float64Array, difference: Float64Array, energy: Float64Array) -> tuple[float, float]:
    """(L1, standard error) from importance-sampled |g - f| and f, summed over channels, (n,).

    L1 = sum w |g - f| / sum w f with w = c_i c_o / p; standard error of the ratio
    sqrt(sum w^2 (|g - f| - L1 f)^2) / sum w f. (nan, nan) where sum w f is 0.
    """
    total = float(weight @ energy)
    if total == 0:
        return float("nan"), float("nan")
    ratio = float(weight @ difference) / total
    return ratio, float(np.sqrt(np.sum((weight * (difference - ratio * energy)) ** 2))) / abs(total)


def _floor(weight: Float64Array, f: FloatArray) -> float:
    """d = 1e-6 albedo/pi, 0 if there is none: a millionth of the Lambertian of the same mean albedo.

    It keeps values that carry no light from counting in log ratios.
    """
    # sum w f / n estimates pi x mean albedo up to the draws left out; only its magnitude matters here
    return 1e-6 * max(float(weight @ f.mean(axis=1)) / max(weight.size, 1), 0.0) / np.pi**2


def _log_ratios(f: FloatArray, g: FloatArray, floor: float) -> FloatArray:
    """|ln((g+d)/(f+d))| of every value with f >= 0 and g >= 0, flat; none without a floor d."""
    usable = (f >= 0) & (g >= 0) if floor > 0 else np.zeros(f.shape, np.bool_)
    ratios: FloatArray = np.abs(np.log((g[usable] + floor) / (f[usable] + floor)))
    return ratios


def _quantiles(ratios: FloatArray) -> dict[str, float]:
    """p50, p95, p99, p999 and max, unweighted; changes the order of `ratios`."""
    if not ratios.size:
        return {name: float("nan") for name in ("p50", "p95", "p99", "p999", "max")}
    p50, p95, p99, p999 = np.quantile(ratios, [0.5, 0.95, 0.99, 0.999], overwrite_input=True)
    return {"p50": float(p50), "p95": float(p95), "p99": float(p99), "p999": float(p999), "max": float(ratios.max())}


def albedo_bias(reference: Brdf, candidate: Brdf) -> dict[str, list[float]]:
    """Relative albedo difference of the regular parts at `BIAS_ANGLES`; of the channels, the largest in magnitude."""
    theta = np.radians(BIAS_ANGLES)
    a, b = (m.albedo(theta) - m.delta_reflectance(theta) for m in (reference, candidate))
    a, b = np.broadcast_arrays(a, b)
    bias = np.divide(b - a, a, out=np.zeros_like(a), where=a != 0)
    worst = np.abs(bias).argmax(axis=1)
    return {"theta_i": theta.tolist(), "bias": bias[np.arange(theta.size), worst].tolist()}


def _delta_difference(reference: Brdf, candidate: Brdf) -> float:
    if not (reference.has_delta or candidate.has_delta):
        return 0.0
    between = np.random.default_rng(_DELTA_ANGLES).uniform(0, np.pi / 2, _DELTA_ANGLES)
    theta = np.concatenate([np.radians(BIAS_ANGLES), between])
    return float(np.abs(reference.delta_reflectance(theta) - candidate.delta_reflectance(theta)).max())


def reciprocity_defect(brdf: Brdf, *, pairs: int = 4_096, seed: int = 1) -> float:
    """int |f(i,o) - f(o,i)| c_i c_o / int f c_i c_o on seeded cosine-distributed pairs."""
    theta_i, theta_o, delta_phi = cosine_pairs(pairs, seed)
    return _defect(brdf.evaluate(theta_i, theta_o, delta_phi), brdf.evaluate(theta_o, theta_i, -delta_phi))


def bilateral_defect(brdf: Brdf, *, pairs: int = 4_096, seed: int = 1) -> float:
    """int |f(dphi) - f(-dphi)| c_i c_o / int f c_i c_o on seeded cosine-distributed pairs."""
    theta_i, theta_o, delta_phi = cosine_pairs(pairs, seed)
    return _defect(brdf.evaluate(theta_i, theta_o, delta_phi), brdf.evaluate(theta_i, theta_o, -delta_phi))


def _defect(f: FloatArray, g: FloatArray) -> float:
    total = float(np.abs(f).sum())
    return float(np.abs(f - g).sum()) / total if total > 0 else 0.0


def _conserves(brdf: Brdf) -> bool:
    """Whether no albedo at `BIAS_ANGLES` passes 1: one pass over all, refined where that leaves a doubt."""
    theta = np.radians(BIAS_ANGLES)
    rough, _ = brdf.albedo_error(theta, tolerance=np.inf)
    # one pass over a measured material was found .0145 off at worst
    near = (rough > 0.9).any(axis=1)
    return bool((rough <= 1.1).all() and (brdf.albedo(theta[near]) <= 1 + ALBEDO_SLACK).all())


def measured_flags(brdf: Brdf, *, pairs: int = 4_096, seed: int = 1) -> dict[str, bool]:
    """bilateral, reciprocal, energy_conserving and non_negative as found on `pairs` seeded pairs.

    A symmetry holds if its L1 defect is at most `FLAG_DEFECT`; energy is conserved if no albedo at `BIAS_ANGLES`
    exceeds 1 by more than `ALBEDO_SLACK`; non-negative means no negative value was met.
    """
    theta_i, theta_o, delta_phi = cosine_pairs(pairs, seed)
    lobe: DirectionSet = mixture(pairs, seed)
    smallest = min(
        float(brdf.evaluate(theta_i, theta_o, delta_phi).min()),
        float(brdf.evaluate(lobe.theta_i, lobe.theta_o, lobe.delta_phi).min()),
    )
    return {
        "bilateral": bilateral_defect(brdf, pairs=pairs, seed=seed) <= FLAG_DEFECT,
        "reciprocal": reciprocity_defect(brdf, pairs=pairs, seed=seed) <= FLAG_DEFECT,
        "energy_conserving": _conserves(brdf),
        "non_negative": smallest >= 0,
    }
