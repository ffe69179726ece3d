"""Nearest, linear and monotone cubic, accuracy beside speed: `python -m tests.benchmarks.interpolation`.

L1 (`metrics`) against bytes a channel of the plain angle grid and of MERL's layout, on analytic gold and on measured
files where ../shared is present. Measured files are not reciprocal: in MERL's layout they are folded, and their last
line is what the fold alone costs. Beside them the time of a look-up: float32, random directions, threads as the library
uses them, each interpolation in turn.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

import brdfcore as bc
from brdfcore.base.conventions import FloatArray
from brdfcore.kernels.machine import launch
from brdfcore.tables.base.sampled import INTERPOLATIONS
from tests import shared
from tests.benchmarks.timing import interleaved, machine

SIZES = (16, 32, 64, 90)
MEASURED = ("paper_white", "vch_golden_yellow", "chm_light_blue")


class Folded(bc.Brdf):
    """Mean of a material over both orders of the directions: the best that a reciprocal layout can hold."""

    def __init__(self, source: bc.Brdf) -> None:
        super().__init__()
        self.source, self.channels, self.bilateral = source, source.channels, source.bilateral
        self.non_negative = source.non_negative

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = 0.5 * (
            self.source.evaluate(theta_i, theta_o, delta_phi) + self.source.evaluate(theta_o, theta_i, -delta_phi)
        )
        return True


def materials() -> Iterator[tuple[str, bc.Brdf]]:
    for roughness in (1.0, 0.3, 0.1):
        yield f"gold, roughness {roughness:g}", bc.model("cook_torrance", roughness=roughness, ior="gold")
    if not shared.REFERENCE.exists():
        print("left out: the measured files (../shared is absent)")
        return
    for name in MEASURED:
        yield name, bc.read(shared.rgl_path(name))


def accuracy(name: str, source: bc.Brdf) -> None:
    fold = None if source.reciprocal else "reciprocal"
    for representation in ("angle_grid", "half_angle_grid"):
        print(f"\n{name}, {representation}: L1 against kB a channel")
        print(f"{'kB':>8}  " + "".join(f"{i:>16}" for i in INTERPOLATIONS) + f"{'+- (linear)':>14}")
        for n in SIZES:
            shape = (n, n, 2 * n)
            tables = {
                i: bc.tabulate(
                    source, representation, shape=shape, interpolation=i,
                    fold=fold if representation == "half_angle_grid" else None,
                )
                for i in INTERPOLATIONS
            }  # fmt: skip
            size = tables["linear"].nbytes / len(source.channels) / 1000
            found = "".join(f"{tables[i].error['l1']:16.5f}" for i in INTERPOLATIONS)
            print(f"{size:8.0f}  {found}{tables['linear'].error['l1_stderr']:14.5f}", flush=True)
        if fold and representation == "half_angle_grid":
            print(f"{'fold':>8}  {bc.compare(source, Folded(source)).l1:.5f} however many cells")


def speed(n: int, rounds: int) -> None:
    rng = np.random.default_rng(1)
    angles = [rng.uniform(0, top, n).astype(np.float32) for top in (1.5707, 1.5707, 3.1415)]
    print(f"\nns a look-up, {n:.0e} look-ups, float32, {launch.threads()} threads, 64 x 64 x 128 nodes")
    print(f"median (low .. high) of {rounds} interleaved rounds")
    for ior in ("gold", ["gold", "copper", "silver"]):
        source = bc.model("cook_torrance", roughness=0.3, ior=ior)
        runs = {}
        for representation in ("angle_grid", "half_angle_grid"):
            for interpolation in INTERPOLATIONS:
                table = bc.tabulate(source, representation, shape=(64, 64, 128), interpolation=interpolation)
                out = np.empty((n, len(table.channels)), np.float32)
                label = f"{representation}, {len(table.channels)} channel(s), {interpolation}"
                runs[label] = lambda table=table, out=out: table.evaluate(*angles, out=out)
        for label, spread in interleaved(runs, rounds=rounds).items():
            low, middle, high = (s / n * 1e9 for s in (spread.low, spread.median, spread.high))
            print(f"{label:48} {middle:7.1f} ({low:.1f} .. {high:.1f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=1_000_000, help="look-ups (default 1e6)")
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    print(machine())
    for name, source in materials():
        accuracy(name, source)
    speed(given.n, given.rounds)


if __name__ == "__main__":
    main()
