"""Out to the renderers: `python -m tests.benchmarks.renderers [files sampling speed picture]`; all without arguments.

files     any material as an RGL file of at most 2 MB: L1 inside Mitsuba's `measured` against the source, on draws of
          the source's own sampler; by angle of incidence; bytes; seconds.
sampling  relative standard deviation of the weights at 30 and 70 degrees.
speed     samples a second with their RGB weights, and look-ups by the plug-in, against `measured` in the same process.
picture   a plate under a sky by the .bsdf file, by the plug-in, and its exact radiance by quadrature.

Needs the extra `mitsuba` and an LLVM that its llvm variants run with (DRJIT_LIBLLVM_PATH names one).
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.kernels.machine import launch
from tests import shared
from tests.benchmarks.timing import interleaved, machine, ratio
from tests.support import rendering

SEED, DRAWS = 20_261_201, 60_000
INCIDENCES = (10.0, 30.0, 50.0, 70.0, 80.0, 85.0)


class Function(bc.Brdf):
    """A material seen through `evaluate` alone."""

    def __init__(self, b: bc.Brdf) -> None:
        super().__init__()
        self.whole, self.channels, self.bilateral = b, b.channels, b.bilateral
        self.reciprocal, self.non_negative = b.reciprocal, b.non_negative
        if hasattr(b, "incidence_knots"):
            self.incidence_knots = b.incidence_knots

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        self.whole.evaluate(theta_i, theta_o, delta_phi, out=out)
        return True


def sources() -> Iterator[tuple[str, bc.Brdf]]:
    for alpha in (0.3, 0.1, 0.03, 0.01):
        yield f"GGX {alpha}", bc.model("ggx", roughness=alpha, ior="gold")
    yield "Oren-Nayar", bc.model("oren_nayar")
    for name in shared.rgl_names():
        yield name, Function(bc.read(shared.rgl_path(name)))
    data = shared.FOLDER / "data"
    for path in sorted((data / "astm").glob("*.astm")):
        yield f"{path.stem} RGB", bc.to_rgb(bc.read(path))
        yield f"{path.stem} 31 bands", bc.read(path)
    yield "Zemax anodise", bc.read(data / "zemax" / "AnoBlackEC1onAlum.bsdf")


def _measured(mi: Any, path: Path) -> Any:
    return mi.load_dict({"type": "measured", "filename": str(path)})


def _inside(mi: Any, bsdf: Any, angles: tuple[Any, Any, Any]) -> Any:
    """f cos theta_o, (n, 3)."""
    import drjit as dr

    theta_i, theta_o, delta_phi = (x.astype(np.float32) for x in angles)
    si = dr.zeros(mi.SurfaceInteraction3f, theta_i.size)
    si.wi = mi.Vector3f(np.sin(theta_i), np.zeros_like(theta_i), np.cos(theta_i))
    wo = mi.Vector3f(np.sin(theta_o) * np.cos(delta_phi), np.sin(theta_o) * np.sin(delta_phi), np.cos(theta_o))
    return np.array(bsdf.eval(mi.BSDFContext(), si, wo)).T


def files(mi: Any) -> None:
    heads = "  ".join(f"{t:>5g}" for t in INCIDENCES)
    print(f"\n{'material':20} {'bytes':>9} {'seconds':>8} {'L1':>7}   at {heads} degrees")
    rng = np.random.default_rng(SEED)
    for name, b in sources():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "made.bsdf"
            start = time.perf_counter()
            table = bc.write(b, path, format="rgl")
            seconds = time.perf_counter() - start
            ours = len(b.channels) > 3  # Mitsuba in RGB reads no spectra: our own look-up, which agrees with it
            bsdf = None if ours else _measured(mi, path)

            def error(theta_i: Any, b: Any = b, table: Any = table, bsdf: Any = bsdf, ours: bool = ours) -> float:
                wi = np.stack([np.sin(theta_i), 0 * theta_i, np.cos(theta_i)], axis=-1)
                drawn = b.sample(wi, rng.random((theta_i.size, 2)))
                used = drawn.wo[:, 2] > 1e-3
                wo, pdf = drawn.wo[used], drawn.pdf[used]
                theta_o = np.arccos(np.minimum(wo[:, 2], 1))
                angles = (theta_i[used], theta_o, np.arctan2(wo[:, 1], wo[:, 0]))
                expected = b.evaluate(*angles) * wo[:, 2:]
                found = table.evaluate(*angles) * wo[:, 2:] if ours else _inside(mi, bsdf, angles)
                expected = np.broadcast_to(expected, found.shape)
                return float((np.abs(found - expected) / pdf[:, None]).sum() / (expected / pdf[:, None]).sum())

            # light from everywhere; nothing beyond half a degree above the horizon, where float32 directions end
            whole = error(np.arcsin(np.sqrt(rng.uniform(1e-4, 1 - 1e-4, DRAWS))))
            rows = "  ".join(f"{error(np.full(20_000, np.radians(t))):.3f}" for t in INCIDENCES)
            print(f"{name:20} {path.stat().st_size:9} {seconds:8.2f} {whole:7.4f}      {rows}", flush=True)


def sampling() -> None:
    print(f"\n{'weights of sample':20} {'30 deg':>7} {'70 deg':>7}   seconds to prepare")
    found = []
    for name in shared.rgl_names():
        b = bc.read(shared.rgl_path(name))
        start = time.perf_counter()
        b._made_sampler()
        seconds = time.perf_counter() - start
        u = np.random.default_rng(SEED).random((100_000, 2))
        row = []
        for theta in np.radians([30.0, 70.0]):
            weight = b.sample([np.sin(theta), 0, np.cos(theta)], u).weight.mean(axis=1)
            row.append(float(weight.std() / weight.mean()))
        found += row
        print(f"{name:20} {row[0]:7.3f} {row[1]:7.3f}   {seconds:.2f}", flush=True)
    print(f"median {np.median(found):.3f}, worst {max(found):.3f}")


def speed(mi: Any) -> None:
    import drjit as dr

    import brdfcore.mitsuba as ours

    ours.register()
    path = shared.rgl_path("satin_purple")
    table = bc.tabulate(bc.read(path), "half_difference", max_bytes=600_000)
    measured = _measured(mi, path)
    plugin = mi.load_dict({"type": "brdf_table", "material": ours.held(table)})
    n = 1_000_000
    rng = np.random.default_rng(SEED)
    theta, phi = np.arcsin(np.sqrt(rng.random(n))), rng.uniform(-np.pi, np.pi, n)
    wi = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1).astype(np.float32)
    u = rng.random((n, 2)).astype(np.float32).clip(0, 1 - 2**-24)
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.wi = mi.Vector3f(wi.T)
    numbers, context = mi.Point2f(u.T), mi.BSDFContext()
    wo = mi.Vector3f(table.sample(wi, u).wo.T)
    dr.eval(si, numbers, wo)

    def jit(call: Any) -> Any:
        def timed() -> None:
            dr.eval(call())
            dr.sync_thread()

        return timed

    runs = {
        "ours, sample": lambda: table.sample(wi, u),
        "measured, sample": jit(lambda: measured.sample(context, si, 0.5, numbers)),
        "plug-in, sample": jit(lambda: plugin.sample(context, si, 0.5, numbers)),
        "measured, eval": jit(lambda: measured.eval(context, si, wo)),
        "plug-in, eval": jit(lambda: plugin.eval(context, si, wo)),
    }
    found = interleaved(runs, rounds=9)
    print(f"\n{n} at a time, RGB; {machine()}")
    for name, spread in found.items():
        low, middle, high = (n / s / 1e6 for s in (spread.high, spread.median, spread.low))
        print(f"{name:20} {middle:7.1f} million/s ({low:.1f} .. {high:.1f})")
    pairs = (
        ("measured, sample", "ours, sample"),
        ("measured, sample", "plug-in, sample"),
        ("measured, eval", "plug-in, eval"),
    )
    for name, call in runs.items():  # of all threads: what other work on the machine does not change
        start = time.process_time()
        with launch.one_thread():
            for _ in range(5):
                call()
        print(f"{name:20} {5 * n / (time.process_time() - start) / 1e6:7.1f} million a second of processor time")
    for slow, fast in pairs:
        low, middle, high = ratio(found[slow], found[fast])
        print(f"{fast} is {middle:.2f} x {slow} ({low:.2f} .. {high:.2f})")


def picture(mi: Any) -> None:
    """Radiance of a plate under a sky that brightens with the height, seen from 40 degrees: L = int f cos L_sky."""
    import brdfcore.mitsuba as ours

    ours.register()
    path = shared.rgl_path("satin_purple")
    b = bc.read(path)
    table = bc.tabulate(b, "half_difference", max_bytes=600_000)
    rows = 1024  # of a coarse one the renderer's interpolation shows
    pixels = np.ones((rows, 64, 3), np.float32)
    height = np.cos((np.arange(rows) + 0.5) / rows * np.pi)
    pixels *= (1 + 0.8 * height)[:, None, None]
    view = np.radians(40.0)
    up = [np.sin(view), 0.0, np.cos(view)]
    # its map's zenith is +y: turned to +z
    turn = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    plugins = {
        "measured": {"type": "measured", "filename": str(path)},
        "plug-in": {"type": "brdf_table", "material": ours.held(table)},
    }
    drawn = table.sample(up, np.random.default_rng(SEED).random((2_000_000, 2)))
    terms = drawn.weight * (1 + 0.8 * drawn.wo[:, 2:])
    expected, spread = terms.mean(axis=0), terms.std(axis=0) / np.sqrt(len(terms))
    print(f"\nplate under a sky, our own sampler   {expected} +- {spread}")
    for name, plugin in plugins.items():
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": 2},
                "sky": {"type": "envmap", "bitmap": mi.Bitmap(pixels), "to_world": turn},
                "plate": {"type": "rectangle", "bsdf": plugin},
                "sensor": {
                    "type": "perspective",
                    "fov": 0.1,
                    "to_world": mi.ScalarTransform4f().look_at([3 * x for x in up], [0, 0, 0], [0, 1, 0]),
                    "film": {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}},
                },
            }
        )
        image = np.array(mi.render(scene, spp=256, seed=5)).reshape(-1, 3)
        mean, error = image.mean(axis=0), image.std(axis=0) / np.sqrt(len(image))
        sigma = (mean - expected) / np.hypot(error, spread)
        print(f"{name:36} {mean} +- {error}: {mean / expected - 1} of it, {sigma.round(1)} standard errors", flush=True)


def main(parts: list[str]) -> None:
    parts = parts or ["files", "sampling", "speed", "picture"]
    if "sampling" in parts:
        sampling()
    if why := rendering.unusable():
        print(f"without Mitsuba: {why}")
        return
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    print(f"Mitsuba {mi.__version__}, llvm_ad_rgb")
    for name, part in (("files", files), ("speed", speed), ("picture", picture)):
        if name in parts:
            part(mi)


if __name__ == "__main__":
    main(sys.argv[1:])
