"""A scene of twenty materials of all kinds, planned, built and measured: `python -m tests.benchmarks.plan`.

Formulas matt to sharp, measured files where ../shared is present, equal materials, narrow angles, single channels, an
environment. Every built file is read again and measured over the angles it is seen in, on directions and by a sum
written here, not by `metrics`.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import brdfcore as bc
from brdfcore.analysis.timing import machine
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
    from brdfcore.directions import mixture

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="folder for what is built; default: a temporary one")
    given = parser.parse_args()
    from brdfcore.analysis.plan import plan
    from brdfcore.analysis.plan_build import build

    print(machine())
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        content = scene()
        planned = plan(content)
        manifest = build(planned, folder)
        if given.keep:
            (folder / "scene.txt").write_text(json.dumps(content, indent=1))
        print(f"{'materials':28} {'use':42} {'bytes':>9} {'ns':>6} {'L1':>9} {'fresh':>9} +- {'':8}  because")
        worst = 0.0
        for choice, told in zip(planned.choices, manifest["materials"]):
            l1, spread = remeasured({**told, "source": choice.source}, folder, 99)
            worst = max(worst, l1 / choice.tolerance)
            print(
                f"{', '.join(choice.names):28} {choice.entry.label:42} {choice.entry.nbytes:9} "
                f"{choice.entry.ns.best:6.1f} {choice.entry.comparison.l1:9.2e} {l1:9.2e} +- {spread:8.1e}  "
                f"{choice.reason}"
            )
        total = manifest["total"]
        print(f"{total['materials']} materials, {total['bytes']} bytes, {total['ns']:.0f} ns for one look-up of each")
        print(f"a MERL table each: {total['naive_bytes']} bytes; this is {100 * total['share_of_naive']:.3f} % of it")
        print(f"worst error on fresh directions: {worst:.2f} x tolerance; problems: {planned.problems or 'none'}")


if __name__ == "__main__":
    main()
