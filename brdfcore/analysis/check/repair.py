"""Named repairs of what `check` finds: only those asked for, each with what it changed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.check.pairs import difference
from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown
from brdfcore.base.reflectance import DATA_ALBEDO_TOLERANCE
from brdfcore.metrics import ALBEDO_SLACK, BIAS_ANGLES

Float64Array = npt.NDArray[np.float64]

#: Every repair in the order in which they are made, so that none undoes one before it.
REPAIRS = {
    "bilateral": "average f(delta_phi) and f(-delta_phi)",
    "reciprocity": "average f(i,o) and f(o,i)",
    "negatives": "set negative values to 0",
    "energy": "where the albedo passes 1, scale f down by a factor of theta_i",
}
#: theta_i at which `energy` knows the albedo: every 1.5 degrees, and closer towards the horizon, where it rises fast.
_ENERGY_NODES = np.radians(np.concatenate([np.arange(0.0, 88.5, 1.5), 90.0 - np.geomspace(1.5, 1e-3, 24)]))
#: Rounds of lowering the factors where the albedo between two nodes still passes 1.
_ROUNDS = 4
#: Albedo that scaling aims at: below 1 by what the integration may be off, seen over ten measured materials.
_AIM = 1 - 2e-4


class Repaired(Brdf):
    """A BRDF after named repairs; evaluated from the source each time, which `tabulate` turns into a table.

    repairs  names, in the order of `REPAIRS`.
    source   the BRDF as it was.
    factors  of "energy" at `_ENERGY_NODES`; None without.
    """

    def __init__(self, source: Brdf, repairs: tuple[str, ...], factors: Float64Array | None = None) -> None:
        super().__init__()
        self.source_brdf, self.repairs, self.factors = source, repairs, factors
        self.channels, self.has_delta = source.channels, source.has_delta
        self.bilateral = source.bilateral or "bilateral" in repairs
        self.reciprocal = source.reciprocal or "reciprocity" in repairs
        self.non_negative = source.non_negative or "negatives" in repairs
        self.energy_conserving = source.energy_conserving or factors is not None
        if factors is not None and "reciprocity" not in repairs and bool((factors < 1).any()):
            self.reciprocal = False  # a factor of theta_i alone treats the directions differently
        self._analytic = source._analytic and factors is None  # the factors have kinks
        self.metadata = {**source.metadata, "repaired": list(repairs)}
        self.report = dict(source.report)

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        def folded(i: FloatArray, o: FloatArray, d: FloatArray) -> FloatArray:
            f = self.source_brdf.evaluate(i, o, d)
            # halves first: the sum of two finite values may not be finite
            return 0.5 * f + 0.5 * self.source_brdf.evaluate(i, o, -d) if "bilateral" in self.repairs else f

        f = folded(theta_i, theta_o, delta_phi)
        if "reciprocity" in self.repairs:
            f = 0.5 * f + 0.5 * folded(theta_o, theta_i, -delta_phi)
        if "negatives" in self.repairs:
            f = np.maximum(f, 0)  # keeps NaN
        if self.factors is not None:
            scale = self._factor(theta_i)
            # the smaller of both directions' factors is reciprocal and takes no less
            scale = np.minimum(scale, self._factor(theta_o)) if "reciprocity" in self.repairs else scale
            f = f * scale
        out[...] = f
        return True

    def _factor(self, theta: npt.NDArray[Any]) -> Float64Array:
        """(n, 1)."""
        assert self.factors is not None
        theta = theta.astype(np.float64)
        factor = np.interp(theta, _ENERGY_NODES, self.factors)
        if self.factors[-1] < 1:  # past the last node the albedo grows as 1/cos at most, where f cos is bounded
            factor *= np.minimum(np.cos(theta) / np.cos(_ENERGY_NODES[-1]), 1.0)
        column: Float64Array = factor[:, None]
        return column

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return self.source_brdf._status(theta_i, theta_o, delta_phi)

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        # what is averaged may be off the same way; a value set to 0 is as uncertain as it was
        i, o, d = theta_i, theta_o, delta_phi
        pairs = [(i, o, d)]
        if "bilateral" in self.repairs:
            pairs += [(i, o, -d)]
        if "reciprocity" in self.repairs:
            pairs += [(o, i, -d) for i, o, d in pairs]
        out[...] = sum(self.source_brdf.uncertainty(*pair) for pair in pairs) / len(pairs)
        if self.factors is not None:
            scale = self._factor(theta_i)
            out *= np.minimum(scale, self._factor(theta_o)) if "reciprocity" in self.repairs else scale
        return True

    def _delta_reflectance(self, theta_i: Float64Array) -> Float64Array:
        delta = self.source_brdf._delta_reflectance(theta_i)
        if "negatives" in self.repairs:
            delta = np.maximum(delta, 0)
        return delta if self.factors is None else delta * self._factor(theta_i)


def repair(b: Brdf, repairs: str | Iterable[str], *, directions: int = 100_000, seed: int = 20_261_122) -> Repaired:
    """`b` with the repairs asked for; `report["repairs"]` says what each changed, `report["warnings"]` what is left.

    repairs  one or several of `REPAIRS`, made in its order: "bilateral" (average over the plane of incidence),
             "reciprocity" (average with the directions exchanged), "negatives" (to 0), "energy" (where the albedo
             passes 1, scale by a factor of theta_i; with "reciprocity" the smaller factor of both directions, else
             reciprocity is lost).

    Each entry of `report["repairs"]`: name, what, l1 (int |change| c_i c_o / int |f| c_i c_o, of the state before it,
    with standard error), misplaced (the same in albedo units, worst channel), values_changed (fraction of the values of
    `directions` seeded pairs), albedo_before and albedo_after by channel at theta_i (degrees). Values that are not
    finite stay as they are.

    Raises `InputError` for no repair or an unknown one.

    >>> bright = 2.5 * bc.model("lambert", reflectance=0.5)  # reflects 1.25 of what arrives
    >>> bc.repair(bright, "energy").albedo(0.5).round(2)
    array([1.])
    """
    chosen = _chosen(repairs)
    theta = np.radians(BIAS_ANGLES)
    done: list[dict[str, Any]] = []
    made: tuple[str, ...] = ()
    factors: Float64Array | None = None
    state: Brdf = b
    albedo = b.albedo(theta)
    for name in chosen:
        made = (*made, name)
        if name == "energy":
            factors = _energy_factors(b, made)
        after = Repaired(b, made, factors)
        l1, error, misplaced, changed = difference(state, after, directions=directions, seed=seed)
        now = after.albedo(theta)
        entry: dict[str, Any] = {
            "name": name,
            "what": REPAIRS[name],
            "l1": l1,
            "l1_stderr": error,
            "misplaced": misplaced,
            "values_changed": changed,
            "theta_i": list(BIAS_ANGLES),
            "albedo_before": albedo.tolist(),
            "albedo_after": now.tolist(),
        }
        if factors is not None and name == "energy":
            entry["smallest_factor"] = float(factors.min())
            entry["scaled_from"] = _first_scaled(factors)
        done.append(entry)
        state, albedo = after, now
    result = Repaired(b, chosen, factors)
    result.report = {
        **b.report,
        "repairs": done,
        "done": [*b.report.get("done", []), *(f"repaired, as asked: {_sentence(e)}" for e in done)],
        "warnings": [*b.report.get("warnings", []), *_left(b, result, albedo)],
    }
    return result


def _chosen(repairs: Any) -> tuple[str, ...]:
    try:
        given = [repairs] if isinstance(repairs, str) else list(repairs)
    except TypeError:
        given = [repairs]
    if not given or any(not isinstance(r, str) or r not in REPAIRS for r in given):
        names = ", ".join(REPAIRS)
        raise InputError(
            "bad_repair", f"repairs = {shown(repairs)}: expected one or several of {names}", where="repairs",
            got=shown(repairs), expected=names,
        )  # fmt: skip
    return tuple(name for name in REPAIRS if name in given)


def _energy_factors(b: Brdf, repairs: tuple[str, ...]) -> Float64Array:
    """Factors in (0, 1] at `_ENERGY_NODES` that bring the largest channel's albedo to `_AIM` where it passes 1.

    One factor for all channels keeps their ratios. Checked between the nodes too: there both neighbours are lowered.
    """
    factors = np.ones(_ENERGY_NODES.size)
    middle = 0.5 * (_ENERGY_NODES[:-1] + _ENERGY_NODES[1:])
    before = tuple(r for r in repairs if r != "energy")
    source = Repaired(b, before) if before else b
    at_nodes, between = _largest_albedo(source, _ENERGY_NODES), _largest_albedo(source, middle)
    if not (np.isfinite(at_nodes).all() and np.isfinite(between).all()):
        raise InputError(
            "not_finite", "energy cannot be repaired: the albedo is not finite; check says where", where="repairs"
        )
    over = at_nodes > 1 + ALBEDO_SLACK
    factors[over] = _AIM / at_nodes[over]
    for _ in range(_ROUNDS):
        excess = between * 0.5 * (factors[:-1] + factors[1:])
        high = np.flatnonzero(excess > 1 + ALBEDO_SLACK)
        if not high.size:
            break
        for k in high.tolist():
            factors[k : k + 2] *= _AIM / excess[k]
    return factors


def _largest_albedo(b: Brdf, theta: Float64Array) -> Float64Array:
    """Of the channels, (n,): to `DATA_ALBEDO_TOLERANCE`, and of a formula, where it comes near 1, a tenth of `_AIM`."""
    albedo, _ = b.albedo_error(theta, tolerance=DATA_ALBEDO_TOLERANCE)
    near = albedo.max(axis=1) > 1 - 2 * DATA_ALBEDO_TOLERANCE
    if b._analytic and near.any():
        albedo[near], _ = b.albedo_error(theta[near], tolerance=2e-5)
    largest: Float64Array = albedo.max(axis=1)
    return largest


def _first_scaled(factors: Float64Array) -> float | None:
    """Smallest theta_i, degrees, at which something is scaled."""
    scaled = np.flatnonzero(factors < 1)
    return None if not scaled.size else float(np.degrees(_ENERGY_NODES[max(int(scaled[0]) - 1, 0)]))


def _sentence(entry: dict[str, Any]) -> str:
    before, after = (float(np.max(entry[k])) for k in ("albedo_before", "albedo_after"))
    return (
        f"{entry['name']} ({entry['what']}): {100 * entry['values_changed']:.3g} % of the values changed, "
        f"L1 {entry['l1']:.3g} ± {entry['l1_stderr']:.1g}; largest albedo {before:.5g} before, {after:.5g} after"
    )


def _left(b: Brdf, result: Repaired, albedo: FloatArray) -> list[str]:
    said = []
    if "energy" in result.repairs and not (albedo <= 1 + ALBEDO_SLACK).all():
        said.append(f"the albedo still reaches {float(albedo.max()):.6g}")
    if b.reciprocal and not result.reciprocal:
        said.append('a factor of theta_i alone made it not reciprocal; ask for "reciprocity" as well to keep it so')
    return said
