"""Every error measure of a candidate against a reference at once, on one seeded set of directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.directions import mixture
from brdfcore.base.errors import InputError
from brdfcore.base.reflectance import ALBEDO_TOLERANCE, DATA_ALBEDO_TOLERANCE
from brdfcore.metrics.estimators import (
    Estimate,
    cube_root_differences,
    honest_ratio,
    log_differences,
    log_ratios,
    quantiles,
    ratio,
    root,
)
from brdfcore.metrics.incidence import Incidences, floored
from brdfcore.metrics.lobes import Drawn, Lobes
from brdfcore.metrics.symmetry import BIAS_ANGLES, PAIRS, symmetry_defects

Float64Array = npt.NDArray[np.float64]

#: Values evaluated at a time by `compare`: memory stays below 300 MB with 195 channels, and one channel on the
#: default number of directions is one piece.
_CHUNK = 1 << 19
#: Beside BIAS_ANGLES, degrees: up to the horizon a table of what conserves energy may reflect more than all light.
_HORIZON = (89.99, 90.0)
#: Angles at which the delta parts are compared, beside BIAS_ANGLES: none of them a node of a table.
_DELTA_ANGLES = 4_096
Range = tuple[float, float]
#: Every direction: float32's pi/2 is larger than pi/2.
WHOLE: Range = (0.0, 1.6)


@dataclass(frozen=True)
class Comparison:
    """How far `candidate` is from `reference`, without their delta parts. Standard errors are one sigma.

    l1, l1_stderr
        int |f'-f| c_i c_o / int f c_i c_o, channels summed: the share of the reflected energy that is misplaced, under
        light from everywhere. Nan if f has no energy, or where a value is not finite. Drawn where either has its
        energy (`metrics.lobes`). Where the albedos say that the draws missed a lobe, the standard error is as large as
        what they missed, and `skipped` says so.
    by_theta_i
        the same for light from one angle (`metrics.incidence.Incidences.rows`): theta_i (radians), l1, l1_stderr,
        albedo_ratio (a list, one a channel), albedo_error.
    between
        the same at angles between those, which are no whole degrees: a tolerance bounds both.
    rel_l2, rel_l2_stderr
        sqrt(int (f'-f)^2 c_i c_o / int f^2 c_i c_o): dominated by the peak.
    rms_log, rms_log_stderr
        sqrt(int (ln(1 + f' c_i) - ln(1 + f c_i))^2 c_i c_o / int c_i c_o), channels averaged (J. Loew, J. Kronander,
        A. Ynnerman, J. Unger, ACM Trans. Graph. 31(1), 2012, DOI 10.1145/2077341.2077350, with light from all sides).
        Values at which the logarithm does not exist are left out.
    rms_cube_root, rms_cube_root_stderr
        the same of (f c_i)^(1/3) (A. Fores, J. Ferwerda, J. Gu, "Toward a perceptually based metric for BRDF modeling",
        Color and Imaging Conference 2012).
    albedo_bias
        {"theta_i": radians, "bias": (albedo' - albedo)/albedo, the worst channel's, "error": what the quadrature may be
        off}, deltas left out; nan where the reference reflects nothing.
    albedo_excess
        where the reference conserves energy, by how much the candidate's albedo passes 1 at most, at 89.99 and 90
        degrees too; else 0.
    log_ratio, log_ratio_interval
        p50, p95, p99, p999, max of |ln((f'+d)/(f+d))|, d = 1e-6 x mean albedo / pi, over all draws with f' >= 0 and
        f >= 0; 95 % intervals [low, high] of all but the largest. The albedo is estimated from the first 2^19 values.
    symmetry
        {"reference": ..., "candidate": ...}: defects of reciprocity and of evenness in delta_phi (`symmetry_defects`).
    regular
        whether the reference has a regular part at all (one that is not 0 everywhere).
    negatives, nan
        values of the candidate below 0, or not a number, among `values`.
    delta
        largest |delta_reflectance' - delta_reflectance| over theta_i, at 4,096 seeded angles and the bias's.
    skipped
        sentences: which measures have no meaning here, and why.
    lobes_from
        rad: a lobe away from the mirror direction and the light that is narrower than this, and without tails, may have
        been missed, in which case nothing here counts it; 0 where reference and candidate leave no room for one. Lobes
        at the mirror direction and the light are found from 1e-8 rad.
    directions, seed
        the set measured on.
    nbytes, ns, flip
        of the candidate, where they were asked for (`brdfcore.compare(..., speed=True, appearance=True)`), else None.
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
    rel_l2_stderr: float = float("nan")
    rms_log: float = float("nan")
    rms_log_stderr: float = float("nan")
    rms_cube_root: float = float("nan")
    rms_cube_root_stderr: float = float("nan")
    log_ratio_interval: dict[str, list[float]] = field(default_factory=dict)
    by_theta_i: list[dict[str, Any]] = field(default_factory=list)
    between: list[dict[str, Any]] = field(default_factory=list)
    symmetry: dict[str, dict[str, float]] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    lobes_from: float = 0.0
    albedo_excess: float = 0.0
    nbytes: int | None = None
    ns: dict[str, Any] | None = None
    flip: dict[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        """JSON-ready; what is not finite becomes null."""
        return {k: finite(v) for k, v in asdict(self).items()}


def finite(value: Any) -> Any:
    """`value` with null for every number that is not finite."""
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, Mapping):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [finite(v) for v in value]
    return value


def compare(
    reference: Brdf,
    candidate: Brdf,
    *,
    directions: int = 200_000,
    seed: int = 20_261_122,
    light: Range = WHOLE,
    view: Range = WHOLE,
    incidences: Incidences | None = None,
) -> Comparison:
    """Every measure at once: L1 and relative L2 on `directions` draws where the energy is (`metrics.lobes`), the others
    on as many of `directions.mixture`.

    light, view  ranges (from, to) of theta_i and theta_o, radians, that the integrals go over; draws outside are left
                 out, so that a narrow range takes more of them. Albedos and symmetries are those of the whole.
    incidences   the reference drawn for by angle beforehand, if many candidates are compared with it.

    Evaluated in pieces of half a million values. Raises `InputError` if the energy of the reference is negative, if the
    channels differ and neither is single, `directions` is no number of draws, or none of them is within the ranges.
    """
    common = Channels.common(reference.channels, candidate.channels)
    channels = len(common)
    drawn = mixture(directions, seed)
    used = drawn.weight > 0
    for name, angle, (low, high) in (("light", drawn.theta_i, light), ("view", drawn.theta_o, view)):
        used &= (angle >= low) & (angle <= high)
        if not used.any():
            raise InputError(
                "range_empty",
                f"{name} = {low:.4g} to {high:.4g} radians: none of {directions} directions is within",
                where=name,
                got=[str(low), str(high)],
                expected="0 <= from < to <= pi/2, and directions enough",
            )
    angles = (drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used])
    weight = drawn.weight[used]
    # of each pair over its channels: squares and number of log differences; squares of those of cube roots
    sums = np.zeros((3, weight.size))
    ratios = np.empty(weight.size * channels, np.float32)
    floor, kept, negatives, nan = 0.0, 0, 0, 0
    step = max(_CHUNK // channels, 1)
    for start in range(0, weight.size, step):
        piece = slice(start, start + step)
        f, g = np.broadcast_arrays(*(b.evaluate(*(x[piece] for x in angles)) for b in (reference, candidate)))
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is counted, not warned of
            if start == 0:
                floor = _floor(weight[piece], f)
            cos_i = np.cos(angles[0][piece])
            logs, cubes = log_differences(f, g, cos_i), cube_root_differences(f, g, cos_i)
            there = ~np.isnan(logs)
            sums[:, piece] = np.where(there, logs**2, 0).sum(axis=1), there.sum(axis=1), (cubes**2).sum(axis=1)
            found = log_ratios(f, g, floor)
            ratios[kept : kept + found.size] = found
        kept += found.size
        negatives += int((g < 0).sum())
        nan += int(np.isnan(g).sum())
    with np.errstate(over="ignore", invalid="ignore"):
        logs_rms, cubes_rms = (
            root(ratio(weight, a, b)) for a, b in ((sums[0], sums[1]), (sums[2], np.full(weight.size, float(channels))))
        )
    values = weight.size * channels
    without_log = values - int(sums[1].sum())
    log_ratio, interval = quantiles(ratios[:kept], -(-kept // channels))
    ratio_count = kept
    del ratios  # the largest array, before the albedos need theirs
    both = Lobes([reference, candidate], seed)
    l1, l2, energy = _misplaced(reference, candidate, energy_draws(both, directions, seed, light, view))
    if incidences is None:
        draws = max(directions // 4, 200)
        incidences = Incidences(reference, common, both, light=light, view=view, seed=seed, draws=draws)
    bias = albedo_bias(reference, candidate)
    rows = incidences.rows(candidate)
    missed = floored(rows, bias) if (light, view) == (WHOLE, WHOLE) else 0.0
    return Comparison(
        l1=l1.value,
        l1_stderr=max(l1.stderr, missed),
        by_theta_i=rows,
        between=incidences.between(candidate),
        rel_l2=l2.value,
        rel_l2_stderr=l2.stderr,
        rms_log=logs_rms.value,
        rms_log_stderr=logs_rms.stderr,
        rms_cube_root=cubes_rms.value,
        rms_cube_root_stderr=cubes_rms.stderr,
        albedo_bias=bias,
        albedo_excess=albedo_excess(reference, candidate),
        log_ratio=log_ratio,
        log_ratio_interval=interval,
        symmetry={
            name: symmetry_defects(b, pairs=min(PAIRS, max(directions // 4, 200)))
            for name, b in (("reference", reference), ("candidate", candidate))
        },
        negatives=negatives,
        nan=nan,
        values=values,
        delta=delta_difference(reference, candidate),
        regular=energy != 0,  # nan, where the reference is not finite, is not nothing
        skipped=_skipped(l1.value, energy, missed, bias, without_log, values - ratio_count, values),
        lobes_from=both.found_from,
        directions=directions,
        seed=seed,
    )


def energy_draws(lobes: Lobes, directions: int, seed: int, light: Range = WHOLE, view: Range = WHOLE) -> Drawn:
    """The draws that L1 and relative L2 are estimated on: light cosine-distributed within its range, views about the
    lobes; weight 0 outside theirs."""
    rng = np.random.default_rng([seed, 3])
    low, high = (float(np.sin(min(t, HALF_PI)) ** 2) for t in light)
    theta_i = np.arcsin(np.sqrt(low + (high - low) * rng.random(directions)))
    drawn = lobes.draw(theta_i, rng)
    return replace(drawn, weight=np.where((drawn.theta_o >= view[0]) & (drawn.theta_o <= view[1]), drawn.weight, 0.0))


def _misplaced(reference: Brdf, candidate: Brdf, drawn: Drawn) -> tuple[Estimate, Estimate, float]:
    """L1, relative L2, and the reference's energy."""
    channels = len(Channels.common(reference.channels, candidate.channels))
    sums = np.zeros((4, drawn.weight.size))  # of each pair over its channels: |g - f|, f, (g - f)^2, f^2
    step = max(_CHUNK // channels, 1)
    with np.errstate(over="ignore", invalid="ignore"):
        for start in range(0, drawn.weight.size, step):
            piece = slice(start, start + step)
            angles = [x[piece] for x in (drawn.theta_i, drawn.theta_o, drawn.delta_phi)]
            f, g = np.broadcast_arrays(*(b.evaluate(*angles) for b in (reference, candidate)))
            e = np.abs(g - f)
            sums[:, piece] = e.sum(axis=1), f.sum(axis=1), (e * e).sum(axis=1), (f * f).sum(axis=1)
        sums[:, drawn.weight == 0] = 0.0  # below the horizon, or not seen: whatever the value there
        total = float(drawn.weight @ sums[1])
        if total < 0:
            mean = total / drawn.weight.size
            raise InputError(
                "negative_energy",
                f"the reference reflects less than nothing: the mean of its weighted draws is {mean:.3g}, so that no "
                "error is relative to it; are marks for missing values left in its data?",
                where="reference",
                got=mean,
                expected="a positive integral",
            )
        l2 = root(ratio(drawn.weight, sums[2], sums[3]))
        return honest_ratio(drawn.weight, sums[0], sums[1]), l2, float(drawn.weight @ sums[3])


def _skipped(
    l1: float,
    energy: float,
    missed: float,
    bias: Mapping[str, list[float]],
    without_log: int,
    without_ratio: int,
    values: int,
) -> list[str]:
    said = []
    if energy == 0:
        said.append("no regular part: L1 and relative L2 have no meaning, the reference is 0 everywhere")
    elif l1 != l1:
        said.append("L1 can't be told: values are not finite, or the reference's energy sums to 0")
    if missed > 0:
        said.append(f"L1 is not known: albedos differ by {missed:.3g} more than the draws found; a lobe was missed")
    dark = [t for t, x in zip(bias["theta_i"], bias["bias"]) if x != x]
    if dark and energy != 0:
        listed = ", ".join(f"{np.degrees(t):.4g}" for t in dark)
        said.append(f"no albedo bias at theta_i = {listed} degrees: the reference reflects nothing there")
    if without_log:
        said.append(f"log rms: {without_log} of {values} values are left out: 1 + f cos theta_i has no logarithm")
    if without_ratio:
        said.append(f"log ratios: {without_ratio} of {values} values are negative or not numbers and are left out")
    return said


def _floor(weight: Float64Array, f: FloatArray) -> float:
    """d = 1e-6 albedo/pi, 0 if there is none: a millionth of the Lambertian of the same mean albedo.

    It keeps values that carry no light from counting in log ratios.
    """
    # sum w f / n estimates pi x mean albedo up to the draws left out; only its magnitude matters here
    return 1e-6 * max(float(weight @ f.mean(axis=1)) / max(weight.size, 1), 0.0) / np.pi**2


def albedo_bias(reference: Brdf, candidate: Brdf) -> dict[str, list[float]]:
    """Relative albedo difference of the regular parts at `BIAS_ANGLES`; of the channels, the largest in magnitude.

    (a' - a)/a, a = int f c_o dwo by quadrature (`Brdf.albedo`); `error` is what the two integrals may be off together,
    relative to a: an estimate with room to spare, not a standard error. Nan where a is not positive.
    """
    theta = np.radians(BIAS_ANGLES)
    found = [_regular_albedo(m, theta) for m in (reference, candidate)]
    a, b, error_a, error_b = np.broadcast_arrays(*(x[0] for x in found), *(x[1] for x in found))
    there = a > 0
    bias = np.divide(b - a, a, out=np.full(a.shape, np.nan), where=there)
    error = np.divide(error_a + error_b, a, out=np.full(a.shape, np.nan), where=there)
    worst = np.where(np.isnan(bias), -1.0, np.abs(bias)).argmax(axis=1)
    row = np.arange(theta.size)
    return {"theta_i": theta.tolist(), "bias": bias[row, worst].tolist(), "error": error[row, worst].tolist()}


def albedo_excess(reference: Brdf, candidate: Brdf) -> float:
    """See `Comparison.albedo_excess`."""
    if not reference.energy_conserving:
        return 0.0
    theta = np.radians([*BIAS_ANGLES, *_HORIZON])
    tolerance = ALBEDO_TOLERANCE if candidate._analytic else DATA_ALBEDO_TOLERANCE
    return max(float(candidate.albedo_error(theta, tolerance=tolerance)[0].max()) - 1, 0.0)


def _regular_albedo(b: Brdf, theta: Float64Array) -> tuple[FloatArray, FloatArray]:
    """Albedo without the delta part at the precision of `Brdf.albedo`, and the estimated error."""
    albedo, error = b.albedo_error(theta, tolerance=ALBEDO_TOLERANCE if b._analytic else DATA_ALBEDO_TOLERANCE)
    return albedo - b.delta_reflectance(theta), error


def delta_difference(reference: Brdf, candidate: Brdf) -> float:
    """Largest |delta_reflectance' - delta_reflectance|, see `Comparison.delta`."""
    if not (reference.has_delta or candidate.has_delta):
        return 0.0
    between = np.random.default_rng(_DELTA_ANGLES).uniform(0, np.pi / 2, _DELTA_ANGLES)
    theta = np.concatenate([np.radians(BIAS_ANGLES), between])
    return float(np.abs(reference.delta_reflectance(theta) - candidate.delta_reflectance(theta)).max())
