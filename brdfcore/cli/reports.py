"""The commands of `brdf` that weigh representations: report for a material, plan for a scene."""

from __future__ import annotations

import math
import shlex
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from brdfcore.cli import arguments
from brdfcore.cli.make import may_write
from brdfcore.cli.output import as_json, bytes_text, line, progress_bar, warn

Json = Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")]


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
    seconds: Annotated[
        float | None,
        typer.Option(help="About how long a material may take; what that leaves out is said.", show_default=False),
    ] = None,
    json: Json = False,
) -> None:
    from brdfcore.reporting.item import Subject
    from brdfcore.reporting.report import kind_of
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


def plan(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.json", show_default=False, help="The scene, see below.")],
    build: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the tables here, for `brdf serve`.", show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    from brdfcore.analysis.plan.build import build as write
    from brdfcore.analysis.plan.plan import MERL_BYTES
    from brdfcore.analysis.plan.plan import plan as make
    from brdfcore.reporting import words

    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = make(scene, progress=progress)
        manifest = write(made, build, progress=progress) if build is not None else None
    if json:
        as_json(manifest or made.to_json())
        return
    rows = [("material", "use", "error", "bytes", "ns", "because")]
    for choice in made.choices:
        rows.append((
            ", ".join(choice.names), choice.entry.label, words.percent(choice.entry.error),
            words.size(choice.entry.nbytes), f"{choice.entry.ns.best:.3g}", choice.reason,
        ))  # fmt: skip
        best = sorted(choice.alternatives, key=lambda a: not a[0].meets(choice.tolerance))[:2]
        for e, why in best:
            numbers = (words.percent(e.error), words.size(e.nbytes), f"{e.ns.best:.3g}")
            rows.append(("", f"  not {e.label}", *numbers, why))
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    for k, row in enumerate(rows):
        line("  ".join([*(cell.ljust(w) for cell, w in zip(row, widths)), row[5]]), "bold" if k == 0 else None)
    line()
    count = len(made.scene.materials)
    line(f"{count} materials: {bytes_text(made.nbytes)} and {made.ns:.0f} ns for a look-up of each")
    share = words.percent(made.nbytes / made.naive_bytes)
    line(f"a MERL table each: {count} x {bytes_text(MERL_BYTES)}; this is {share} of it")
    if build is not None:
        off = [(c.verified["error"], c.tolerance) for c in made.choices if c.verified]
        worst = max(math.inf if error is None else error / tolerance for error, tolerance in off)
        line(f"{build}: written and measured again on other directions; the worst error is {worst:.2f} x its tolerance")
    for text in made.problems:
        warn(text)


_HELP: dict[Any, str] = {
    plan: """What does a scene need? For each material the smallest representation that is right enough, and why.

SCENE.json lists materials, how each is seen, and a budget:

\b
  {"budget": {"error": 0.01, "bytes": 5e6, "ns": 20},
   "materials": [
     {"name": "wall", "model": "lambert", "parameters": {"reflectance": 0.8}},
     {"name": "car", "file": "paint.bsdf", "light": [0, 80], "view": [10, 60],
      "lighting": "environment", "channels": ["G"], "error": 0.02}]}

error is that of each material under light from any one angle (default 0.01), bytes that of all tables together, ns the
longest time of a look-up on one core; light and view are ranges of theta_i and theta_o in degrees ("angles": "rad"
switches); lighting is "lamps" or "environment"; channels are names or wavelengths. What is left out is not restricted.
Files are sought beside the scene.
Equal materials share one table; only the channels needed are stored; errors are measured over the angles seen; a
formula is kept where it is quick. --build writes NAME.h5, NAME.json and plan.manifest, which `brdf serve --data DIR`
serves, and measures each file on directions that nothing was chosen by.

\b
Examples:
  brdf plan scene.json
  brdf plan scene.json --build materials --json""",
    report: """Which representation does a material need? Error, memory and speed of all of them, and which to use.

Builds every table that can hold MATERIAL over a range of sizes, measures each one's error on random directions and its
look-ups' time, and chooses the fastest within --tolerance (of equally fast ones the smallest). Takes a minute or two a
material. .html is one page that loads nothing from elsewhere; .json has every number; .md and .png are for documents.
The chosen tables are written, read again and measured once more. An existing file is replaced.

\b
Examples:
  brdf report cook_torrance:roughness=0.1,ior=gold paint.bsdf -o report.html
  brdf report paint.bsdf --tolerance 0.002 --max-bytes 1MB -o report.json --tables tables""",
}
_SHORT: dict[Any, str] = {
    plan: "Say what a scene's materials need, and build it.",
    report: "Say which representation a material needs: error, bytes, speed.",
}


def add_to(app: typer.Typer) -> None:
    """Register the commands of this module."""
    for command, text in _HELP.items():
        app.command(help=text, short_help=_SHORT[command])(command)
