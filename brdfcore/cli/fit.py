"""`brdf fit`: the analytic model that stands for a material, and what it loses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from brdfcore.base.errors import InputError
from brdfcore.cli import arguments
from brdfcore.cli.make import may_write
from brdfcore.cli.output import as_json, line, percent

if TYPE_CHECKING:
    from brdfcore.analysis.fit.fit import Fit

#: Parameters and correlated pairs printed; JSON has all of them.
_MOST_ROWS, _MOST_PAIRS = 40, 5


def fit(
    source: Annotated[str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or NAME:key=value,...")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Model file to write, .json.", show_default=False)
    ] = None,
    model: Annotated[str, typer.Option(help="auto, ggx, cook_torrance, ward, phong or blinn_phong.")] = "auto",
    lobes: Annotated[str, typer.Option(metavar="[auto|0..3]", help="Specular lobes on the diffuse base.")] = "auto",
    loss: Annotated[str, typer.Option(help="auto, energy, relative, cube_root or log: what is made small.")] = "auto",
    base: Annotated[str, typer.Option(metavar="[lambert|oren_nayar]", help="The diffuse part.")] = "lambert",
    light: arguments.Light = None,
    view: arguments.View = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
    json: Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")] = False,
) -> None:
    from brdfcore.analysis.fit.fit import fit as fitted
    from brdfcore.formats.io.files import write

    if out is not None:
        may_write(out, force)
    angles = {
        name: arguments.angle_range(f"--{name}", text)
        for name, text in (("light", light), ("view", view))
        if text is not None
    }
    found = fitted(arguments.load(source), model, _count(lobes), loss, base=base, angles=angles)
    if out is not None:
        write(found, out, format="model")
    if json:
        as_json({"input": source, "file": None if out is None else str(out), **found.to_json()})
        return
    line(source if out is None else f"{source} -> {out}", style="bold")
    for text in _page(found):
        line(text)


def _count(text: str) -> int | str:
    if text == "auto":
        return text
    if text not in ("0", "1", "2", "3"):
        said = f"--lobes {text[:40]!r}: expected auto, or 0 to 3"
        raise InputError("bad_option", said, where="--lobes", got=text[:40], expected="auto, or 0 to 3")
    return int(text)


def _page(found: Fit) -> Iterator[str]:
    yield "model: " + " + ".join(str(term["model"]) for term in found.terms)
    error = "" if np.isnan(found.l1_stderr) else f" ± {percent(found.l1_stderr)}"
    where = "over the measured geometries" if np.isnan(found.l1_stderr) else "on directions that it was not fitted on"
    yield f"L1: {percent(found.l1)}{error} of the reflected energy is in the wrong place, {where}"
    yield f"made small: {found.loss}, {found.value:.4g}; condition number {found.condition:.3g}"
    yield f"{'parameter':<34}{'value':>12}   95 % interval"
    for e in found.estimates[:_MOST_ROWS]:
        interval = e.why if e.low is None or e.high is None else f"{e.low:.4g} to {e.high:.4g}"
        yield f"{e.name:<34}{e.value:>12.5g}   {interval}"
    if len(found.estimates) > _MOST_ROWS:
        yield f"{len(found.estimates)} parameters in all; --json has every one"
    for one, other, correlation in found.correlated[:_MOST_PAIRS]:
        yield f"hardly told apart: {one} and {other}, correlation {correlation:+.3f}"
    for remark in found.remarks:
        yield f"note: {remark}"


_HELP = """The analytic model nearest to a material, and what it loses.

A diffuse base and up to three lobes (GGX, Cook-Torrance, Ward, Phong, Blinn-Phong). No start values are asked. The
share of energy that the model misplaces is measured on directions that it was not fitted on; every parameter has its
interval, or the reason why it has none. Measured points are fitted as points.

\b
Examples:
  brdf fit paint.bsdf -o fitted.json
  brdf fit paint.csv --model ggx --lobes 1
  brdf plot paint.bsdf fitted.json -o both.png"""


def add_to(app: typer.Typer) -> None:
    """Register the command."""
    app.command(help=_HELP, short_help="The analytic model nearest to a material, and what it loses.")(fit)
