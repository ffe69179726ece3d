"""The commands of `brdf` that look at a material: models, info, eval, plot. Others: `cli.make`, `cli.harmonics`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
import typer

import brdfcore
from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import ANGLE_NAMES, broadcast_shape
from brdfcore.base.errors import InputError
from brdfcore.base.registry import FORMATS, MODELS, REPRESENTATIONS, Registry
from brdfcore.base.status import Status
from brdfcore.cli import albedo, arguments, check, example, export, fit, gloss, harmonics, make, repair, reports
from brdfcore.cli.output import as_json, error_lines, facts, line, parameter_lines
from brdfcore.names import Lighting, Scale, View

#: Of `plot`: a slice, a lit sphere, or where the values come from.
PlotView = Literal[View, "sphere", "coverage"]

Json = Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")]
Source = Annotated[
    str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or model as NAME:key=value,...")
]

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: the same on a terminal, in a pipe and in a log
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        line(f"brdf {brdfcore.__version__}")
        raise typer.Exit


@app.callback(
    help=f"""Reflectance tables with a known error: look at materials, tabulate, evaluate, plot, convert, serve.

{arguments.GRAMMAR}

Angles are degrees unless --angles rad is given. f_r is in 1/sr, without the cosine; the mirror direction is
theta_o = theta_i, delta_phi = 180.

Exit codes: 0 done, 1 a file or the machine is in the way, 2 wrong command line or input, 3 a check failed (brdf
check), 130 interrupted. Errors go to stderr; with --json as {{"error": {{"code", "detail", "context"}}}}.

\b
Examples:
  brdf models
  brdf tabulate cook_torrance:roughness=0.2,ior=gold -o gold.h5
  brdf plot gold.h5 -o gold.svg --scale log
  brdf serve"""
)
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error; anywhere on the line.")
    ] = False,
) -> None:
    pass


@app.command(
    short_help="List models, table representations and file formats.",
    help="""List the models; with NAME the details of one.

\b
Examples:
  brdf models
  brdf models cook_torrance
  brdf models --all --json""",
)
def models(
    name: Annotated[str | None, typer.Argument(help="One model.", show_default=False)] = None,
    everything: Annotated[bool, typer.Option("--all", help="Also table representations and file formats.")] = False,
    json: Json = False,
) -> None:
    registries = [MODELS, REPRESENTATIONS, FORMATS] if everything else [MODELS]
    if name is not None:
        holder = next((r for r in registries if name in r), MODELS)
        entries = {holder.kind: [_entry(holder, name)]}
    else:
        entries = {r.kind: [_entry(r, n) for n in r] for r in registries}
    if json:
        as_json({f"{kind}s": [{**e, "parameters": [p.to_json() for p in e["parameters"]]} for e in listed]
                 for kind, listed in entries.items()})  # fmt: skip
        return
    for kind, listed in entries.items():
        if len(entries) > 1:
            line(f"{kind.upper()}S", style="bold")
        for entry in listed:
            line(entry["name"], style="bold")
            for key in ("summary", "formula", "extensions", *(["reference"] if name else [])):
                if entry[key]:
                    line(f"  {entry[key]}")
            for text in parameter_lines(entry["parameters"]):
                line(f"    {text}")
            line()


def _entry(registry: Registry, name: str) -> dict[str, Any]:
    cls = registry.load(name)
    extensions = " ".join(getattr(cls, "EXTENSIONS", ()))
    if extensions:
        extensions += ", read and written" if getattr(cls, "writable", False) else ", read"
    return {
        "name": name,
        "summary": cls.SUMMARY,
        "formula": getattr(cls, "FORMULA", ""),
        "reference": getattr(cls, "REFERENCE", ""),
        "extensions": extensions,
        "parameters": cls.PARAMETERS,
    }


@app.command(
    short_help="Say what a file or model is.",
    help="""Say what a file or model is: channels, symmetries, size, id, what reading it found and did, measured error.

\b
Examples:
  brdf info gold.h5
  brdf info paint.bsdf --json
  brdf info cook_torrance:roughness=0.1,ior=gold""",
)
def info(source: Source, json: Json = False) -> None:
    b = arguments.load(source, say=False)
    described = b.describe()
    if source.partition(":")[0] not in MODELS:
        described["file_bytes"] = arguments.file_of(source)[0].stat().st_size
    described["report"] = b.report
    if json:
        as_json({"input": source, **described})
        return
    error = described.pop("error", None)
    described["channels"] = ", ".join(b.channels.labels())
    described.pop("channel_kind")
    line(source, style="bold")
    facts({"built from" if k == "source" else k: v for k, v in described.items()})
    if error is not None:
        for text in error_lines(error, b.has_delta):
            line(text)
        for text in error.get("warnings", ()):
            line(f"warning: {text}")


@app.command(
    name="eval",
    short_help="Evaluate f_r at given angles.",
    help="""Evaluate f_r (1/sr, without the cosine) and print it with all its digits.

Lists broadcast: equal lengths, or one value. --input takes a file of three columns theta_i, theta_o, delta_phi
("-" is stdin) instead. An angle past the horizon or not a number is an error.

\b
Examples:
  brdf eval cook_torrance:roughness=0.1,ior=gold --theta-i 30,45 --theta-o 30 --delta-phi 180
  brdf eval gold.h5 --theta-i 0.5 --theta-o 0.5 --delta-phi 3.14 --angles rad --json
  brdf eval gold.h5 --input directions.csv --csv > values.csv
  brdf eval gold.h5 --theta-i 30 --theta-o 0,30,60 --delta-phi 180 --uncertainty --status""",
)
def evaluate(
    source: Source,
    theta_i: Annotated[str | None, typer.Option(metavar="LIST", help="Polar angles of the light.")] = None,
    theta_o: Annotated[str | None, typer.Option(metavar="LIST", help="Polar angles of the viewer.")] = None,
    delta_phi: Annotated[
        str | None, typer.Option(metavar="LIST", help="phi_o - phi_i; 180 is the mirror side.")
    ] = None,
    input: Annotated[str | None, typer.Option(metavar="FILE", help="Three columns of angles; - is stdin.")] = None,
    angles: arguments.Unit = "deg",
    status: Annotated[bool, typer.Option("--status", help="Also where each value comes from.")] = False,
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Also the half-width of each value's 95 % interval, 1/sr.")
    ] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Comma-separated values.")] = False,
    json: Json = False,
) -> None:
    unit = angles
    typed = _directions((theta_i, theta_o, delta_phi), input, unit)
    radians = [arguments.angle(name, values, unit) for name, values in zip(ANGLE_NAMES, typed)]
    b = arguments.load(source)
    values = b.evaluate(*radians)
    names = [Status(code).name.lower() for code in b.status(*radians).tolist()] if status else None
    widths = b.uncertainty(*radians) if uncertainty else None
    given = [x.tolist() for x in np.broadcast_arrays(*typed)]
    if json:
        answer: dict[str, Any] = {
            "unit": "1/sr",
            "angles": unit,
            "channels": b.channels.to_json(),
            **dict(zip(ANGLE_NAMES, given)),
            "values": values.tolist(),
            "has_delta": b.has_delta,
        }
        if names is not None:
            answer["status"] = names
        if widths is not None:
            answer["uncertainty"] = widths.tolist()
        as_json(answer)
        return
    print("\n".join(_rows(b, unit, given, values, widths, names, csv)))


def _directions(
    lists: tuple[str | None, str | None, str | None], file: str | None, unit: str
) -> list[npt.NDArray[np.float64]]:
    """The three angles as they were given, in their unit, 1-D and broadcastable."""
    options = [f"--{name.replace('_', '-')}" for name in ANGLE_NAMES]
    if file is not None:
        if any(x is not None for x in lists):
            raise InputError("options_exclude", f"--input already gives {', '.join(options)}: leave them out")
        return arguments.read_directions(file, unit)
    missing = [o for o, x in zip(options, lists) if x is None]
    if missing:
        raise InputError(
            "missing_angles", f"missing {', '.join(missing)}; give all three, or --input FILE", where=missing[0]
        )
    arrays = [arguments.numbers(o, x) for o, x in zip(options, lists) if x is not None]
    broadcast_shape(ANGLE_NAMES, (arrays[0].shape, arrays[1].shape, arrays[2].shape))
    return arrays


def _rows(
    b: Brdf,
    unit: str,
    given: list[list[float]],
    values: npt.NDArray[Any],
    widths: npt.NDArray[Any] | None,
    names: list[str] | None,
    csv: bool,
) -> Iterator[str]:
    labels = [str(c).replace(",", " ") for c in b.channels.labels()]
    head = [*(f"{n}_{unit}" for n in ANGLE_NAMES), *(f"f_r_{c}" for c in labels)]
    if widths is not None:
        head += [f"u_{c}" for c in labels]  # not f_r_: no value, should the file be read again
        values = np.concatenate([values, widths], axis=-1)
    head = [h.replace(" ", "") for h in head] + (["status"] if names else [])
    table = [[*map(repr, angles), *map(repr, row)] for angles, row in zip(zip(*given), values.tolist())]
    if names:
        table = [[*row, name] for row, name in zip(table, names)]
    if csv:
        yield from (",".join(row) for row in [head, *table])
        return
    room = [max(len(row[k]) for row in [head, *table]) for k in range(len(head))]
    yield from ("  ".join(cell.ljust(w) for cell, w in zip(row, room)).rstrip() for row in [head, *table])
    if b.has_delta:
        yield "# a perfect mirror part is not in f_r; see brdf info"


@app.command(
    short_help="Draw f_r as .png or .svg, or write .csv or .json.",
    help="""Draw f_r as a picture (.png, .svg), or write the numbers behind it (.csv, .json).

"polar" is the plane of incidence, the mirror side to the right; several sources are drawn over each other.
"hemisphere" shows all viewers for one theta_i, "coverage" which of them were measured, "sphere" is a lit sphere of the
material. With one source and one theta_i every channel is drawn, otherwise the middle one (G of R, G, B) unless
--channel names another; the picture says which. An existing picture is replaced.

\b
Examples:
  brdf plot cook_torrance:roughness=0.1,ior=gold -o gold.png
  brdf plot paint.bsdf paint.h5 -o compare.svg --theta-i 45 --scale log
  brdf plot gold.h5 -o gold.png --view hemisphere --theta-i 60 --scale log
  brdf plot gold.h5 -o gold.png --view sphere --light sky
  brdf plot paint.astm -o where.png --view coverage""",
)
def plot(
    sources: Annotated[list[str], typer.Argument(metavar="SOURCE...", show_default=False, help="Files or models.")],
    out: Annotated[Path, typer.Option("--out", "-o", help=".png, .svg, .csv or .json file.", show_default=False)],
    theta_i: Annotated[str | None, typer.Option(metavar="LIST", help="Light: 0,30,60; hemisphere: one, 30.")] = None,
    view: Annotated[PlotView, typer.Option(help="Plane of incidence, all viewers, or a lit sphere.")] = "polar",
    scale: Annotated[Scale | None, typer.Option(help="Of f_r.  [default: linear]", show_default=False)] = None,
    light: Annotated[
        Lighting | None, typer.Option(help="Around the sphere.  [default: studio]", show_default=False)
    ] = None,
    channel: Annotated[str | None, typer.Option(help="Name, wavelength or position.", show_default=False)] = None,
    title: Annotated[str | None, typer.Option(help="Instead of the sources.", show_default=False)] = None,
    dpi: Annotated[float, typer.Option(help="Of a .png, 20 to 1200.")] = 150.0,
    angles: arguments.Unit = "deg",
) -> None:
    kind = out.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg", "csv", "json"):
        raise InputError(
            "bad_extension", f"{out}: expected a name ending in .png, .svg, .csv or .json", where="--out", got=kind
        )
    _check_sphere(view, kind, theta_i, scale, light)
    if view == "coverage" and kind in ("csv", "json"):
        raise InputError(
            "bad_extension", f"{out}: the coverage is a picture, .png or .svg; its numbers are in brdf info --json",
            where="--out", got=kind,
        )  # fmt: skip
    single = view != "polar" or kind in ("csv", "json")
    if single and len(sources) > 1:
        raise InputError("one_source", f"{view}, .{kind}: takes one SOURCE, got {len(sources)}", where="SOURCE")
    unit = angles
    lights: npt.NDArray[np.float64] | None
    if theta_i is None and view == "coverage":
        lights = None
    elif theta_i is None:
        lights = np.radians([30.0] if view == "hemisphere" else [0.0, 30.0, 60.0])
    else:
        lights = np.asarray(arguments.angle("theta_i", arguments.numbers("--theta-i", theta_i), unit))
    names = [arguments.label(s) for s in sources]
    if len(set(names)) < len(names):  # files of one name in several folders
        names = sources
    materials = {name: arguments.load(s) for name, s in zip(names, sources)}
    write_file(out, _picture(materials, lights, kind, view, scale, light, channel, title, dpi, unit))
    line(str(out))


def _check_sphere(view: PlotView, kind: str, theta_i: str | None, scale: Scale | None, light: Lighting | None) -> None:
    """An option that the view has no use for is an error: it would be ignored in silence."""
    if view == "sphere":
        if kind in ("csv", "json"):
            raise InputError(
                "bad_extension", f"sphere is a picture: .png or .svg, not .{kind}", where="--out", got=kind
            )
        idle = "--theta-i" if theta_i is not None else "--scale" if scale is not None else None
    else:
        idle = "--light" if light is not None else None
    if idle is not None:
        raise InputError("options_exclude", f"--view {view} takes no {idle}: leave it out", where=idle)


def _picture(
    materials: dict[str, Brdf],
    lights: npt.NDArray[np.float64] | None,
    kind: str,
    view: PlotView,
    scale: Scale | None,
    light: Lighting | None,
    channel: str | None,
    title: str | None,
    dpi: float,
    unit: str,
) -> bytes:
    from brdfcore import plot as pictures

    name, first = next(iter(materials.items()))
    if view == "coverage" or lights is None:
        where = pictures.coverage(first, lights, title=title or name, dpi=dpi)
        return bytes(pictures.render(where, kind))
    if kind in ("csv", "json"):
        data = pictures.slice(first, lights, view=view, channel=channel)
        if kind == "csv":
            return str(data.to_csv(unit)).encode()
        from json import dumps

        return (dumps(data.to_json(unit)) + "\n").encode()
    options: dict[str, Any] = {"scale": scale or "linear", "channel": channel, "dpi": dpi}
    if view == "sphere":
        shone = light or "studio"
        figure = pictures.sphere(first, shone, channel=channel, title=title or name, dpi=dpi)
    elif view == "hemisphere":
        figure = pictures.hemisphere(first, lights, title=title or name, **options)
    elif len(materials) == 1:
        figure = pictures.polar(first, lights, title=title or name, **options)
    else:
        figure = pictures.polar(materials, lights, title=title, **options)
    rendered: bytes = pictures.render(figure, kind)
    return rendered


example.add_to(app)
make.add_to(app)
export.add_to(app)
check.add_to(app)
gloss.add_to(app)
fit.add_to(app)
albedo.add_to(app)
repair.add_to(app)
reports.add_to(app)
harmonics.add_to(app)
