"""The speed-against-error report of one or several materials: measured once, written as page, picture, text or JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from brdfcore.analysis.pareto.pareto import Pareto, pareto
from brdfcore.analysis.pareto.timing import versions
from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError, StorageError
from brdfcore.build.judge import verified
from brdfcore.metrics import compare
from brdfcore.reporting.appearance import appearance
from brdfcore.reporting.error_map import error_map
from brdfcore.reporting.item import Item, Subject
from brdfcore.tables.base.table import Progress, Table
from brdfcore.tables.store import open_table

Kind = Literal["html", "json", "md", "png"]
KINDS: tuple[Kind, ...] = ("html", "json", "md", "png")
#: Seed of the directions on which a chosen table is measured again after it was written and read.
FRESH_SEED = 7


class Report:
    """Materials and what was found of each; `write` chooses the form by the file's name."""

    def __init__(self, items: Sequence[Item], command: str) -> None:
        self.items = list(items)
        self.command = command

    def to_json(self) -> dict[str, Any]:
        """{"materials": [{material, tolerance, machine, front, chosen, table_path, ...}], "versions", "command"}."""
        return {
            "materials": [item.to_json() for item in self.items],
            "versions": versions(),
            "command": self.command,
        }

    def render(self, kind: Kind) -> bytes:
        """The report as "html" (one page, nothing loaded from elsewhere), "json", "md" (Markdown) or "png"."""
        if kind not in KINDS:
            raise _bad_kind(str(kind))
        if kind == "json":
            return (json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n").encode()
        if kind == "md":
            from brdfcore.reporting.markdown import markdown

            return markdown(self.items, self.command).encode()
        if kind == "png":
            from brdfcore.plot.rendering import render
            from brdfcore.reporting.figures import sheet

            return render(sheet([(i.found, i.look, i.where, i.shown, i.shown_name) for i in self.items]), "png")
        from brdfcore.reporting.page import page

        return page(self.items, self.command).encode()

    def write(self, path: Path) -> None:
        """Whole or not at all; `InputError` for an extension that is none of `KINDS`."""
        content = self.render(kind_of(path))
        write_file(path, content)


def kind_of(path: Path) -> Kind:
    """What a file of this name holds."""
    kind = path.suffix.lower().removeprefix(".")
    for known in KINDS:
        if kind == known:
            return known
    raise _bad_kind(path.name)


def _bad_kind(got: str) -> InputError:
    listed = ", ".join(f".{k}" for k in KINDS)
    return InputError(
        "bad_extension", f"{got}: expected a name ending in {listed}", where="--out", got=got[-80:], expected=listed
    )


def report(
    subjects: Sequence[Subject] | Mapping[str, Brdf],
    *,
    tolerance: float | None = None,
    max_bytes: int | None = None,
    tables: Path | None = None,
    peers: bool = False,
    seconds: float | None = None,
    command: str = "",
    progress: Progress | None = None,
    **options: Any,
) -> Report:
    """Measure every material (`analysis.pareto.pareto.pareto`), compare pictures, and write the table of each.

    subjects the materials by name, or with what is known of where they come from.
    tables   folder for the chosen tables, made if absent; None writes none. A table is written if it is right enough,
             also where the formula was chosen over it.
    options  `sizes`, `representations`, `directions`, `rounds` of `pareto`.

    >>> wall = {"wall": bc.model("lambert")}
    >>> found = bc.report(wall, sizes=(8000,), representations=["angle_grid"], rounds=1, directions=20_000)
    >>> found.render("md").decode().startswith("#")
    True
    """
    if isinstance(subjects, Mapping):
        subjects = [Subject(label, b) for label, b in subjects.items()]
    if not subjects:
        raise InputError("wrong_number", "report: expected at least one material, got none", where="MATERIAL")
    items = []
    for k, subject in enumerate(subjects):
        told = _told(progress, subject.label, k, len(subjects))
        found = pareto(
            subject.brdf, material=subject.label, tolerance=tolerance, max_bytes=max_bytes, peers=peers,
            path=subject.path, seconds=seconds, progress=told, **options,
        )  # fmt: skip
        items.append(_item(subject, found, tables, told))
    return Report(items, command)


def _item(subject: Subject, found: Pareto, tables: Path | None, progress: Progress | None) -> Item:
    if progress is not None:
        progress(0, 1, "lighting spheres")
    shown = found.table if found.chosen.kind == "model" and found.table is not None else found.chosen
    assert shown.brdf is not None
    look = appearance(found.source, shown.brdf, need_flip=False)
    item = Item(subject, found, shown.brdf, shown.label, look, error_map(found.source, shown.brdf))
    best = found.table
    if tables is not None and best is not None and isinstance(best.brdf, Table) and best.meets(found.tolerance):
        if progress is not None:
            progress(0, 1, "writing the table and measuring it again")
        item.table_path, item.verified = _written(best.brdf, found, tables, subject.label)
    return item


def _written(table: Table, found: Pareto, folder: Path, label: str) -> tuple[Path, dict[str, Any]]:
    """Save, open again, and measure on directions that nothing was chosen by."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(
            "cannot_write", f"{folder}: {error.strerror or error}", where=str(folder), got=error.strerror
        ) from error
    table.error = {**table.error, "tolerance": found.tolerance}
    path = folder / f"{file_name(label)}.h5"
    table.save(path)
    again = compare(found.source, open_table(path), seed=FRESH_SEED).to_json()
    return path, verified(again)


def file_name(label: str) -> str:
    """`label` as a name that every file system and the service take."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", label).strip("-._")[:60] or "material"


def _told(progress: Progress | None, label: str, k: int, count: int) -> Progress | None:
    if progress is None:
        return None
    head = f"{label} ({k + 1} of {count}): " if count > 1 else ""
    return lambda done, total, stage: progress(done, total, f"{head}{stage}"[:100])
