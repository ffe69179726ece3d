"""What one light direction sends into the hemisphere, as coefficients: f or f c_o over wo at a fixed theta_i.

    g(theta_o, delta_phi) = sum_(m>=0) (2-d_m0) sum_l (a_lm cos m delta_phi + b_lm sin m delta_phi) p_l^m(c_o)

with l + m odd for f c_o, even for f. The plain projection of a curve and its ringing, without the second direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown
from brdfcore.base.quadrature import gauss_legendre
from brdfcore.harmonics.legendre import checked_degree, degrees, legendre, order_offset
from brdfcore.harmonics.rules import Rule, rule_for
from brdfcore.harmonics.series import MAX_LMAX
from brdfcore.harmonics.targets import TARGETS, Target
from brdfcore.harmonics.windows import factors, window_named

Float64Array = npt.NDArray[np.float64]

#: The names a slice knows its targets by, and their functions of theta_o.
SLICE_TARGETS = {"f": TARGETS["f"], "f_cos_o": TARGETS["f_cos_o"]}


@dataclass(frozen=True)
class SliceExpansion:
    """Coefficients of one slice.

    theta_i       radians.
    cosines, sines   float64 (lmax + 1, lmax + 1, channels): a_lm at [l, m] and b_lm, 0 where a function is not used.
    truncation    {"target", "f"}: relative L2 error over the hemisphere, channels together, of the target and of f.
    quadrature    distance from the coefficients of a coarser rule, relative: what sampling did to them, from above.
    """

    theta_i: float
    lmax: int
    target: str
    window: str
    channels: Channels
    cosines: Float64Array
    sines: Float64Array
    truncation: dict[str, float]
    quadrature: float

    def evaluate(self, theta_o: npt.ArrayLike, delta_phi: npt.ArrayLike) -> Float64Array:
        """f_r of the expansion (the target divided by its cosine), broadcast shape + (channels,)."""
        theta, phi = np.broadcast_arrays(np.asarray(theta_o, np.float64), np.asarray(delta_phi, np.float64))
        found = _summed(self, np.cos(theta).reshape(-1), over_x=True)
        m = np.arange(self.lmax + 1)
        angle = m[:, None] * phi.reshape(-1)
        values = np.einsum("mnc,mn->nc", found[0], np.cos(angle)) + np.einsum("mnc,mn->nc", found[1], np.sin(angle))
        return np.asarray(values.reshape(*theta.shape, -1))


def project_slice(
    b: Brdf, theta_i: float, lmax: int = 32, *, target: str = "f_cos_o", window: str | None = None
) -> SliceExpansion:
    """Expand what `b` reflects from theta_i (radians) to degree lmax: f c_o ("f_cos_o") or f ("f").

    Raises `InputError` for an angle outside [0, pi/2] or another target, `LimitError` for a degree too large.

    >>> one = bc.project_slice(bc.model("lambert", reflectance=0.5), 0.3, 8)
    >>> round(float(one.cosines[1, 0, 0]), 6), one.truncation["target"] < 1e-6  # (rho/pi) sqrt(pi/3), degree 1 alone
    (0.325735, True)
    """
    lmax = checked_degree(lmax, MAX_LMAX)
    if target not in SLICE_TARGETS:
        raise InputError(
            "bad_target", f"target = {shown(target)}: expected f or f_cos_o", where="target", got=shown(target)
        )
    name = window_named(window)
    light = np.asarray(theta_i, dtype=np.float64)
    if light.ndim:
        raise InputError("bad_angle", "theta_i: a slice has one angle", where="theta_i", got=list(light.shape))
    b.evaluate(light, 0.0, 0.0)  # refuses an angle outside the domain
    rule, kind = rule_for(b, max(lmax, 1)), SLICE_TARGETS[target]
    sampled = [_projected(b, float(light), lmax, kind, r) for r in (rule.finer(), rule)]
    (cosines, sines, sums), coarse = sampled[0], sampled[1]
    total = _energy(cosines, sines)
    apart = _energy(cosines - coarse[0], sines - coarse[1])
    w = factors(name, lmax)[:, None, None]
    made = SliceExpansion(
        float(light), lmax, target, name, b.channels, cosines * w, sines * w, {},
        float(np.sqrt(apart / total)) if total > 0 else 0.0,
    )  # fmt: skip
    made.truncation.update(_errors(made, sums, kind))
    return made


_Samples = tuple[Float64Array, Float64Array, Float64Array, Float64Array, Float64Array]


def _projected(
    b: Brdf, theta_i: float, lmax: int, target: Target, rule: Rule
) -> tuple[Float64Array, Float64Array, _Samples]:
    """Coefficients, and the samples: c_o, weights, cosine means, sine means, mean squares of f."""
    if rule.graded:
        theta_o, w = rule.inner(theta_i)
        x = np.cos(theta_o)
    else:
        x, w = gauss_legendre(rule.nodes)
        theta_o = np.arctan2(np.sqrt((1 - x) * (1 + x)), x)
    phi, w_phi = rule.azimuth()
    f = b.evaluate(theta_i, theta_o[None, :], phi[:, None]).astype(np.float64, copy=False)
    m = np.arange(lmax + 1)
    flat = f.reshape(phi.size, -1)
    even, odd = (((wave(m[:, None] * phi) * w_phi) @ flat).reshape(m.size, x.size, -1) for wave in (np.cos, np.sin))
    if rule.bilateral:
        odd[...] = 0.0  # over half a circle it would not vanish by itself
    squares = (w_phi @ (flat * flat)).reshape(x.size, -1)
    p = legendre(lmax, x, parity=target.parity_o)
    cosines, sines = np.zeros((2, lmax + 1, lmax + 1, f.shape[-1]))
    for k in range(lmax + 1):
        rows = degrees(lmax, k, target.parity_o)
        block = p[order_offset(lmax, k, target.parity_o) :][: rows.size] * (w * x**target.cos_o)
        for found, means in ((cosines, even), (sines, odd)):
            found[rows, k] = 4 * np.pi * (block @ means[k])
    return cosines, sines, (x, w, even, odd, squares)


def _energy(cosines: Float64Array, sines: Float64Array) -> float:
    weight = np.where(np.arange(cosines.shape[1]) == 0, 1.0, 2.0)[None, :, None]
    return float((weight * (cosines**2 + sines**2)).sum())


def _summed(made: SliceExpansion, x: Float64Array, *, over_x: bool) -> tuple[Float64Array, Float64Array]:
    """(orders, x, channels) of cosines and sines, the factor 2 - d_m0 included."""
    parity = SLICE_TARGETS[made.target].parity_o
    p = legendre(made.lmax, x, parity=parity, over_x=over_x and parity == "odd")
    found = np.zeros((2, made.lmax + 1, x.size, len(made.channels)))
    for m in range(made.lmax + 1):
        rows = degrees(made.lmax, m, parity)
        block = p[order_offset(made.lmax, m, parity) :][: rows.size]
        for k, source in enumerate((made.cosines, made.sines)):
            found[k, m] = (1 if m == 0 else 2) * np.einsum("lx,lc->xc", block, source[rows, m])
    return found[0], found[1]


def _errors(made: SliceExpansion, sums: _Samples, target: Target) -> dict[str, float]:
    """Found order by order on the samples themselves: no difference of large squares but beyond the last order."""
    x, w, even, odd, squares = sums
    left, right = _summed(made, x, over_x=True)
    double = np.where(np.arange(made.lmax + 1) == 0, 1.0, 2.0)[:, None, None]
    # (2 - d) (mean - sum/(2 - d))^2 of each order, and what orders above the last hold
    inside = (double * ((even - left / double) ** 2 + (odd - right / double) ** 2)).sum(axis=0)
    beyond = np.maximum(squares - (double * (even**2 + odd**2)).sum(axis=0), 0)
    found = {}
    for name, weight in (("target", w * x ** (2 * target.cos_o)), ("f", w)):
        total = float(weight @ squares.sum(axis=1))
        found[name] = float(np.sqrt(float(weight @ (inside + beyond).sum(axis=1)) / total)) if total > 0 else 0.0
    return found
