"""What is worth telling of an expansion: errors by degree, where its energy lies, how negative it gets, its size."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.harmonics.expansion import HarmonicExpansion
from brdfcore.harmonics.targets import MERL_BYTES

Float64Array = npt.NDArray[np.float64]


def spectrum(expansion: HarmonicExpansion) -> tuple[Float64Array, Float64Array]:
    """Shares of the expansion's energy by the degree l of the light's side, and by l' of the viewer's, each
    (lmax + 1,): sum over the others of (2-d_m0) rho_ll'm^2, channels together, over all of it; 0 for nothing."""
    found = np.zeros((2, expansion.lmax + 1))
    for m in range(expansion.orders):
        weight = 1.0 if m == 0 else 2.0
        square = (expansion.coefficients(m) ** 2).sum(axis=0)
        if m and not expansion.bilateral:
            square += (expansion.coefficients(m, sines=True) ** 2).sum(axis=0)
        rows, columns = expansion.degrees(m)
        found[0, rows] += weight * square.sum(axis=1)
        found[1, columns] += weight * square.sum(axis=0)
    total = float(found[0].sum())
    light, viewer = found / (total if total > 0 else 1.0)
    return light, viewer


def harmonic_summary(expansion: HarmonicExpansion) -> dict[str, Any]:
    """As plain numbers for JSON, errors relative L2 over pairs of directions (`harmonics.expansion.build_expansion`):

        lmax, target, window, coefficients, bytes, larger_than_merl, bilateral, reciprocal
        truncation, projection, quadrature, factors   {"target", "f"}: of f c c and of f
        error_by_degree          of the target if it ended at degree 0, 1, ..., lmax
        spectrum                 {"light", "viewer"}: shares of the energy by degree
        minimum, maximum, minimum_at   f_r, 1/sr; degrees

    An expansion that was opened from a file says what its report has kept.

    >>> found = bc.harmonic_summary(bc.project(bc.model("lambert"), 8))
    >>> found["coefficients"], found["larger_than_merl"], round(found["minimum"], 6)  # 0.5/pi
    (40, False, 0.159155)
    """
    told = dict(expansion.report.get("harmonics", {}))
    light, viewer = spectrum(expansion)
    return {
        "lmax": expansion.lmax,
        "target": expansion.target,
        "window": told.get("window", {"name": expansion.window}),
        "coefficients": expansion.size,
        "bytes": expansion.nbytes,
        "larger_than_merl": expansion.nbytes > MERL_BYTES,
        "bilateral": bool(expansion.bilateral),
        "reciprocal": bool(expansion.reciprocal),
        **{k: told[k] for k in ("truncation", "projection", "quadrature", "factors", "symmetrised") if k in told},
        "error_by_degree": told.get("by_degree", []),
        "error_by_channel": told.get("by_channel", []),
        "spectrum": {"light": light.tolist(), "viewer": viewer.tolist()},
        **{k: told[k] for k in ("minimum", "maximum", "minimum_at") if k in told},
    }
