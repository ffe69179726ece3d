"""`tabulate`: choose a representation and its size, build it, and measure its error on fresh directions."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

from brdfcore.brdf import Brdf
from brdfcore.errors import InputError
from brdfcore.metrics import compare
from brdfcore.registry import REPRESENTATIONS
from brdfcore.tables.base import BuildOptions, Progress, Table

#: L1 that `tabulate` aims at when neither tolerance nor max_bytes is given.
DEFAULT_TOLERANCE = 0.01
#: L1 above which a table is called bad, unasked: one part in twenty of the light in the wrong place.
BAD_L1 = 0.05
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
        L1 to reach; the fastest representation, at the smallest size, that meets it. Default 0.01 when neither
        max_bytes nor shape is given. If none meets it, the best is returned with a `ToleranceWarning`.
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
    progress : callable(done, total, stage), optional
        Called as work proceeds.

    Returns
    -------
    Table
        `t.error` holds `metrics.Comparison` as JSON, measured on seeded random directions (none of them a
        node), plus `warnings`: sentences for a person where the table is bad. A source's delta part is kept
        apart, never smeared.

    Raises
    ------
    InputError
        Options that exclude each other, a shape the representation can't have, a source it can't hold, or a
        source value that is not finite.
    """
    options = _options(shape, interpolation, negatives, fold)
    if shape is not None and (tolerance is not None or max_bytes is not None):
        raise InputError(
            "options_exclude",
            "shape fixes the size: leave out tolerance and max_bytes, or leave out shape",
            where="shape",
        )
    if tolerance is not None and not tolerance > 0:
        raise InputError("bad_option", f"tolerance = {tolerance!r}: expected a number > 0", where="tolerance")
    if max_bytes is not None and max_bytes <= 0:
        raise InputError("bad_option", f"max_bytes = {max_bytes!r}: expected a number > 0", where="max_bytes")
    if representation != "auto":
        names: Sequence[str] = (representation,)
    elif shape is not None:
        names = ("angle_grid",)  # the representation that a shape of angles speaks of
    else:
        names = REPRESENTATIONS.names()
    classes: list[type[Table]] = [REPRESENTATIONS.load(name) for name in names]
    if representation == "auto":
        classes = [c for c in classes if c.can_hold(b)]
    if tolerance is None and max_bytes is None and (shape is not None or representation != "auto"):
        return _measured(classes[0].build(b, options, progress), b, None, progress)
    if tolerance is None and max_bytes is None:
        tolerance = DEFAULT_TOLERANCE
    return _search(b, classes, options, tolerance, max_bytes, progress)


def _options(
    shape: Sequence[int] | None, interpolation: str, negatives: str, fold: str | Iterable[str] | None
) -> BuildOptions:
    if negatives not in ("keep", "zero"):
        raise InputError(
            "bad_option", f"negatives = {negatives!r}: expected 'keep' or 'zero'", where="negatives", got=str(negatives)
        )
    folds = frozenset([fold] if isinstance(fold, str) else fold or ())
    unknown = folds - {"bilateral", "reciprocal"}
    if unknown:
        raise InputError(
            "bad_option", f"fold = {sorted(unknown)}: expected 'bilateral', 'reciprocal' or both", where="fold"
        )
    nodes: tuple[int, ...] | None = None
    if shape is not None:
        try:
            nodes = tuple(int(n) for n in shape)
        except (TypeError, ValueError) as error:
            raise InputError("bad_option", f"shape = {shape!r}: expected whole numbers", where="shape") from error
        if any(n != m for n, m in zip(nodes, shape, strict=True)):
            raise InputError("bad_option", f"shape = {shape!r}: expected whole numbers", where="shape")
    return BuildOptions(nodes, interpolation, negatives, folds)


def _search(
    b: Brdf,
    classes: Sequence[type[Table]],
    options: BuildOptions,
    tolerance: float | None,
    max_bytes: int | None,
    progress: Progress | None,
) -> Table:
    """Build candidates from the cheapest up; stop at the first that meets the tolerance, else keep the best."""
    best: Table | None = None
    smallest: int | None = None
    for cls in classes:
        for candidate in cls.candidates(b, options, max_bytes):
            table = cls.build(b, candidate, progress)
            if max_bytes is not None and table.nbytes > max_bytes:
                smallest = min(table.nbytes, smallest or table.nbytes)
                continue
            table = _measured(table, b, tolerance, progress)
            if best is None or _l1(table) < _l1(best):
                best = table
            if tolerance is not None and _l1(table) <= tolerance:
                return table
            if tolerance is not None and not cls.worth_refining(_l1(table), tolerance):
                break
    if best is None:
        need = f"; the smallest takes {smallest}" if smallest else ""
        raise InputError(
            "max_bytes_too_small",
            f"no table fits into max_bytes = {max_bytes}{need}",
            where="max_bytes",
            got=max_bytes,
            expected=smallest,
        )
    if tolerance is not None:
        which = f"{best.name} of {best.nbytes} bytes"
        message = f"no table met tolerance {tolerance:g}: the best, {which}, has L1 {_l1(best):.3g}"
        best.error["warnings"].append(message)
        warnings.warn(message, ToleranceWarning, stacklevel=3)
    return best


def _l1(table: Table) -> float:
    value = table.error.get("l1")
    return 0.0 if value is None else float(value)  # None: no regular part, so nothing can be misplaced


def _measured(table: Table, source: Brdf, tolerance: float | None, progress: Progress | None) -> Table:
    if progress is not None:
        progress(0, 1, "measuring the error")
    found: dict[str, Any] = compare(source, table).to_json()
    found["tolerance"] = tolerance
    found["warnings"] = _complaints(found)
    table.error = found
    if not table.metadata:
        table.metadata = dict(source.metadata)
    if progress is not None:
        progress(1, 1, "measuring the error")
    return table


def _complaints(error: dict[str, Any]) -> list[str]:
    """What a user has to be told without asking."""
    said = []
    if error["l1"] is None:
        said.append("the source has no regular part: L1 has no meaning, the table holds its mirror part only")
    elif error["l1"] > BAD_L1:
        said.append(
            f"this table misplaces {100 * error['l1']:.0f} % of the reflected energy (L1 = {error['l1']:.3g}): "
            "its cells are wider than the material's lobe; don't render with it"
        )
    pairs = zip(error["albedo_bias"]["bias"], error["albedo_bias"]["theta_i"])
    worst = max((p for p in pairs if math.degrees(p[1]) <= BAD_ALBEDO_TO + 1e-9), key=lambda pair: abs(pair[0]))
    if abs(worst[0]) > BAD_ALBEDO:
        said.append(f"its albedo is off by {100 * worst[0]:+.0f} % at theta_i = {math.degrees(worst[1]):.1f} degrees")
    if error["nan"]:
        said.append(f"{error['nan']} of {error['values']} values are not numbers")
    return said
