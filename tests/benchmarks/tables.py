"""Tables on sharp and plain materials, accuracy beside speed: `python -m tests.benchmarks.tables [--speed-only ...]`.

L1 is "reference L1" (sum c_i c_o |e| / sum c_i c_o |f| on the directions of ../shared/reference, each half apart, the
worse one quoted) for the measured files, and the estimator of `metrics` for analytic materials. kB = 1000 bytes by
`nbytes`. Peers run in the same process, interleaved; what is absent is named and left out.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.base.geometry import vectors_from_angles
from brdfcore.kernels.machine import launch
from tests import shared
from tests.benchmarks.accuracy import reference_l1
from tests.benchmarks.timing import interleaved, machine, ratio

HALVES = (slice(0, 2000), slice(2000, None))


def measured(max_bytes: int) -> None:
    """The ten files within `max_bytes`, three channels."""
    print(f"\nten measured files, half_difference, max_bytes = {max_bytes}")
    heads = f"{'bytes':>9} {'lobe':>7} {'uniform':>8} {'p99 |ln|':>9} {'t.error l1':>11} {'build s':>8}  nodes"
    print(f"{'material':20} {heads}")
    worst, tails = [], []
    for name in shared.rgl_names():
        source = bc.read(shared.rgl_path(name))
        start = time.perf_counter()
        table = bc.tabulate(source, "half_difference", max_bytes=max_bytes)
        seconds = time.perf_counter() - start
        theta_i, theta_o, delta_phi, reference = shared.rgl_reference(name)
        found = table.evaluate(theta_i, theta_o, delta_phi)
        lobe, uniform = (reference_l1(theta_i, theta_o, reference, found, half) for half in HALVES)
        floor = 1e-6 * float(source.albedo(0.0).mean()) / np.pi
        usable = (found >= 0) & (reference >= 0)
        p99 = float(np.quantile(np.abs(np.log((found[usable] + floor) / (reference[usable] + floor))), 0.99))
        worst.append(max(lobe, uniform))
        tails.append(p99)
        shape = " x ".join(str(n) for n in table.to_arrays()["values"].shape[:3])
        print(
            f"{name:20} {table.nbytes:9} {lobe:7.4f} {uniform:8.4f} {p99:9.3f} {table.error['l1']:11.4f} "
            f"{seconds:8.1f}  {shape}",
            flush=True,
        )
    print(f"worst {max(worst):.4f}, median {np.median(worst):.4f}, worst p99 {max(tails):.3f}")


def analytic(max_bytes: int) -> None:
    """Gold under GGX and Beckmann at falling roughness, one channel."""
    print(f"\ngold, one channel, half_difference, max_bytes = {max_bytes}")
    print(f"{'lobe':26} {'bytes':>8} {'L1':>8} {'+-':>8} {'albedo bias to 85 deg':>22} {'build s':>8}")
    for distribution in ("ggx", "beckmann"):
        for roughness in (1.0, 0.3, 0.1, 0.03, 0.01, 0.003):
            source = bc.model("cook_torrance", roughness=roughness, ior="gold", distribution=distribution)
            start = time.perf_counter()
            table = bc.tabulate(source, "half_difference", max_bytes=max_bytes)
            seconds = time.perf_counter() - start
            pairs = zip(table.error["albedo_bias"]["theta_i"], table.error["albedo_bias"]["bias"])
            bias = max((b for t, b in pairs if t <= np.radians(85.001)), key=abs)
            print(
                f"{distribution + ', roughness ' + format(roughness, 'g'):26} {table.nbytes:8} "
                f"{table.error['l1']:8.5f} {table.error['l1_stderr']:8.5f} {bias:+22.5f} {seconds:8.1f}",
                flush=True,
            )


def twenty_models() -> dict[str, bc.Brdf]:
    """Twenty analytic materials of all kinds and roughnesses."""
    made = {
        "lambert": bc.model("lambert"),
        "lambert rgb": bc.model("lambert", reflectance=[0.8, 0.4, 0.1]),
        "oren_nayar": bc.model("oren_nayar", sigma=0.5),
        "phong 20": bc.model("phong", exponent=20),
        "phong 2000": bc.model("phong", exponent=2000),
        "blinn_phong 200": bc.model("blinn_phong", exponent=200),
        "ward .2": bc.model("ward", roughness=0.2),
        "ward .02": bc.model("ward", roughness=0.02),
        "diffuse + glass coat": bc.model("cook_torrance", diffuse=0.5, specular=0.5, roughness=0.05, ior="glass"),
        "diffuse + spike": 0.7 * bc.model("lambert") + 0.02 * bc.model("ggx", roughness=0.01, ior="silver"),
    }
    for distribution in ("ggx", "beckmann"):
        for roughness in (0.6, 0.2, 0.05, 0.01, 0.003):
            label = f"gold {distribution} {roughness:g}"
            made[label] = bc.model("cook_torrance", roughness=roughness, ior="gold", distribution=distribution)
    return made


def tolerance(asked: float) -> None:
    """`tabulate(tolerance=)` of ten files and twenty models, measured again on other directions."""
    print(f"\ntolerance = {asked:g}, measured again on 400,000 fresh directions")
    heads = f"{'chosen':16} {'bytes':>9} {'t.error l1':>11} {'fresh l1':>9} {'+-':>8} {'build s':>8}"
    print(f"{'material':24} {heads}")
    sources: dict[str, Any] = {f"measured {name}": name for name in shared.rgl_names()} if shared.RGL.exists() else {}
    sources |= twenty_models()
    worst = 0.0
    for label, source in sources.items():
        if isinstance(source, str):
            source = bc.read(shared.rgl_path(source))
        start = time.perf_counter()
        table = bc.tabulate(source, tolerance=asked)
        seconds = time.perf_counter() - start
        again = bc.compare(source, table, directions=400_000, seed=4_242_424)
        worst = max(worst, again.l1)
        print(
            f"{label:24} {table.name:16} {table.nbytes:9} {table.error['l1']:11.5f} {again.l1:9.5f} "
            f"{again.l1_stderr:8.5f} {seconds:8.1f}",
            flush=True,
        )
    print(f"worst {worst:.5f}: {'within' if worst <= 1.1 * asked else 'ABOVE'} 1.1 x the tolerance")


def mitsuba_measured(path: Any, angles: list[Any]) -> Any:
    """A function that evaluates Mitsuba's `measured` plug-in on the same directions, or None (the reason printed)."""
    try:
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
    except (ImportError, RuntimeError, AttributeError) as error:
        print(f"left out: Mitsuba ({error})")
        return None
    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    theta_i, theta_o, delta_phi = angles
    wi = mi.Vector3f(np.sin(theta_i), np.zeros_like(theta_i), np.cos(theta_i))
    wo = mi.Vector3f(np.sin(theta_o) * np.cos(delta_phi), np.sin(theta_o) * np.sin(delta_phi), np.cos(theta_o))
    dr.eval(wi, wo)
    interaction = dr.zeros(mi.SurfaceInteraction3f, theta_i.size)
    interaction.wi = wi
    dr.eval(interaction)
    context = mi.BSDFContext()

    def run() -> None:
        value = bsdf.eval(context, interaction, wo)
        dr.eval(value)
        dr.sync_thread()

    return run


def speed(n: int, rounds: int) -> None:
    """Look-ups a second of each representation of one material, and of Mitsuba, from angles (Mitsuba: from vectors)."""
    name = "chm_light_blue"
    rng = np.random.default_rng(3)
    angles = [rng.uniform(0, top, n).astype(np.float32) for top in (1.57, 1.57, 3.14)]
    runs: dict[str, Any] = {}
    if shared.RGL.exists():
        source = bc.read(shared.rgl_path(name))
        half = bc.tabulate(source, "half_difference", max_bytes=768_000)
        grid = bc.tabulate(source, "angle_grid", max_bytes=768_000)
        out = np.empty((n, 3), np.float32)
        runs["half_difference rgb 768 kB"] = lambda: half.evaluate(*angles, out=out)
        vectors = [np.ascontiguousarray(v, np.float32) for v in vectors_from_angles(*(a.astype(float) for a in angles))]
        runs["half_difference rgb 768 kB, vectors"] = lambda: half.evaluate_vectors(*vectors, out=out)
        runs["angle_grid rgb 768 kB"] = lambda: grid.evaluate(*angles, out=out)
        runs["vndf_warp rgb"] = lambda: source.evaluate(*angles, out=out)
        if (peer := mitsuba_measured(shared.rgl_path(name), angles)) is not None:
            runs["Mitsuba measured rgb"] = peer
    else:
        print("left out: measured materials (../shared is absent)")
    gold = bc.model("cook_torrance", roughness=0.1, ior="gold")
    half_one = bc.tabulate(gold, "half_difference", max_bytes=256_000)
    grid_one = bc.tabulate(gold, "angle_grid", max_bytes=256_000)
    single = np.empty((n, 1), np.float32)
    runs["half_difference 1 channel 256 kB"] = lambda: half_one.evaluate(*angles, out=single)
    runs["angle_grid 1 channel 256 kB"] = lambda: grid_one.evaluate(*angles, out=single)
    times = interleaved(runs, rounds=rounds)
    print(f"\n{n:.0e} look-ups, float32, {launch.threads()} threads, median of {rounds} interleaved rounds")
    for label, spread in times.items():
        rates = [n / s / 1e6 for s in (spread.median, spread.high, spread.low)]
        print(f"{label:34} {rates[0]:7.1f} million/s ({rates[1]:.0f} .. {rates[2]:.0f})")
    pairs = [
        ("half_difference rgb 768 kB", "Mitsuba measured rgb"),
        ("half_difference rgb 768 kB, vectors", "Mitsuba measured rgb"),
        ("vndf_warp rgb", "Mitsuba measured rgb"),
        ("half_difference rgb 768 kB", "angle_grid rgb 768 kB"),
        ("half_difference 1 channel 256 kB", "angle_grid 1 channel 256 kB"),
    ]
    for ours, other in pairs:
        if ours in times and other in times:
            low, middle, high = ratio(times[other], times[ours])
            print(f"{ours} is {middle:.2f} x {other} ({low:.2f} .. {high:.2f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "parts", nargs="*", choices=["measured", "large", "analytic", "tolerance", "speed", []], help="default: all"
    )
    parser.add_argument("-n", type=int, default=10_000_000, help="look-ups (default 1e7)")
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    parts = given.parts or ["measured", "large", "analytic", "tolerance", "speed"]
    print(machine())
    if not shared.REFERENCE.exists():
        print("left out: the ten measured files (../shared is absent)")
    if "measured" in parts and shared.REFERENCE.exists():
        measured(768_000)
    if "large" in parts and shared.REFERENCE.exists():
        measured(4_500_000)
    if "analytic" in parts:
        analytic(256_000)
    if "tolerance" in parts:
        tolerance(0.01)
    if "speed" in parts:
        speed(given.n, given.rounds)


if __name__ == "__main__":
    main()
