"""`project`: an expansion in spherical harmonics with stated errors, of a given degree or the smallest that will do."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.directions import mixture
from brdfcore.base.errors import InputError, LimitError
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.build.local_error import with_uncertainty
from brdfcore.build.tabulate import positive
from brdfcore.harmonics.expansion import HarmonicExpansion, build_expansion, expanded
from brdfcore.harmonics.legendre import checked_degree
from brdfcore.harmonics.projection import projected
from brdfcore.harmonics.rules import lobe_widths
from brdfcore.harmonics.series import MAX_LMAX
from brdfcore.harmonics.spectrum import error_by_degree
from brdfcore.harmonics.targets import Target, count, target_named
from brdfcore.harmonics.windows import window_named
from brdfcore.metrics import compare
from brdfcore.tables.base.table import BuildOptions, Progress, Table

Float64Array = npt.NDArray[np.float64]

#: Degrees that "auto" tries, and the largest expansion it makes.
_TRIED = (16, 32, 64, 128, 256)
#: Error above which an expansion has not resolved the lobe: the fall of its error says nothing yet.
_ROUGH = 0.1
#: Degree for 1 % times the half-width at half maximum of the lobe, radians: GGX's 3.3/m, whose half-width is 1.28 m.
_LOBE = 4.2
#: Fewest and most directions that an expansion's own error is measured on; that many times its bytes take some seconds.
_MEASURED_ON, _AFFORDABLE = (2_000, 200_000), 6e10
#: Directions on which a table is held against the target's norm.
_DIRECTIONS = 50_000


def project(
    b: Brdf,
    lmax: int | Literal["auto"] = 32,
    *,
    tolerance: float | None = None,
    target: str = "f_cos_cos",
    window: str | None = None,
    symmetrise: bool = False,
    progress: Progress | None = None,
) -> HarmonicExpansion:
    """Expand any BRDF in spherical harmonics of both directions.

    Parameters
    ----------
    b : Brdf
        The source. Its delta part is kept apart, never expanded.
    lmax : int or "auto"
        Largest degree, 1 to 1,024; "auto" with a tolerance: the smallest that meets it, up to 256.
    tolerance : float, optional
        Relative L2 error of the target to reach by truncation; for a given lmax, an error if it is not met.
    target : {"f_cos_cos", "f", "f_cos_o"}
        f c_i c_o extended oddly over the horizon, f extended evenly, f c_o.
    window : {"none", "lanczos", "hann", "lanczos2"}, optional
        Factors against ringing; the report says what they cost.
    symmetrise : bool
        Project a source that is not reciprocal on its reciprocal part; the report says how much energy that removes.
    progress : callable(done, total, stage), optional

    Returns
    -------
    HarmonicExpansion
        A `Brdf` and a table: report["harmonics"] holds truncation (Parseval) and quadrature errors in the norm of the
        target and of f, the error by degree, the window's numbers and the smallest value
        (`harmonics.expansion.build_expansion`); `error` is `compare` with the source.

    Raises
    ------
    InputError
        An unknown target or window, no tolerance beside "auto", a source that is not finite.
    LimitError
        A degree or size too large, or a tolerance that no allowed degree meets: it says which degree and how many
        bytes that would take, and which table does it in fewer.

    >>> white = bc.model("lambert", reflectance=0.5)
    >>> h = bc.project(white, 8)  # f c_i c_o is one term, of degree 1 in both directions
    >>> h.evaluate(0.3, 0.2, 1.0).round(6), h.report["harmonics"]["truncation"]["target"] < 1e-6
    (array([0.159155]), True)
    """
    kind, shape, wanted = target_named(target), window_named(window), positive("tolerance", tolerance)
    if lmax == "auto":
        if wanted is None:
            raise InputError("options_exclude", "lmax='auto' needs a tolerance", where="tolerance", expected="a number")
        made = _smallest(b, kind, shape, wanted, symmetrise, progress)
    else:
        degree = checked_degree(lmax, MAX_LMAX)  # refuses other texts
        made = expanded(b, degree, target=target, window=shape, symmetrise=symmetrise, progress=progress)
        found = made.report["harmonics"]["truncation"]["target"]
        if wanted is not None and found > wanted:
            raise LimitError(
                "tolerance_not_met",
                f"lmax = {degree} has an error of {found:.3g}, above the tolerance {wanted:g}; "
                "try lmax='auto', or a larger one",
                where="lmax",
                got=found,
                limit=wanted,
            )
    if progress is not None:
        progress(0, 1, "measuring the error")
    directions = int(np.clip(_AFFORDABLE / made.nbytes, *_MEASURED_ON))
    made.error = {
        **compare(b, made, directions=directions).to_json(),
        "tolerance": wanted,
        "warnings": list(made.report["warnings"]),
    }
    with_uncertainty(made, b)
    if progress is not None:
        progress(1, 1, "measuring the error")
    return made


def _smallest(
    b: Brdf, target: Target, window: str, tolerance: float, symmetrise: bool, progress: Progress | None
) -> HarmonicExpansion:
    """The smallest degree whose expansion as stored meets the tolerance."""
    errors, width = np.ones(1), min(lobe_widths(b))
    for lmax in _TRIED:
        found = projected(b, lmax, target, symmetrise=symmetrise, progress=progress)
        errors = error_by_degree(found.moments)
        if errors[-1] > tolerance:
            # a lobe this narrow won't come down to it: don't spend what the last degrees take
            if lmax >= 64 and errors[-1] > _ROUGH and _LOBE / width > 16 * _TRIED[-1]:
                break
            continue
        low, high = max(int(np.argmax(errors <= tolerance)), 1), lmax
        # a window and dropped directions add to the truncation: the first degree whose expansion meets it
        while low < high:
            middle = (low + high) // 2
            if _stated(build_expansion(b, found.truncated(middle), window)) <= tolerance:
                high = middle
            else:
                low = middle + 1
        made = build_expansion(b, found.truncated(low), window)
        if _stated(made) <= tolerance:
            return made
    raise _refusal(b, target, errors, width, tolerance, symmetrise)


def _stated(made: HarmonicExpansion) -> float:
    return float(made.report["harmonics"]["truncation"]["target"])


def _expected_degree(errors: Float64Array, width: float, tolerance: float) -> tuple[float, str]:
    """The degree that would meet the tolerance, and what says so: the error's last octave, continued as a power of the
    degree, or where it has not begun to fall like one, the width of the lobe."""
    last = errors.size - 1
    if errors[last] > _ROUGH:
        return _LOBE / width, "judged by the width of its lobe (for 1 %)"
    slope = float(np.log(max(errors[last], 1e-300) / max(errors[max(last // 2, 1)], 1e-300)) / np.log(2))
    degree = float("inf") if slope > -0.05 else float(last * (errors[last] / tolerance) ** (-1 / slope))
    return degree, "judged by its fall over the last octave"


def _refusal(
    b: Brdf, target: Target, errors: Float64Array, width: float, tolerance: float, symmetrise: bool
) -> LimitError:
    last = errors.size - 1
    need, why = _expected_degree(errors, width, tolerance)
    size: float | None = None
    told = "and it falls too slowly for any degree"
    if need < 1e6:
        need = max(need, last + 1)
        size = 8 * _entries(int(np.ceil(need)), target, b, symmetrise) * len(b.channels)
        told = f"a degree of about {need:.0f} would meet it, {size:.3g} bytes of coefficients, {why}"
    table = _table_within(b, target, tolerance)
    instead = (
        f"; half_difference does it in {table[0].nbytes} bytes (relative L2 {table[1]:.3g} in the same norm)"
        if table is not None and table[1] <= tolerance
        else f"; half_difference of {table[0].nbytes} bytes has {table[1]:.3g} in the same norm"
        if table is not None
        else ""
    )
    return LimitError(
        "tolerance_not_met",
        f"no degree up to {last} has an error of {tolerance:g}: at {last} it is {errors[-1]:.3g}, {told}{instead}",
        where="tolerance",
        got=tolerance,
        limit=float(errors[-1]),
        degree=None if need >= 1e6 else int(np.ceil(need)),
        bytes=size,
        table=None if table is None else {"representation": table[0].name, "bytes": table[0].nbytes, "error": table[1]},
    )


def _entries(lmax: int, target: Target, b: Brdf, symmetrise: bool) -> float:
    """Coefficients a channel: exact for degrees that could be listed, by the leading power beyond."""
    symmetric = target.symmetric and (b.reciprocal or symmetrise)
    if lmax <= 4_096:
        return float(count(lmax, target, b.bilateral, symmetric))
    return float(count(4_096, target, b.bilateral, symmetric)) * (lmax / 4_096) ** 3


def _table_within(b: Brdf, target: Target, tolerance: float) -> tuple[Table, float] | None:
    """The smallest half_difference table within the tolerance of the target's norm, or the best, and its error."""
    cls: Any = REPRESENTATIONS.load("half_difference")
    best: tuple[Table, float] | None = None
    for options in cls.candidates(b, BuildOptions(), None):
        table = cls.build(b, options)
        error = norm_distance(b, table, target)
        if best is None or error < best[1]:
            best = (table, error)
        if error <= tolerance:
            break
    return best


def norm_distance(
    reference: Brdf, candidate: Brdf, target: Target, *, directions: int = _DIRECTIONS, seed: int = 20_261_122
) -> float:
    """Relative L2 distance in the norm of the target, sqrt(int (g'-g)^2 / int g^2) over dw_i dw_o, by draws about the
    lobe and the hemisphere (`directions.mixture`)."""
    drawn = mixture(directions, seed)
    used = drawn.weight > 0
    angles = drawn.theta_i[used], drawn.theta_o[used], drawn.delta_phi[used]
    c_i, c_o = np.cos(angles[0]), np.cos(angles[1])
    # the draws' weights are c_i c_o over their density
    weight = drawn.weight[used] * c_i ** (2 * target.cos_i - 1) * c_o ** (2 * target.cos_o - 1)
    f, g = (x.evaluate(*angles) for x in (reference, candidate))
    total = float(weight @ (f * f).sum(axis=1))
    return float(np.sqrt(float(weight @ ((g - f) ** 2).sum(axis=1)) / total)) if total > 0 else 0.0
