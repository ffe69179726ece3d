"""`brdf gloss`: what a glossmeter would read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdfcore.base.errors import InputError
from brdfcore.cli import arguments
from brdfcore.cli.output import as_json, line

if TYPE_CHECKING:
    from brdfcore.analysis.gloss.gloss import Geometry, Gloss

#: Channels printed; JSON has all of them.
_MOST_COLUMNS = 6


def gloss(
    source: Annotated[str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or NAME:key=value,...")],
    geometry: Annotated[
        list[str] | None,
        typer.Option(metavar="THETA:SOURCE:RECEPTOR", help="Not 20, 60, 85: 45:0.75,2.5:2,4", show_default=False),
    ] = None,
    collimated: Annotated[bool, typer.Option("--collimated", help="A source of no width.")] = False,
    reference_ior: Annotated[float, typer.Option(help="Index of the black glass that has 100 GU.")] = 1.567,
    tolerance: Annotated[float, typer.Option(help="Error to stop at, gloss units.")] = 0.05,
    json: Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")] = False,
) -> None:
    from dataclasses import replace

    from brdfcore.analysis.gloss import gloss as module

    geometries = list(module.GLOSS) if not geometry else [_geometry(text) for text in geometry]
    haze: Geometry | None = module.HAZE
    if collimated:
        geometries = [replace(g, source=(0.0, 0.0)) for g in geometries]
        haze = replace(module.HAZE, source=(0.0, 0.0))
    found = module.gloss(
        arguments.load(source), geometries=geometries, haze=haze, reference_ior=reference_ior, tolerance=tolerance
    )
    if json:
        as_json({"input": source, **found.to_json()})
        return
    line(source, style="bold")
    for text in _page(found):
        line(text)


def _geometry(text: str) -> Geometry:
    """THETA:ALONG,ACROSS:ALONG,ACROSS, degrees."""
    from brdfcore.analysis.gloss.gloss import Geometry

    parts = text.split(":")
    if len(parts) != 3:
        raise InputError(
            "bad_geometry",
            f"--geometry {text[:80]!r}: expected THETA:SOURCE:RECEPTOR in degrees, e.g. 45:0.75,2.5:2,4",
            where="--geometry",
            got=text[:80],
            expected="THETA:ALONG,ACROSS:ALONG,ACROSS",
        )
    theta, source, receptor = (tuple(arguments.numbers("--geometry", part).tolist()) for part in parts)
    if len(theta) != 1:
        raise InputError("bad_geometry", f"--geometry {text[:80]!r}: one THETA", where="--geometry", got=text[:80])
    return Geometry(parts[0].strip(), theta[0], source, receptor)


def _page(found: Gloss) -> Iterator[str]:
    labels = found.channels.labels()
    shown = labels[:_MOST_COLUMNS]
    yield f"gloss units: 100 is polished black glass of n = {found.reference_ior:g} in the same geometry"
    yield f"{'':<22}" + "".join(f"{name:>12}" for name in (*shown, "luminance")) + "   error"
    for name, reading in found.gloss.items():
        yield _row(f"gloss {name} deg", reading.to_json(), len(shown), not reading.converged)
    titles = {"astm_d4039": "haze D4039, G60-G20", "astm_e430": "haze E430, at 20 deg"}
    for name, values in found.haze.items():
        yield _row(titles[name], values, len(shown), not values.get("converged", True))
    if len(labels) > len(shown):
        yield f"{len(labels)} channels in all; --json has every one"
    yield f"luminance: {found.luminance_of}"
    yield f"standards: {'; '.join(found.standards) or 'none: the geometries are not theirs'}"
    for name, reading in found.gloss.items():
        g = reading.geometry
        sizes = f"source {g.source[0]:g} x {g.source[1]:g}, receptor {g.receptor[0]:g} x {g.receptor[1]:g} degrees"
        mirror = f"; {max(reading.of_delta):.4g} GU by the perfect mirror part" if any(reading.of_delta) else ""
        yield f"  {name}: {sizes} (in the plane of incidence x across it){mirror}"


def _row(title: str, values: dict[str, Any], count: int, doubtful: bool) -> str:
    def cell(x: float | None) -> str:
        return f"{'-' if x is None else format(x, '.4g' if abs(x) < 10 else '.2f'):>12}"

    errors = [e for e in values["error"] if e is not None]
    worst = f"± {max(errors):.1g}" if errors else "not finite"
    cells = "".join(cell(x) for x in (*values["values"][:count], values["luminance"]))
    return f"{title:<22}{cells}   {worst}{', above the tolerance' if doubtful else ''}"


_HELP = """What a glossmeter reads: gloss at 20, 60 and 85 degrees and haze, over the apertures of the standards.

ISO 2813 / ASTM D523 (gloss), ASTM D4039 (haze index G60 - G20), ASTM E430 B / ISO 13803 (haze beside the 20 degree
image). The integration resolves lobes far narrower than the receptor and counts a perfect mirror part exactly; its
error is printed. Metals exceed 100.

\b
Examples:
  brdf gloss paint.bsdf
  brdf gloss cook_torrance:roughness=0.01,ior=glass --json
  brdf gloss gold.h5 --geometry 45:0.75,2.5:2,4 --geometry 60:0,0:4.4,11.7"""


def add_to(app: typer.Typer) -> None:
    """Register the command."""
    app.command(help=_HELP, short_help="Gloss at 20, 60 and 85 degrees, and haze.")(gloss)
