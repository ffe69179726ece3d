"""Make an expansion of a BRDF: sample, project, factor, and state every error apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError, LimitError
from brdfcore.harmonics.expansion import MAX_LMAX, HarmonicExpansion, packed_arrays
from brdfcore.harmonics.factors import factored
from brdfcore.harmonics.grids import grid_values
from brdfcore.harmonics.legendre import checked_degree
from brdfcore.harmonics.moments import Moments, Progress, moments
from brdfcore.harmonics.rules import Rule, lobe_widths, rule_for
from brdfcore.harmonics.spectrum import distance, error_by_degree, target_error, value_error
from brdfcore.harmonics.targets import MERL_BYTES, TARGETS, Target, blocks, count, degrees_of
from brdfcore.harmonics.windows import factors as window_factors
from brdfcore.harmonics.windows import step_response
from brdfcore.metrics import ALBEDO_SLACK
from brdfcore.tables.base.table import sampled_delta

Float64Array = npt.NDArray[np.float64]

#: Coefficients of all channels at which a projection is refused, bytes as float64.
MAX_BYTES = 2_000_000_000
#: Directions dropped from an order may cost this part of the truncation error, in quadrature 0.5 % of it.
FACTOR_SHARE = 0.1
#: ... and this part of the norm of what is kept: where a narrow lobe leaves most of the target out, the truncation
#: error is no measure of what may be dropped of the rest.
_KEPT_SHARE = 0.01
#: Quadrature is refined while its error is above this part of the truncation error (in quadrature: 0.1 % of it), ...
_QUADRATURE_SHARE = 0.05
#: and while the two rules' truncation errors differ by more than this part, ...
_TRUNCATION_SHARE, _PARSEVAL_FLOOR = 0.01, 3e-8
#: ... or until it is rounding, or a refinement would take more evaluations than this a degree cubed.
_QUADRATURE_FLOOR, _EVALUATIONS = 1e-9, 60.0
#: float32 where its rounding, 3e-8, is below a thousandth of the truncation error.
_SINGLE_FROM = 3e-5
_ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)


@dataclass
class Projected:
    """Moments on the finer rule, the coefficients on the coarser, and what symmetry took out.

    removed: energy of the part that was not reciprocal, relative; None where nothing was asked or needed.
    truncation_apart: difference of the truncation errors that the two rules find.
    """

    moments: Moments
    coarse: list[Float64Array]
    coarse_energy: Float64Array
    rule: Rule
    removed: float | None
    symmetric: bool
    truncation_apart: float = 0.0

    def truncated(self, lmax: int) -> Projected:
        """The same, ended at a lower degree."""
        kept = blocks(lmax, self.moments.target, self.moments.bilateral)
        places = {(b.m, b.sine): k for k, b in enumerate(self.moments.blocks)}

        def cut(source: list[Float64Array]) -> list[Float64Array]:
            return [source[places[b.m, b.sine]][:, : b.rows, : b.columns] for b in kept]

        m = self.moments
        rho = cut(m.rho)
        cross = rho if m.cross is m.rho else cut(m.cross)
        return replace(self, moments=replace(m, lmax=lmax, blocks=kept, rho=rho, cross=cross), coarse=cut(self.coarse))


def projected(
    b: Brdf,
    lmax: int,
    target: Target,
    *,
    symmetrise: bool = False,
    bilateral: bool = False,
    progress: Progress | None = None,
) -> Projected:
    """Coefficients to degree lmax on two rules; the finer is refined while quadrature counts beside truncation."""
    symmetric = target.symmetric and (b.reciprocal or symmetrise)
    if symmetrise and not target.symmetric:
        raise InputError(
            "bad_target", f"symmetrise: the target {target.name} is not symmetric in its directions", where="target"
        )
    size = count(lmax, target, b.bilateral, symmetric) * len(b.channels) * 8
    if size > MAX_BYTES:
        raise LimitError(
            "expansion_too_large",
            f"lmax = {lmax} needs {size} bytes of coefficients; the limit is {MAX_BYTES}",
            where="lmax",
            got=size,
            limit=MAX_BYTES,
        )
    rule = rule_for(b, lmax)
    while True:
        fine, coarse = moments(b, target, rule, progress), moments(b, target, rule.coarser(), None)
        if bilateral and not b.bilateral:
            fine, coarse = _even(fine), _even(coarse)
        removed = _symmetrised(fine, coarse) if symmetric else None
        found = Projected(fine, coarse.rho, coarse.energy, rule, removed if symmetrise else None, symmetric)
        error = distance(fine, fine.rho, coarse.rho)[0]
        truncation = _truncation(fine)
        apart = abs(_truncation(coarse) - truncation)
        if error <= max(_QUADRATURE_SHARE * truncation, _QUADRATURE_FLOOR) and apart <= max(
            _TRUNCATION_SHARE * truncation, _PARSEVAL_FLOOR
        ):
            return replace(found, truncation_apart=apart)
        mirror, retro = lobe_widths(b)
        finer = rule.finer() if rule.graded else replace(rule, width=min(mirror, 0.1), retro=min(retro, 1.0))
        if finer.evaluations > max(_EVALUATIONS * lmax**3, 8e6):
            return replace(found, truncation_apart=apart)
        rule = finer


def _truncation(found: Moments) -> float:
    total = float(found.energy.sum())
    return float(np.sqrt(target_error(found).sum() / total)) if total > 0 else 0.0


def _even(found: Moments) -> Moments:
    """Cosines only: the part that is bilateral; the energy of sines is part of the error then."""
    kept = sum(not b.sine for b in found.blocks)
    rho, cross = found.rho[:kept], found.cross[:kept]
    cross = rho if found.cross is found.rho else cross
    return replace(found, bilateral=True, blocks=found.blocks[:kept], rho=rho, cross=cross)


def _symmetrised(*all_found: Moments) -> float:
    """Make cosines symmetric and sines antisymmetric, in place; the energy removed from the first, relative."""
    removed = 0.0
    for k, found in enumerate(all_found):
        for place, block in enumerate(found.blocks):
            r, sign = found.rho[place], -1.0 if block.sine else 1.0
            half = 0.5 * (r - sign * r.transpose(0, 2, 1))
            if k == 0:
                removed += block.weight * float((half * half).sum())
            found.rho[place] = r - half
            if found.cross is not found.rho:
                t = found.cross[place]
                found.cross[place] = 0.5 * (t + sign * t.transpose(0, 2, 1))
    total = float(all_found[0].energy.sum())
    return removed / total if total > 0 else 0.0


def expanded(
    b: Brdf,
    lmax: int,
    *,
    target: str = "f_cos_cos",
    window: str = "none",
    symmetrise: bool = False,
    bilateral: bool = False,
    progress: Progress | None = None,
) -> HarmonicExpansion:
    """The expansion of `b` to degree lmax; `build_expansion` says what its report holds."""
    lmax = checked_degree(lmax, MAX_LMAX)
    if lmax < 1:
        raise InputError("bad_lmax", "lmax = 0: expected at least 1", where="lmax", got=0)
    found = projected(b, lmax, TARGETS[target], symmetrise=symmetrise, bilateral=bilateral, progress=progress)
    return build_expansion(b, found, window)


def build_expansion(b: Brdf, found: Projected, window: str) -> HarmonicExpansion:
    """Window, factor and store what `projected` found.

    report["harmonics"], errors relative L2 over pairs of directions, channels together, of the target and of f:

        truncation    of the expansion as stored, window and factors included, by Parseval
        quadrature    distance from the coefficients of a coarser rule: an upper estimate of what sampling did to them;
                      `truncation` how far the truncation errors of the two rules are apart, `energy` their ||target||^2
        projection    truncation without window and factors; factors: what dropped directions cost
        by_degree     truncation if it ended at degree 0, 1, ..., lmax; by_channel: truncation of each channel's target
    """
    m = found.moments
    target, lmax = m.target, m.lmax
    w = window_factors(window, lmax)
    windowed = []
    for block, r in zip(m.blocks, m.rho):
        rows, columns = degrees_of(block, lmax, target)
        windowed.append(r * w[rows][:, None] * w[columns][None, :])
    total, total_f = (float(x) if x > 0 else 1.0 for x in (m.energy.sum(), m.energy_f.sum()))
    packed = found.symmetric and m.bilateral
    plain = float(target_error(m).sum())
    # sines and cosines that mirror each other would not through bases found for each side
    budget = 0.0 if found.symmetric and not packed else FACTOR_SHARE**2 * float(target_error(m, windowed).sum())
    held = sum(block.weight * float((r * r).sum()) for block, r in zip(m.blocks, windowed))
    budget = min(budget, _KEPT_SHARE**2 * held)
    if budget < _SINGLE_FROM**2 * FACTOR_SHARE**2 * total:
        budget = 0.0  # principal directions of squares are good to half of float64's digits
    orders = factored(m.blocks, windowed, budget, packed)
    dtype = np.float32 if plain > _SINGLE_FROM**2 * total else np.float64
    arrays = packed_arrays(orders, packed, dtype)
    flags = {
        "bilateral": m.bilateral,
        "reciprocal": found.symmetric,
        "energy_conserving": False,
        "non_negative": False,
    }
    made = HarmonicExpansion(arrays, lmax, target.name, window, packed, b.channels, flags, sampled_delta(b))
    kept = [made.coefficients(block.m, sines=block.sine) for block in m.blocks]
    quadrature, quadrature_f = distance(m, m.rho, found.coarse)
    energies = (m.energy, np.where(found.coarse_energy > 0, found.coarse_energy, 1.0))
    smallest, largest, at = _extremes(made)
    stated: dict[str, Any] = {
        "lmax": lmax,
        "target": target.name,
        "window": {"name": window, **({} if window == "none" else step_response(window, lmax))},
        "coefficients": made.size,
        "truncation": {
            "target": float(np.sqrt(target_error(m, kept).sum() / total)),
            "f": float(np.sqrt(value_error(m, kept).sum() / total_f)),
        },
        "projection": {
            "target": float(np.sqrt(plain / total)),
            "f": float(np.sqrt(value_error(m).sum() / total_f)),
        },
        "quadrature": {
            "target": quadrature,
            "f": quadrature_f,
            "truncation": found.truncation_apart,
            "energy": abs(float(energies[1].sum()) / float(energies[0].sum() or 1.0) - 1.0) if plain or total else 0.0,
            "evaluations": found.rule.evaluations,
            "graded": found.rule.graded,
        },
        "factors": {"target": distance(m, windowed, kept)[0], "ranks": int(arrays["ranks"].sum())},
        "by_degree": error_by_degree(m).tolist(),
        "by_channel": np.sqrt(target_error(m, kept) / np.where(m.energy > 0, m.energy, 1.0)).tolist(),
        "minimum": smallest,
        "maximum": largest,
        "minimum_at": at,
    }
    if found.removed is not None:
        stated["symmetrised"] = {"energy_removed": found.removed}
    done = [*b.report.get("done", [])]
    said = [*b.report.get("warnings", [])]
    if found.removed is not None:
        done.append(f"projected on the reciprocal part, as asked: {100 * found.removed:.3g} % of the energy removed")
    if made.nbytes > MERL_BYTES:
        said.append(f"{made.nbytes} bytes: larger than a MERL file ({MERL_BYTES})")
    made.report = {**b.report, "done": done, "warnings": said, "harmonics": stated}
    made.source = dict(getattr(b, "source", {}) or {"name": "", "format": "", "sha256": ""})
    made.metadata = dict(b.metadata)
    # a margin, as the smallest value was looked for at some points only
    made.non_negative = smallest > 0.01 * max(largest, 0.0)
    if b.energy_conserving:
        albedo = made.albedo(np.radians(_ENERGY_ANGLES))
        made.energy_conserving = bool((albedo <= 1 + ALBEDO_SLACK).all())
    return made


def _extremes(made: HarmonicExpansion) -> tuple[float, float, list[float]]:
    """Smallest and largest value on a grid about as fine as the waves, and where the smallest is, degrees."""
    n = int(np.clip(made.lmax, 24, 64))
    theta = np.linspace(0, np.pi / 2, n)
    phi = np.linspace(0, np.pi if made.bilateral else 2 * np.pi, n)
    f = grid_values(made, theta, theta, phi)
    k = np.unravel_index(int(f.argmin()), f.shape)
    at = [float(np.degrees(x)) for x in (theta[k[0]], theta[k[1]], phi[k[2]])]
    return float(f.min()), float(f.max()), at
