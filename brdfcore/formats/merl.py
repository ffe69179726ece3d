"""MERL database: an isotropic RGB measurement as a plain lattice of half and difference angles, read and written.

Three little-endian int32 (numbers of cells of theta_h, theta_d, phi_d; 90, 90, 180 in the database), then three planes
of float64, red, green, blue, each in C order with phi_d fastest. f_r in 1/sr is the number times 1/1500 (red),
1.15/1500 (green), 1.66/1500 (blue). A cell with a negative number in every plane is invalid.
"""

from __future__ import annotations

import hashlib
import os
import struct
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import RGB
from brdfcore.base.errors import FileFormatError, InputError, LimitError, StorageError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format, LossWarning
from brdfcore.metrics import measured_flags, reciprocity_defect
from brdfcore.tables.base.sampled import INTERPOLATION
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.half_angle_grid import CELLS, MERL_SHAPE, HalfAngleGrid, continued

#: f_r of a number 1 in each plane.
SCALES = (1 / 1500, 1.15 / 1500, 1.66 / 1500)
PLANES = ("red", "green", "blue")
#: Largest file read; the database's have 35 MB.
MAX_BYTES = 2_000_000_000
#: Most cells an axis that a header may name: far beyond any lattice, and text or another binary format has more.
_MOST_CELLS = 4_096
#: Any negative number means an invalid cell; -1 is the usual one.
_INVALID = -1.0
_HEADER = struct.Struct("<3i")
#: Cells read or written at a time.
_CHUNK = 1 << 18

_CONVENTIONS = {
    "value": "f_r in 1/sr is the number times 1/1500 (red), 1.15/1500 (green), 1.66/1500 (blue)",
    "theta_h": "cell i of n covers 90 (i/n)^2 to 90 ((i+1)/n)^2 degrees",
    "theta_d": "n equal cells over 0 to 90 degrees, between either direction and the half vector",
    "phi_d": "n equal cells over 0 to 180 degrees, azimuth of wi about the half vector; phi_d + 180 degrees exchanges "
    "the directions and is the same cell",
    "invalid": "a cell that is negative in every plane has no value; in one or two it is noise about 0",
}
_PLACES = {
    "centre": "a value belongs to the middle of its cell; a nearest look-up is the floor of the coordinates",
    "lower_edge": "a value belongs to the lower edge of its cell (half a cell below its middle), as asked",
}


class MerlFormat(Format):
    """The MERL database's binary files; other numbers of cells are read too, with a warning.

    Read into a `HalfAngleGrid`: float32, where the file has float64 (6e-8 relative, far below the measurement's noise,
    for half the memory a look-up touches). Written from any BRDF with one channel or R, G, B: a `HalfAngleGrid`
    with the cells it has, anything else in the middle of the database's 90 x 90 x 180 cells. Cells whose middle is
    below the horizon are -1; a negative value, which would mean the same, becomes 0. What the layout can't hold is
    said in a `LossWarning`.
    """

    name = "merl"
    SUMMARY = "MERL database, isotropic RGB lattice of half and difference angles"
    REFERENCE = (
        "W. Matusik, H. Pfister, M. Brand, L. McMillan, A data-driven reflectance model, ACM Trans. Graph. 22(3), "
        "2003, DOI 10.1145/882262.882343"
    )
    EXTENSIONS = (".binary",)
    PARAMETERS = (
        Parameter(
            "invalid", "", "what invalid cells become: the nearest valid value along theta_h, or 0",
            "continue", kind="choice", choices=("continue", "zero"),
        ),
        Parameter("negatives", "", "what negative numbers of valid cells become", "keep", kind="choice",
                  choices=("keep", "zero")),
        Parameter("cells", "", "point of its cell that a value belongs to", "centre", kind="choice",
                  choices=tuple(CELLS)),
        Parameter("header", "", "cells of a header that has 90, 90, 180 in another order: the database's, as its own "
                  "reader takes them, or as declared", "database", kind="choice", choices=("database", "declared")),
        INTERPOLATION,
    )  # fmt: skip
    writable = True
    exact = False

    def sniff(self, head: bytes) -> bool:
        """Nothing marks these files: three plausible numbers of cells, and what follows reads as float64 of sane size.

        Text gives numbers of cells above 2^24. Of the whole float64 in `head`, nine in ten must be 0, or within 1e-30
        and 1e12 in magnitude: random bytes have one in fifteen.
        """
        if len(head) < _HEADER.size or not all(1 <= n <= _MOST_CELLS for n in _HEADER.unpack_from(head)):
            return False
        numbers = np.frombuffer(head, "<f8", (len(head) - _HEADER.size) // 8, _HEADER.size)
        size = np.abs(numbers)
        sane = (size == 0) | ((size >= 1e-30) & (size <= 1e12))
        return bool(sane.sum() >= 0.9 * sane.size)

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file. Options: invalid="zero", cells="lower_edge", interpolation; see `PARAMETERS`.

        Raises `StorageError` if it can't be opened, `FileFormatError` naming file, field and byte offset if its header
        and size don't fit together, a number is not finite or no cell is valid, `LimitError` above `MAX_BYTES`.
        """
        chosen = resolve("format 'merl'", self.PARAMETERS, options)
        try:
            with path.open("rb") as file:
                return _read(file, path.name, chosen)
        except OSError as error:
            if isinstance(error, StorageError):
                raise
            reason = error.strerror or str(error)
            raise StorageError("cannot_open", f"{path}: {reason}", where=str(path), got=reason) from error

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write `brdf`; `InputError` unless it has one channel (written three times) or R, G, B."""
        if len(brdf.channels) != 1 and tuple(brdf.channels) != tuple(RGB):
            listed = ", ".join(brdf.channels.labels()[:8])
            raise InputError(
                "channels_do_not_fit",
                f"a MERL file holds R, G, B, or one channel three times; this material has: {listed}",
                where="brdf",
                got=listed,
                expected="R, G, B or one channel",
            )
        for sentence in _losses(brdf):
            warnings.warn(sentence, LossWarning, stacklevel=2)
        table = brdf if isinstance(brdf, HalfAngleGrid) else _sampled(brdf)
        return write_file(path, _encoded(table), self.read)


# ---- read ----------------------------------------------------------------------------------------


def _damaged(file: str, field: str, offset: int, reason: str, got: Any, expected: str) -> FileFormatError:
    return FileFormatError(
        "damaged_file",
        f"{file}: {field} at byte {offset}: {reason}; got {got}, expected {expected}",
        where=file,
        field=field,
        offset=offset,
        got=got,
        expected=expected,
    )


def _dimensions(file: BinaryIO, name: str) -> tuple[int, int, int]:
    """Numbers of cells, held to the size of the file before anything is allocated."""
    head = file.read(_HEADER.size)
    if len(head) < _HEADER.size:
        raise _damaged(
            name, "dimensions", len(head), "the file ends inside the header", f"{len(head)} bytes", "12 bytes"
        )
    shape = _HEADER.unpack(head)
    for k, (axis, n) in enumerate(zip(("theta_h", "theta_d", "phi_d"), shape)):
        if not 2 <= n <= _MOST_CELLS:
            raise _damaged(name, f"cells of {axis}", 4 * k, "no number of cells", n, f"2 to {_MOST_CELLS}")
    size = os.fstat(file.fileno()).st_size
    cells = shape[0] * shape[1] * shape[2]
    expected = _HEADER.size + 8 * len(PLANES) * cells
    if size > MAX_BYTES and size == expected:
        raise LimitError(
            "file_too_large",
            f"{name}: {size} bytes; at most {MAX_BYTES} are read",
            where=name,
            got=size,
            limit=MAX_BYTES,
        )
    if size == _HEADER.size + 4 * len(PLANES) * cells:
        raise _damaged(
            name, "red plane", _HEADER.size, "the file has the size of float32 numbers, the database's are float64",
            f"{size} bytes", f"{expected} bytes: keep the first 12 and write the rest as float64",
        )  # fmt: skip
    if size != expected:
        needed = f"{expected} bytes for {' x '.join(map(str, shape))} cells and 3 planes of float64"
        if size < expected:
            plane = PLANES[(size - _HEADER.size) // (8 * cells)]
            raise _damaged(name, f"{plane} plane", size, "the file ends too early", f"{size} bytes", needed)
        raise _damaged(name, "end", expected, "bytes after the last plane", f"{size} bytes", needed)
    return shape[0], shape[1], shape[2]


def _read(file: BinaryIO, name: str, chosen: dict[str, Any]) -> HalfAngleGrid:
    declared = _dimensions(file, name)
    shape = declared
    turned = sorted(declared) == sorted(MERL_SHAPE) and declared != MERL_SHAPE
    if turned and chosen["header"] == "database":
        shape = MERL_SHAPE
    cells = shape[0] * shape[1] * shape[2]
    digest = hashlib.sha256(_HEADER.pack(*declared))
    values = np.empty((cells, len(PLANES)), np.float32)
    bad = np.zeros(cells, np.uint8)  # in how many planes a cell is negative
    negative, zero = [0] * len(PLANES), [0] * len(PLANES)
    for c, plane in enumerate(PLANES):
        for start in range(0, cells, _CHUNK):
            at = file.tell()
            raw = file.read(8 * min(_CHUNK, cells - start))
            digest.update(raw)
            numbers = np.frombuffer(raw, "<f8")
            part = slice(start, start + numbers.size)
            with np.errstate(over="ignore"):
                values[part, c] = numbers * SCALES[c]
            if not np.isfinite(values[part, c]).all():
                k = int(np.flatnonzero(~np.isfinite(values[part, c]))[0])
                what = "not a finite number" if not np.isfinite(numbers[k]) else "beyond float32"
                reason = f"value {start + k} is {what}"
                raise _damaged(name, f"{plane} plane", at + 8 * k, reason, str(numbers[k]), "a finite number")
            below = numbers < 0
            bad[part] += below
            negative[c] += int(below.sum())
            zero[c] += int((numbers == 0).sum())
            if start + numbers.size < cells and len(raw) < 8 * _CHUNK:  # shortened since its size was asked for
                raise _damaged(name, f"{plane} plane", at + len(raw), "the file ends too early", len(raw), "more bytes")
    valid = (bad < len(PLANES)).reshape(shape)
    invalid = int(cells - valid.sum())
    if invalid == cells:
        raise _damaged(name, "red plane", _HEADER.size, "no cell is valid", f"{cells} negative ones", "valid cells")
    lattice = values.reshape(*shape, len(PLANES))
    done = ["numbers scaled by 1/1500, 1.15/1500, 1.66/1500 and rounded to float32 (6e-8 relative)"]
    if invalid and chosen["invalid"] == "zero":
        lattice[~valid] = 0
        done.append(f"{invalid} invalid cells set to 0, as asked")
    elif invalid:
        continued(lattice, valid)
        done.append(
            f"{invalid} invalid cells continued: next valid value at a lower theta_h, else a higher one, else theta_d"
        )
    noise = int((lattice[valid] < 0).sum())
    if noise and chosen["negatives"] == "zero":
        np.maximum(lattice, 0, out=lattice)
        done.append(f"{noise} negative numbers of valid cells set to zero, as asked")
    unknown = {"reciprocal": True, "bilateral": False, "energy_conserving": False, "non_negative": False}
    table = HalfAngleGrid(
        lattice, RGB, unknown, filled=np.packbits(~valid) if invalid else None,
        interpolation=chosen["interpolation"], cells=chosen["cells"],
    )  # fmt: skip
    flags = measured_flags(table) | {"reciprocal": True, "non_negative": bool((lattice >= 0).all())}  # both are known
    for flag in FLAGS:
        setattr(table, flag, flags[flag])
    said = []
    if turned:
        order, usual = " x ".join(map(str, declared)), " x ".join(map(str, MERL_SHAPE))
        said.append(
            f"the header says {order} cells of theta_h, theta_d, phi_d, which the database's own reader, that looks at "
            f"their product only, takes as {usual}: read as {' x '.join(map(str, shape))} "
            f"(header='{chosen['header']}'); the other of header='database' and 'declared' reads it the other way"
        )
    if shape != MERL_SHAPE:
        named = " x ".join(map(str, shape))
        said.append(f"{named} cells, not the database's 90 x 90 x 180: most other readers refuse such a file")
    if noise and chosen["negatives"] == "keep":
        said.append(
            f"{noise} numbers of valid cells are negative (noise; other readers take the cell for invalid); kept"
        )
    table.source = {"name": name, "format": "merl", "sha256": digest.hexdigest()}
    table.report = {
        "format": "merl",
        "file": name,
        "sha256": digest.hexdigest(),
        "bytes": _HEADER.size + 24 * cells,
        "conventions": {**_CONVENTIONS, "cells": _PLACES[chosen["cells"]]},
        "found": {
            "channels": list(RGB),
            "cells": dict(zip(("theta_h", "theta_d", "phi_d"), shape)),
            "scale factors": dict(zip(RGB, SCALES)),
            "negative": dict(zip(RGB, negative)),
            "zero": dict(zip(RGB, zero)),
            "not a number": dict.fromkeys(RGB, 0),
            "invalid cells": invalid,
            "valid cells": cells - invalid,
            "angles covered": "both directions to the horizon, but for the invalid cells",
        },
        "done": done,
        "warnings": said,
    }
    return table


# ---- write ---------------------------------------------------------------------------------------


def _losses(brdf: Brdf) -> Iterator[str]:
    """What of `brdf` a MERL file can't hold, a sentence each."""
    if not brdf.reciprocal:
        yield (
            f"the material is not reciprocal (L1 defect {reciprocity_defect(brdf):.3g}): the file keeps the mean over "
            "both orders of the directions"
        )
    if brdf.has_delta:
        most = float(brdf.delta_reflectance(np.linspace(0, np.pi / 2, 91)).max())
        yield f"the perfect mirror part (reflectance up to {most:.3g}) is left out: the file has no place for it"
    if len(brdf.channels) == 1:
        yield "one channel, written three times"
    if isinstance(brdf, HalfAngleGrid):
        shape = brdf.values.shape[:3]
        if shape != MERL_SHAPE:
            named = " x ".join(map(str, shape))
            yield f"{named} cells, not the database's 90 x 90 x 180: most other readers refuse the file"
        if brdf.cells != "centre":
            yield f"the values belong to the {brdf.cells} of their cells: read the file with cells={brdf.cells!r}"
        negative = _negative(brdf)
        if negative:
            yield f"{negative} values are negative, which means an invalid cell in the file: written as 0"


def _sampled(brdf: Brdf) -> HalfAngleGrid:
    """`brdf` in the database's cells, folded where it is not reciprocal."""
    table = HalfAngleGrid.build(brdf, BuildOptions(fold=frozenset() if brdf.reciprocal else frozenset({"reciprocal"})))
    negative = _negative(table)
    if negative:
        text = f"{negative} values are negative, which means an invalid cell in the file: written as 0"
        warnings.warn(text, LossWarning, stacklevel=3)
    return table


def _negative(table: HalfAngleGrid) -> int:
    return int((table.values[~table.filled_cells] < 0).sum())


def _encoded(table: HalfAngleGrid) -> bytes:
    shape = table.values.shape[:3]
    pieces = [_HEADER.pack(*shape)]
    values = table.values.reshape(-1, len(table.channels))
    invalid = table.filled_cells.reshape(-1)
    for c, scale in enumerate(SCALES):
        plane = values[:, c if len(table.channels) > 1 else 0]
        for start in range(0, plane.size, _CHUNK):
            part = slice(start, start + _CHUNK)
            numbers = np.maximum(plane[part], 0).astype("<f8") / scale
            numbers[invalid[part]] = _INVALID
            pieces.append(numbers.tobytes())
    return b"".join(pieces)
