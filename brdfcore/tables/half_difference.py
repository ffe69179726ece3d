"""The representation for lobes: half/difference coordinates, guides along two of them, fitted half-precision nodes.

In these coordinates the mirror direction is one face of the lattice, theta_h = 0, so a lobe of any width lies along
an axis (S. Rusinkiewicz, "A new change of variables for efficient BRDF representation", EGWR 1998,
DOI 10.1007/978-3-7091-6453-2_2). The guides take the lobe's shape out; what is left varies slowly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Self

from brdfcore.base.brdf import Brdf
from brdfcore.base.parameters import Parameter
from brdfcore.tables.base.folding import folded_sample, folds
from brdfcore.tables.base.half_fit import Fitter, shape_for
from brdfcore.tables.base.half_lattice import HalfLattice, check_linear, check_shape, steps_z
from brdfcore.tables.base.layout import Layout
from brdfcore.tables.base.table import (
    DELTA_NODES,
    BuildOptions,
    Progress,
)

#: Nodes a channel that `candidates` tries for a tolerance.
LADDER = (500, 1_000, 2_000, 4_000, 8_000, 16_000, 32_000, 64_000, 128_000, 256_000, 512_000)


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
        check_linear(cls.name, options.interpolation)
        bilateral, reciprocal = folds(source, options)
        fold_reciprocal = reciprocal and bilateral  # a quarter turn is only stored of a table that is both
        shape = options.shape or shape_for(128_000, bilateral, fold_reciprocal)[0]
        check_shape(shape, "theta_h, theta_d, phi_d", len(source.channels))
        fitter, layout = (options.prepared or _prepared(source, options))(progress)
        return cls.fitted(source, options, fitter, layout, shape, bilateral, fold_reciprocal, progress)

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        bilateral, reciprocal = folds(source, options)
        reciprocal = reciprocal and bilateral
        options = replace(options, prepared=options.prepared or _prepared(source, options))
        beside = 2 * (2 * 1281 + 2 * 321 + 1 + steps_z(bilateral, reciprocal)) + (
            DELTA_NODES * 8 * len(source.channels) if source.has_delta else 0
        )
        if max_bytes is None:
            shapes = [shape_for(n, bilateral, reciprocal)[0] for n in LADDER]
        else:
            nodes = max((max_bytes - beside) // (2 * len(source.channels)), 64)
            shapes = shape_for(nodes, bilateral, reciprocal)
        each = 2 * len(source.channels)
        return [replace(options, shape=s, nbytes=each * s[0] * s[1] * s[2] + beside) for s in shapes]


def _prepared(source: Brdf, options: BuildOptions) -> Callable[[Progress | None], tuple[Fitter, Layout]]:
    """The source as the table will see it, folds applied, and where its nodes belong: found when first asked for."""
    bilateral, reciprocal = folds(source, options)
    sample = folded_sample(source, bilateral, reciprocal)
    found: list[tuple[Fitter, Layout]] = []

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
