"""`tabulate`: choose a representation and its size, build it, and measure its error on fresh directions."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.build.judge import MEASURES, Judge, Measure, bounded
from brdfcore.build.local_error import with_uncertainty
from brdfcore.build.search import Search
from brdfcore.metrics import Range
from brdfcore.metrics.incidence import GRAZING, worst
from brdfcore.tables.base.seen import Seen
from brdfcore.tables.base.table import BuildOptions, Progress, Table

#: L1 that `tabulate` aims at when neither tolerance nor max_bytes is given.
DEFAULT_TOLERANCE = 0.01
#: L1 above which a table is called bad, unasked: one part in twenty of the light in the wrong place.
BAD_L1 = 0.05
#: Error of the mirror part's reflectance above which a table is called bad.
BAD_DELTA = 0.005
#: Albedo error above which the same is said of the energy, at theta_i up to BAD_ALBEDO_TO degrees: at more grazing
#: angles nearly every table is off, and next to no light arrives there.
BAD_ALBEDO, BAD_ALBEDO_TO = 0.05, 80.0


class ToleranceWarning(UserWarning):
    """No table met the tolerance asked for; the best one was returned and its error says how good it is."""


def tabulate(
    b: Brdf,
    representation: str = "auto",
    *,
    tolerance: float | None = None,
    max_bytes: int | None = None,
    shape: Sequence[int] | None = None,
    interpolation: str = "linear",
    negatives: str = "keep",
    fold: str | Iterable[str] | None = None,
    light: Range | None = None,
    view: Range | None = None,
    measure: Measure = "incidence",
    progress: Progress | None = None,
) -> Table:
    """Turn any BRDF into a table whose error is known.

    Parameters
    ----------
    b : Brdf
        The source.
    representation : str
        A name of `representations()`, or "auto": every one that can hold `b` is considered.
    tolerance : float, optional
        Error to reach, as `measure` says, and that of the delta part's reflectance where there is one. Of all tables
        that meet it the one of the fewest bytes is taken, among those that take at most 1.25 times the time of the
        fastest (by a table of times measured once, `build.costs`). Default 0.01 when neither max_bytes nor shape is
        given. If none meets it, the best is returned with a `ToleranceWarning`. Where the source conserves energy,
        tables whose albedo passes 1 by more than four times the tolerance, up to 90 degrees, are taken only if no
        other meets it; `error["albedo_excess"]` says by how much.
    max_bytes : int, optional
        Limit on `nbytes`; the smallest error within it.
    shape : sequence of int, optional
        Nodes per axis, both ends included; excludes tolerance and max_bytes. Without bilateral symmetry
        delta_phi is periodic over 2 pi.
    interpolation : str
        Between nodes; what the representation offers.
    negatives : {"keep", "zero"}
        What negative values of the source become; zeroed ones are counted in `report["done"]`.
    fold : str or iterable of str, optional
        "bilateral" and/or "reciprocal": average over a symmetry the source does not have. The cost is in the error.
    light, view : (float, float), optional
        Ranges (from, to) of theta_i and theta_o, radians, that the table is wanted for: errors and tolerance are over
        these, and `half_difference` has its nodes there. Beyond them it answers, and `status` says EXTRAPOLATED.
    measure : {"incidence", "average"}
        "incidence": light from each angle from 0 to 85 degrees (inside `light`): L1, and the albedo of each channel,
        relative to it or to a tenth of the channels' mean; at 88 and 89 degrees four times as much is allowed. Below 5
        degrees L1 is that of means over the azimuth. "average": L1 under light from everywhere, which may hide an error
        of ten times as much at grazing light.
    progress : callable(done, total, stage), optional
        Called as work proceeds.

    Returns
    -------
    Table
        `t.error` holds `metrics.Comparison` as JSON (by angle of incidence in `t.error["by_theta_i"]`), measured on
        seeded random directions (none of them a node), plus `warnings`: sentences for a person where the table is bad.
        A source's delta part is kept apart, never smeared.

    Raises
    ------
    InputError
        Options that exclude each other, a shape the representation can't have, a source it can't hold, or a
        source value that is not finite.

    >>> gold = bc.model("cook_torrance", roughness=0.3, ior="gold")
    >>> table = bc.tabulate(gold, tolerance=0.01)
    >>> table.error["l1"] < 0.01, bc.compare(gold, table).l1 < 0.01
    (True, True)
    >>> bc.tabulate(gold, "angle_grid", shape=(8, 8, 9)).nbytes  # 8 x 8 x 9 nodes, float32
    2304
    """
    if measure not in MEASURES:
        raise _bad_option("measure", measure, " or ".join(map(repr, MEASURES)))
    options = _options(shape, interpolation, negatives, fold, Seen.of(light, view))
    if shape is not None and (tolerance is not None or max_bytes is not None):
        raise InputError(
            "options_exclude",
            "shape fixes the size: leave out tolerance and max_bytes, or leave out shape",
            where="shape",
        )
    tolerance, room = positive("tolerance", tolerance), positive("max_bytes", max_bytes)
    max_bytes = None if room is None else int(room)
    if representation != "auto":
        names: Sequence[str] = (representation,)
    elif shape is not None:
        names = ("angle_grid",)  # the representation that a shape of angles speaks of
    else:
        names = REPRESENTATIONS.names()
    classes: list[type[Table]] = [REPRESENTATIONS.load(name) for name in names]
    if representation == "auto":
        classes = [c for c in classes if c.FOR_AUTO and c.can_hold(b)]
    if tolerance is None and max_bytes is None and (shape is not None or representation != "auto"):
        table = classes[0].build(b, options, progress)
        table = _measured(table, Judge(b, options.seen, measure), None, progress)
        return with_uncertainty(_advised(table, b, names), b)
    if tolerance is None and max_bytes is None:
        tolerance = DEFAULT_TOLERANCE
    search = Search(b, Judge(b, options.seen, measure), options, tolerance, max_bytes, progress)
    return with_uncertainty(_advised(_found(search, classes), b, names), b)


def positive(name: str, value: Any) -> float | None:
    """`value` as a float if it is a finite number > 0, None if it is None; else an `InputError` that names it."""
    if value is None:
        return None
    try:
        number = float(value) if isinstance(value, Real) else math.nan
    except OverflowError:  # a whole number beyond float64
        number = math.inf
    if not 0 < number < math.inf:  # false for NaN
        raise _bad_option(name, value, "a finite number > 0")
    return number


def _bad_option(name: str, value: Any, expected: str) -> InputError:
    got = shown(value)
    return InputError("bad_option", f"{name} = {got}: expected {expected}", where=name, got=got, expected=expected)


def _options(
    shape: Sequence[int] | None, interpolation: str, negatives: str, fold: str | Iterable[str] | None, seen: Seen
) -> BuildOptions:
    if negatives not in ("keep", "zero"):
        raise _bad_option("negatives", negatives, "'keep' or 'zero'")
    try:
        folds = frozenset([fold] if isinstance(fold, str) else fold or ())
    except TypeError as error:
        raise _bad_option("fold", fold, "'bilateral', 'reciprocal' or both") from error
    if folds - {"bilateral", "reciprocal"}:
        raise _bad_option("fold", fold, "'bilateral', 'reciprocal' or both")
    nodes: tuple[int, ...] | None = None
    if shape is not None:
        try:
            nodes = tuple(int(n) for n in shape)
            whole = bool(nodes) and all(n == m and abs(n) < 2**31 for n, m in zip(nodes, shape, strict=True))
        except (TypeError, ValueError, OverflowError):
            whole = False
        if not whole:
            raise _bad_option("shape", shape, "whole numbers below 2^31")
    return BuildOptions(nodes, interpolation, negatives, folds, seen=seen)


def _found(search: Search, classes: Sequence[type[Table]]) -> Table:
    """The table that the search chose, measured; one that misses the tolerance says so."""
    table = _measured(search.run(classes), search.judge, search.tolerance, search.progress)
    tolerance, measure = search.tolerance, search.judge.measure
    # on fresh directions: what is not finite between those that chose it does not meet anything
    if tolerance is not None and (not search.met or math.isinf(bounded(table.error, measure))):
        which = f"{table.name} of {table.nbytes} bytes"
        delta = table.error["delta"]
        also = f" and its mirror part is off by {delta:.3g}" if table.has_delta and delta is not None else ""
        message = (
            f"no table met tolerance {tolerance:g}: the best, {which}, has L1 {_l1(table):.3g}"
            f"{where_worst(table.error) if measure == 'incidence' else ''}{also}"
        )
        table.error["warnings"].append(message)
        warnings.warn(message, ToleranceWarning, stacklevel=4)
    return table


def where_worst(error: Mapping[str, Any]) -> str:
    """ ", .03 at theta_i = 85 degrees": the angle that a tolerance fails at first."""
    rows = [r for r in [*error["by_theta_i"], *error["between"]] if math.degrees(r["theta_i"]) <= GRAZING + 1e-9]
    if not rows:
        return ""
    row = max(rows, key=lambda r: worst([r]))
    if not math.isfinite(worst([row])):
        return f", not finite at theta_i = {math.degrees(row['theta_i']):.4g} degrees"
    return f", {max(row['l1'], row['albedo_error']):.3g} at theta_i = {math.degrees(row['theta_i']):.4g} degrees"


def _l1(table: Table) -> float:
    if not table.error["regular"]:
        return 0.0  # nothing can be misplaced
    return math.inf if table.error["l1"] is None else float(table.error["l1"])  # None: not finite


def _measured(table: Table, judge: Judge, tolerance: float | None, progress: Progress | None) -> Table:
    if progress is not None:
        progress(0, 1, "measuring the error")
    found = judge.stated(table)
    found["tolerance"] = tolerance
    found["warnings"] = _complaints(found, judge.seen)
    table.error = found
    if not table.metadata:
        table.metadata = dict(judge.source.metadata)
    if progress is not None:
        progress(1, 1, "measuring the error")
    return table


def _complaints(error: dict[str, Any], seen: Seen) -> list[str]:
    """What a user has to be told without asking."""
    said = []
    if not error["regular"]:
        said.append("the source has no regular part: L1 has no meaning, the table holds its mirror part only")
    elif error["l1"] is None:
        said.append("its L1 can't be told: values of the source or of the table are not finite")
    elif error["l1"] > BAD_L1:
        said.append(
            f"this table misplaces {100 * error['l1']:.0f} % of the reflected energy (L1 = {error['l1']:.3g}): "
            "its cells are wider than the material's lobe; don't render with it"
        )
    if error["delta"] is None or error["delta"] > BAD_DELTA:
        off = "not finite" if error["delta"] is None else f"off by up to {error['delta']:.3g}"
        said.append(f"the reflectance of its mirror part is {off}")
    pairs = [p for p in zip(error["albedo_bias"]["bias"], error["albedo_bias"]["theta_i"]) if p[0] is not None]
    # an albedo takes all views: it says nothing of a table that is not wanted for all
    pairs = [p for p in pairs if seen.whole and math.degrees(p[1]) <= BAD_ALBEDO_TO + 1e-9]
    worst = max(pairs, key=lambda pair: abs(pair[0]), default=(0.0, 0.0))
    if abs(worst[0]) > BAD_ALBEDO:
        said.append(f"its albedo is off by {100 * worst[0]:+.0f} % at theta_i = {math.degrees(worst[1]):.1f} degrees")
    if error["nan"]:
        said.append(f"{error['nan']} of {error['values']} values are not numbers")
    return said


def _advised(table: Table, source: Brdf, tried: Sequence[str]) -> Table:
    """`table`, with what else to try among its warnings if it misplaces too much."""
    if _l1(table) > BAD_L1:
        untried: dict[str, type[Table]] = {
            name: REPRESENTATIONS.load(name) for name in REPRESENTATIONS if name not in tried
        }
        others = [name for name, cls in untried.items() if cls.FOR_AUTO and cls.can_hold(source)]
        named = f"representation {' or '.join(others)}, or " if others else ""
        table.error["warnings"].append(f"try {named}more nodes: a larger shape or max_bytes")
    return table
