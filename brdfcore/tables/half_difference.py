"""The representation for lobes: half/difference coordinates, guides along two of them, fitted half-precision nodes.

In these coordinates the mirror direction is one face of the lattice, theta_h = 0, so a lobe of any width lies along
an axis (S. Rusinkiewicz, "A new change of variables for efficient BRDF representation", EGWR 1998,
DOI 10.1007/978-3-7091-6453-2_2). The guides take the lobe's shape out; what is left varies slowly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter
from brdfcore.metrics import ALBEDO_SLACK
from brdfcore.tables.base.half_fit import Fitter, Layout, shape_for
from brdfcore.tables.base.half_lattice import HalfLattice, lattice_arrays, steps_z
from brdfcore.tables.base.table import (
    DELTA_NODES,
    BuildOptions,
    Progress,
    expected_time,
    sampled_delta,
)

#: Nodes a channel that `candidates` tries for a tolerance.
LADDER = (8_000, 24_000, 64_000, 128_000, 256_000, 512_000)
#: Time of a look-up against an angle grid's, both in the caches: 1.2 (three channels) to 1.8 (one).
_TIME = 1.8
_ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)


class HalfDifference(HalfLattice):
    """f_r = 2^(guide_h(theta_h) + guide_d(theta_d)) K(theta_i, theta_o) values(theta_h, theta_d, phi_d).

    Trilinear in warped coordinates. Where that has less error (Phong's lobes) the angle to the mirror direction takes
    the place of theta_h (`mirror`).
    Coordinates, maps and K: `kernels.tables.half_difference`. Folded by the source's flags: phi_d over a quarter turn
    if bilateral and reciprocal, half a turn if bilateral, else a whole one.

    Arrays:

        values  float16 (n_h, n_d, n_p, C)  nodes, times `scale`: relative precision 2^-11, and half the bytes
        guide_h uint16 (1281,)  exponent of 2 over u = tan^2 theta_h, 32 steps an octave: guide_low + guide_step word
        guide_d uint16 (321,)   exponent of 2 over w = cos^2 theta_d, 16 steps an octave: guide_step word
        map_h   uint16 (1281,)  node position over u, in 1/65536 of the way to the last node
        map_d   uint16 (321,)   node position over w
        map_p   uint16 (n,)     node position over phi_d's diamond angle, 64 steps a quarter turn

    A table made for some angles only (`seen`) has its nodes where these are, and is fitted to them; beyond them it
    continues, and `status` says EXTRAPOLATED.

    Interpolated values never exceed the largest node of the cell, times guide and K there. Look-ups run in the type
    of the angles.
    """

    name = "half_difference"
    SUMMARY = "half/difference coordinates, guides along theta_h and theta_d, float16 nodes, trilinear"
    PARAMETERS = (
        Parameter("shape", "", "nodes along theta_h, theta_d, phi_d", "80,40,40", kind="text"),
        Parameter("interpolation", "", "between the nodes", "linear", kind="choice", choices=("linear",)),
    )
    EVALUATION_VERSION = 2

    # ---- build --------------------------------------------------------------------------------

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Fit nodes to `source`; see `tables.base.half_fit` and `Table.build`."""
        if options.interpolation != "linear":
            raise InputError(
                "bad_option",
                f"interpolation = {options.interpolation!r}: half_difference offers 'linear'",
                where="interpolation",
                got=options.interpolation,
                expected="linear",
            )
        bilateral, reciprocal = _folds(source, options)
        fold_reciprocal = reciprocal and bilateral  # a quarter turn is only stored of a table that is both
        shape = options.shape or shape_for(LADDER[3], bilateral, fold_reciprocal)[0]
        if len(shape) != 3 or min(shape) < 3 or np.prod([float(n) for n in shape]) * len(source.channels) >= 2**31:
            raise InputError(
                "bad_shape",
                f"shape = {list(shape)}: expected 3 numbers of nodes (theta_h, theta_d, phi_d), each at least 3, "
                "with fewer than 2^31 values in all",
                where="shape",
                got=list(shape),
                expected="3 whole numbers >= 3",
            )

        fitter, layout = (options.prepared or _prepared(source, options))(progress)
        told = None if progress is None else lambda done, total: progress(done, total, "fitting the nodes")
        nodes = fitter.nodes(layout, (shape[0], shape[1], shape[2]), told)
        done = [f"averaged over the {name} symmetry, as asked" for name in sorted(options.fold)]
        negative = int((nodes < 0).sum())
        if negative and (options.negatives == "zero" or source.non_negative):
            nodes = np.maximum(nodes, 0)  # a fit may dip below a source that does not
            if not source.non_negative:
                done.append(f"{negative} negative nodes set to zero, as asked")
        arrays, scale, guide = lattice_arrays(nodes, layout)
        flags = {
            "bilateral": bilateral,
            "reciprocal": fold_reciprocal and layout.factor in ("sum", "both", "none"),
            "energy_conserving": source.energy_conserving,
            "non_negative": bool((arrays["values"] >= 0).all()),
        }
        table = cls(
            arrays,
            scale,
            guide,
            layout.factor,
            layout.mirror,
            source.channels,
            flags,
            sampled_delta(source),
            options.seen,
        )
        if flags["energy_conserving"]:
            table.energy_conserving = bool((table.albedo(np.radians(_ENERGY_ANGLES)) <= 1 + ALBEDO_SLACK).all())
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {**source.report, "done": [*source.report.get("done", []), *done]}
        return table

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        bilateral, reciprocal = _folds(source, options)
        reciprocal = reciprocal and bilateral
        options = replace(options, prepared=options.prepared or _prepared(source, options))
        if max_bytes is None:
            shapes = [shape_for(n, bilateral, reciprocal)[0] for n in LADDER]
        else:
            beside = 2 * (2 * 1281 + 2 * 321 + 1 + steps_z(bilateral, reciprocal)) + (
                DELTA_NODES * 8 * len(source.channels) if source.has_delta else 0
            )
            nodes = max((max_bytes - beside) // (2 * len(source.channels)), 64)
            shapes = shape_for(nodes, bilateral, reciprocal)
        each = 2 * len(source.channels)
        return [replace(options, shape=s, time=expected_time(_TIME, each * s[0] * s[1] * s[2])) for s in shapes]


def _folds(source: Brdf, options: BuildOptions) -> tuple[bool, bool]:
    """(bilateral, reciprocal) of the table: what the source has, and what was asked for."""
    return source.bilateral or "bilateral" in options.fold, source.reciprocal or "reciprocal" in options.fold


def _prepared(source: Brdf, options: BuildOptions) -> Callable[[Progress | None], tuple[Fitter, Layout]]:
    """The source as the table will see it, folds applied, and where its nodes belong: found when first asked for."""
    bilateral, reciprocal = _folds(source, options)
    found: list[tuple[Fitter, Layout]] = []

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

    def prepared(progress: Progress | None) -> tuple[Fitter, Layout]:
        if not found:
            if progress is not None:
                progress(0, 1, "placing the nodes")
            fitter = Fitter(source, sample, bilateral, bilateral and reciprocal, options.seen)
            found.append((fitter, fitter.layout()))
            if progress is not None:
                progress(1, 1, "placing the nodes")
        return found[0]

    return prepared
