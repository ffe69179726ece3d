"""The representation for an error by angle of incidence: theta_i, and distance and azimuth about the lobe's centre."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

from brdfcore.base.brdf import Brdf
from brdfcore.base.parameters import Parameter
from brdfcore.metrics.lobes import Lobes
from brdfcore.tables.base.folding import folded_sample, folds
from brdfcore.tables.base.half_lattice import HalfLattice, check_linear, check_shape, steps_z
from brdfcore.tables.base.layout import Layout
from brdfcore.tables.base.table import DELTA_NODES, BuildOptions, Progress

if TYPE_CHECKING:  # the fit needs the compiler, which a list of representations does not
    from brdfcore.tables.lobe_grid.fit import LobeFitter

#: Nodes that `candidates` tries for a tolerance.
LADDER = (600, 1_200, 2_500, 5_000, 10_000, 16_000, 24_000, 36_000, 54_000, 80_000, 120_000, 180_000)
#: What u is taken about, as the attribute `centre` names it and the kernels number it.
CENTRES = {"half_vector": 0, "mirror_direction": 1, "light": 2}
#: Words of guides and maps beside the nodes, without the map of the azimuth.
_WORDS = 2 * 1089 + 2 * 321


class LobeGrid(HalfLattice):
    """f_r = 2^(guide_h(u) + guide_d(theta_i)) K(theta_i, theta_o) values(u, theta_i, azimuth).

    u is the distance from the centre of the lobe: theta_h of the half vector (microfacet lobes), the viewer's angle
    from the mirror direction (Phong's), or from the light (retro-reflection); azimuth is about that centre. Each
    incidence has nodes of its own, so that the error at grazing light is as small as anywhere; at theta_i = 0 the
    azimuth has no meaning and the slice is the mean over it. Coordinates, maps, K: `kernels.tables.lobe_grid`.

    Arrays:

        values  float16 (n_u, n_i, n_p, C)  nodes, times `scale`: relative precision 2^-11, and half the bytes
        guide_h uint16 (1089,)  exponent of 2 over u, 16 steps an octave: guide_low + guide_step word
        guide_d uint16 (321,)   exponent of 2 over w = c_i/(1 + s_i), 16 steps an octave: guide_step word
        map_h   uint16 (1089,)  node position over u, in 1/65536 of the way to the last node
        map_d   uint16 (321,)   node position over w
        map_p   uint16 (n,)     node position over the azimuth's diamond angle, 64 steps a quarter turn

    Not folded by reciprocity. A table made for some angles only (`seen`) has its nodes where these are; beyond them it
    continues, and `status` says EXTRAPOLATED. Look-ups run in the type of the angles.
    """

    name = "lobe_grid"
    SUMMARY = "theta_i, distance and azimuth about the lobe's centre, guides, float16 nodes, trilinear"
    PARAMETERS = (
        Parameter("shape", "", "nodes along distance, theta_i, azimuth", "48,28,24", kind="text"),
        Parameter("interpolation", "", "between the nodes", "linear", kind="choice", choices=("linear",)),
    )

    @staticmethod
    def _module() -> tuple[Any, Any]:
        from brdfcore.kernels.tables import lobe_grid

        return lobe_grid, lobe_grid.lobe_scale

    def _kind(self) -> dict[str, Any]:
        return {"centre": next(name for name, number in CENTRES.items() if number == self.mirror)}

    @classmethod
    def _read_kind(cls, attributes: Mapping[str, Any]) -> int:
        centre = attributes.get("centre")
        if not isinstance(centre, str) or centre not in CENTRES:
            raise cls._bad("centre", repr(centre)[:40], " or ".join(CENTRES))
        return CENTRES[centre]

    @classmethod
    def _steps_z(cls, bilateral: bool) -> set[int]:
        return {steps_z(bilateral, False)}

    # ---- build --------------------------------------------------------------------------------

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Fit nodes to `source`; see `fit` and `Table.build`."""
        from brdfcore.tables.lobe_grid.fit import LobeLayout, shape_for

        check_linear(cls.name, options.interpolation)
        bilateral, _ = folds(source, options)
        shape = options.shape or shape_for(LADDER[7], bilateral)
        check_shape(shape, "distance, theta_i, azimuth", len(source.channels))
        fitter, layout = (options.prepared or _prepared(source, options))(progress)
        if isinstance(layout, LobeLayout):
            layout = layout.aligned(shape[1], fitter.knots)
        return cls.fitted(source, options, fitter, layout, shape, bilateral, False, progress)

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        from brdfcore.tables.lobe_grid.fit import shape_for

        bilateral, _ = folds(source, options)
        options = replace(options, prepared=options.prepared or _prepared(source, options))
        each = 2 * len(source.channels)
        turns = 1 if bilateral else 2
        beside = 2 * (_WORDS + 1 + steps_z(bilateral, False))
        beside += DELTA_NODES * 8 * len(source.channels) if source.has_delta else 0
        sizes: Iterable[int] = [n * turns for n in LADDER]
        if max_bytes is not None:
            sizes = (max((max_bytes - beside) // each, 64),)
        shapes = [shape_for(n, bilateral) for n in sizes]
        return [replace(options, shape=s, nbytes=each * s[0] * s[1] * s[2] + beside) for s in shapes]


def _prepared(source: Brdf, options: BuildOptions) -> Callable[[Progress | None], tuple[LobeFitter, Layout]]:
    """The source as the table will see it, and where its nodes belong: found when first asked for."""
    bilateral, reciprocal = folds(source, options)
    sample = folded_sample(source, bilateral, reciprocal)
    found: list[tuple[LobeFitter, Layout]] = []

    def prepared(progress: Progress | None) -> tuple[LobeFitter, Layout]:
        from brdfcore.tables.lobe_grid.fit import LobeFitter

        if not found:
            if progress is not None:
                progress(0, 1, "placing the nodes")
            lobes = options.lobes or Lobes([source], 1)
            knots = [float(t) for t in getattr(source, "incidence_knots", ())]
            fitter = LobeFitter(sample, len(source.channels), bilateral, options.seen, lobes, knots)
            found.append((fitter, fitter.layout()))
            if progress is not None:
                progress(1, 1, "placing the nodes")
        return found[0]

    return prepared
