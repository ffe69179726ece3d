"""`brdf check`: what is wrong with a BRDF, on one page."""

from __future__ import annotations

from typing import Annotated

import typer

from brdfcore.cli import arguments
from brdfcore.cli.output import as_json, line

#: Exit code if a check failed, so that scripts need not read the page.
CHECK_FAILED = 3
_STYLES = {"pass": "green", "note": "yellow", "fail": "bold red", "head": "bold", "": None}


def check(
    source: Annotated[str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or NAME:key=value,...")],
    directions: Annotated[int, typer.Option(help="Random direction pairs.")] = 100_000,
    seed: Annotated[int, typer.Option(help="Of the random directions.")] = 20_261_122,
    json: Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")] = False,
) -> None:
    from brdfcore.analysis.check.checks import check as run

    report = run(arguments.load(source), directions=directions, seed=seed)
    if json:
        as_json({"input": source, **report.to_json()})
    else:
        line(source, style="bold")
        for text, kind in report.lines():
            line(text, style=_STYLES[kind])
    if not report.passed:
        raise typer.Exit(CHECK_FAILED)


_HELP = """Check energy, reciprocity, sign, symmetry, the normal and the horizon, and print one page.

Every amount is misplaced reflectance: 0.01 is 1 % of the light that arrives. The worst directions are named in
degrees. "note" is what measurements do and nobody promised otherwise; "fail" is past a threshold, which the page
gives with its reason, or against what the source declares.

Exit code 0 if nothing failed, 3 if something did (1 and 2 as for every command).

\b
Examples:
  brdf check paint.bsdf
  brdf check phong:exponent=10,convention=published
  brdf check gold.h5 --json"""


def add_to(app: typer.Typer) -> None:
    """Register the command."""
    app.command(help=_HELP, short_help="Check energy, reciprocity, sign and symmetry; one page.")(check)
