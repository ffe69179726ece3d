"""`brdf export`: a table as a shader's function, with its nodes beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brdfcore.cli import arguments
from brdfcore.cli.make import may_write
from brdfcore.cli.output import as_json, bytes_text, line


def export(
    source: Annotated[str, typer.Argument(metavar="TABLE", show_default=False, help="Table file, .h5.")],
    target: Annotated[
        Path, typer.Argument(metavar="FILE", show_default=False, help=".glsl, .wgsl, or .safetensors for the nodes.")
    ],
    name: Annotated[
        str | None, typer.Option(help="Of the function, NAME_f; default: the file's.", show_default=False)
    ] = None,
    group: Annotated[int, typer.Option(help="Of the storage buffer, in WGSL.")] = 0,
    binding: Annotated[int, typer.Option(help="Of the storage buffer, in WGSL.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
    json: Annotated[bool, typer.Option("--json", help="JSON on stdout; an error is JSON on stderr.")] = False,
) -> None:
    from brdfcore.out.array_file import array_bytes
    from brdfcore.out.shader import ARRAYS
    from brdfcore.out.shader import export as write

    may_write(target, force)
    table, nodes = arguments.load(source), target.with_suffix(ARRAYS)
    if nodes != target and nodes.is_file() and nodes.read_bytes() != array_bytes(table):
        may_write(nodes, force)  # the same nodes serve several shaders
    files = write(table, target, name=name, group=group, binding=binding)
    if json:
        as_json({"files": [{"file": str(f), "bytes": f.stat().st_size} for f in files]})
        return
    for file in files:
        line(f"{file}: {bytes_text(file.stat().st_size)}")


_HELP = """Write a table as a function of a shader, NAME_f(wi, wo) in GLSL or WGSL, and its nodes as a file beside it.

Of half_difference, lobe_grid and angle_grid tables with one channel or three; `brdf tabulate` makes one. How the nodes
are bound is said in the file's first lines.

\b
Examples:
  brdf tabulate cook_torrance:roughness=0.2,ior=gold -o gold.h5
  brdf export gold.h5 gold.glsl
  brdf export gold.h5 gold.wgsl --name metal --group 1 --force"""


def add_to(app: typer.Typer) -> None:
    """Register the command."""
    app.command(help=_HELP, short_help="Write a table as a shader's function.")(export)
