"""`brdf repair`: named repairs into a table, with what each changed."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from brdfcore.cli import arguments
from brdfcore.cli.make import may_write
from brdfcore.cli.output import as_json, bytes_text, error_lines, line, percent, progress_bar, warn


def repair(
    source: Annotated[str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or NAME:key=value,...")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Table file to write, .h5.", show_default=False)],
    do: Annotated[
        str,
        typer.Option(metavar="NAMES", help="bilateral, reciprocity, negatives, energy.", show_default=False),
    ],
    representation: Annotated[str, typer.Option(help="Name from `brdf models --all`, or auto.")] = "auto",
    tolerance: Annotated[
        float | None, typer.Option(help="L1 of the table against the repaired one.", show_default="0.01")
    ] = None,
    max_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="E.g. 4.5MB: the best table within.", show_default=False)
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
    json: Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")] = False,
) -> None:
    from brdfcore.analysis.check.repair import repair as run
    from brdfcore.build.tabulate import ToleranceWarning, tabulate

    may_write(out, force)
    limit = None if max_bytes is None else arguments.byte_count("--max-bytes", max_bytes)
    repaired = run(arguments.load(source), [part.strip() for part in do.split(",")])
    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # the table's own warnings say it as well
        table = tabulate(repaired, representation, tolerance=tolerance, max_bytes=limit, progress=progress)
    # every representation keeps what it likes of the source's report: the repairs stay with the table in any case
    table.report = {**table.report, "repairs": repaired.report["repairs"]}
    table.save(out)
    if json:
        as_json({
            "file": str(out),
            "repairs": repaired.report["repairs"],
            "warnings": repaired.report["warnings"],
            "representation": table.name,
            "nbytes": table.nbytes,
            "id": table.id,
            "error": table.error,
        })  # fmt: skip
        return
    for entry in repaired.report["repairs"]:
        for text in _lines(entry):
            line(text)
    line(f"{out}: {table.name}, {bytes_text(table.nbytes)}; its error is against the repaired material")
    for text in error_lines(table.error, table.has_delta):
        line(text)
    for text in [*repaired.report["warnings"], *table.error["warnings"]]:
        warn(text)


def _lines(entry: dict[str, Any]) -> Iterator[str]:
    largest = [max(max(row) for row in entry[k]) for k in ("albedo_before", "albedo_after")]
    moved = [
        (max(abs(a - b) for a, b in zip(x, y)), theta)
        for x, y, theta in zip(entry["albedo_before"], entry["albedo_after"], entry["theta_i"])
    ]
    most, at = max(moved)
    changed, l1, error = (percent(entry[k]) for k in ("values_changed", "l1", "l1_stderr"))
    yield f"{entry['name']}: {entry['what']}"
    yield f"  changed          {changed} of the values, {l1} ± {error} of the reflected light (L1)"
    yield f"  largest albedo   {largest[0]:.5g} before, {largest[1]:.5g} after"
    yield f"  albedo moved     by {most:.3g} at theta_i = {at:g} degrees, where it moved most"
    if entry.get("scaled_from") is not None:
        least = entry["smallest_factor"]
        yield f"  scaled           from theta_i = {entry['scaled_from']:.4g} degrees on, by {least:.3g} at the least"


_HELP = """Repair what `brdf check` found, only as asked, and write the result as a table.

\b
--do takes one or several, made in this order:
  bilateral     average f(delta_phi) and f(-delta_phi)
  reciprocity   average f(i,o) and f(o,i)
  negatives     set negative values to 0
  energy        where the albedo passes 1, scale f by a factor of theta_i

What each one changed is printed and stays in the table's report. An existing file is replaced with --force only.

\b
Examples:
  brdf repair paint.bsdf -o paint.h5 --do negatives
  brdf repair phong:exponent=10,convention=published -o phong.h5 --do reciprocity,energy"""


def add_to(app: typer.Typer) -> None:
    """Register the command."""
    app.command(help=_HELP, short_help="Repair what check found, as asked, into a table.")(repair)
