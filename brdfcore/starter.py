"""A small library to look at on first start: models and tables that show what the service does."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import Any

from brdfcore.base.atomic import write_file
from brdfcore.base.catalogue import model
from brdfcore.build.tabulate import tabulate
from brdfcore.tables.base.table import Progress

#: name -> (model, parameters, shape of the table or None to keep the model itself, what it shows)
MATERIALS: dict[str, tuple[str, dict[str, Any], tuple[int, int, int] | None, str]] = {
    "white-lambert": ("lambert", {"reflectance": 0.8}, None, "a perfectly diffuse white: the same value everywhere"),
    "gold-satin": (
        "cook_torrance",
        {"roughness": 0.2, "ior": "gold"},
        (61, 61, 121),
        "gold, roughness 0.2, as a table",
    ),
    "gold-polished": (
        "cook_torrance",
        {"roughness": 0.02, "ior": "gold"},
        None,
        "gold, roughness 0.02, evaluated exactly",
    ),
    "gold-polished-grid": (
        "cook_torrance",
        {"roughness": 0.02, "ior": "gold"},
        (61, 61, 121),
        "the same gold in a plain angle grid: its lobe is narrower than a cell. Kept to show what the error says",
    ),
    "copper-rough": (
        "cook_torrance",
        {"roughness": 0.4, "ior": "copper"},
        (46, 46, 91),
        "copper, roughness 0.4, as a table",
    ),
    "red-plastic": (
        "cook_torrance",
        {"diffuse": [0.55, 0.06, 0.05], "specular": 0.4, "roughness": 0.15, "ior": "glass"},
        (61, 61, 121),
        "a red diffuse base under a dielectric lobe, three channels",
    ),
    "silver-mirror": (
        "mirror",
        {"ior": "silver"},
        None,
        "a perfect mirror: all of it is a delta, the regular part is 0",
    ),
}


def starter_library(folder: str | PathLike[str], progress: Progress | None = None) -> list[Path]:
    """Build the starter materials into `folder` (made if absent) and return their files.

    NAME.h5 holds a table, NAME.json a model with its parameters. Existing files are left as they are.
    Takes a few seconds; `progress(done, total, stage)` is called per material.

    >>> [path.name for path in bc.starter_library("materials")][:3]
    ['white-lambert.json', 'gold-satin.h5', 'gold-polished.json']
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for done, (name, (kind, parameters, shape, about)) in enumerate(MATERIALS.items()):
        if progress is not None:
            progress(done, len(MATERIALS), f"building {name}")
        path = folder / (f"{name}.json" if shape is None else f"{name}.h5")
        made.append(path)
        if path.exists():
            continue
        source = model(kind, **parameters)
        if shape is None:
            text = json.dumps({"model": kind, "parameters": parameters, "about": about}, indent=1)
            write_file(path, (text + "\n").encode())
        else:
            table = tabulate(source, "angle_grid", shape=shape)
            table.metadata["about"] = about
            table.save(path)
    if progress is not None:
        progress(len(MATERIALS), len(MATERIALS), "starter library ready")
    return made
