"""What 95 % intervals hold, how wide they are and what they cost: `python -m tests.benchmarks.uncertainty`.

Tables: of lobes drawn by seed, and of measured files where ../shared is present; fresh directions, uniform over both
hemispheres and by f c_i c_o, pooled over channels; then single incidences. Measurements: a fifth of the geometries is
left out, the rest is regridded, and its intervals are asked for what was left out. Status: a file's own geometries,
called measured and off by more than 2 %.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import brdfcore as bc
from brdfcore.base.directions import mixture
from brdfcore.base.status import Status
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.kernels.machine.launch import one_thread
from tests import shared
from tests.benchmarks.holdout import FILES, measurements
from tests.benchmarks.timing import interleaved, machine

Float64Array = npt.NDArray[np.float64]
Angles = tuple[Float64Array, Float64Array, Float64Array]

#: Degrees.
INCIDENCES = (0, 0.5, 1, 2, 5, 10, 20, 30, 40, 50, 60, 70, 80, 85, 88, 89, 89.9)
_COLUMNS = {"angles": "deg", "mirror": 180, "quantity": "f"}
_NAMED = {"theta_i": "theta_i_deg", "theta_o": "theta_o_deg", "delta_phi": "delta_phi_deg", "value": "f_r_value"}


def uniform(n: int, seed: int, theta_i: float | None = None) -> Angles:
    """Both directions uniform over the hemisphere, or the light at one angle."""
    rng = np.random.default_rng(seed)
    lights = np.arccos(rng.random(n)) if theta_i is None else np.full(n, theta_i)
    return lights, np.arccos(rng.random(n)), rng.uniform(-np.pi, np.pi, n)


def by_energy(b: bc.Brdf, n: int, seed: int) -> Angles:
    """Directions drawn in proportion to f c_i c_o, channels summed."""
    drawn = mixture(4 * n, seed)
    energy = b.evaluate(drawn.theta_i, drawn.theta_o, drawn.delta_phi).sum(axis=1) * drawn.weight
    energy = np.where(np.isfinite(energy), np.maximum(energy, 0), 0)
    pick = np.random.default_rng(seed).choice(4 * n, n, p=energy / energy.sum())
    return drawn.theta_i[pick], drawn.theta_o[pick], drawn.delta_phi[pick]


def lobes(count: int, seed: int) -> Iterator[tuple[str, bc.Brdf]]:
    """Lobes on a diffuse base, drawn by seed."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        model = str(rng.choice(["ggx", "cook_torrance", "ward"]))
        roughness = float(np.exp(rng.uniform(np.log(0.02), np.log(0.5))))
        diffuse = float(rng.uniform(0, 0.5))
        lobe = bc.model(model, roughness=roughness)
        yield f"{model} {roughness:.3f} + {diffuse:.2f}", lobe + bc.model("lambert", reflectance=diffuse)


def covered(source: bc.Brdf, table: bc.Brdf, angles: Angles) -> tuple[npt.NDArray[np.bool_], float]:
    """(which errors are within, median half-width over median error)."""
    error = np.abs(table.evaluate(*angles) - source.evaluate(*angles))
    width = table.uncertainty(*angles)
    middle = float(np.median(error))
    return error <= width, float(np.median(width)) / middle if middle > 0 else float("nan")


def cost(table: bc.Table, n: int = 1_000_000) -> float:
    """Time of `uncertainty` over that of `evaluate`, float32, one thread."""
    rng = np.random.default_rng(3)
    angles = [rng.uniform(0, top, n).astype(np.float32) for top in (1.57, 1.57, 3.14)]
    runs = {"evaluate": lambda: table.evaluate(*angles), "uncertainty": lambda: table.uncertainty(*angles)}
    with one_thread():
        found = interleaved(runs, rounds=5)
    return float(found["uncertainty"].median / found["evaluate"].median)


def tables(tolerance: float, count: int, names: list[str]) -> None:
    print("95 % intervals of tables: within, uniform and by energy (median half-width / median error); the worst of")
    print(f"single incidences {INCIDENCES} degrees; part of the bytes; cost in look-ups")
    sources: list[tuple[str, Any]] = [(n, bc.read(shared.rgl_path(n))) for n in names]
    for name, source in [*sources, *lobes(count, 20_261_201)]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            table = bc.tabulate(source, tolerance=tolerance)
        learnt = table.local_error
        assert learnt is not None
        both = [covered(source, table, a) for a in (uniform(50_000, 5), by_energy(source, 50_000, 6))]
        single = {d: covered(source, table, uniform(4_000, 7, float(np.radians(d))))[0].mean() for d in INCIDENCES}
        worst = min(single, key=lambda d: single[d])
        told = ", ".join(f"{w.mean():.3f} ({r:.1f})" for w, r in both)
        print(
            f"{name:28} {table.name:16} {table.nbytes / 1e3:8.0f} kB  {told}  {single[worst]:.3f} at {worst:g}  "
            f"{learnt.nbytes / table.nbytes:.3f}  {cost(table):.2f}",
            flush=True,
        )


def left_out(seeds: int) -> None:
    print("\na fifth of the geometries left out: within (median half-width / median error), by theta_i")
    for name, (path, options) in FILES.items():
        m = measurements(path, options)
        groups = m.groups()
        within, widths, errors, lights = [], [], [], []
        for seed in range(seeds):
            count = int(groups.max()) + 1
            left = np.isin(groups, np.random.default_rng(seed).permutation(count)[: round(0.2 * count)])
            table, out = to_brdf(m.select(~left)), m.select(left)
            angles = out.theta_i, out.theta_o, out.delta_phi
            error, width = np.abs(table.evaluate(*angles) - out.values), table.uncertainty(*angles)
            within.append(error <= width)
            errors.append(error.ravel())
            widths.append(width.ravel())
            lights.append(np.rint(np.degrees(out.theta_i)))
        inside, light = np.concatenate(within), np.concatenate(lights)
        each = ", ".join(f"{t:g}: {inside[light == t].mean():.3f}" for t in np.unique(light))
        ratio = np.median(np.concatenate(widths)) / np.median(np.concatenate(errors))
        print(f"{name:12} {inside.mean():.3f} ({ratio:.1f})  {each}", flush=True)


def status() -> None:
    print("\na file's own geometries: rows, called measured, of these off by more than 2 %; the others off by, median")
    found: dict[str, Any] = {name: to_brdf(measurements(*given)) for name, given in FILES.items()}
    found["openmaterial"] = bc.read(shared.FOLDER / "data/openmaterial/example_material_lidar_brdf.xompt")
    for name in ("retro", "grazing"):
        found[name] = bc.read(shared.FOLDER / f"cases/{name}.csv", **_COLUMNS, **_NAMED)
    for name, b in found.items():
        called = b.status(*b.angles.T) == Status.MEASURED
        off = (np.abs(b.evaluate(*b.angles.T) - b.measured) > 0.02 * np.abs(b.measured)).any(axis=1)
        told = b.smoothed()
        print(
            f"{name:12} {len(b.angles):5} {int(called.sum()):5} {int((called & off).sum()):3}  "
            f"{told['rows']} smoothed, off by {told.get('off by, median', 0)}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tolerance", type=float, default=0.01)
    parser.add_argument("--lobes", type=int, default=6)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--parts", nargs="*", default=["tables", "left-out", "status"])
    given = parser.parse_args()
    start = time.perf_counter()
    print(machine())
    here = shared.REFERENCE.exists()
    if not here:
        print("left out: measured files (../shared is absent)")
    if "tables" in given.parts:
        tables(given.tolerance, given.lobes, shared.rgl_names() if here else [])
    if "left-out" in given.parts and here:
        left_out(given.seeds)
    if "status" in given.parts and here:
        status()
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
