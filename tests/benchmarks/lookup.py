"""Look-ups in an angle grid, accuracy beside speed: `python -m tests.benchmarks.lookup`.

1e7 random directions, float32, one channel, through the public `evaluate(out=)`, in one run with
- scipy RegularGridInterpolator (1 thread, on a tenth of the directions: it is that slow),
- interpn linear (`bench` extra; one call a thread),
- plain C compiled with -O3 -march=native -ffast-math (../shared/reference/trilinear.c, needs gcc),
- the loads of a look-up alone (load8 of the same file): the ceiling.
All on two table sizes. What is absent is named and left out.
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

import brdfcore as bc
from brdfcore.kernels.machine import launch
from brdfcore.tables.angle_grid import AngleGrid
from tests.benchmarks.timing import Spread, interleaved, machine, per_call, ratio

SOURCE = Path(__file__).parents[2].parent / "shared" / "reference" / "trilinear.c"
#: Error is taken over theta up to 80 degrees: f itself has no finite value at the horizon. L1 counts all.
ACCURATE_TO = np.radians(80)
SHAPES = ((90, 90, 180), (32, 32, 64))


def in_threads(count: int, n: int, run: Callable[[int, int], None]) -> None:
    """run(start, stop) on `count` equal parts of n, one thread each."""
    edges = np.linspace(0, n, count + 1).astype(int)
    workers = [threading.Thread(target=run, args=(int(a), int(b))) for a, b in pairwise(edges)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()


def plain_c(folder: Path) -> Any:
    """The compiled yardsticks, or None with the reason printed."""
    if not SOURCE.exists() or shutil.which("gcc") is None:
        print("left out: plain C and its load ceiling (need gcc and ../shared/reference/trilinear.c)")
        return None
    target = folder / "trilinear.so"
    flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, str(SOURCE), "-o", str(target)], check=True)
    library = ctypes.CDLL(str(target))
    library.trilinear.argtypes = [ctypes.c_void_p] * 5 + [ctypes.c_size_t] + [ctypes.c_int] * 3
    library.trilinear.restype = None
    library.load8.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_size_t] + [ctypes.c_int] * 2
    library.load8.restype = ctypes.c_float
    return library


def candidates_for(table: AngleGrid, angles: list[Any], out: Any, library: Any, threads: int) -> dict[str, Any]:
    """name -> function that makes all look-ups once, writing where `out` can check them."""
    theta_i, theta_o, delta_phi = angles
    n = theta_i.size
    values = table.values[..., 0]
    n_i, n_o, n_d = values.shape
    runs: dict[str, Callable[[], object]] = {}
    runs["angle_grid"] = lambda: table.evaluate(theta_i, theta_o, delta_phi, out=out["angle_grid"].reshape(-1, 1))
    axes = [np.linspace(0, top, k) for top, k in zip((np.pi / 2, np.pi / 2, np.pi), values.shape, strict=True)]
    scipy_table = RegularGridInterpolator(axes, values)
    few = np.stack([x[: n // 10] for x in angles], axis=1)

    def scipy_run() -> None:
        out["scipy"][: n // 10] = scipy_table(few)

    runs["scipy"] = scipy_run
    try:
        import interpn
    except ImportError:
        print("left out: interpn (the `bench` extra brings it)")
    else:
        dims = [n_i, n_o, n_d]
        starts = np.zeros(3, np.float32)
        steps = np.array([axis[1] for axis in axes], np.float32)
        flat = np.ascontiguousarray(values).reshape(-1)

        def interpn_part(a: int, b: int) -> None:
            interpn.raw.interpn_linear_regular_f32(
                dims, starts, steps, flat, [x[a:b] for x in angles], out["interpn"][a:b]
            )

        runs["interpn"] = lambda: in_threads(threads, n, interpn_part)
    if library is not None:

        def c_part(a: int, b: int) -> None:
            pointers = [x[a:].ctypes.data for x in angles]
            library.trilinear(*pointers, values.ctypes.data, out["plain C"][a:].ctypes.data, b - a, n_i, n_o, n_d)

        runs["plain C"] = lambda: in_threads(threads, n, c_part)
        i, o, d = (
            np.minimum((x * ((k - 1) / top)).astype(np.int32), k - 2)
            for x, k, top in zip(angles, values.shape, (np.pi / 2, np.pi / 2, np.pi), strict=True)
        )
        base = (i * (n_o * n_d) + o * n_d + d).astype(np.int32)

        def loads(a: int, b: int) -> None:
            library.load8(base[a:].ctypes.data, values.ctypes.data, b - a, n_o * n_d, n_d)

        runs["load ceiling"] = lambda: in_threads(threads, n, loads)
    return runs


def report(shape: tuple[int, int, int], n: int, rounds: int, library: Any) -> None:
    gold = bc.model("cook_torrance", roughness=0.3, ior="gold")
    table = bc.tabulate(gold, "angle_grid", shape=shape)
    assert isinstance(table, AngleGrid)
    rng = np.random.default_rng(1)
    angles = [rng.uniform(0, top, n).astype(np.float32) for top in (1.5707, 1.5707, 3.1415)]
    names = ("angle_grid", "scipy", "interpn", "plain C")
    out = {name: np.full(n, np.nan, np.float32) for name in names}
    threads = launch.threads()
    times = interleaved(candidates_for(table, angles, out, library, threads), rounds=rounds)
    exact = gold.evaluate(*angles)[:, 0]
    size = f"{shape[0]} x {shape[1]} x {shape[2]}, {table.nbytes / 1e6:.2f} MB"
    print(f"\n{size}, {n:.0e} look-ups, float32, {threads} threads")
    print(f"the table itself: L1 = {table.error['l1']:.5f}, every candidate reads the same nodes")
    print("candidate        million/s  (low .. high)    angle_grid is   rms error / mean f (theta < 80 deg)")
    away = (angles[0] < ACCURATE_TO) & (angles[1] < ACCURATE_TO)
    scale = float(np.abs(exact[away]).mean())
    for name, spread in times.items():
        count = n // 10 if name == "scipy" else n
        rate = [count / s / 1e6 for s in (spread.median, spread.high, spread.low)]
        faster = "" if name == "angle_grid" else _times(spread, times["angle_grid"], n / count)
        wrong = ""
        if name in out:
            off = (out[name][:count] - exact[:count])[away[:count]]
            wrong = f"{np.sqrt(np.mean(off**2)) / scale:.4f}"
        print(f"{name:15} {rate[0]:10.1f}  ({rate[1]:.0f} .. {rate[2]:.0f})".ljust(46) + f"{faster:26}{wrong}")
    print("cost of one call: " + ", ".join(f"{k} -> {_small(table, angles, k)}" for k in (1, 100, 10_000)))


def _times(other: Spread, ours: Spread, factor: float) -> str:
    low, middle, high = (factor * x for x in ratio(other, ours))
    return f"{middle:.2f} x ({low:.2f}..{high:.2f})"


def _small(table: AngleGrid, angles: list[Any], k: int) -> str:
    theta_i, theta_o, delta_phi = (x[:k] for x in angles)
    seconds = per_call(lambda: table.evaluate(theta_i, theta_o, delta_phi))
    return f"{seconds * 1e6:.1f} us ({seconds / k * 1e9:.0f} ns a look-up)"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=10_000_000, help="look-ups (default 1e7)")
    parser.add_argument("--rounds", type=int, default=9, help="interleaved rounds (default 9)")
    given = parser.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        library = plain_c(Path(folder))
        for shape in SHAPES:
            report(shape, given.n, given.rounds, library)
    import numba

    print(f"\nthreading layer: {numba.threading_layer()}; medians of interleaved rounds, ratios round by round")


if __name__ == "__main__":
    main()
