"""The command `brdf harmonics`: an expansion in spherical harmonics, its errors in numbers and as a picture."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.cli import arguments
from brdfcore.cli.make import Force, Json, may_write
from brdfcore.cli.output import as_json, bytes_text, facts, line, progress_bar, warn
from brdfcore.names import Target, Window

#: Degrees whose errors are printed, beside the last.
_SHOWN = (0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)

_HELP = """Expand a material in spherical harmonics of both directions and say what that leaves out.

The target is f_r cos theta_i cos theta_o unless --target says otherwise. Errors are relative L2 over all pairs of
directions, in two norms: of the target, which is what a scene sees, and of f_r itself, which grazing angles rule.
--lmax gives the degree; --tolerance looks for the smallest whose error of the target is below it, or says what it would
take. -o writes a table (.h5), or a picture (.png, .svg): error by degree, spectrum, slices over the original.

\b
Examples:
  brdf harmonics cook_torrance:roughness=0.3 --lmax 16
  brdf harmonics paint.bsdf --tolerance 0.05 -o paint-sh.h5
  brdf harmonics paint.bsdf --lmax 24 -o paint.png --theta-i 0,45 --json"""


def harmonics(
    source: Annotated[str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or NAME:key=value,...")],
    lmax: Annotated[
        int | None, typer.Option(min=1, help="Largest degree; 32 if no tolerance.", show_default=False)
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Error of the target to reach, e.g. 0.05.", show_default=False)
    ] = None,
    target: Annotated[Target, typer.Option(help="What is expanded.")] = "f_cos_cos",
    window: Annotated[Window | None, typer.Option(help="Against ringing.", show_default=False)] = None,
    symmetrise: Annotated[bool, typer.Option("--symmetrise", help="Keep the reciprocal part only.")] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", help=".h5, .png or .svg file.", show_default=False)] = None,
    theta_i: Annotated[
        str, typer.Option(metavar="LIST", help="Slices of a picture, degrees; one to four.")
    ] = "0,30,60",
    channel: Annotated[str | None, typer.Option(help="Of the slices.", show_default=False)] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    from brdfcore.build.project import project
    from brdfcore.harmonics.summary import harmonic_summary

    kind = None if out is None else out.suffix.lower().removeprefix(".")
    if kind not in (None, "h5", "png", "svg"):
        raise InputError(
            "bad_extension", f"{out}: expected a name ending in .h5, .png or .svg", where="--out", got=kind
        )
    if out is not None:
        may_write(out, force or kind != "h5")  # a picture is replaced, as by brdf plot
    lights = np.asarray(arguments.angle("theta_i", arguments.numbers("--theta-i", theta_i), "deg"))
    b = arguments.load(source)
    start = time.perf_counter()
    with progress_bar() as progress:
        degree: Any = lmax if lmax is not None else 32 if tolerance is None else "auto"
        made = project(
            b, degree, tolerance=tolerance, target=target, window=window, symmetrise=symmetrise, progress=progress
        )
    seconds = time.perf_counter() - start
    told = harmonic_summary(made)
    if out is not None:
        if kind == "h5":
            made.save(out)
        else:
            _draw(out, str(kind), b, made, lights, channel, arguments.label(source))
    if json:
        as_json({"input": source, "file": None if out is None else str(out), "seconds": seconds, **told})
        return
    _print(source, told, made.report, seconds)
    if out is not None:
        line(str(out))


def _draw(out: Path, kind: str, b: Brdf, made: Any, lights: Any, channel: str | None, title: str) -> None:
    from brdfcore import plot as pictures

    figure = pictures.expansion(b, made, lights, channel=channel, title=title)
    write_file(out, pictures.render(figure, kind))


def _print(source: str, told: dict[str, Any], report: dict[str, Any], seconds: float) -> None:
    symmetric = (
        "symmetric: half of them stored" if told["reciprocal"] else "not symmetric: the source is not reciprocal"
    )
    line(source, style="bold")
    line(f"degree {told['lmax']} of {told['target']}, {bytes_text(told['bytes'])}, {seconds:.2f} s")
    line(f"  coefficients     {told['coefficients']:,} a channel, {symmetric}")
    line("relative L2 error      of the target     of f_r")
    for key, words in (
        ("truncation", "truncation"), ("projection", "  without window"), ("quadrature", "sampling")
    ):  # fmt: skip
        if key != "projection" or told["window"]["name"] != "none":
            line(f"  {words:<20} {told[key]['target']:<17.4g} {told[key]['f']:.4g}")
    if told["window"]["name"] != "none":
        w = told["window"]
        line(f"window {w['name']}: on a step, undershoot {w['undershoot']:.3g} and relative L2 error {w['l2']:.3g}")
    if "symmetrised" in told:
        line(
            f"not reciprocal, and left out as asked: {100 * told['symmetrised']['energy_removed']:.3g} % of the energy"
        )
    light, viewer = (told["spectrum"][side] for side in ("light", "viewer"))
    line("degree   error if it ended there   energy of the light, of the viewer")
    for l in sorted({*(k for k in _SHOWN if k < told["lmax"]), told["lmax"]}):  # noqa: E741
        line(f"  {l:>4}   {told['error_by_degree'][l]:<23.4g}   {100 * light[l]:.3g} %, {100 * viewer[l]:.3g} %")
    at = ", ".join(f"{x:.4g}" for x in told["minimum_at"])
    line(f"f_r from {told['minimum']:.4g} to {told['maximum']:.4g} 1/sr; least at {at} degrees")
    facts({"done": report.get("done", [])})
    if told["minimum"] < 0:
        warn("the expansion is negative in places: it rings there; a window makes that less")
    for text in report.get("warnings", ()):
        warn(text)


def add_to(app: typer.Typer) -> None:
    """Register the command."""
    app.command(help=_HELP, short_help="Expand in spherical harmonics; errors, spectrum, picture.")(harmonics)
