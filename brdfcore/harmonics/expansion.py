"""The representation in spherical harmonics, made of any BRDF: projected, windowed, factored; errors stated apart."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter
from brdfcore.harmonics.factors import factored
from brdfcore.harmonics.grids import grid_values
from brdfcore.harmonics.legendre import checked_degree
from brdfcore.harmonics.projection import Projected, projected
from brdfcore.harmonics.series import MAX_LMAX, Series, packed_arrays
from brdfcore.harmonics.spectrum import distance, error_by_degree, target_error, value_error
from brdfcore.harmonics.targets import MERL_BYTES, TARGETS, degrees_of
from brdfcore.harmonics.windows import factors as window_factors
from brdfcore.harmonics.windows import step_response
from brdfcore.metrics import ALBEDO_SLACK
from brdfcore.tables.base.table import BuildOptions, Progress, sampled_delta

#: Degree of `tabulate` without a shape.
DEFAULT_LMAX = 32
#: Directions dropped from an order may cost this part of the truncation error, in quadrature 0.5 % of it.
FACTOR_SHARE = 0.1
#: ... and this part of the norm of what is kept: where a narrow lobe leaves most of the target out, the truncation
#: error is no measure of what may be dropped of the rest.
_KEPT_SHARE = 0.01
#: float32 where its rounding, 3e-8, is below a thousandth of the truncation error.
_SINGLE_FROM = 3e-5
_ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)


class HarmonicExpansion(Series):
    """An expansion of f_r to degree `lmax`; what it leaves out rings, and may be negative.

    `report["harmonics"]` holds what `build_expansion` measured. Coefficients and arrays: `Series`.

    >>> h = bc.project(bc.model("lambert", reflectance=0.5), 8)
    >>> h.lmax, h.target, h.packed
    (8, 'f_cos_cos', True)
    """

    name = "harmonic"
    SUMMARY = "spherical harmonics of both directions, truncated at a degree; error by Parseval"
    PARAMETERS = (Parameter("shape", "", "the largest degree, one number", "32", kind="text"),)
    FOR_AUTO = False

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """`expanded` with options.shape = (lmax,), f_cos_cos, no window."""
        if options.interpolation != "linear" or options.negatives != "keep":
            raise InputError(
                "bad_option",
                "harmonic: a sum of smooth functions takes no interpolation between nodes and keeps what is negative",
                where="interpolation" if options.interpolation != "linear" else "negatives",
            )
        shape = options.shape or (DEFAULT_LMAX,)
        if len(shape) != 1:
            raise InputError(
                "bad_shape", f"shape = {list(shape)}: expected one number, the degree", where="shape", got=list(shape)
            )
        symmetrise = "reciprocal" in options.fold
        folded = "bilateral" in options.fold
        return cls._of(expanded(source, shape[0], symmetrise=symmetrise, bilateral=folded, progress=progress))

    @classmethod
    def _of(cls, made: HarmonicExpansion) -> Self:
        assert isinstance(made, cls)
        return made


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
