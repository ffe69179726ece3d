"""The commands of `brdf` that weigh representations: report."""

from __future__ import annotations

import shlex
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from brdfcore.cli import arguments
from brdfcore.cli.make import may_write
from brdfcore.cli.output import as_json, line, progress_bar

Json = Annotated[bool, typer.Option("--json", help="The same as the .json form, on stdout too.")]


def report(
    sources: Annotated[list[str], typer.Argument(metavar="MATERIAL...", show_default=False, help="Files or models.")],
    out: Annotated[Path, typer.Option("--out", "-o", help=".html, .json, .md or .png file.", show_default=False)],
    tolerance: Annotated[
        float | None, typer.Option(help="Error (L1) that is right enough.", show_default="0.01")
    ] = None,
    max_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="E.g. 500kB: nothing larger is chosen.", show_default=False)
    ] = None,
    tables: Annotated[
        Path | None, typer.Option(metavar="DIR", help="For the tables.", show_default="OUT's name-tables")
    ] = None,
    peers: Annotated[
        bool, typer.Option("--peers/--no-peers", help="Time scipy, interpn and Mitsuba beside, where installed.")
    ] = True,
    seconds: Annotated[float, typer.Option(help="About how long a material may take.")] = 240.0,
    json: Json = False,
) -> None:
    from brdfcore.reporting.report import Subject, kind_of
    from brdfcore.reporting.report import report as make

    kind_of(out)  # refused before the work
    may_write(out, force=True)
    limit = None if max_bytes is None else arguments.byte_count("--max-bytes", max_bytes)
    folder = tables or out.with_name(f"{out.stem}-tables")
    names = [arguments.label(s) for s in sources]
    if len(set(names)) < len(names):  # files of one name in several folders
        names = sources
    subjects = []
    for name, source in zip(names, sources):
        path = Path(source)
        subjects.append(Subject(name, arguments.load(source), source, path if path.is_file() else None))
    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what a table's error says as well
        made = make(
            subjects,
            tolerance=tolerance,
            max_bytes=limit,
            tables=folder,
            peers=peers,
            seconds=seconds,
            command=shlex.join(["brdf", *sys.argv[1:]]) if sys.argv[1:2] == ["report"] else "",
            progress=progress,
        )
        made.write(out)
    if json:
        as_json(made.to_json())
        return
    from brdfcore.reporting import words

    for item in made.items:
        line(f"{item.found.material}: {words.advice(item.found)}")
    line(str(out))


_HELP: dict[Any, str] = {
    report: """Which representation does a material need? Error, memory and speed of all of them, and which to use.

Builds every table that can hold MATERIAL over a range of sizes, measures each one's error on random directions and its
look-ups' time, and chooses the fastest within --tolerance (of equally fast ones the smallest). Takes a minute or two a
material. .html is one page that loads nothing from elsewhere; .json has every number; .md and .png are for documents.
The chosen tables are written, read again and measured once more. An existing file is replaced.

\\b
Examples:
  brdf report cook_torrance:roughness=0.1,ior=gold paint.bsdf -o report.html
  brdf report paint.bsdf --tolerance 0.002 --max-bytes 1MB -o report.json --tables tables""",
}
_SHORT: dict[Any, str] = {report: "Say which representation a material needs: error, bytes, speed."}


def add_to(app: typer.Typer) -> None:
    """Register the commands of this module."""
    for command, text in _HELP.items():
        app.command(help=text, short_help=_SHORT[command])(command)
