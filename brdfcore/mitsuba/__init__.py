"""A material of ours as a BSDF of Mitsuba 3: `brdfcore.mitsuba.register()`, then the plug-in "brdf_table".

    import mitsuba as mi, brdfcore.mitsuba
    mi.set_variant("llvm_ad_rgb")
    brdfcore.mitsuba.register()
    bsdf = mi.load_dict({"type": "brdf_table", "filename": "paint.h5"})

A `half_difference` table is looked up as it is, in Dr.Jit (llvm, cuda; in scalar variants by our own kernels); anything
else is tabulated as one first. Directions are drawn through the quantiles that `Brdf.sample` draws through. `wi`, in
Mitsuba the direction towards the camera, is our theta_i, as in Mitsuba's own `measured`: it matters where a material
is not reciprocal. Needs the extra `mitsuba`. Reflection on the front; a mirror part is left out, with a warning.
"""

from __future__ import annotations

from brdfcore.mitsuba.plugin import PLUGIN, held, register

__all__ = ["PLUGIN", "held", "register"]
