"""MERL's layout against the compact table, accuracy beside speed: `python -m tests.benchmarks.merl`.

Each material is written as a MERL file (90 x 90 x 180 cells, 35 MB) and read back; its look-ups are compared with the
material: nearest (the usual practice), linear, monotone cubic, and linear with values taken for the lower edges of
their cells (the classic mistake). Beside them `half_difference` within 256 kB a channel.

L1 and its standard error are those of `metrics`; "lobe" and "uniform" are the reference L1 of the measured files (each
half of ../shared/reference's directions apart). A measured file is not reciprocal: "fold" is the L1 of its mean over
both orders of the directions, below which no MERL file can come. ns: float32 look-ups from random directions.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import brdfcore as bc
from brdfcore.formats.base.format import LossWarning
from brdfcore.kernels.machine import launch
from tests import shared
from tests.benchmarks.accuracy import reference_l1
from tests.benchmarks.interpolation import Folded
from tests.benchmarks.timing import interleaved, machine

LIMIT = 256_000
HALVES = (slice(0, 2000), slice(2000, None))
METALS = ["gold", "copper", "silver"]
READINGS = {
    "MERL nearest": {"interpolation": "nearest"},
    "MERL linear": {"interpolation": "linear"},
    "MERL monotone cubic": {"interpolation": "monotone_cubic"},
    "MERL linear, half a cell off": {"interpolation": "linear", "cells": "lower_edge"},
}


def materials() -> Iterator[tuple[str, bc.Brdf]]:
    for roughness in (1.0, 0.3, 0.1, 0.03, 0.01):
        yield f"metals, roughness {roughness:g}", bc.model("cook_torrance", roughness=roughness, ior=METALS)
    yield "ggx, roughness 0.1", bc.model("cook_torrance", roughness=0.1, ior=METALS, distribution="ggx")
    if not shared.REFERENCE.exists():
        print("left out: the measured files (../shared is absent)")
        return
    for name in shared.rgl_names():
        yield name, bc.read(shared.rgl_path(name))


def readings(source: bc.Brdf, folder: Path) -> tuple[dict[str, bc.Brdf], float, float]:
    """The tables compared, and the seconds that writing and one reading took."""
    path = folder / "material.binary"
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LossWarning)
        bc.write(source, path)
    write = time.perf_counter() - start
    start = time.perf_counter()
    tables = {name: bc.read(path, **options) for name, options in READINGS.items()}
    read = (time.perf_counter() - start) / len(tables)
    tables["half_difference"] = bc.tabulate(source, "half_difference", max_bytes=LIMIT * len(source.channels))
    return tables, write, read


def report(name: str, source: bc.Brdf, n: int, rounds: int, folder: Path) -> None:
    tables, write, read = readings(source, folder)
    fold = "" if source.reciprocal else f", fold {bc.compare(source, Folded(source)).l1:.4f}"
    print(f"\n{name} (written in {write:.2f} s, read in {read:.2f} s{fold})")
    print(f"{'':30} {'bytes':>9} {'L1':>8} {'+-':>7} {'lobe':>7} {'uniform':>8} {'albedo 0, 60 deg':>18} {'ns':>7}")
    rng = np.random.default_rng(2)
    angles = [rng.uniform(0, top, n).astype(np.float32) for top in (1.5707, 1.5707, 3.1415)]
    out = np.empty((n, 3), np.float32)
    times = interleaved({k: lambda t=t: t.evaluate(*angles, out=out) for k, t in tables.items()}, rounds=rounds)
    for label, table in tables.items():
        found = bc.compare(source, table)
        halves = ["", ""]
        if name in shared.rgl_names():
            *where, reference = shared.rgl_reference(name)
            values = table.evaluate(*where)
            halves = [f"{reference_l1(where[0], where[1], reference, values, half):.4f}" for half in HALVES]
        bias = f"{100 * found.albedo_bias['bias'][0]:+.2f} {100 * found.albedo_bias['bias'][2]:+.2f} %"
        size = table.nbytes if isinstance(table, bc.Table) else 0
        print(
            f"{label:30} {size:9} {found.l1:8.5f} {found.l1_stderr:7.5f} {halves[0]:>7} {halves[1]:>8} {bias:>18} "
            f"{times[label].median / n * 1e9:7.1f}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("only", nargs="*", help="parts of the materials' names; default: all")
    parser.add_argument("-n", type=int, default=300_000, help="look-ups timed (default 3e5)")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    print(f"{machine()}; {launch.threads()} threads")
    with tempfile.TemporaryDirectory() as folder:
        for name, source in materials():
            if not given.only or any(part in name for part in given.only):
                report(name, source, given.n, given.rounds, Path(folder))


if __name__ == "__main__":
    main()
