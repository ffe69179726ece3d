"""The plug-in itself."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB
from brdfcore.base.errors import InputError, missing_extra

#: Name of the plug-in.
PLUGIN = "brdf_table"
#: Materials given to `held`, by the number that stands for them.
_held: dict[int, Brdf] = {}


def held(material: Brdf) -> int:
    """A number for the property `material` of the plug-in, which stands for a material that has no file."""
    number = len(_held) + 1
    _held[number] = material
    return number


def register(name: str = PLUGIN) -> None:
    """Register the plug-in with the variant that is set; to be called after each `mitsuba.set_variant`.

    Its properties: `filename`, a file of any format that `brdfcore.read` knows; or `material`, a number from `held`.
    Raises `MissingExtraError` without Mitsuba, `InputError` without a variant or for a spectral or polarised one.
    """
    try:
        import mitsuba as mi
    except ImportError as error:
        raise missing_extra("mitsuba", "mitsuba", "a BSDF of Mitsuba") from error
    variant = mi.variant()
    if variant is None or "spectral" in variant or "polarized" in variant:
        raise InputError(
            "no_variant",
            f"the variant is {variant}: first set one of RGB or monochromatic light, as llvm_ad_rgb",
            where="variant",
            got=variant,
            expected="a variant in rgb or mono",
        )
    mi.register_bsdf(name, _plugin_class(mi))


def material_of(properties: Any) -> Brdf:
    """The material that a plug-in's properties name, in R, G, B or one channel."""
    if "material" in properties:
        number = int(properties["material"])
        if number not in _held:
            said = f"material = {number}: not a number that brdfcore.mitsuba.held gave in this process"
            raise InputError("unknown_material", said, where="material", got=number)
        b = _held[number]
    else:
        from brdfcore.formats.io.files import read

        b = read(str(properties["filename"]))
    if len(b.channels) > 1 and b.channels != RGB:
        from brdfcore.base.colour import to_rgb

        b = to_rgb(b)
    if b.has_delta:
        warnings.warn("brdf_table: the mirror part of the material is left out", UserWarning, stacklevel=2)
    return b


def _table(b: Brdf) -> Any:
    from brdfcore.build.tabulate import tabulate
    from brdfcore.tables.half_difference import HalfDifference

    return b if isinstance(b, HalfDifference) else tabulate(b, "half_difference", max_bytes=600_000)


def _plugin_class(mi: Any) -> Any:
    import drjit as dr

    from brdfcore.sampling.quantiles import make_sampler

    scalar = mi.variant().startswith("scalar")

    class BrdfTable(mi.BSDF):  # type: ignore[misc]
        """f_r of a table, times cos theta_o."""

        def __init__(self, properties: Any) -> None:
            mi.BSDF.__init__(self, properties)
            b = material_of(properties)
            if scalar:
                self.material = b
            else:
                from brdfcore.mitsuba.lookup import HalfDifferenceLookup, QuantileDraw

                self.lookup, self.drawing = HalfDifferenceLookup(mi, _table(b)), QuantileDraw(mi, make_sampler(b))
            # without both a scene stays dark under a point light, and 15 % too dark under a sky
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags]
            self.m_flags = flags

        def _f(self, wi: Any, wo: Any) -> Any:
            if not scalar:
                return self.lookup.f(wi, wo)
            found = self.material.evaluate_vectors(_plain(wi), _plain(wo))
            return mi.Color3f(*(float(x) for x in np.broadcast_to(found, 3)))

        def _spectrum(self, value: Any) -> Any:
            return value if dr.size_v(mi.Spectrum) == 3 else mi.Spectrum(dr.mean(value))

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """f_r cos theta_o."""
            above = (si.wi.z > 0) & (wo.z > 0) & active
            if scalar and not above:
                return mi.Spectrum(0.0)
            value = self._f(_raised(mi, si.wi, above), _raised(mi, wo, above)) * wo.z
            return dr.select(above, self._spectrum(value), 0.0)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """1/sr of solid angle of wo."""
            above = (si.wi.z > 0) & (wo.z > 0) & active
            if scalar:
                return float(self.material.pdf(_plain(si.wi), _plain(wo))) if above else 0.0
            found = self.drawing.density(_raised(mi, si.wi, above), _raised(mi, wo, above))
            return dr.select(above, found, 0.0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """Both."""
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            """(BSDFSample3f, f_r cos theta_o / pdf)."""
            bs = dr.zeros(mi.BSDFSample3f)
            above = (si.wi.z > 0) & active
            # an index of 0 would end every path at the first Russian roulette
            bs.eta, bs.sampled_component = 1.0, 0
            bs.sampled_type = mi.UInt32(int(mi.BSDFFlags.GlossyReflection))
            if scalar:
                if not above:
                    return bs, mi.Spectrum(0.0)
                drawn = self.material.sample(_plain(si.wi), np.minimum([float(x) for x in sample2], 1 - 2.0**-53))
                bs.wo, bs.pdf = mi.Vector3f(*(float(x) for x in drawn.wo)), float(drawn.pdf)
            else:
                u = mi.Point2f(dr.clip(sample2.x, 0, 1 - 2.0**-24), dr.clip(sample2.y, 0, 1 - 2.0**-24))
                wo, density = self.drawing.draw(_raised(mi, si.wi, above), u)
                above &= (wo.z > 0) & dr.isfinite(density) & (density > 0)
                bs.wo, bs.pdf = wo, dr.select(above, density, 0.0)
            value = self.eval(ctx, si, bs.wo, above)
            return bs, dr.select(above, value / dr.select(bs.pdf > 0, bs.pdf, 1.0), 0.0)

        def to_string(self) -> str:
            """Name of the plug-in."""
            return f"{PLUGIN}[]"

    return BrdfTable


def _plain(w: Any) -> Any:
    return np.array([float(w.x), float(w.y), float(w.z)])


def _raised(mi: Any, w: Any, above: Any) -> Any:
    """w, or the normal where it may not be looked up."""
    import drjit as dr

    return dr.select(above, w, mi.Vector3f(0, 0, 1))
