"""Scattered measurements to a table: what holes and negative values become, and the report of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.import_report import report_of
from brdfcore.formats.base.measurements import Measurements
from brdfcore.kernels.machine.blas import one_blas_thread
from brdfcore.tables.scattered.lattice import Policy
from brdfcore.tables.scattered.table import Scattered

#: Standard uncertainties of a normal distribution in the half-width of its 95 % interval.
Z95 = 1.96

#: Options of `to_brdf`, which every reader of scattered measurements takes beside its own.
POLICIES = (
    Parameter(
        "holes",
        "",
        "values farther than `gap` from every measured geometry, or more grazing than all: continued from the limits "
        "of the measured range, those of the nearest measurement, or 0",
        "continue",
        kind="choice",
        choices=("continue", "nearest", "zero"),
    ),
    Parameter("negatives", "", "what negative values become", "keep", kind="choice", choices=("keep", "zero")),
    Parameter(
        "fold",
        "",
        "average delta_phi and -delta_phi, where both are measured",
        "none",
        kind="choice",
        choices=("none", "bilateral"),
    ),
    Parameter(
        "smoothing",
        "",
        "of the interpolator; not given: chosen by cross-validation",
        None,
        bounds=(0, 1e3),
        per_channel=False,
    ),
    Parameter(
        "gap",
        "",
        "farther than this from every measured geometry is a hole",
        15.0,
        bounds=(0.1, 90),
        unit="degrees",
        per_channel=False,
    ),
    Parameter(
        "in_plane",
        "",
        "what keeps its value out of the plane of incidence, where only that was measured: f, f cos(theta_i) "
        "cos(theta_o), the lobe about the mirror direction, f times a power of the cosines; auto: what fits best",
        "auto",
        kind="choice",
        choices=("auto", "f", "f_cos_cos", "lobe", "power"),
    ),
    Parameter("shape", "", "nodes along theta_h, theta_d and half a turn of phi_d, as [64,28,24]", None, kind="text"),
)


def to_brdf(measurements: Measurements, **options: Any) -> Brdf:
    """A `scattered` table of measurements: regridded, every geometry kept; its `report` says what was found and done.

    options   holes, negatives, fold, smoothing, gap (degrees), shape: see `POLICIES`. The defaults change no measured
              value. Azimuths measured on one side only are taken to be the same on the other, which the report says.

    Raises `InputError` for an option out of range, or too few geometries.
    """
    with one_blas_thread():
        return _regridded(measurements, options)


def _regridded(measurements: Measurements, options: dict[str, Any]) -> Brdf:
    chosen = resolve("measurements", POLICIES, options)
    done = list(measurements.done)
    kept = measurements
    negative = kept.values < 0
    if chosen["negatives"] == "zero" and negative.any():
        kept = replace(kept, values=np.maximum(kept.values, 0))
        done.append(f"{int(negative.sum())} negative values set to zero, as asked")
    one_sided, fold = kept.one_sided(), chosen["fold"] == "bilateral"
    if one_sided:
        done.append(
            "measured on one side of the plane of incidence only: the other side is taken to be the same "
            "(bilateral symmetry is assumed, not measured)"
        )
    elif fold:
        done.append("delta_phi and -delta_phi averaged, as asked")
    policy = Policy(
        holes=chosen["holes"],
        negatives=chosen["negatives"],
        smoothing=chosen["smoothing"],
        gap=float(np.radians(chosen["gap"])),
        shape=_shape_of(chosen["shape"]),
        plane=chosen["in_plane"],
    )
    table = Scattered.from_points(
        np.stack([kept.theta_i, kept.theta_o, kept.delta_phi], axis=1),
        np.array(kept.values),
        kept.channels,
        bilateral=one_sided or fold,
        policy=policy,
        instrument=None if kept.uncertainty is None else Z95 * kept.uncertainty,
    )
    table.source = {"name": kept.file, "format": kept.format, "sha256": str(kept.source.get("sha256", ""))}
    table.metadata = {"description": kept.description} if kept.description else {}
    table.report = report_of(measurements, table, done, chosen)
    return table


def not_scattered(brdf: Brdf, what: str) -> InputError:
    """The refusal of formats that list measured geometries; `what` names the file."""
    got = getattr(brdf, "name", type(brdf).__name__)
    return InputError(
        "not_scattered",
        f"{what} lists measured geometries; this is {got!r}: tabulate it as 'scattered' first, which measures it at "
        "the geometries of a goniometer",
        where="brdf",
        got=got,
        expected="a scattered table",
    )


def _shape_of(text: str | None) -> tuple[int, ...] | None:
    if text is None:
        return None
    try:
        return tuple(int(part) for part in text.strip(" []()").split(","))
    except ValueError:
        raise InputError(
            "bad_shape", f"shape = {text[:60]!r}: expected 3 whole numbers, as [64,28,24]", where="shape", got=text[:60]
        ) from None
