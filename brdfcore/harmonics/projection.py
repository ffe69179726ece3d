"""Project a BRDF: sampled on two rules, the finer refined while quadrature counts beside truncation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError, LimitError
from brdfcore.harmonics.moments import Moments, Progress, moments
from brdfcore.harmonics.rules import Rule, lobe_widths, rule_for
from brdfcore.harmonics.spectrum import distance, target_error
from brdfcore.harmonics.targets import Target, blocks, count

Float64Array = npt.NDArray[np.float64]

#: Coefficients of all channels at which a projection is refused, bytes as float64.
MAX_BYTES = 2_000_000_000
#: Evaluations of the material on the first rule at which it is refused: minutes.
MAX_EVALUATIONS = 1_000_000_000
#: Quadrature is refined while its error is above this part of the truncation error (in quadrature: 0.1 % of it), ...
_QUADRATURE_SHARE = 0.05
#: and while the two rules' truncation errors differ by more than this part, ...
_TRUNCATION_SHARE, _PARSEVAL_FLOOR = 0.01, 3e-8
#: ... or until it is rounding, or a refinement would take more evaluations than this a degree cubed.
_QUADRATURE_FLOOR, _EVALUATIONS = 1e-9, 60.0


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
    if rule.evaluations > MAX_EVALUATIONS:
        raise LimitError(
            "too_much_work",
            f"lmax = {lmax} takes some {rule.evaluations:.1g} evaluations of the material and more than {size} bytes; "
            f"the limit is {MAX_EVALUATIONS:.0e} evaluations: a table holds a lobe this sharp in less",
            where="lmax",
            got=rule.evaluations,
            limit=MAX_EVALUATIONS,
        )
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
