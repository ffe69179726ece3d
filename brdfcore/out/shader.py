"""A table as a shader's function, GLSL (ES 3.00: WebGL2) or WGSL (WebGPU), and its nodes as a file beside it."""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.kernels.tables.half_coordinates import HORIZON_COS
from brdfcore.kernels.tables.half_difference_arrays import HalfSettings
from brdfcore.out.array_file import WIDTH, array_bytes, as_table, offsets
from brdfcore.out.shader_source import COORDINATES, source

#: What a path may end in: a shader, or the nodes alone.
LANGUAGES = {".glsl": "glsl", ".wgsl": "wgsl"}
ARRAYS = ".safetensors"
#: Most numbers of the nodes: a texture of 2,048 x 8,192; many browsers take no higher one.
MOST_NUMBERS = WIDTH * 8_192
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")


def export(
    table: Brdf, path: str | PathLike[str], *, name: str | None = None, group: int = 0, binding: int = 0
) -> list[Path]:
    """Write a table as a shader's function, `NAME_f(wi, wo) -> vec3`, and its nodes beside it; the files written.

    path     .glsl or .wgsl, with the nodes in a file of the same name that ends in .safetensors; or .safetensors, the
             nodes alone (`array_bytes`).
    name     of the function and its constants, so that a shader can hold several materials; default: the file's.
    group, binding  of the storage buffer, in WGSL.

    Of half_difference, lobe_grid and angle_grid (linear or nearest), with one channel, which becomes three equal ones,
    or three. The function interpolates by itself, in float32. GLSL reads the nodes as `uniform sampler2D NAME_nodes`,
    R32F, 2,048 wide, NEAREST; WGSL as a storage buffer `array<f32>`.

    Raises `InputError` for another table or ending, `StorageError` where a file can't be written.

    >>> from pathlib import Path
    >>> table = bc.tabulate(bc.model("lambert", reflectance=0.5), "angle_grid", shape=(3, 3, 3))
    >>> [file.name for file in bc.export(table, "white.glsl")]
    ['white.glsl', 'white.safetensors']
    >>> "vec3 white_f(vec3 wi, vec3 wo) {" in Path("white.glsl").read_text()
    True
    """
    path, table = Path(path), as_table(table)
    language = LANGUAGES.get(path.suffix.lower())
    if language is None and path.suffix.lower() != ARRAYS:
        endings = ", ".join([*LANGUAGES, ARRAYS])
        raise InputError(
            "unknown_shader",
            f"{path.name}: ends in {path.suffix or 'nothing'!r}; a table is exported to {endings}",
            where="path",
            got=path.suffix,
            expected=endings,
        )
    data = array_bytes(table)
    beside = path.with_suffix(ARRAYS) if language else path
    written = []
    if language is not None:
        text = shader_text(table, language, _checked_name(name, path.stem), beside.name, group, binding)
        write_file(path, text.encode())
        written.append(path)
    write_file(beside, data)
    return [*written, beside]


def shader_text(table: Brdf, language: str, name: str, beside: str, group: int = 0, binding: int = 0) -> str:
    """The source in "glsl" or "wgsl"; `beside` is what the file of the nodes is called."""
    held = as_table(table)
    look_up = held.array_look_up()
    channels = len(held.channels)
    first = offsets(look_up.nodes)
    size = sum(a.size for a in look_up.nodes.values())
    if channels not in (1, 3):
        raise InputError(
            "bad_channels",
            f"a shader's function has three channels, this table {channels}: bc.to_rgb(source) first, or one channel",
            where="channels",
            got=channels,
            expected="1 or 3",
        )
    if "values" not in look_up.nodes:
        raise InputError(
            "no_shader",
            f"{held.name} has no shader; tabulate the material as half_difference, lobe_grid or angle_grid",
            where="table",
            got=held.name,
            expected="half_difference, lobe_grid or angle_grid",
        )
    if size > MOST_NUMBERS:
        raise InputError(
            "table_too_large",
            f"{size} nodes; a texture of {WIDTH} x {MOST_NUMBERS // WIDTH} holds {MOST_NUMBERS}: make a smaller table",
            where="table",
            got=size,
            expected=f"at most {MOST_NUMBERS}",
        )
    shape = look_up.nodes["values"].shape
    words = {"NODE": "return vec3(P_at(node));"}
    if channels == 3:
        words["NODE"] = "int n = 3 * node;\n  return vec3(P_at(n), P_at(n + 1), P_at(n + 2));"
    constants: dict[str, float | int] = {f"N{k}": int(n) for k, n in enumerate(shape[:3])}
    settings: Any = look_up.settings
    kind = "half" if isinstance(settings, HalfSettings) else "grid"
    if isinstance(settings, HalfSettings):
        _half(held.name, settings, look_up.nodes["map_p"].size, words, constants)
        constants |= {word.upper(): first[word] for word in ("guide_h", "guide_d", "map_h", "map_d", "map_p")}
    else:
        span = np.pi if settings.bilateral else 2 * np.pi
        per = [(n - 1) / whole for n, whole in zip(shape, (np.pi / 2, np.pi / 2, span))]
        constants |= {f"PER_{axis}": float(x) for axis, x in zip("IOD", per)}
        words["AHEAD"], words["FROM_END"] = (
            ("abs(ahead)", "ahead < 0.0") if settings.bilateral else ("ahead", "turned < 0.0")
        )
        words["FOUND"] = "P_trilinear(i, j, l, u, v, w)"
        if settings.nearest:
            at = [f"({cell} + int(floor({part} + 0.5)))" for cell, part in zip("ijl", "uvw")]
            words["FOUND"] = f"P_node(({at[0]} * P_N1 + {at[1]}) * P_N2 + {at[2]})"
    head = (
        f"// {held.name}, id {held.id}\n"
        f"// nodes: {beside} (safetensors: skip 8 bytes and the header whose length they hold), float32,\n"
    )
    if language == "glsl":
        head += (
            f"// as a texture R32F, {WIDTH} x {-(-size // WIDTH)}, filters NEAREST; GLSL ES needs\n"
            "// precision highp float; and precision highp int; before this\n"
        )
    else:
        head += "// as a storage buffer, read-only\n"
    return head + source(language, kind, name, words, constants, {"WIDTH": WIDTH, "GROUP": group, "BINDING": binding})


def _half(
    representation: str, settings: HalfSettings, nodes_z: int, words: dict[str, str], constants: dict[str, float | int]
) -> None:
    """Words and constants of tables in half/difference coordinates and about a lobe."""
    for axis, (first, last, steps) in (("U", settings.octaves_u), ("W", settings.octaves_w)):
        shift = 23 - (steps.bit_length() - 1)
        constants[f"FIRST_{axis}"], constants[f"LAST_{axis}"] = (127 + first) << 23, (last - first) << 23
        constants[f"SHIFT_{axis}"], constants[f"MASK_{axis}"] = shift, (1 << shift) - 1
        constants[f"PART_{axis}"] = 2.0**-shift
    constants |= {"STEPS_Z": float(settings.steps_z), "NODES_Z": nodes_z}
    words["COORDINATES"] = COORDINATES[representation, settings.centre]
    words["ABOUT"] = "apart" if settings.centre == 2 else "sum"
    folded = settings.reciprocal and not settings.lobe
    words["Z_FOLD"] = "z0" if folded else "P_pick(z0, 2.0 - z0, x < 0.0)"
    words["Z_SIDE"] = "z1" if settings.bilateral else "2.0 + P_pick(z1, -z1, turned < 0.0)"
    k = settings.factor
    up, down = (
        " + ".join(f"{c!r} * {x}" if x else repr(c) for c, x in terms if c)
        for terms in (
            ((k[0], "ci"), (k[1], "co"), (k[2], "")),
            ((k[3], "ci * co"), (k[4], "(ci + co)"), (k[5], "")),
        )
    )
    words["HORIZON"] = repr(HORIZON_COS)
    words["GROWTH"] = f"({up}) / ({down})"


def _checked_name(name: str | None, stem: str) -> str:
    made = re.sub(r"[^A-Za-z0-9]+", "_", stem).strip("_") if name is None else name
    made = made if name is not None or made[:1].isalpha() else f"brdf_{made}".strip("_")
    if not _NAME.fullmatch(made):
        raise InputError(
            "bad_name",
            f"name = {made!r}: expected a letter, then letters, digits and single underscores",
            where="name",
            got=made[:80],
            expected="an identifier of GLSL and WGSL",
        )
    return made
