"""Is this a BRDF? Energy, reciprocity, positivity, bilateral symmetry, the pole and the horizon, in albedo units."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.check import limits
from brdfcore.analysis.check.findings import CheckReport, Finding, Verdict, Worst
from brdfcore.analysis.check.pairs import Sums, misplaced
from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray
from brdfcore.metrics import ALBEDO_SLACK, FLAG_DEFECT

Float64Array = npt.NDArray[np.float64]

#: theta_i of the energy check, degrees.
ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 83.0, 85.0, 87.0, 88.0, 89.0, 89.5, 89.9)
#: Amounts, in albedo units, above which a check fails whatever the entry declares, and why there.
FAILS_ABOVE = {
    "energy": (0.01, "reflectances are measured to about 1 %; more is light from nowhere"),
    "reciprocity": (0.1, "ten measured materials of the RGL database reach .084"),
    "positivity": (0.001, "noise about zero stays below it; more shows as black spots"),
    "bilateral": (0.01, "only chiral surfaces lack it; a measurement turned by a degree reaches it"),
    "normal": (0.1, "azimuth has no meaning at the normal; ten measured materials of the RGL database reach .062"),
}
#: Power of 1/cos with which f cos may grow towards 90 degrees: over three decades a bounded one appears as less.
BOUNDED = 0.05
#: Standard errors by which a random estimate has to pass a threshold.
SIGMAS = 3.0


def check(b: Brdf, *, directions: int = 100_000, seed: int = 20_261_122) -> CheckReport:
    """Every check of any BRDF, on one page: `print(bc.check(b))`.

    energy       albedo <= 1, the delta part included, at 15 angles up to 89.9 degrees.
    reciprocity  int |f(i,o) - f(o,i)| c_i c_o dwi dwo / pi.
    positivity   int max(-f, 0) c_i c_o dwi dwo / pi, values that are not finite, and a delta part below 0.
    bilateral    int |f(delta_phi) - f(-delta_phi)| c_i c_o dwi dwo / pi.
    normal       f at theta_i = 0 and at theta_o = 0 against its mean over delta_phi, int |f - mean| c dw.
    horizon      finite at 90 degrees; f cos_o bounded as theta_o -> 90, f cos_i as theta_i -> 90 degrees.

    The integrals over pairs are estimated on `directions` seeded draws of `directions.mixture`, with standard errors;
    each amount is a reflectance, of the worst channel: what of uniform light goes, or would go, where it should not.
    An entry is held to what it declares (`FLAG_DEFECT`, relative, for a symmetry), and to `FAILS_ABOVE` in any case.

    Raises `InputError` if `directions` or `seed` is no whole number in range.

    >>> found = bc.check(bc.model("lambert", reflectance=0.5))
    >>> [f.name for f in found.findings if f.verdict != "pass"], found.findings[0].says
    ([], 'largest albedo 0.5, margin 0.5')
    """
    draws: dict[str, Any] = {"directions": directions, "seed": seed}
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is a finding, not a warning
        energy, albedo = _energy(b)
        pairs = [_reciprocity(b, draws), _positivity(b, draws), _bilateral(b, draws)]
        findings = [energy, *pairs, _normal(b), _horizon(b)]
    return CheckReport(findings, b.channels, albedo, int(directions), int(seed))


# ---- one check each -----------------------------------------------------------------------------


def _energy(b: Brdf) -> tuple[Finding, float]:
    """The finding, and the mean albedo of the channels for uniform light."""
    theta = np.radians(ENERGY_ANGLES)
    albedo, error = b.albedo_error(theta, tolerance=1e-3)
    unsure = (np.abs(albedo - 1) <= 2 * error).any(axis=1)
    if unsure.any():  # on which side of 1
        albedo[unsure], error[unsure] = b.albedo_error(theta[unsure], tolerance=1e-6, budget=2_000_000)
    excess = albedo - 1
    past = (~(excess <= error + ALBEDO_SLACK)).any(axis=1)
    ranked = np.where(np.isfinite(excess), excess, np.inf)
    labels, best = b.channels.labels(), ranked.argmax(axis=1)
    k = int(ranked.max(axis=1).argmax())
    value, doubt = float(excess[k, best[k]]), float(error[k, best[k]])
    limit, because = FAILS_ABOVE["energy"]
    holds = not past.any()
    fails = not holds and (b.energy_conserving or not value - doubt <= limit)
    if not np.isfinite(value):
        says = "the albedo is not finite"
    elif holds:
        says = f"largest albedo {1 + value:.6g}, margin {max(-value, 0.0):.2g}"
    else:
        first = np.array(ENERGY_ANGLES)[past].min()
        says = f"albedo {1 + value:.5g}: more light than arrives, from theta_i = {first:g} on"
        says += ", though declared not to" if b.energy_conserving else ""
    order = np.argsort(-ranked.max(axis=1), kind="stable")[: 1 if holds else 3]
    worst = [
        Worst(ENERGY_ANGLES[j], None, None, labels[best[j]], f"{labels[best[j]]}: albedo {albedo[j, best[j]]:.5f}")
        for j in order.tolist()
    ]
    verdict: Verdict = "fail" if fails else "pass" if holds else "note"
    finding = Finding(
        "energy", verdict, value, doubt, ranked.max(axis=0).tolist(), None, b.energy_conserving, holds, limit, because,
        says, worst,
    )  # fmt: skip
    # light of the cosine-weighted hemisphere: d(sin^2 theta_i)
    shares = np.sin(theta) ** 2 / np.sin(theta[-1]) ** 2
    return finding, float(np.trapezoid(albedo.mean(axis=1), shares))


def _reciprocity(b: Brdf, draws: dict[str, Any]) -> Finding:
    def quantity(f: FloatArray, i: Float64Array, o: Float64Array, d: Float64Array) -> tuple[FloatArray, FloatArray]:
        g = b.evaluate(o, i, -d)
        return np.abs(f - g), g

    sums = misplaced(b, quantity, "f(i,o) = {f}, f(o,i) = {g}", **draws)
    return _symmetry("reciprocity", sums, b.reciprocal, "with the directions exchanged")


def _bilateral(b: Brdf, draws: dict[str, Any]) -> Finding:
    def quantity(f: FloatArray, i: Float64Array, o: Float64Array, d: Float64Array) -> tuple[FloatArray, FloatArray]:
        g = b.evaluate(i, o, -d)
        return np.abs(f - g), g

    sums = misplaced(b, quantity, "f = {f}, at -delta_phi {g}", **draws)
    return _symmetry("bilateral", sums, b.bilateral, "on the other side of the plane of incidence")


def _symmetry(name: str, sums: Sums, declared: bool, words: str) -> Finding:
    limit, because = FAILS_ABOVE[name]
    c = int(sums.mean.argmax())
    value, error = float(sums.mean[c]), float(sums.error[c])
    relative = _largest(sums.relative)
    holds = relative <= FLAG_DEFECT
    fails = value - SIGMAS * error > limit or (declared and not holds)
    if value == 0:
        says = f"no value differs {words}"
    else:
        says = f"{_share(relative)} of the reflected light differs {words}"
        says += ", though declared the same" if declared and not holds else ""
    verdict: Verdict = "fail" if fails else "pass" if holds else "note"
    return Finding(
        name, verdict, value, error, sums.mean.tolist(), relative, declared, holds, limit, because, says,
        [] if holds else sums.worst,
    )  # fmt: skip


def _positivity(b: Brdf, draws: dict[str, Any]) -> Finding:
    def quantity(f: FloatArray, *_: Float64Array) -> tuple[FloatArray, FloatArray]:
        return np.maximum(-f, 0.0), f

    sums = misplaced(b, quantity, "f = {f}", **draws)
    least = float(b.delta_reflectance(np.radians(np.arange(0.0, 90.1, 2.5))).min()) if b.has_delta else 0.0
    limit, because = FAILS_ABOVE["positivity"]
    c = int(sums.mean.argmax())
    value, error = float(sums.mean[c]), float(sums.error[c])
    holds = sums.count == 0 and sums.not_finite == 0 and least >= 0
    fails = value - SIGMAS * error > limit or sums.not_finite > 0 or not least >= 0 or (b.non_negative and not holds)
    said = []
    if sums.not_finite:
        said.append(f"{sums.not_finite} of {sums.values} values are not finite")
    if not least >= 0:
        said.append(f"the mirror part goes down to {least:.3g}")
    if sums.count:
        said.append(
            f"{_share(sums.count / sums.values)} of the values are negative"
            + (", though declared not to be" if b.non_negative else "")
        )
    verdict: Verdict = "fail" if fails else "pass" if holds else "note"
    return Finding(
        "positivity", verdict, value, error, sums.mean.tolist(), _largest(sums.relative), b.non_negative, holds, limit,
        because, "; ".join(said) or "no value is negative, every one is finite", sums.worst,
    )  # fmt: skip


def _normal(b: Brdf) -> Finding:
    value, error, worst = limits.azimuth_dependence(b)
    limit, because = FAILS_ABOVE["normal"]
    c = int(value.argmax())
    largest = float(value[c])
    holds = largest <= ALBEDO_SLACK
    if holds:
        says = "at the normal, values do not depend on delta_phi"
    else:
        says = "at the normal, values depend on delta_phi, which has no meaning there"
    verdict: Verdict = "fail" if not largest <= limit else "pass" if holds else "note"
    return Finding(
        "normal", verdict, largest, float(error[c]), value.tolist(), None, None, holds, limit, because, says,
        [] if holds else worst,
    )  # fmt: skip


def _horizon(b: Brdf) -> Finding:
    growth = limits.horizon(b)
    because = "f cos may not grow towards 90 degrees, and every value there is finite"
    holds = growth.not_finite == 0 and growth.power <= BOUNDED
    if growth.not_finite:
        says = f"{growth.not_finite} values at 90 degrees are not finite"
    elif not holds:
        says = f"f cos grows without bound towards 90 degrees, as 1/cos^{growth.power:.2g}"
    else:
        says = "f cos stays bounded; the amount is what leaves within a degree of the horizon"
    return Finding(
        "horizon", "pass" if holds else "fail", float(growth.last_degree.max()), growth.error,
        growth.last_degree.tolist(), None, None, holds, None, because, says, growth.worst,
    )  # fmt: skip


def _largest(relative: Float64Array) -> float:
    """The largest, leaving out channels that reflect nothing."""
    return float(np.nan_to_num(relative, nan=0.0).max())


def _share(part: float) -> str:
    return f"{100 * part:.2g} %"
