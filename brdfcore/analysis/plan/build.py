"""Write what a plan chose into a folder that the service serves, and measure what was written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from brdfcore.analysis.pareto.pareto import is_formula
from brdfcore.analysis.plan.plan import Choice, Plan
from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Scaled, Sum
from brdfcore.base.errors import InputError, StorageError
from brdfcore.build.judge import verified
from brdfcore.formats.io.files import read, write
from brdfcore.metrics import compare
from brdfcore.tables.base.seen import Seen
from brdfcore.tables.base.table import Progress, Table

#: JSON, under a name that the service does not take for a material's.
MANIFEST = "plan.manifest"
#: Of the directions on which what was written is measured: nothing was chosen on them.
FRESH_SEED = 11


def build(plan: Plan, folder: Path, *, progress: Progress | None = None) -> dict[str, Any]:
    """Write NAME.h5 or NAME.json for each choice, and `MANIFEST`; the manifest as it was written.

    NAME is the first of the equal materials; the manifest's `names` maps every name of the scene to its file. Each file
    is read again and measured on other directions: `verified` of each material. Existing files are replaced; a file of
    the same name and the other kind is removed, as the service would not know which of the two is meant.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError("cannot_write", f"{folder}: {error.strerror or error}", where=str(folder)) from error
    for k, choice in enumerate(plan.choices):
        if progress is not None:
            progress(k, len(plan.choices), f"writing {choice.names[0]} and measuring it")
        _write(choice, folder)
    names = {name: c.path.name for c in plan.choices for name in c.names if c.path is not None}
    manifest = {"schema": 1, "names": names, **plan.to_json()}
    write_file(folder / MANIFEST, (json.dumps(manifest, indent=1, allow_nan=False) + "\n").encode())
    return manifest


def _write(choice: Choice, folder: Path) -> None:
    name, b = choice.names[0], choice.entry.brdf
    if isinstance(b, Table):
        over = Seen(choice.light, choice.view).attributes()
        b.error = {**choice.entry.comparison.to_json(), **over, "tolerance": choice.tolerance, "warnings": []}
        path, other = folder / f"{name}.h5", folder / f"{name}.json"
        b.save(path)
    elif b is not None and is_formula(b) and not isinstance(b, (Sum, Scaled)):
        path, other = folder / f"{name}.json", folder / f"{name}.h5"
        write(b, path, "model")
    else:
        raise InputError(
            "not_stored", f"{name}: a {type(b).__name__} can't be written to a file", where=name, got=type(b).__name__
        )
    other.unlink(missing_ok=True)
    again = read(path)
    reference = choice.source
    if len(again.channels) > len(reference.channels):  # a formula keeps all its channels
        from brdfcore.analysis.plan.scene import Selected

        again = Selected(again, [list(again.channels).index(c) for c in reference.channels])
    found = compare(
        reference, again, directions=choice.directions, seed=FRESH_SEED, light=choice.light, view=choice.view
    ).to_json()
    choice.path = path
    choice.verified = verified(found)
