"""`brdf example`: files to try the other commands on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brdfcore.cli.make import may_write
from brdfcore.cli.output import as_json, line


def example(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Made if absent.")] = Path("."),
    force: Annotated[bool, typer.Option("--force", help="Replace the files if they exist.")] = False,
    json: Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")] = False,
) -> None:
    from brdfcore.examples import FILES, example_files

    if folder.is_dir():
        for name in FILES:
            may_write(folder / name, force)
    paths = example_files(folder, replace=force)
    if json:
        as_json({"files": [str(path) for path in paths]})
        return
    for path in paths:
        line(str(path))


def add_to(app: typer.Typer) -> None:
    app.command(
        short_help="Write small files to try the other commands on.",
        help="""Write three small files of one made-up paint into FOLDER: paint.csv, a goniometer's scan with noise;
paint.bsdf, another in the RGL database's format; paint.json, the truth behind both.

\\b
Examples:
  brdf example
  brdf info paint.csv
  brdf plot paint.json paint.csv paint.bsdf -o paint.png --scale log""",
    )(example)
