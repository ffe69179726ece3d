"""What a tolerance means for one source: its candidates are measured on the same draws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

from brdfcore.base.brdf import Brdf
from brdfcore.metrics import compare
from brdfcore.metrics.comparison import delta_difference
from brdfcore.metrics.incidence import Incidences, worst
from brdfcore.metrics.lobes import Lobes
from brdfcore.tables.base.seen import Seen
from brdfcore.tables.base.table import Table

Measure = Literal["incidence", "average"]
MEASURES: tuple[Measure, ...] = ("incidence", "average")
#: Directions that errors are measured on; fewer while only candidates are compared.
_DIRECTIONS, _COMPARED = 200_000, 60_000
_SEED = 20_261_122


class Judge:
    """Measures tables against `source`.

    measure  "incidence": a tolerance bounds L1 and the albedo's error for light from each angle up to 85 degrees, and
             both over four up to 89 (`metrics.incidence.worst`). "average": L1 for light from everywhere.
             Both bound the error of the mirror part's reflectance too.
    """

    def __init__(self, source: Brdf, seen: Seen, measure: Measure) -> None:
        self.source, self.seen, self.measure = source, seen, measure
        self.lobes = Lobes([source], _SEED)
        self.incidences = Incidences(source, source.channels, self.lobes, light=seen.light, view=seen.view, seed=_SEED)

    def error(self, table: Table, tolerance: float | None = None) -> float:
        """What a tolerance bounds; infinite where it is not known well enough to be held to `tolerance`."""
        if self.measure == "incidence":
            rows = self.incidences.rows(table)
            if worst(rows) <= (math.inf if tolerance is None else tolerance):
                rows += self.incidences.between(table)
            return max(worst(rows, tolerance), delta_difference(self.source, table))
        directions = self.seen.draws(_COMPARED)
        found = compare(
            self.source, table, directions=directions, light=self.seen.light, view=self.seen.view,
            incidences=self.incidences,
        )  # fmt: skip
        return bounded(found.to_json(), "average", tolerance)

    def stated(self, table: Table) -> dict[str, Any]:
        """Everything measured, as JSON."""
        compared = compare(
            self.source, table, directions=self.seen.draws(_DIRECTIONS), light=self.seen.light, view=self.seen.view,
            incidences=self.incidences,
        )  # fmt: skip
        return {**compared.to_json(), **self.seen.attributes(), "measure": self.measure}


def verified(error: Mapping[str, Any]) -> dict[str, Any]:
    """Of a stated error (a `Comparison` as JSON) on fresh draws, what is told: `error`, what a tolerance bounds, null
    where it is not finite; L1 under light from everywhere, and what it was measured on."""
    worst_incidence = bounded(error, "incidence")
    kept = {key: error[key] for key in ("l1", "l1_stderr", "delta", "directions", "seed")}
    return {"error": worst_incidence if math.isfinite(worst_incidence) else None, **kept}


def bounded(error: Mapping[str, Any], measure: str, tolerance: float | None = None) -> float:
    """What a tolerance bounds, from a stated error (a `Comparison` as JSON)."""
    delta = math.inf if error["delta"] is None else error["delta"]
    l1 = math.inf if error["l1"] is None else error["l1"]  # None: not finite somewhere
    if measure == "incidence":
        unknown = l1 if error["regular"] and math.isinf(l1) else 0.0
        return max(worst([*error["by_theta_i"], *error["between"]], tolerance), delta, unknown)
    if not error["regular"]:
        return float(delta)  # nothing can be misplaced
    return float(max(l1, delta))
