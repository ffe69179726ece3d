"""The plug-in in Mitsuba: its numbers against ours, its draws against its density, and a furnace."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from tests.support import rendering

pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="the mitsuba extra is not installed")

_COMPARED = """
import json, sys
import numpy as np, drjit as dr, mitsuba as mi
import brdfcore as bc, brdfcore.mitsuba
mi.set_variant(sys.argv[1])
brdfcore.mitsuba.register()
table = bc.open_table(sys.argv[2])
bsdf = mi.load_dict({"type": "brdf_table", "filename": sys.argv[2]})
many = not sys.argv[1].startswith("scalar")
n = 20_000 if many else 20
rng = np.random.default_rng(0)
theta, phi = np.arccos(rng.uniform(0.05, 1, n)), rng.uniform(-3, 3, n)
wi = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
u = rng.random((n, 2)).astype(np.float32).clip(0, 1 - 2**-24)
drawn = table.sample(wi, u.astype(float))
context = mi.BSDFContext()


def asked(w, o, u):
    si = dr.zeros(mi.SurfaceInteraction3f, n) if many else dr.zeros(mi.SurfaceInteraction3f)
    si.wi = w
    bs, weight = bsdf.sample(context, si, 0.5, u)
    return bsdf.eval(context, si, o), bsdf.pdf(context, si, o), bs.wo, bs.pdf, weight


if many:
    vector = lambda a: mi.Vector3f(a.T.astype(np.float32))
    found = [np.array(x).T for x in asked(vector(wi), vector(drawn.wo), mi.Point2f(u.T))]
else:
    each = [asked(mi.Vector3f(*w), mi.Vector3f(*o), mi.Point2f(*map(float, v))) for w, o, v in zip(wi, drawn.wo, u)]
    found = [np.array([np.ravel(x) for x in column]) for column in zip(*each)]
value, pdf, wo, wo_pdf, weight = found
expected = table.evaluate_vectors(wi, drawn.wo) * drawn.wo[:, 2:]
far = lambda a, b: float(np.quantile(np.abs(a - b) / (np.abs(b) + 0.01 * np.abs(b).mean()), 0.99))
print(json.dumps({
    "eval": far(value, expected), "pdf": far(pdf.ravel(), drawn.pdf), "wo": far(wo, drawn.wo),
    "sample pdf": far(wo_pdf.ravel(), drawn.pdf), "weight": far(weight, drawn.weight),
}))
"""


def compared(variant: str, path: Path) -> dict[str, float]:
    import json

    found: dict[str, float] = json.loads(rendering.run(_COMPARED, variant, path).splitlines()[-1])
    return found


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("table") / "gold.h5"
    metals = bc.model("cook_torrance", roughness=0.2, ior=["gold", "copper", "silver"], diffuse=0.1, specular=0.8)
    bc.tabulate(metals, "half_difference", shape=(24, 12, 13)).save(path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb", "llvm_mono"])
def test_answers_as_our_own_kernels(variant: str, table: Path) -> None:
    if variant.startswith("llvm") and (why := rendering.unusable()):
        pytest.skip(why)
    if variant == "llvm_mono" and "llvm_mono" not in rendering.run("import mitsuba; print(mitsuba.variants())"):
        pytest.skip("this Mitsuba has no llvm_mono")
    found = compared(variant, table)
    assert found["eval"] < 1e-4
    assert found["pdf"] < 1e-3
    assert found["sample pdf"] < 1e-3
    assert found["weight"] < 1e-3
    assert found["wo"] < 1e-4


_LIT = """
import sys
import numpy as np, drjit as dr, mitsuba as mi
import brdfcore.mitsuba
mi.set_variant("llvm_ad_rgb")
brdfcore.mitsuba.register()
lamp = {"type": "point", "position": [0, 0, 5], "intensity": 25.0}
light = {"sky": {"type": "constant", "radiance": 1.0}, "lamp": lamp}
scene = mi.load_dict({
    "type": "scene", "integrator": {"type": "path"}, "light": light[sys.argv[2]],
    "plane": {"type": "rectangle", "bsdf": {"type": "brdf_table", "filename": sys.argv[1]}},
    "sensor": {"type": "perspective", "fov": 2, "to_world": mi.ScalarTransform4f().look_at(
        [3 * np.sin(0.7), 0, 3 * np.cos(0.7)], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}}},
})
print(*np.array(mi.render(scene, spp=256, seed=3)).reshape(-1, 3).mean(axis=0))
"""


@pytest.mark.slow
def test_lit_as_it_should_be(table: Path) -> None:
    """Under a sky of radiance 1 it has its albedo, not 15 % less; under a lamp, f cos of the one direction."""
    if why := rendering.unusable():
        pytest.skip(why)
    ours = bc.open_table(table)
    found = np.array(rendering.run(_LIT, table, "sky").split(), float)
    assert found == pytest.approx(ours.albedo(0.7), rel=5e-3)
    found = np.array(rendering.run(_LIT, table, "lamp").split(), float)
    # over the pixels the lamp's direction varies by a degree; the radiance is intensity / 25 f cos
    assert found == pytest.approx(ours.evaluate(0.7, 0.0, 0.0), rel=0.03)


_CHI = """
import os, sys
import mitsuba as mi, drjit as dr
import brdfcore.mitsuba
os.chdir(sys.argv[2])
mi.set_variant("llvm_ad_rgb")
brdfcore.mitsuba.register()
from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain
for theta in (0.1, 0.7, 1.3):
    wi = [float(dr.sin(theta)), 0.0, float(dr.cos(theta))]
    sample, pdf = BSDFAdapter("brdf_table", f'<string name="filename" value="{sys.argv[1]}"/>', wi=wi)
    test = ChiSquareTest(domain=SphericalDomain(), sample_func=sample, pdf_func=pdf, sample_dim=3, res=301, ires=8)
    print("passed", test.run(0.001, 9))
"""


@pytest.mark.slow
def test_chi_square_by_mitsuba(table: Path, tmp_path: Path) -> None:
    if why := rendering.unusable():
        pytest.skip(why)
    assert rendering.run(_CHI, table, tmp_path).count("passed True") == 3


def test_what_is_refused() -> None:
    code = """
import mitsuba as mi, brdfcore as bc, brdfcore.mitsuba as bm
for variant in (None, "scalar_spectral"):
    if variant: mi.set_variant(variant)
    try: bm.register()
    except bc.InputError as error: print(error.context["where"])
class Properties(dict): pass
from brdfcore.mitsuba.plugin import material_of
try: material_of(Properties(material=7))
except bc.InputError as error: print(error.context["where"])
print(len(material_of(Properties(material=bm.held(bc.model("lambert")))).channels))
"""
    assert rendering.run(code).split() == ["variant", "variant", "material", "1"]
