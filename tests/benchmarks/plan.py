"""A scene of twenty materials of all kinds, planned, built and measured: `python -m tests.benchmarks.plan`.

Formulas matt to sharp, measured files where ../shared is present, equal materials, narrow angles, single channels, an
environment. Every built file is read again and measured over the angles it is seen in, on directions and by a sum
written here, not by `metrics`. Beside the total: a MERL table each, and what a table for the angles seen saves.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.analysis.pareto.tabulating import USUAL
from brdfcore.analysis.pareto.timing import look_up_maker, machine, time_all
from brdfcore.tables.base.seen import EVERYWHERE, Seen
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.half_difference import HalfDifference
from tests import shared


def scene() -> dict[str, Any]:
    """At 1 %."""
    materials: list[dict[str, Any]] = [
        {"name": "wall", "model": "lambert", "parameters": {"reflectance": [0.8, 0.78, 0.7]}},
        {"name": "ceiling", "model": "lambert", "parameters": {"reflectance": [0.8, 0.78, 0.7]}},
        {"name": "clay", "model": "oren_nayar", "parameters": {}},
        {"name": "clay-pot", "model": "oren_nayar", "parameters": {}, "lighting": "environment"},
        {"name": "gold", "model": "cook_torrance", "parameters": {"roughness": 0.1, "ior": "gold"}},
        {"name": "gold-sharp", "model": "cook_torrance", "parameters": {"roughness": 0.01, "ior": "gold"}},
        {"name": "steel", "model": "ggx", "parameters": {"roughness": 0.3, "ior": "steel"}},
        {"name": "plastic", "model": "blinn_phong", "parameters": {}},
        {"name": "brushed", "model": "ward", "parameters": {"roughness": 0.4}},
        {"name": "window", "model": "mirror", "parameters": {"ior": "glass"}},
        {"name": "cloth", "model": "cook_torrance", "parameters": {"roughness": 0.6}, "lighting": "environment"},
    ]
    if shared.RGL.exists():
        for k, name in enumerate(
            ("aurora_white", "cardboard", "paper_white", "vch_golden_yellow", "chm_light_blue", "satin_purple")
        ):
            materials.append({"name": name, "file": str(shared.rgl_path(name))})
            if k == 0:
                materials.append({"name": "aurora-again", "file": str(shared.rgl_path(name))})
        materials += [
            {"name": "floor", "file": str(shared.rgl_path("irid_flake_paint2")), "light": [0, 70], "view": [20, 70]},
            {"name": "sign", "file": str(shared.rgl_path("ilm_l3_37_matte")), "channels": ["G"], "light": [0, 80]},
        ]
    return {"budget": {"error": 0.01}, "materials": materials}


def remeasured(choice: Any, folder: Path, seed: int) -> tuple[float, float]:
    """(L1, standard error) of a built file over the angles seen, from cosine-distributed and mirrored directions."""
    low_i, high_i = np.radians(choice["light"])
    low_o, high_o = np.radians(choice["view"])
    from brdfcore.base.directions import mixture

    drawn = mixture(400_000, seed, cosine_share=0.4)
    used = (drawn.weight > 0) & (drawn.theta_i >= low_i) & (drawn.theta_i <= high_i)
    used &= (drawn.theta_o >= low_o) & (drawn.theta_o <= high_o)
    angles = [x[used] for x in (drawn.theta_i, drawn.theta_o, drawn.delta_phi)]
    source, found = choice["source"], bc.read(folder / choice["file"])
    picks = [list(source.channels).index(c) for c in found.channels]
    f, g = source.evaluate(*angles)[:, picks], found.evaluate(*angles)
    w = drawn.weight[used]
    wrong, energy = np.abs(g - f).sum(axis=1), f.sum(axis=1)
    total = float(w @ energy)
    if total == 0:
        return 0.0, 0.0
    l1 = float(w @ wrong) / total
    return l1, float(np.sqrt(np.sum((w * (wrong - l1 * energy)) ** 2)) / abs(total))


def told(done: int, total: int, stage: str) -> None:
    """A line on stderr as each material begins."""
    if stage.endswith("building harmonic 8"):
        print(f"{100 * done // max(total, 1):3} %  {stage.partition(':')[0]}", file=sys.stderr, flush=True)


def naive_ns(planned: Any) -> float:
    """One look-up in a MERL-layout table of each material (node next to the direction), all channels of each.

    The time of such a look-up does not depend on what the table holds: one table a number of channels is timed.
    """
    counts = [len(m.brdf.channels) for m in planned.scene.materials]
    makers = {}
    for channels in sorted(set(counts)):
        values = [0.1 + 0.1 * k for k in range(channels)]
        grey = bc.model("lambert", reflectance=values if channels > 1 else values[0])
        makers[str(channels)] = look_up_maker(bc.tabulate(grey, USUAL[0], shape=USUAL[1], interpolation=USUAL[2]))
    times = time_all(makers, headline=True)
    return sum(times[str(n)]["1000000"].best for n in counts)


def limited_and_not(name: str, light: tuple[float, float], view: tuple[float, float]) -> None:
    """L1 over the angles seen (degrees) of half_difference made for them and made for all, at equal bytes."""
    source = bc.read(shared.rgl_path(name))
    seen = Seen(*((float(np.radians(a)), float(np.radians(b))) for a, b in (light, view)))
    print(f"\n{name}, light {light}, view {view}: error over what is seen, made for it / for all angles")
    prepared: dict[Seen, Any] = {}
    for size in (32_000, 64_000, 128_000, 256_000, 512_000):
        found = []
        for made_for in (seen, EVERYWHERE):
            tables = []
            for options in HalfDifference.candidates(
                source, BuildOptions(seen=made_for, prepared=prepared.get(made_for)), size
            ):
                prepared[made_for] = options.prepared
                table = HalfDifference.build(source, options)
                l1 = bc.compare(source, table, light=seen.light, view=seen.view, seed=5, directions=150_000).l1
                tables.append((l1, table.nbytes))
            found.append(min(tables))
        (a, bytes_a), (b, bytes_b) = found
        print(f"{bytes_a:9} bytes {a:.5f}   {bytes_b:9} bytes {b:.5f}   {b / a:.2f} x", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="folder for what is built; default: a temporary one")
    given = parser.parse_args()
    from brdfcore.analysis.plan.build import build
    from brdfcore.analysis.plan.plan import plan

    print(machine())
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        content = scene()
        start = time.perf_counter()
        planned = plan(content, progress=told)
        seconds = time.perf_counter() - start
        manifest = build(planned, folder)
        if given.keep:
            (folder / "scene.txt").write_text(json.dumps(content, indent=1))
        print(f"{'materials':28} {'use':42} {'bytes':>9} {'ns':>6} {'L1':>9} {'fresh':>9} +- {'':8}  because")
        worst = 0.0
        for choice, stored in zip(planned.choices, manifest["materials"]):
            l1, spread = remeasured({**stored, "source": choice.source}, folder, 99)
            worst = max(worst, l1 / choice.tolerance)
            print(
                f"{', '.join(choice.names):28} {choice.entry.label:42} {choice.entry.nbytes:9} "
                f"{choice.entry.ns.best:6.1f} {choice.entry.comparison.l1:9.2e} {l1:9.2e} +- {spread:8.1e}  "
                f"{choice.reason}"
            )
        total = manifest["total"]
        print(f"{total['materials']} materials, {total['bytes']} bytes, {total['ns']:.0f} ns for one look-up of each")
        print(f"a MERL table each: {naive_ns(planned):.0f} ns for one look-up of each; planned in {seconds:.0f} s")
        print(f"a MERL table each: {total['naive_bytes']} bytes; this is {100 * total['share_of_naive']:.3f} % of it")
        print(f"worst error on fresh directions: {worst:.2f} x tolerance; problems: {planned.problems or 'none'}")
    if shared.RGL.exists():
        limited_and_not("irid_flake_paint2", (0, 70), (20, 70))
        limited_and_not("vch_golden_yellow", (0, 60), (60, 85))


if __name__ == "__main__":
    main()
