"""Measure what a look-up of each representation costs, by channels and size, and write it to brdfcore/build/costs.json.

python -m tests.benchmarks.costs [--write]

Times are the best of several rounds on one thread's own clock: what else the machine does slows some rounds, and none
of them down to less. `tabulate` chooses by the written table.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.analysis.pareto.timing import at_a_glance, machine
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.vndf_warp import VndfWarp

SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
CHANNELS = (1, 3, 8, 32)
WAYS = (
    ("angle_grid", "linear"), ("angle_grid", "nearest"), ("angle_grid", "monotone_cubic"),
    ("half_difference", "linear"), ("lobe_grid", "linear"),
    ("half_angle_grid", "linear"), ("half_angle_grid", "nearest"),
    ("specular_grid", "linear"),
)  # fmt: skip
ROUNDS = 3


class Flat(bc.Brdf):
    """The same everywhere: what a table holds does not change what looking it up costs, and this is built at once."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = bc.Channels([float(400 + k) for k in range(channels)] if channels > 1 else ["value"])

    def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
        out[...] = 0.25
        return True


def measured(name: str, way: str, channels: int, nbytes: int) -> float:
    if way == "monotone_cubic":  # a hundred times as slow: its size hardly matters
        nbytes = min(nbytes, SIZES[1])
    cls = REPRESENTATIONS.load(name)
    options = next(iter(cls.candidates(Flat(channels), BuildOptions(interpolation=way), nbytes)))
    table = cls.build(Flat(channels), options)
    return float(min(at_a_glance(table) for _ in range(ROUNDS)))


def warp(channels: int) -> float:
    """Of the arrays of a file of the RGL database; their values don't matter."""
    ones = lambda *shape: np.ones(shape, np.float32)  # noqa: E731
    made = VndfWarp.from_densities(
        theta_i=np.linspace(0, np.pi / 2, 8, dtype=np.float32), sigma=ones(128), ndf=ones(128), vndf=ones(8, 128, 128),
        spectra=ones(8, channels, 32, 32), channels=Flat(channels).channels,
        flags=dict.fromkeys(("bilateral", "reciprocal", "energy_conserving", "non_negative"), False),
    )  # fmt: skip
    return float(min(at_a_glance(made) for _ in range(ROUNDS)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="replace the stored table")
    options = parser.parse_args()
    ns: dict[str, list[list[float]]] = {}
    for name, way in WAYS:
        ns[f"{name} {way}"] = [[round(measured(name, way, c, size), 2) for size in SIZES] for c in CHANNELS]
        print(f"{name} {way}: {ns[f'{name} {way}']}", flush=True)
    # one size each: a file's own; scattered measurements are looked up in a half/difference lattice
    ns["vndf_warp linear"] = [[round(warp(c), 2)] * len(SIZES) for c in CHANNELS]
    print(f"vndf_warp linear: {ns['vndf_warp linear']}", flush=True)
    ns["scattered linear"] = ns["half_difference linear"]
    found = {"machine": machine(), "nbytes": SIZES, "channels": CHANNELS, "ns": ns}
    if options.write:
        path = Path(bc.__file__).parent / "build" / "costs.json"
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
