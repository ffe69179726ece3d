"""The source as a table will see it: averaged over the symmetries that it is asked to have."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.tables.base.table import BuildOptions

Float64Array = npt.NDArray[np.float64]
#: f_r of (theta_i, theta_o, delta_phi), (n,) each: (n, channels).
Sample = Callable[[Float64Array, Float64Array, Float64Array], Float64Array]


def folds(source: Brdf, options: BuildOptions) -> tuple[bool, bool]:
    """(bilateral, reciprocal) of the table: what the source has, and what was asked for."""
    return source.bilateral or "bilateral" in options.fold, source.reciprocal or "reciprocal" in options.fold


def folded_sample(source: Brdf, bilateral: bool, reciprocal: bool) -> Sample:
    """f_r of `source`, averaged over the symmetries that it has not; `InputError` where it is not finite."""

    def sample(theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.float64]:
        f = source.evaluate(theta_i, theta_o, delta_phi)
        if bilateral and not source.bilateral:
            f = 0.5 * (f + source.evaluate(theta_i, theta_o, -delta_phi))
        if reciprocal and not source.reciprocal:
            g = source.evaluate(theta_o, theta_i, -delta_phi)
            if bilateral and not source.bilateral:
                g = 0.5 * (g + source.evaluate(theta_o, theta_i, delta_phi))
            f = 0.5 * (f + g)
        if not np.isfinite(f).all():
            k = int(np.argwhere(~np.isfinite(f))[0][0])
            degrees = [round(float(np.degrees(a[k])), 6) for a in (theta_i, theta_o, delta_phi)]
            raise InputError(
                "source_not_finite",
                f"the source is not finite at theta_i, theta_o, delta_phi = {degrees} degrees",
                where="source",
                got=degrees,
                expected="finite values",
            )
        return f.astype(np.float64, copy=False)

    return sample
