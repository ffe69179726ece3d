"""Spherical harmonics: Legendre functions, projection, and expansions beside tables of the same error.

`python -m tests.benchmarks.harmonics [legendre laws files time]`. Errors named target are relative L2 of f c_i c_o,
f of f itself; L1 is `metrics.compare`'s. Look-ups a second are median, from random angles, on all cores.
"""

from __future__ import annotations

import argparse
import time
import warnings

import numpy as np
from scipy.special import sph_harm_y_all

import brdfcore as bc
from brdfcore.build.project import norm_distance
from brdfcore.harmonics.expansion import expanded
from brdfcore.harmonics.irradiance import irradiance_factors, kernel_energy
from brdfcore.harmonics.legendre import legendre
from brdfcore.harmonics.projection import projected
from brdfcore.harmonics.rules import lobe_widths
from brdfcore.harmonics.targets import TARGETS
from brdfcore.harmonics.windows import WINDOWS, step_response
from tests import shared
from tests.benchmarks.timing import interleaved, machine, ratio

F_COS_COS = TARGETS["f_cos_cos"]


def functions(lmax: int, points: int, rounds: int) -> None:
    """p_l^m of all l, m against scipy's Y_l^m of the same degree and points, interleaved: one call straight after
    scipy's, which leaves nothing of ours in the caches, and several in a row."""
    x = np.cos(np.linspace(0.01, 3.1, points))
    theta, phi = np.arccos(x), np.zeros(points)
    in_a_row = 20

    def repeated() -> None:
        for _ in range(in_a_row):
            legendre(lmax, x)

    legendre(lmax, x)
    times = interleaved(
        {
            "scipy": lambda: sph_harm_y_all(lmax, lmax, theta, phi),
            "one call": lambda: legendre(lmax, x),
            f"{in_a_row} in a row": repeated,
        },
        rounds=rounds,
    )
    scipy = times.pop("scipy")
    print(f"\nlmax {lmax}, {points} points: scipy sph_harm_y_all {1e6 * scipy.median / points:.0f} us a point")
    for name, spent in times.items():
        calls = in_a_row if "row" in name else 1
        low, middle, high = (calls * r for r in ratio(scipy, spent))
        print(
            f"p_l^m, {name}: {1e6 * spent.median / calls / points:.1f} us a point; "
            f"{middle:.0f} x ({low:.0f} .. {high:.0f})"
        )


def numbers() -> None:
    """Windows on a step, the irradiance kernel, and the degree for 1 % of a lobe."""
    for name in WINDOWS:
        found = step_response(name, 16)
        print(f"window {name:9} lmax 16: undershoot {found['undershoot']:.4f}, L2 {found['l2']:.3f}")
    print("A_l / pi:", " ".join(f"{a:.15f}" for a in irradiance_factors(6) / np.pi))
    nine = kernel_energy(2)
    print(f"nine coefficients: {100 * nine['energy']:.3f} % of the energy, relative L2 error {100 * nine['l2']:.3f} %")


HEADS = (
    "material", "lmax", "kB", "truncation", "quadrature", "by evaluation", "L1", "minimum, 1/sr", "look-ups, M/s",
    "made in s", "half_difference of that error: kB", "truncation", "L1", "M/s",
)  # fmt: skip


def files(degrees: list[int], lookups: int) -> None:
    """The ten measured files: expansions, and the smallest half_difference of at most the same error; Markdown."""
    print(f"\n| {' | '.join(HEADS)} |\n|---|{'---:|' * (len(HEADS) - 1)}")
    rng = np.random.default_rng(3)
    angles = [rng.uniform(0, top, lookups) for top in (1.57, 1.57, 3.14)]
    for name in shared.rgl_names():
        source = bc.read(shared.rgl_path(name))
        for lmax in degrees:
            start = time.perf_counter()
            h = expanded(source, lmax)
            seconds = time.perf_counter() - start
            stated = h.report["harmonics"]
            error = stated["truncation"]["target"]
            l1 = bc.compare(source, h, directions=50_000).l1
            cells = (
                name, f"{lmax}", f"{h.nbytes / 1000:.0f}", f"{error:.4f}", f"{stated['quadrature']['target']:.5f}",
                f"{by_evaluation(source, h):.4f}", f"{l1:.4f}", f"{stated['minimum']:.2f}", f"{rate(h, angles):.3f}",
                f"{seconds:.2f}", *beside(source, error, angles),
            )  # fmt: skip
            print(f"| {' | '.join(cells)} |", flush=True)


def beside(source: bc.Brdf, error: float, angles: list[np.ndarray]) -> tuple[str, str, str, str]:
    """The smallest half_difference whose distance in the target's norm is at most `error`."""
    for size in (6_000, 24_000, 96_000, 384_000, 1_500_000, 6_000_000):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = bc.tabulate(source, "half_difference", max_bytes=3 * size)
        found = norm_distance(source, table, F_COS_COS)
        if found <= error:
            break
    kilobytes = f"{'' if found <= error else 'none up to '}{table.nbytes / 1000:.0f}"
    return kilobytes, f"{found:.4f}", f"{table.error['l1']:.4f}", f"{rate(table, angles):.0f}"


def by_evaluation(b: bc.Brdf, h: bc.Brdf, strata: int = 40) -> float:
    """Relative L2 of the target: by draws about the lobe where it is narrow, else from one random point in each of
    strata^3 cells, denser towards the horizon."""
    if min(lobe_widths(b)) < 0.04:
        return norm_distance(b, h, F_COS_COS, directions=2_000_000)
    cell = np.stack(np.meshgrid(*[np.arange(strata)] * 3, indexing="ij")).reshape(3, -1)
    u = 1 - (cell + np.random.default_rng(1).random(cell.shape)) / strata
    theta_i, theta_o, delta_phi = (top * (1 - a**1.5) for top, a in zip((np.pi / 2, np.pi / 2, np.pi), u))
    weight = np.sqrt(u).prod(axis=0) * np.sin(theta_i) * np.sin(theta_o) * (np.cos(theta_i) * np.cos(theta_o)) ** 2
    f, g = (m.evaluate(theta_i, theta_o, delta_phi) for m in (b, h))
    return float(np.sqrt(weight @ ((f - g) ** 2).sum(axis=1) / (weight @ (f * f).sum(axis=1))))


def rate(b: bc.Brdf, angles: list[np.ndarray]) -> float:
    b.evaluate(*angles)
    times = interleaved({"it": lambda: b.evaluate(*angles)}, rounds=3)
    return angles[0].size / times["it"].median / 1e6


def timed(degrees: list[int], rounds: int) -> None:
    """Coefficients of three channels of measured files, with the coarser rule that states the quadrature error."""
    print(f"\n{'projection, 3 channels':24} {'lmax':>5} {'s':>7} {'quadrature':>11} {'truncation':>11} evaluations")
    for name in ("paper_white", "vch_golden_yellow", "chm_light_blue"):
        source = bc.read(shared.rgl_path(name))
        projected(source, 16, F_COS_COS)
        for lmax in degrees:
            times = interleaved(
                {"it": lambda source=source, lmax=lmax: projected(source, lmax, F_COS_COS)}, rounds=rounds
            )
            stated = expanded(source, lmax).report["harmonics"]
            print(
                f"{name:24} {lmax:5} {times['it'].median:7.2f} {stated['quadrature']['target']:11.2e} "
                f"{stated['projection']['target']:11.4f} {stated['quadrature']['evaluations']}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=["legendre", "numbers", "files", "time", []], help="default: all")
    parser.add_argument("--degrees", type=int, nargs="+", default=[16, 32, 64])
    parser.add_argument("-n", type=int, default=100_000, help="look-ups timed")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    parts = given.parts or ["legendre", "numbers", "time", "files"]
    print(machine())
    if "legendre" in parts:
        functions(256, 64, given.rounds)
    if "numbers" in parts:
        numbers()
    if not shared.REFERENCE.exists():
        print("left out: the ten measured files (../shared is absent)")
        return
    if "time" in parts:
        timed([64, 256], min(given.rounds, 3))
    if "files" in parts:
        files(given.degrees, given.n)


if __name__ == "__main__":
    main()
