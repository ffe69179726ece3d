"""MBSDF, the measured BSDF of NVIDIA's Material Definition Language: read and written.

A text header (`NVIDIA ARC MBSDF V1`, then lines of name="value", each ended by a line feed), then a block or two: a
line `MBSDF_DATA=` or `MBSDF_DATA_REFLECTION=`, or `MBSDF_DATA_TRANSMISSION=`; three little-endian uint32 (type: 0 one
channel, 1 red, green, blue; N cells of theta, M of phi); N x N x M x channels float32, theta_in slowest, then theta_out
and phi. f in 1/sr without the cosine, at the middle of cells: theta (i + 1/2) 90/N, phi = |phi_out - phi_in|
(k + 1/2) 180/M degrees, the mirror direction at 180; linear between them, beyond the outermost its value. Renderers
(Omniverse, Iray, and what is built on the MDL SDK) average f(in, out) and f(out, in), clip negative values where they
sample, and scale by 1 / the largest albedo above 1; the file itself is none of that, and is read as it stands.

Read to a `node_grid` of the file's own cells and numbers, so that it is written again byte for byte. Transmission isn't
held: its block is left out, by name; a file of nothing else is refused. Anything else is written as its values in the
middle of `shape` cells.
"""

from __future__ import annotations

import hashlib
import struct
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import RGB, VALUE
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format, LossWarning, read_bytes
from brdfcore.formats.base.import_report import measures_of, value_range
from brdfcore.metrics import measured_flags
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.node_grid import NodeGrid, cell_centres

MAGIC = b"NVIDIA ARC MBSDF V1\n"
REFLECTION, TRANSMISSION = (b"MBSDF_DATA=\n", b"MBSDF_DATA_REFLECTION=\n"), b"MBSDF_DATA_TRANSMISSION=\n"
#: Largest file read; 90 x 90 x 180 cells of three channels have 17 MB.
MAX_BYTES = 256_000_000
#: Longest header, bytes, and most cells an axis: far beyond any file.
_MOST_HEADER, _MOST_CELLS = 65_536, 4_096
_COUNTS = struct.Struct("<3I")

_CONVENTIONS = {
    "value": "f_r in 1/sr, without the cosine",
    "theta_in, theta_out": "cell i of N has its middle at (i + 1/2) 90/N degrees; theta_in is read as theta_i",
    "phi": "|phi_out - phi_in|, cell k of M has its middle at (k + 1/2) 180/M degrees; the mirror direction at 180",
    "between cells": "linear; beyond the middle of the outermost its value, as the SDK looks it up",
}


class _Block(NamedTuple):
    """One block of data: where it begins, its key, its cells and values (N, N, M, channels) float32."""

    offset: int
    key: bytes
    values: npt.NDArray[np.float32]


class MbsdfFormat(Format):
    """NVIDIA's measured BSDF (`.mbsdf`): reflection of 1 or 3 channels, read to the bit and written byte for byte."""

    name = "mbsdf"
    SUMMARY = "NVIDIA MDL measured BSDF: cells of theta_in, theta_out, phi"
    REFERENCE = "NVIDIA Material Definition Language, Language Specification, appendix: the MBSDF file format; MDL SDK"
    EXTENSIONS = (".mbsdf",)
    PARAMETERS = (
        Parameter("negatives", "", "what negative values become", "keep", kind="choice", choices=("keep", "zero")),
    )
    WRITE_PARAMETERS = (
        Parameter("shape", "", "cells of theta and of phi, of what is sampled", "90,180", kind="text"),
        Parameter("negatives", "", "what negative values become", "keep", kind="choice", choices=("keep", "zero")),
    )
    writable = True
    exact = False

    def sniff(self, head: bytes) -> bool:
        return head.startswith(MAGIC.rstrip())

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file. `StorageError` if it can't be opened, `LimitError` above `MAX_BYTES`, `FileFormatError` naming
        file, field and byte offset if it is damaged or holds no reflection."""
        given = resolve("format 'mbsdf'", self.PARAMETERS, options)
        data = read_bytes(path, MAX_BYTES)
        header, blocks = _parsed(data, path.name)
        return _table(header, blocks, path.name, data, given["negatives"])

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write `brdf`: its own cells where it was read from such a file, else f in the middle of `shape` cells.

        `InputError` for a perfect mirror part and for channels other than one, or R, G, B.
        """
        given = resolve("writing format 'mbsdf'", self.WRITE_PARAMETERS, options)
        header, key, values, losses = _content(brdf, given["shape"])
        negative = int((values < 0).sum())
        if negative and given["negatives"] == "zero":
            values = np.maximum(values, 0)
            losses.append(f"{negative} negative values written as 0, as asked")
        n, _, m, channels = values.shape
        counts = _COUNTS.pack(int(channels == 3), n, m)
        content = MAGIC + header + key + counts + np.ascontiguousarray(values, "<f4").tobytes()
        again = write_file(path, content, self.read)
        for text in losses:
            warnings.warn(text, LossWarning, stacklevel=2)
        return again


def _bad(file: str, field: str, offset: int, reason: str, got: Any, expected: str) -> FileFormatError:
    return FileFormatError(
        "damaged_file",
        f"{file}: {field} at byte {offset}: {reason}; got {got}, expected {expected}",
        where=file,
        file=file,
        field=field,
        offset=offset,
        got=got,
        expected=expected,
    )


# ---- read ----------------------------------------------------------------------------------------


def _parsed(data: bytes, file: str) -> tuple[bytes, dict[str, _Block]]:
    """(the header's lines, the blocks by side); nothing is allocated that the file does not hold."""
    if not data.startswith(MAGIC):
        raise _bad(file, "header", 0, "no MBSDF file", repr(data[: len(MAGIC)]), repr(MAGIC))
    at = len(MAGIC)
    while not data.startswith((*REFLECTION, TRANSMISSION), at):
        end = data.find(b"\n", at, len(MAGIC) + _MOST_HEADER)
        if end < 0:
            raise _bad(file, "header", at, "no block of data follows", repr(data[at : at + 40]), "MBSDF_DATA...=")
        at = end + 1
    header = data[len(MAGIC) : at]
    blocks: dict[str, _Block] = {}
    while at < len(data):
        key = next((k for k in (*REFLECTION, TRANSMISSION) if data.startswith(k, at)), None)
        if key is None:
            raise _bad(file, "block", at, "more follows the last block", repr(data[at : at + 24]), "MBSDF_DATA...=")
        side = "transmission" if key == TRANSMISSION else "reflection"
        if side in blocks:
            raise _bad(file, "block", at, f"a second block of {side}", repr(key), "one of each")
        start = at + len(key)
        values = _values(data, start, file, side)
        blocks[side] = _Block(start, key, values)
        at = start + _COUNTS.size + values.nbytes
    if "reflection" not in blocks:
        raise FileFormatError(
            "transmission_only",
            f"{file}: holds transmission only (MBSDF_DATA_TRANSMISSION), and reflectance is read only",
            where=file,
            file=file,
            field="block",
            offset=blocks["transmission"].offset,
            got="transmission",
            expected="MBSDF_DATA= or MBSDF_DATA_REFLECTION=",
        )
    return header, blocks


def _values(data: bytes, at: int, file: str, side: str) -> npt.NDArray[np.float32]:
    if len(data) < at + _COUNTS.size:
        raise _bad(file, f"{side} counts", len(data), "the file ends inside them", len(data) - at, "12 bytes")
    kind, n, m = _COUNTS.unpack_from(data, at)
    if kind > 1:
        raise _bad(file, f"{side} type", at, "unknown", kind, "0 (one channel) or 1 (red, green, blue)")
    for k, (name, count) in enumerate((("theta", n), ("phi", m)), 1):
        if not 1 <= count <= _MOST_CELLS:
            raise _bad(file, f"{side} cells of {name}", at + 4 * k, "no number of cells", count, f"1 to {_MOST_CELLS}")
    count = n * n * m * (3 if kind else 1)
    start = at + _COUNTS.size
    if len(data) - start < 4 * count:
        needed = f"{4 * count} for {n} x {n} x {m} cells"
        raise _bad(file, f"{side} values", len(data), "the file ends too early", f"{len(data) - start} bytes", needed)
    values = np.frombuffer(data, "<f4", count, start)
    if not np.isfinite(values).all():
        k = int(np.flatnonzero(~np.isfinite(values))[0])
        raise _bad(file, f"{side} values", start + 4 * k, f"value {k} is not finite", str(values[k]), "a finite number")
    return values.reshape(n, n, m, -1)


def _table(header: bytes, blocks: dict[str, _Block], file: str, data: bytes, negatives: str) -> NodeGrid:
    block = blocks["reflection"]
    values = block.values.astype(np.float32)  # a copy, in the machine's byte order
    n, _, m, count = values.shape
    channels = RGB if count == 3 else VALUE
    done, remarks = [], []
    negative = int((values < 0).sum())
    if negative and negatives == "zero":
        values = np.maximum(values, 0)
        done.append(f"{negative} negative values set to zero, as asked")
    theta = cell_centres(n, HALF_PI)
    table = NodeGrid.from_nodes(theta, theta, cell_centres(m, np.pi), values, channels, bilateral=True)
    flags = measured_flags(table) | {"bilateral": True, "non_negative": bool((values >= 0).all())}  # both are known
    for flag in FLAGS:
        setattr(table, flag, flags[flag])
    total = float(np.abs(values).sum(dtype=np.float64))
    apart = float(np.abs(values - values.transpose(1, 0, 2, 3)).sum(dtype=np.float64)) / total if total else 0.0
    if not table.reciprocal:
        remarks.append(
            f"the file is not reciprocal: f(in, out) and f(out, in) differ by {apart:.3g} of the sum of its values; "
            "it is read as it stands, while renderers average both orders"
        )
    if negative and negatives == "keep":
        remarks.append(f"{negative} of {values.size} values are negative; they are kept, while renderers clip them")
    if "transmission" in blocks:
        shape = " x ".join(map(str, blocks["transmission"].values.shape[:3]))
        remarks.append(f"the block MBSDF_DATA_TRANSMISSION ({shape} cells) is left out: only reflectance is held")
    sha = hashlib.sha256(data).hexdigest()
    table.source = {"name": file, "format": "mbsdf", "sha256": sha}
    lines = header.decode("latin-1").splitlines()
    table.metadata = {
        "mbsdf": {
            "header": header.decode("latin-1"),
            "key": block.key.decode().strip(),
            "transmission": len(blocks) == 2,
        }
    }
    about = next((x.partition("=")[2].strip('"') for x in lines if x.startswith(("description=", "name="))), "")
    if about:
        table.metadata["description"] = about[:200]
    table.report = {
        "format": "mbsdf",
        "file": file,
        "sha256": sha,
        "bytes": len(data),
        "conventions": dict(_CONVENTIONS),
        "found": {
            "channels": channels.to_json(),
            "cells": {"theta_in": n, "theta_out": n, "phi": m},
            "blocks": sorted(blocks),
            "header": [x[:200] for x in lines[:50]],
            "range": value_range(values, channels),
            "reciprocity of the values, unweighted": apart,
            "angles covered": f"theta {np.degrees(theta[0]):.4g} to {np.degrees(theta[-1]):.4g} degrees",
        },
        **measures_of(table, values),
        "done": done,
        "warnings": remarks,
    }
    return table


# ---- write ---------------------------------------------------------------------------------------


def _content(brdf: Brdf, shape: str) -> tuple[bytes, bytes, npt.NDArray[np.float32], list[str]]:
    """(header lines, key, values, what is lost) of a file for `brdf`."""
    if brdf.has_delta:
        raise InputError(
            "delta_not_held",
            "an MBSDF file can't hold a perfect mirror part; write the regular part alone, or another format",
            where="brdf",
        )
    if len(brdf.channels) != 1 and tuple(brdf.channels) != tuple(RGB):
        listed = ", ".join(brdf.channels.labels()[:8])
        raise InputError(
            "channels_do_not_fit",
            f"an MBSDF file holds one channel, or R, G, B; this material has: {listed}",
            where="brdf",
            got=listed,
            expected="one channel, or R, G, B",
        )
    losses: list[str] = []
    kept = brdf.metadata.get("mbsdf")
    if isinstance(brdf, NodeGrid) and _own_cells(brdf):
        table = brdf
        if isinstance(kept, dict) and kept["transmission"]:
            losses.append("the transmission of the file that was read is not held, so it is not written")
    else:
        table = _sampled(brdf, shape, losses)
    if not brdf.reciprocal and not isinstance(kept, dict):
        losses.append("the material is not reciprocal: it is written as it is, and renderers average both orders")
    if len(brdf.channels) == 1 and brdf.channels != VALUE:
        losses.append(f"the channel {brdf.channels.labels()[0]} is written without its name")
    if isinstance(kept, dict):
        return kept["header"].encode("latin-1"), kept["key"].encode() + b"\n", table.values, losses
    name = str(brdf.metadata.get("description") or getattr(brdf, "source", {}).get("name", "")) or "BRDF"
    plain = "".join(c if c.isascii() and c.isprintable() else "?" for c in name[:200])
    quoted = plain.replace("\\", "\\\\").replace('"', '\\"')
    return f'description="{quoted}"\n'.encode(), REFLECTION[1], table.values, losses


def _own_cells(table: NodeGrid) -> bool:
    """Whether a grid's nodes are the middles of such a file's cells."""
    n, n_o, m, _ = table.values.shape
    same = table.bilateral and n == n_o and table.between == "angles" and table.values.dtype == np.float32
    theta = cell_centres(n, HALF_PI)
    return bool(
        same
        and np.array_equal(table.theta_i, theta)
        and np.array_equal(table.theta_o, theta)
        and np.array_equal(table.delta_phi, cell_centres(m, np.pi))
    )


def _sampled(brdf: Brdf, shape: str, losses: list[str]) -> NodeGrid:
    try:
        n, m = (int(x) for x in shape.strip(" []()").split(","))
    except ValueError:
        n = m = 0
    if not (2 <= n <= _MOST_CELLS and 2 <= m <= _MOST_CELLS and 12 * n * n * m <= MAX_BYTES):
        raise InputError(
            "bad_shape",
            f"shape = {shape[:40]!r}: expected 2 whole numbers of cells from 2 to {_MOST_CELLS}, as [90,180], for a "
            f"file of at most {MAX_BYTES} bytes",
            where="shape",
            got=shape[:40],
            expected="e.g. [90,180]",
        )
    fold = frozenset() if brdf.bilateral else frozenset({"bilateral"})
    table = NodeGrid.build(brdf, BuildOptions(shape=(n, n, m), fold=fold))
    losses.append(f"sampled in the middle of {n} x {n} x {m} cells, float32, linear between them")
    if fold:
        losses.append("delta_phi and -delta_phi averaged: the file has one side of the plane of incidence")
    return table
