"""Symmetries and other claims of one BRDF, measured: reciprocity, evenness in delta_phi, energy, sign."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.directions import DirectionSet, cosine_pairs, mixture
from brdfcore.metrics.estimators import Estimate, ratio

#: theta_i of the albedo bias and of the energy check, degrees.
BIAS_ANGLES = (0.0, 30.0, 60.0, 80.0, 85.0, 89.0, 89.9)
#: A symmetry of data holds if its L1 defect is below this. Measured materials that were made symmetric have defects of
#: 5e-7 to 1.3e-5 left in their tables; ones that are not reciprocal have .02 and more; the errors asked of a table
#: begin at 1e-3.
FLAG_DEFECT = 1e-4
#: An albedo may pass 1 by this much before energy counts as not conserved: quadrature.
ALBEDO_SLACK = 1e-6
#: Seeded pairs that a defect is measured on.
PAIRS = 4_096


def reciprocity_defect(brdf: Brdf, *, pairs: int = PAIRS, seed: int = 1) -> float:
    """int |f(i,o) - f(o,i)| c_i c_o / int f c_i c_o on seeded cosine-distributed pairs."""
    return _on_cosine_pairs(brdf, pairs, seed, swapped=True).value


def bilateral_defect(brdf: Brdf, *, pairs: int = PAIRS, seed: int = 1) -> float:
    """int |f(dphi) - f(-dphi)| c_i c_o / int f c_i c_o on seeded cosine-distributed pairs."""
    return _on_cosine_pairs(brdf, pairs, seed, swapped=False).value


def symmetry_defects(brdf: Brdf, *, pairs: int = PAIRS, seed: int = 1) -> dict[str, float]:
    """`reciprocity` and `bilateral` defect with their standard errors (`..._stderr`), JSON-ready.

    On cosine-distributed pairs and on pairs around the mirror direction, each set apart; the larger defect counts, as
    either can miss what the other sees.
    """
    drawn = mixture(pairs, seed)
    used = drawn.weight > 0
    lobe = (drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used])
    found: dict[str, float] = {}
    for name, swapped in (("reciprocity", True), ("bilateral", False)):
        ways = (_defect(brdf, *lobe, drawn.weight[used], swapped), _on_cosine_pairs(brdf, pairs, seed, swapped=swapped))
        worst = max(ways, key=lambda e: e.value if e.value == e.value else np.inf)
        found |= {name: worst.value, f"{name}_stderr": worst.stderr}
    return found


def _on_cosine_pairs(brdf: Brdf, pairs: int, seed: int, *, swapped: bool) -> Estimate:
    angles = cosine_pairs(pairs, seed)
    return _defect(brdf, *angles, np.ones(angles[0].size), swapped)


def _defect(
    brdf: Brdf,
    theta_i: npt.NDArray[np.float64],
    theta_o: npt.NDArray[np.float64],
    delta_phi: npt.NDArray[np.float64],
    weight: npt.NDArray[np.float64],
    swapped: bool,
) -> Estimate:
    f = brdf.evaluate(theta_i, theta_o, delta_phi)
    first, second = (theta_o, theta_i) if swapped else (theta_i, theta_o)
    g = brdf.evaluate(first, second, -delta_phi)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite makes the defect nan
        found = ratio(weight, np.abs(f - g).sum(axis=1), np.abs(f).sum(axis=1))
    # nothing anywhere: nothing is asymmetric
    return Estimate(0.0, 0.0) if not f.any() else found


def _conserves(brdf: Brdf) -> bool:
    """Whether no albedo at `BIAS_ANGLES` passes 1: one pass over all, refined where that leaves a doubt."""
    theta = np.radians(BIAS_ANGLES)
    rough, _ = brdf.albedo_error(theta, tolerance=np.inf)
    # one pass over a measured material was found .0145 off at worst
    near = (rough > 0.9).any(axis=1)
    return bool((rough <= 1.1).all() and (brdf.albedo(theta[near]) <= 1 + ALBEDO_SLACK).all())


def measured_flags(brdf: Brdf, *, pairs: int = PAIRS, seed: int = 1) -> dict[str, bool]:
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
