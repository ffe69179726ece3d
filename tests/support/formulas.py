"""BRDFs given as Python functions, and the error of an expansion found by evaluating it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from brdfcore.base.brdf import Brdf
from brdfcore.harmonics.expansion import HarmonicExpansion
from brdfcore.harmonics.targets import TARGETS

Values = Callable[[Any, Any, Any], Any]


class Formula(Brdf):
    """f(theta_i, theta_o, delta_phi) of a function, (n,) or (n, channels)."""

    def __init__(self, function: Values, **flags: Any) -> None:
        super().__init__()
        self.function = function
        for name, value in flags.items():
            setattr(self, name, value)

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        out[...] = np.asarray(self.function(theta_i, theta_o, delta_phi)).reshape(theta_i.size, -1)
        return True


def evaluated_error(b: Brdf, h: HarmonicExpansion, strata: int = 48) -> tuple[float, float]:
    """Relative L2 of target and of f by evaluation: one random point in each of strata^3 cells, denser towards the
    horizon and the plane of incidence; nothing in common with projection's nodes. Good to .4 %."""
    cell = np.stack(np.meshgrid(*[np.arange(strata)] * 3, indexing="ij")).reshape(3, -1)
    u = 1 - (cell + np.random.default_rng(1).random(cell.shape)) / strata
    theta_i, theta_o, delta_phi = (top * (1 - a**1.5) for top, a in zip((np.pi / 2, np.pi / 2, np.pi), u))
    c_i, c_o = np.cos(theta_i), np.cos(theta_o)
    weight = np.sqrt(u).prod(axis=0) * np.sin(theta_i) * np.sin(theta_o)
    f, g = (m.evaluate(theta_i, theta_o, delta_phi) for m in (b, h))
    target = TARGETS[h.target]
    of_target = weight * c_i ** (2 * target.cos_i) * c_o ** (2 * target.cos_o)
    square, whole = ((f - g) ** 2).sum(axis=1), (f * f).sum(axis=1)
    in_target, in_f = (float(np.sqrt(w @ square / (w @ whole))) for w in (of_target, weight))
    return in_target, in_f


def lopsided(theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
    return 1 + 0.5 * np.cos(theta_i) + 0.2 * np.sin(theta_o) * np.cos(delta_phi)
