"""Windows: factors w_l of the coefficients that trade sharpness for less ringing, and what each of them costs.

rho_ll'm becomes w_l w_l' rho_ll'm. With t = l/(lmax+1): none 1; lanczos sin(pi t)/(pi t); hann (1 + cos(pi t))/2;
lanczos2 the square of lanczos.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown
from brdfcore.base.quadrature import composite
from brdfcore.harmonics.legendre import legendre

Float64Array = npt.NDArray[np.float64]

WINDOWS: MappingProxyType[str, Callable[[Float64Array], Float64Array]] = MappingProxyType(
    {
        "none": np.ones_like,
        "lanczos": np.sinc,
        "hann": lambda t: 0.5 * (1 + np.cos(np.pi * t)),
        "lanczos2": lambda t: np.sinc(t) ** 2,
    }
)


def window_named(name: object) -> str:
    """The window's name, "none" for None; `InputError` listing the others."""
    if name is None:
        return "none"
    if not isinstance(name, str) or name not in WINDOWS:
        expected = ", ".join(WINDOWS)
        raise InputError(
            "bad_window",
            f"window = {shown(name)}: expected one of {expected}",
            where="window",
            got=shown(name),
            expected=expected,
        )
    return name


def factors(name: str, lmax: int) -> Float64Array:
    """w_l for l = 0 ... lmax."""
    return WINDOWS[window_named(name)](np.arange(lmax + 1) / (lmax + 1))


def step_response(name: str, lmax: int) -> dict[str, float]:
    """What a window does to a step: 1 on the upper half of the sphere, 0 on the lower, expanded to lmax.

    undershoot: how far the sum goes below 0. l2: relative L2 error over the sphere. Undershoot is the depth of the
    ringing beside an edge of any function, per unit of the edge; l2 is what the edge's blur costs.
    """
    edges = np.cos(np.linspace(np.pi / 2, 0, lmax // 16 + 2))
    x, w = composite(edges, 64)
    p = legendre(lmax, x, first_order=0, last_order=0)
    # zonal: the coefficient of p_l is 2 pi int p_l f dx
    c = 2 * np.pi * (p @ w) * factors(name, lmax)
    signs = (-1.0) ** np.arange(lmax + 1)
    upper, lower = c @ p, (c * signs) @ p
    error = w @ (upper - 1) ** 2 + w @ lower**2
    # the deepest ring is beside the step: within 3 pi/lmax of it
    near = np.linspace(0, min(1.0, 3 * np.pi / (lmax + 1)), 2_001)
    ring = (c * signs) @ legendre(lmax, near, first_order=0, last_order=0)
    return {"undershoot": max(-float(ring.min()), 0.0), "l2": float(np.sqrt(error))}
