"""`brdf albedo`: how much of the light from a direction is reflected at all."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
import typer

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import LimitError
from brdfcore.cli import arguments
from brdfcore.cli.output import as_json, line

#: Channels printed; JSON has all of them.
_MOST_COLUMNS = 6
#: Angles at a time: each may take 400,000 evaluations.
_MOST_ANGLES = 1_000
#: Decimals printed at most, however small the error.
_MOST_DECIMALS = 9


def albedo(
    source: Annotated[str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or NAME:key=value,...")],
    theta_i: Annotated[str, typer.Option(metavar="LIST", help="Polar angles of the light.")] = "0,30,60",
    angles: arguments.Unit = "deg",
    json: Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")] = False,
) -> None:
    given = arguments.numbers("--theta-i", theta_i)
    if given.size > _MOST_ANGLES:
        raise LimitError(
            "too_many_angles", f"--theta-i: {given.size} angles; at most {_MOST_ANGLES}",
            where="--theta-i", got=given.size, limit=_MOST_ANGLES,
        )  # fmt: skip
    theta = arguments.angle("theta_i", given, angles)
    b = arguments.load(source)
    values, error = b.albedo_error(theta, tolerance=None)
    delta = b.delta_reflectance(theta)
    if json:
        as_json(
            {
                "input": source,
                "theta_i": given.tolist(),
                "angles": angles,
                "values": values.tolist(),
                "error": error.tolist(),
                "delta_reflectance": delta.tolist(),
                "channels": b.channels.to_json(),
                "has_delta": b.has_delta,
            }
        )
        return
    line(source, style="bold")
    for text in _page(b, given, angles, values, error, delta):
        line(text)


def _page(
    b: Brdf, theta: FloatArray, unit: str, values: FloatArray, error: FloatArray, delta: FloatArray
) -> Iterator[str]:
    labels = b.channels.labels()
    shown = labels[:_MOST_COLUMNS]
    head = f"{'theta_i, ' + unit:<14}" + "".join(f"{name:>14}" for name in shown)
    yield "directional-hemispherical reflectance" + (", the perfect mirror part included" if b.has_delta else "")
    yield f"{head}   error"
    for angle, row, off in zip(theta, values, error):
        worst = f"± {off.max():.1g}" if np.isfinite(off).all() else "not finite"
        yield f"{angle:<14g}" + "".join(f"{known(x, e):>14}" for x, e in zip(row[: len(shown)], off)) + f"   {worst}"
    if b.has_delta:
        yield "by the perfect mirror part alone"
        yield head
        for angle, row, off in zip(theta, delta, error):
            yield f"{angle:<14g}" + "".join(f"{known(x, e):>14}" for x, e in zip(row[: len(shown)], off))
    if len(labels) > len(shown):
        yield f"{len(labels)} channels in all; --json has every one"


def known(value: float, error: float) -> str:
    """`value` to the decimal of the leading digit of its error."""
    if not (math.isfinite(value) and math.isfinite(error)):
        return f"{value:.3g}"
    decimals = -math.floor(math.log10(error)) if error > 0 else _MOST_DECIMALS
    return f"{value:.{min(max(decimals, 0), _MOST_DECIMALS)}f}"


_HELP = """The share of the light from each direction that is reflected into all directions, by channel.

The integral of f_r cos theta_o over the hemisphere of viewers, a perfect mirror part included. Panels of the quadrature
are halved until their estimated error, which is printed, is small: below 5e-7 for a formula, 1e-3 for measured or
interpolated values, where the estimate is far above the error. Digits past it are left out; --json has all.

\b
Examples:
  brdf albedo cook_torrance:roughness=0.1,ior=gold
  brdf albedo paint.bsdf --theta-i 0,45,80,89
  brdf albedo mirror:ior=silver --json"""


def add_to(app: typer.Typer) -> None:
    """Register the command."""
    app.command(help=_HELP, short_help="Reflectance of the light from a direction.")(albedo)
