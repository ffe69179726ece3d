"""How wrong a table is, beside its bytes: `python -m tests.benchmarks.accuracy [--markdown]`.

Analytic gold at several roughnesses, and the ten real files where ../shared is present:
- native warp against the values another renderer gives (../shared/reference),
- the plain angle grid of 90 x 90 x 180 nodes against the native warp: L1 with its standard error on seeded
  directions; "reference L1" on the reference's directions, near the lobe and uniform; worst albedo bias to 80 degrees.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator

import numpy as np

import brdfcore as bc
from tests import shared

SHAPE = (90, 90, 180)


def analytic_rows() -> Iterator[list[str]]:
    for roughness in (1.0, 0.3, 0.1, 0.03, 0.01):
        source = bc.model("cook_torrance", roughness=roughness, ior="gold")
        start = time.perf_counter()
        table = bc.tabulate(source, "angle_grid", shape=SHAPE)
        seconds = time.perf_counter() - start
        yield [f"gold, roughness {roughness:g}", *_columns(table), f"{seconds:.1f}"]


def real_rows() -> Iterator[list[str]]:
    for name in shared.rgl_names():
        source = bc.read(shared.rgl_path(name))
        theta_i, theta_o, delta_phi, reference = shared.rgl_reference(name)
        native = source.evaluate(theta_i, theta_o, delta_phi)
        relative = np.median(np.abs(native - reference) / np.maximum(np.abs(reference), 1e-12))
        start = time.perf_counter()
        table = bc.tabulate(source, "angle_grid", shape=SHAPE)
        seconds = time.perf_counter() - start
        found = table.evaluate(theta_i, theta_o, delta_phi)
        parts = slice(0, 2000), slice(2000, None)
        halves = [reference_l1(theta_i, theta_o, reference, found, part) for part in parts]
        yield [name, *_columns(table), f"{seconds:.1f}", f"{relative:.1e}", *(f"{h:.4f}" for h in halves)]


def _columns(table: bc.Table) -> list[str]:
    bias = [b for t, b in zip(table.error["albedo_bias"]["theta_i"], table.error["albedo_bias"]["bias"]) if t < 1.4]
    worst = max(bias, key=abs)
    return [
        f"{table.nbytes / len(table.channels) / 1e6:.1f}",
        f"{table.error['l1']:.4f} ± {table.error['l1_stderr']:.4f}",
        f"{100 * worst:+.1f} %",
        f"{table.error['log_ratio']['p99']:.2f}",
    ]


def reference_l1(theta_i, theta_o, reference, found, half) -> float:  # type: ignore[no-untyped-def]
    """sum c_i c_o |e| / sum c_i c_o |f| over one half of the reference directions."""
    weight = (np.cos(theta_i) * np.cos(theta_o))[half, None]
    return float((weight * np.abs(found - reference)[half]).sum() / (weight * np.abs(reference)[half]).sum())


def show(heads: list[str], rows: Iterator[list[str]], markdown: bool) -> None:
    if markdown:
        print("| " + " | ".join(heads) + " |")
        print("|" + " --- |" * len(heads))
        for row in rows:
            print("| " + " | ".join(row) + " |", flush=True)
    else:
        print("  ".join(f"{h:>22}" for h in heads))
        for row in rows:
            print("  ".join(f"{c:>22}" for c in row), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="as in the documentation")
    markdown = parser.parse_args().markdown
    heads = ["material, as angle_grid 90 x 90 x 180", "MB a channel", "L1", "albedo bias", "p99 log ratio", "build s"]
    show(heads, analytic_rows(), markdown)
    print()
    if shared.REFERENCE.exists():
        more = ["native: median rel. difference", "reference L1, lobe", "reference L1, uniform"]
        show([*heads, *more], real_rows(), markdown)
    else:
        print("left out: the ten real files (../shared is absent)")


if __name__ == "__main__":
    main()
