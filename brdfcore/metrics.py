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
from brdfcore.directions import DirectionSet, mixture, uniform_pairs

Float64Array = npt.NDArray[np.float64]

#: theta_i of the albedo bias, degrees.
BIAS_ANGLES = (0.0, 30.0, 60.0, 80.0, 85.0, 89.0, 89.9)
#: A symmetry of data holds if its L1 defect is below this. Measured materials that were made symmetric have defects of
#: 5e-7 to 1.3e-5 left in their tables; ones that are not reciprocal have .02 and more; the errors asked of a table
#: begin at 1e-3.
FLAG_DEFECT = 1e-4
#: An albedo may pass 1 by this much before energy counts as not conserved: quadrature.
ALBEDO_SLACK = 1e-6


@dataclass(frozen=True)
class Comparison:
    """How far `candidate` is from `reference`, without their delta parts.

    l1            int |f'-f| c_i c_o / int f c_i c_o ("misplaced energy"), channels summed; nan if f has no energy.
    l1_stderr     its standard error: the estimate is random.
    rel_l2        sqrt(int (f'-f)^2 c_i c_o / int f^2 c_i c_o).
    albedo_bias   {"theta_i": radians, "bias": (albedo' - albedo)/albedo, worst channel's}, deltas left out.
    log_ratio     p50, p95, p99, p999, max of |ln((f'+d)/(f+d))|, d = 1e-6 x mean albedo / pi, over all draws with
                  f' >= 0 and f >= 0.
    negatives, nan  values of the candidate below 0, or not a number, among `values`.
    delta         largest |delta_reflectance' - delta_reflectance|.
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

    Raises `InputError` if the channels differ and neither is single.
    """
    Channels.common(reference.channels, candidate.channels)
    drawn = mixture(directions, seed)
    used = drawn.weight > 0
    angles = (drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used])
    f, g = np.broadcast_arrays(reference.evaluate(*angles), candidate.evaluate(*angles))
    weight = drawn.weight[used]
    value, error = l1(weight, f, g)
    nan = np.isnan(g)
    return Comparison(
        l1=value,
        l1_stderr=error,
        rel_l2=relative_l2(weight, f, g),
        albedo_bias=albedo_bias(reference, candidate),
        log_ratio=log_ratio_quantiles(weight, f, g),
        negatives=int((g < 0).sum()),
        nan=int(nan.sum()),
        values=int(g.size),
        delta=_delta_difference(reference, candidate),
        directions=directions,
        seed=seed,
    )


def l1(weight: Float64Array, f: Float64Array, g: Float64Array) -> tuple[float, float]:
    """(L1, standard error) from importance-sampled values.

    L1 = sum w |g - f| / sum w f with w = c_i c_o / p, (n,), f and g (n, channels), channels summed; standard
    error of the ratio sqrt(sum w^2 (|g - f| - L1 f)^2) / sum w f. (nan, nan) where sum w f is 0.
    """
    difference = np.abs(g - f).sum(axis=1)
    energy = f.sum(axis=1)
    total = float(weight @ energy)
    if total == 0:
        return float("nan"), float("nan")
    ratio = float(weight @ difference) / total
    return ratio, float(np.sqrt(np.sum((weight * (difference - ratio * energy)) ** 2))) / abs(total)


def relative_l2(weight: Float64Array, f: Float64Array, g: Float64Array) -> float:
    """sqrt(sum w (g - f)^2 / sum w f^2), channels summed; nan where f is 0."""
    total = float(weight @ (f**2).sum(axis=1))
    return float(np.sqrt(float(weight @ ((g - f) ** 2).sum(axis=1)) / total)) if total > 0 else float("nan")


def log_ratio_quantiles(weight: Float64Array, f: Float64Array, g: Float64Array) -> dict[str, float]:
    """p50, p95, p99, p999 and max of |ln((g+d)/(f+d))|, unweighted over the draws; d = 1e-6 albedo/pi.

    d keeps values that carry no light from counting: a millionth of the Lambertian of the same mean albedo.
    """
    # sum w f / n estimates pi x mean albedo up to the draws left out; only its magnitude matters here
    floor = 1e-6 * max(float(weight @ f.mean(axis=1)) / max(weight.size, 1), 0.0) / np.pi**2
    usable = (f >= 0) & (g >= 0)
    if floor == 0 or not usable.any():
        return {name: float("nan") for name in ("p50", "p95", "p99", "p999", "max")}
    ratio = np.abs(np.log((g[usable] + floor) / (f[usable] + floor)))
    p50, p95, p99, p999 = np.quantile(ratio, [0.5, 0.95, 0.99, 0.999])
    return {"p50": float(p50), "p95": float(p95), "p99": float(p99), "p999": float(p999), "max": float(ratio.max())}


def albedo_bias(reference: Brdf, candidate: Brdf) -> dict[str, list[float]]:
    """Relative albedo difference of the regular parts at `BIAS_ANGLES`; of the channels, the largest in magnitude."""
    theta = np.radians(BIAS_ANGLES)
    a, b = (m.albedo(theta) - m.delta_reflectance(theta) for m in (reference, candidate))
    a, b = np.broadcast_arrays(a, b)
    bias = np.divide(b - a, a, out=np.zeros_like(a), where=a != 0)
    worst = np.abs(bias).argmax(axis=1)
    return {"theta_i": theta.tolist(), "bias": bias[np.arange(theta.size), worst].tolist()}


def _delta_difference(reference: Brdf, candidate: Brdf) -> float:
    theta = np.radians(BIAS_ANGLES)
    return float(np.abs(reference.delta_reflectance(theta) - candidate.delta_reflectance(theta)).max())


def reciprocity_defect(brdf: Brdf, *, pairs: int = 4_096, seed: int = 1) -> float:
    """int |f(i,o) - f(o,i)| c_i c_o / int f c_i c_o on seeded cosine-distributed pairs."""
    theta_i, theta_o, delta_phi = uniform_pairs(pairs, seed)
    return _defect(brdf.evaluate(theta_i, theta_o, delta_phi), brdf.evaluate(theta_o, theta_i, -delta_phi))


def bilateral_defect(brdf: Brdf, *, pairs: int = 4_096, seed: int = 1) -> float:
    """int |f(dphi) - f(-dphi)| c_i c_o / int f c_i c_o on seeded cosine-distributed pairs."""
    theta_i, theta_o, delta_phi = uniform_pairs(pairs, seed)
    return _defect(brdf.evaluate(theta_i, theta_o, delta_phi), brdf.evaluate(theta_i, theta_o, -delta_phi))


def _defect(f: FloatArray, g: FloatArray) -> float:
    total = float(np.abs(f).sum())
    return float(np.abs(f - g).sum()) / total if total > 0 else 0.0


def measured_flags(brdf: Brdf, *, pairs: int = 4_096, seed: int = 1) -> dict[str, bool]:
    """bilateral, reciprocal, energy_conserving and non_negative as found on `pairs` seeded pairs.

    A symmetry holds if its L1 defect is at most `FLAG_DEFECT`; energy is conserved if no albedo at `BIAS_ANGLES`
    exceeds 1 by more than `ALBEDO_SLACK`; non-negative means no negative value was met.
    """
    theta_i, theta_o, delta_phi = uniform_pairs(pairs, seed)
    lobe: DirectionSet = mixture(pairs, seed)
    smallest = min(
        float(brdf.evaluate(theta_i, theta_o, delta_phi).min()),
        float(brdf.evaluate(lobe.theta_i, lobe.theta_o, lobe.delta_phi).min()),
    )
    return {
        "bilateral": bilateral_defect(brdf, pairs=pairs, seed=seed) <= FLAG_DEFECT,
        "reciprocal": reciprocity_defect(brdf, pairs=pairs, seed=seed) <= FLAG_DEFECT,
        "energy_conserving": bool((brdf.albedo(np.radians(BIAS_ANGLES)) <= 1 + ALBEDO_SLACK).all()),
        "non_negative": smallest >= 0,
    }
