"""The commands of `brdf` that make something: tabulate, convert, serve."""

from __future__ import annotations

import time
import warnings
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from brdfcore.base.atomic import refuse_special
from brdfcore.base.errors import MissingExtraError, StorageError, missing_extra
from brdfcore.cli import arguments
from brdfcore.cli.output import (
    as_json,
    bytes_text,
    error_lines,
    facts,
    line,
    percent,
    progress_bar,
    warn,
)

Json = Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")]
Force = Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")]


def tabulate(
    source: Annotated[str, typer.Argument(metavar="SOURCE", show_default=False, help="File, or NAME:key=value,...")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Table file to write, .h5.", show_default=False)],
    representation: Annotated[str, typer.Option(help="Name from `brdf models --all`, or auto.")] = "auto",
    shape: Annotated[
        str | None, typer.Option(metavar="N,N,N", help="Nodes per axis, both ends included.", show_default=False)
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Error to reach, e.g. 0.01, see --measure.", show_default=False)
    ] = None,
    max_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="E.g. 4.5MB: the best table within.", show_default=False)
    ] = None,
    interpolation: Annotated[
        str, typer.Option(help="Between nodes: nearest, linear, monotone_cubic; what the representation offers.")
    ] = "linear",
    negatives: Annotated[str, typer.Option(metavar="[keep|zero]", help="Negative values of the source.")] = "keep",
    fold: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="bilateral, reciprocal: average over a symmetry.", show_default=False),
    ] = None,
    light: arguments.Light = None,
    view: arguments.View = None,
    measure: Annotated[
        str, typer.Option(metavar="[incidence|average]", help="What a tolerance bounds: each incidence, or the mean.")
    ] = "incidence",
    rgb: Annotated[
        str | None,
        typer.Option(metavar="ILLUMINANT", help="Wavelengths to linear sRGB first, e.g. D65.", show_default=False),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    from brdfcore.build.tabulate import ToleranceWarning
    from brdfcore.build.tabulate import tabulate as build

    may_write(out, force)
    nodes = None if shape is None else arguments.whole_numbers("--shape", shape)
    limit = None if max_bytes is None else arguments.byte_count("--max-bytes", max_bytes)
    ranges = [
        None if text is None else arguments.angle_range(name, text)
        for name, text in (("--light", light), ("--view", view))
    ]
    folds = None if fold is None else [part.strip() for part in fold.split(",")]
    b = arguments.load(source)
    if rgb is not None:
        from brdfcore.base.colour import to_rgb

        b = to_rgb(b, rgb)
    start = time.perf_counter()
    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # the table's own warnings say it as well
        table = build(
            b,
            representation,
            tolerance=tolerance,
            max_bytes=limit,
            shape=nodes,
            interpolation=interpolation,
            negatives=negatives,
            fold=folds,
            light=ranges[0],
            view=ranges[1],
            measure=measure,  # type: ignore[arg-type]  # checked there
            progress=progress,
        )
    seconds = time.perf_counter() - start
    table.save(out)
    shapes = {name: list(a.shape) for name, a in table.to_arrays().items()}
    if json:
        found = {
            "file": str(out),
            "representation": table.name,
            "channels": table.channels.to_json(),
            "shapes": shapes,
            "nbytes": table.nbytes,
            "id": table.id,
            "seconds": seconds,
            "error": table.error,
            "report": table.report,
        }
        as_json(found)
        return
    largest = max(shapes.values(), key=lambda s: _product(s), default=[])
    line(f"{out}: {table.name}, {' x '.join(map(str, largest))}, {bytes_text(table.nbytes)}, {seconds:.2f} s")
    line(f"id {table.id}")
    for text in error_lines(table.error, table.has_delta):
        line(text)
    facts({"done": table.report.get("done", [])})
    for text in table.error["warnings"]:
        warn(text)


def convert(
    source: Annotated[str, typer.Argument(metavar="A", show_default=False, help="SOURCE to read.")],
    target: Annotated[Path, typer.Argument(metavar="B", show_default=False, help="File to write.")],
    read_as: Annotated[
        str | None,
        typer.Option("--from", metavar="FORMAT", help="Format of A; else its content tells.", show_default=False),
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            "--to", "--format", metavar="FORMAT", help="Format of B; else its extension tells.", show_default=False
        ),
    ] = None,
    writing: Annotated[
        str, typer.Option("--write", metavar="KEY=VALUE,...", help="Options of B's writer.", show_default=False)
    ] = "",
    force: Force = False,
    json: Json = False,
) -> None:
    from brdfcore.formats.io import conversion
    from brdfcore.formats.io import files as io

    may_write(target, force)
    b = arguments.load(source, read_as, say=False)
    to = io.format_for(b, target, format)
    options = arguments.given("--write", writing, io.write_options(to)) if writing else {}
    found = conversion.convert(b, target, to, options)
    if json:
        as_json(found.to_json())
        return
    line(f"{target}: {found.format}, {bytes_text(found.bytes)}")
    for text in found.losses:
        warn(text)
    c = found.comparison
    if c is None:
        line("round trip: not compared, the channels differ")
    elif c.l1 != c.l1:
        line("round trip: the source has no regular part to compare")
    elif c.l1 == 0:
        line(f"round trip: read back, every one of {c.values:,} values compared is the same")
    else:
        line(
            f"round trip: read back, {percent(c.l1)} ± {percent(c.l1_stderr)} of the energy is misplaced (L1); "
            f"p50 log ratio {c.log_ratio['p50']:.3g}, p99 {c.log_ratio['p99']:.3g}"
        )
        w = found.worst
        if w:
            line(
                f"worst at theta_i = {w['theta_i']:g}, theta_o = {w['theta_o']:g}, delta_phi = {w['delta_phi']:g} "
                f"degrees: {w['before']:.4g}/sr became {w['after']:.4g}/sr ({w['channel']})"
            )
    facts({"lost": found.lost})
    report = found.result.report
    facts({"done": report.get("done", []), "warnings": report.get("warnings", [])})


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on.", show_default="127.0.0.1")] = None,
    port: Annotated[int | None, typer.Option(help="Port; 0 takes a free one.", show_default="8000")] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder of the materials, made if absent.", show_default="brdf-data")
    ] = None,
    no_starter: Annotated[bool, typer.Option("--no-starter", help="Leave an empty folder empty.")] = False,
    log_level: Annotated[str | None, typer.Option(help="debug, info, warning or error.", show_default="info")] = None,
    cache_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="Tables kept in memory, e.g. 512MiB.", show_default=False)
    ] = None,
    max_points: Annotated[int | None, typer.Option(help="Most points of a request.", show_default=False)] = None,
    max_body_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="Largest request body, e.g. 64MiB.", show_default=False)
    ] = None,
    max_json_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="Largest JSON body of numbers, e.g. 2MiB.", show_default=False)
    ] = None,
    head_seconds: Annotated[
        float | None, typer.Option(help="What the headers of a request get to arrive.", show_default=False)
    ] = None,
    send_seconds: Annotated[
        float | None, typer.Option(help="After which a client that takes nothing is cut off.", show_default=False)
    ] = None,
    body_seconds: Annotated[
        float | None, typer.Option(help="In which a request body must arrive.", show_default=False)
    ] = None,
    max_values: Annotated[
        int | None, typer.Option(help="Most values of an answer, points x channels.", show_default=False)
    ] = None,
    max_theta_i: Annotated[
        int | None, typer.Option(help="Most angles of incidence of a slice.", show_default=False)
    ] = None,
    max_lmax: Annotated[int | None, typer.Option(help="Largest degree of an expansion.", show_default=False)] = None,
    max_work_seconds: Annotated[
        float | None, typer.Option(help="Longest analysis, as estimated from its channels.", show_default=False)
    ] = None,
    max_held_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="All request bodies at once, e.g. 192MiB.", show_default=False)
    ] = None,
    max_upload_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="Largest upload, e.g. 256MiB.", show_default=False)
    ] = None,
    upload_seconds: Annotated[
        float | None, typer.Option(help="In which an upload must arrive.", show_default=False)
    ] = None,
    max_table_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="Largest table that a request makes.", show_default=False)
    ] = None,
    job_seconds: Annotated[
        int | None, typer.Option(help="Processor time of an upload or tabulation.", show_default=False)
    ] = None,
    job_memory_bytes: Annotated[
        str | None, typer.Option(metavar="BYTES", help="Memory of an upload or tabulation.", show_default=False)
    ] = None,
    allow_hdf5: Annotated[bool, typer.Option("--allow-hdf5", help="Take uploads of HDF5 table files.")] = False,
    allowed_hosts: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Host names to answer to, comma-separated.", show_default=False)
    ] = None,
    drain_seconds: Annotated[
        int | None, typer.Option(help="What running requests get at the end.", show_default=False)
    ] = None,
) -> None:
    # by name: the library does not import the service, and runs without it
    try:
        service = import_module("brdf_service.main")
    except ModuleNotFoundError as error:
        if isinstance(error, MissingExtraError):
            raise
        raise missing_extra((error.name or "brdf_service").partition(".")[0], "service", "brdf serve") from error
    code = service.serve(
        host=host,
        port=port,
        data=data,
        starter=False if no_starter else None,
        log_level=log_level,
        cache_bytes=_bytes("--cache-bytes", cache_bytes),
        max_points=max_points,
        max_body_bytes=_bytes("--max-body-bytes", max_body_bytes),
        body_seconds=body_seconds,
        max_json_bytes=_bytes("--max-json-bytes", max_json_bytes),
        head_seconds=head_seconds,
        send_seconds=send_seconds,
        max_values=max_values,
        max_theta_i=max_theta_i,
        max_lmax=max_lmax,
        max_work_seconds=max_work_seconds,
        max_held_bytes=_bytes("--max-held-bytes", max_held_bytes),
        max_upload_bytes=_bytes("--max-upload-bytes", max_upload_bytes),
        upload_seconds=upload_seconds,
        max_table_bytes=_bytes("--max-table-bytes", max_table_bytes),
        job_seconds=job_seconds,
        job_memory_bytes=_bytes("--job-memory-bytes", job_memory_bytes),
        allow_hdf5=True if allow_hdf5 else None,
        allowed_hosts=allowed_hosts,
        drain_seconds=drain_seconds,
    )
    raise typer.Exit(int(code or 0))


_HELP: dict[Any, str] = {
    tabulate: """Turn a model or a measured file into a table file, and say how large its error is.

Give --shape, or --tolerance, or --max-bytes, or nothing (tolerance 0.01). The error is measured on random directions,
none of them a node of the table. An existing file is replaced with --force only.

\b
Examples:
  brdf tabulate cook_torrance:roughness=0.2,ior=gold -o gold.h5
  brdf tabulate paint.bsdf -o paint.h5 --max-bytes 4.5MB
  brdf tabulate lambert -o white.h5 --representation angle_grid --shape 10,10,19
  brdf tabulate paint.bsdf -o p.h5 --representation half_angle_grid --interpolation monotone_cubic --fold reciprocal""",
    convert: """Read A, write it as B in another format, read B again and say what the round trip cost.

Options of a format: `brdf models --all` lists them, a wrong one too. An existing file is replaced with --force only.

\b
Examples:
  brdf convert paint.bsdf paint.h5
  brdf convert paint.bsdf paint.binary
  brdf convert gold.h5 copy.h5 --force --json
  brdf convert paint.bsdf paint_brdf.xompt --write shape=40,25,56
  brdf convert black.bsdf:zeros=data black_brdf.xompt --from zemax""",
    serve: """Serve a folder of materials over HTTP, with pictures for a browser at the address it prints.

An empty folder is filled with a starter library first. A setting is a flag, or a variable: --max-points is
BRDF_MAX_POINTS, and so on; --data is BRDF_DATA_DIR, --no-starter BRDF_STARTER=0. BRDF_API_KEY is a variable only: the
key that storing and deleting take. Without it others than this machine can only read. Stop it with Ctrl-C.

\b
Examples:
  brdf serve
  brdf serve --port 0 --data ~/materials
  brdf serve --host 0.0.0.0 --no-starter --log-level warning""",
}


_SHORT: dict[Any, str] = {
    tabulate: "Turn a model or a file into a table with a known error.",
    convert: "Write a material in another format and check the round trip.",
    serve: "Serve a folder of materials over HTTP.",
}


def add_to(app: typer.Typer) -> None:
    """Register the commands of this module."""
    for command, text in _HELP.items():
        app.command(help=text, short_help=_SHORT[command])(command)


def _bytes(flag: str, text: str | None) -> int | None:
    return None if text is None else arguments.byte_count(flag, text)


def may_write(path: Path, force: bool) -> None:
    """Refuse before the work what would fail, or destroy something, after it."""
    refuse_special(path)
    if path.exists() and not force:
        raise StorageError("exists", f"{path}: exists; --force replaces it", where=str(path))
    if not path.parent.is_dir():
        raise StorageError("cannot_write", f"{path.parent}: no such folder", where=str(path.parent))


def _product(shape: list[int]) -> int:
    total = 1
    for n in shape:
        total *= n
    return total
