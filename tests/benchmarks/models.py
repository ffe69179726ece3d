"""Analytic models from angles, accuracy beside speed: `python -m tests.benchmarks.models`.

1e7 random directions through the public `evaluate(out=)`, all threads, in one interleaved run with Mitsuba 3's
`roughconductor` (`bench` extra; its llvm variants need the system's libLLVM) on the same directions and material:
gold, Beckmann and GGX, roughness .1 and .01. Our float32 angles arrive in memory and f leaves to memory. Mitsuba is
timed twice: from unit vectors made beforehand, and from the same angles, with the sines and cosines in its own kernel.
It returns f cos theta_o. What is absent is named and left out.

Accuracy on the same float32 angles, half of them near the mirror direction, where f is above 1e-6 of its peak:
- the fast tier against the exact tier,
- Mitsuba against the exact tier with its own masking, both read as float64 from float32: GGX with separable Smith
  (`ggx(correlated=False)`), Beckmann with separable Smith by its rational approximation, and with the exact function.

Then every model's fast and exact tier alone.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.base import geometry
from brdfcore.base.directions import mixture
from brdfcore.kernels.machine import blocks, launch
from tests.benchmarks.timing import interleaved, machine, ratio

GOLD = (0.370, 2.820)
MODELS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("phong", {}),
    ("blinn_phong", {}),
    ("ward", {}),
    ("oren_nayar", {}),
    ("ggx", {"ior": "gold"}),
    ("cook_torrance", {}),
    ("cook_torrance", {"ior": "gold"}),
    ("cook_torrance", {"ior": "gold", "masking": "smith"}),
    ("cook_torrance", {"ior": 1.5}),
    ("cook_torrance", {"ior": 1.5, "fresnel": "schlick"}),
    ("cook_torrance", {"ior": "gold", "distribution": "ggx"}),
    ("cook_torrance", {"ior": "gold", "distribution": "blinn"}),
    ("cook_torrance", {"ior": "gold", "distribution": "gaussian"}),
    ("cook_torrance", {"ior": ["gold", "silver", "copper"]}),
)
Runs = dict[str, Callable[[], object]]


def mitsuba() -> Any:
    """(mitsuba, drjit) with an llvm variant, or None with the reason printed."""
    if importlib.util.find_spec("mitsuba") is None:
        print("left out: mitsuba (the `bench` extra brings it)")
        return None
    library = os.environ.setdefault("DRJIT_LIBLLVM_PATH", newest_llvm())
    # an old libLLVM ends the process instead of raising: a child tries first
    probe = "from tests.benchmarks.models import *; tools = start(); RoughConductor(tools, 'ggx', 0.1).probe()"
    tried = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    if tried.returncode:
        said = (tried.stderr.strip().splitlines() or ["nothing said"])[0][:120]
        print(f"left out: mitsuba, whose llvm variant needs the system's libLLVM, 16 or later ({library}): {said}")
        return None
    return start()


def start() -> Any:
    """Mitsuba with the first of its llvm variants: one channel if it has that."""
    import drjit
    import mitsuba as mi

    mi.set_variant(next(v for v in ("llvm_mono", "llvm_ad_mono", "llvm_ad_rgb") if v in mi.variants()))
    return mi, drjit


def newest_llvm() -> str:
    """Path of the system's libLLVM of the highest version, "" if the loader lists none."""
    with contextlib.suppress(OSError):
        listed = subprocess.run(["ldconfig", "-p"], capture_output=True, text=True, check=False).stdout
        found = re.findall(r"libLLVM[-.so]*(\d+)\S* .*=> (\S+)", listed)
        return max(((int(version), path) for version, path in found), default=(0, ""))[1]
    return ""


class RoughConductor:
    """Mitsuba's plug-in on arrays of directions."""

    def __init__(self, tools: Any, distribution: str, alpha: float) -> None:
        self.mi, self.dr = tools
        n, k = GOLD
        spectrum = {"type": "spectrum"}
        self.bsdf = self.mi.load_dict(
            {
                "type": "roughconductor",
                "distribution": distribution,
                "alpha": alpha,
                "eta": {**spectrum, "value": n},
                "k": {**spectrum, "value": k},
            }
        )

    def probe(self) -> None:
        self.from_angles(*self.arrays(*(np.full(9, x, np.float32) for x in (0.5, 0.5, 3.0))))

    def from_vectors(self, wi: Any, wo: Any) -> Any:
        """f cos theta_o, evaluated and waited for."""
        si = self.dr.zeros(self.mi.SurfaceInteraction3f, self.dr.width(wi))
        si.wi = wi
        value = self.bsdf.eval(self.mi.BSDFContext(), si, wo)[0]
        self.dr.eval(value)
        self.dr.sync_thread()
        return value

    def from_angles(self, theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
        return self.from_vectors(*self.vectors(theta_i, theta_o, delta_phi))

    def vectors(self, theta_i: Any, theta_o: Any, delta_phi: Any) -> Any:
        dr, mi = self.dr, self.mi
        (s_i, c_i), (s_o, c_o), (s, c) = (dr.sincos(x) for x in (theta_i, theta_o, delta_phi))
        return mi.Vector3f(s_i, 0, c_i), mi.Vector3f(s_o * c, s_o * s, c_o)

    def arrays(self, *angles: Any) -> Any:
        """numpy angles as Mitsuba's, in its memory."""
        held = [self.mi.Float(a) for a in angles]
        self.dr.eval(held)
        self.dr.sync_thread()
        return held


def gold(distribution: str, roughness: float, **more: Any) -> bc.Brdf:
    return bc.model("cook_torrance", distribution=distribution, roughness=roughness, ior="gold", **more)


def random_angles(n: int) -> list[Any]:
    rng = np.random.default_rng(1)
    return [rng.uniform(0, top, n).astype(np.float32) for top in (1.5707, 1.5707, 3.1415)]


def speed(tools: Any, distribution: str, roughness: float, n: int, rounds: int) -> None:
    angles = random_angles(n)
    out = np.empty((n, 1), np.float32)

    def timed(brdf: bc.Brdf) -> Callable[[], object]:
        return lambda: brdf.evaluate(*angles, out=out)

    runs: Runs = {
        "fast, V-grooves": timed(gold(distribution, roughness, precision="fast")),
        "fast, Smith": timed(gold(distribution, roughness, masking="smith", precision="fast")),
        "exact, V-grooves": timed(gold(distribution, roughness)),
    }
    if tools is not None:
        plugin = RoughConductor(tools, distribution, roughness)
        held = plugin.arrays(*angles)
        wi, wo = plugin.vectors(*held)
        plugin.dr.eval(wi, wo)
        plugin.dr.sync_thread()
        runs["Mitsuba, vectors"] = lambda: plugin.from_vectors(wi, wo)
        runs["Mitsuba, angles"] = lambda: plugin.from_angles(*held)
    # stands between Mitsuba and the first of the next round: idle threads of one keep a core busy for a while
    runs["exact, Smith"] = timed(gold(distribution, roughness, masking="smith"))
    times = interleaved(runs, rounds=rounds)
    print(f"\n{distribution}, roughness {roughness:g}, {n:.0e} directions, float32 in and out")
    print("candidate            million/s  (low .. high)    fast, Smith is               exact, Smith is")
    for name, spread in times.items():
        rate = [n / s / 1e6 for s in (spread.median, spread.high, spread.low)]
        compared = [
            "{1:.3g} x ({0:.3g} .. {2:.3g})".format(*ratio(spread, times[ours])) if name.startswith("Mitsuba") else ""
            for ours in ("fast, Smith", "exact, Smith")
        ]
        print(
            f"{name:18} {rate[0]:11.1f}  ({rate[1]:.1f} .. {rate[2]:.1f})".ljust(50) + f"{compared[0]:29}{compared[1]}"
        )


def accuracy(tools: Any, distribution: str, roughness: float, n: int = 400_000) -> None:
    drawn = mixture(n, 5, widths=(roughness,))
    angles = [x.astype(np.float32) for x in (drawn.theta_i, drawn.theta_o, drawn.delta_phi)]
    exact_angles = [x.astype(np.float64) for x in angles]
    print(f"relative error, {distribution}, roughness {roughness:g}: {'':17}largest     99.9 %")
    for masking in ("vgroove", "smith"):
        want = gold(distribution, roughness, masking=masking).evaluate(*exact_angles)[:, 0]
        got = gold(distribution, roughness, masking=masking, precision="fast").evaluate(*angles)[:, 0]
        _errors(f"fast against exact, {masking}", got, want, exact_angles, distribution, roughness)
    if tools is None:
        return
    plugin = RoughConductor(tools, distribution, roughness)
    value = np.array(plugin.from_angles(*plugin.arrays(*angles)), np.float64) / np.cos(exact_angles[1])
    for name, want in _separable(distribution, roughness, exact_angles).items():
        _errors(f"Mitsuba against {name}", value, want, exact_angles, distribution, roughness)


def _separable(distribution: str, m: float, angles: list[Any]) -> dict[str, Any]:
    """f with the product of two Smith functions, from the exact tier."""
    if distribution == "ggx":
        return {"exact": bc.model("ggx", roughness=m, ior="gold", correlated=False).evaluate(*angles)[:, 0]}
    from scipy.special import erf

    unmasked = gold(distribution, m, masking="none").evaluate(*angles)[:, 0]
    a = 1 / (m * np.tan(np.maximum(angles[:2], 1e-30)))
    # Walter et al. 2007: the exact function (equation after 26) and its rational approximation (27)
    exact = 2 / (1 + erf(a) + np.exp(-a * a) / (a * np.sqrt(np.pi)))
    rational = np.where(a >= 1.6, 1.0, (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a))
    return {
        "exact, rational masking": unmasked * rational[0] * rational[1],
        "exact, exact masking": unmasked * exact[0] * exact[1],
    }


def _errors(name: str, got: Any, want: Any, angles: list[Any], distribution: str, m: float) -> None:
    t2 = geometry.pair_from_angles(*angles).tan2_h
    near = np.exp(-t2 / m**2) * (1 + t2) ** 2 if distribution == "beckmann" else ((1 + t2) * m * m / (t2 + m * m)) ** 2
    counted = (near >= 1e-6) & (want > 0)
    error = np.abs(got[counted] / want[counted] - 1)
    print(f"  {name:50}    {error.max():9.2g}  {np.quantile(error, 0.999):9.2g}   ({counted.sum()} pairs)")


def every_model(n: int, rounds: int) -> None:
    angles = random_angles(n)
    few = [x[: n // 10] for x in angles]
    print(f"\nevery model, {n:.0e} directions, float32 in and out (exact: a tenth of them), million/s (low .. high)")
    for name, given in MODELS:
        exact, fast = bc.model(name, **given), bc.model(name, precision="fast", **given)
        count = len(exact.channels)
        out = np.empty((n, count), np.float32)
        runs: Runs = {
            "fast": lambda m=fast, out=out: m.evaluate(*angles, out=out),
            "exact": lambda m=exact, out=out: m.evaluate(*few, out=out[: n // 10]),
        }
        listed = ", ".join(f"{k}={v}" for k, v in given.items())
        line = f"{name}({listed})".ljust(58)
        for tier, s in interleaved(runs, rounds=rounds).items():
            points = (n if tier == "fast" else n // 10) / 1e6
            line += f" {tier} {points / s.median:6.1f} ({points / s.high:.0f} .. {points / s.low:.0f})".ljust(30)
        print(line)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=10_000_000, help="directions (default 1e7)")
    parser.add_argument("--rounds", type=int, default=5, help="interleaved rounds (default 5)")
    given = parser.parse_args()
    print(f"{machine()}; {launch.threads()} threads compiled, {blocks.threads()} numpy")
    tools = mitsuba()
    if tools is not None:
        mi, drjit = tools
        print(f"Mitsuba {mi.__version__}, variant {mi.variant()}, {drjit.thread_count()} threads")
    for distribution in ("beckmann", "ggx"):
        for roughness in (0.1, 0.01):
            speed(tools, distribution, roughness, given.n, given.rounds)
            accuracy(tools, distribution, roughness)
    every_model(given.n, given.rounds)


if __name__ == "__main__":
    main()
