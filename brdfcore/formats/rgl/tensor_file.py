"""The `tensor_file` 1.0 container: named arrays in one file. Nothing in it is trusted before it is checked.

Layout, little-endian: 12 bytes `tensor_file\\0`; 2 bytes version (1, 0); uint32 number of fields; then for each
field uint16 length of the name, the name, uint16 number of dimensions, uint8 type code, uint64 offset of the
data from the start of the file, and the dimensions as uint64. Data in C order, each field aligned to 8 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError

MAGIC = b"tensor_file\x00"
#: Type codes of the container.
DTYPES: dict[int, np.dtype[Any]] = {
    1: np.dtype("u1"),
    2: np.dtype("i1"),
    3: np.dtype("<u2"),
    4: np.dtype("<i2"),
    5: np.dtype("<u4"),
    6: np.dtype("<i4"),
    7: np.dtype("<u8"),
    8: np.dtype("<i8"),
    9: np.dtype("<f2"),
    10: np.dtype("<f4"),
    11: np.dtype("<f8"),
}
#: numpy's own limit is 64; no field of this format has more than 5.
MAX_DIMENSIONS = 32
_ALIGN = 8


class Field(NamedTuple):
    """One array and the byte where its data begins."""

    array: npt.NDArray[Any]
    offset: int


class TensorFile(NamedTuple):
    """Fields in the order of the file, and the bytes that no field and no header accounts for at the end."""

    fields: dict[str, Field]
    trailing: int


def damaged(file: str, field: str, offset: int, reason: str, got: Any, expected: str) -> FileFormatError:
    """The error for one thing wrong in a file: names file, field and byte offset."""
    return FileFormatError(
        "damaged_file",
        f"{file}: {field} at byte {offset}: {reason}; got {got}, expected {expected}",
        where=file,
        field=field,
        offset=offset,
        got=got,
        expected=expected,
    )


class _Cursor:
    """Reads the header front to back and refuses to read past the end."""

    def __init__(self, data: bytes, file: str) -> None:
        self.data, self.file, self.at = data, file, 0

    def take(self, layout: str, field: str) -> tuple[Any, ...]:
        size = struct.calcsize(layout)
        self.need(size, field)
        values = struct.unpack_from(layout, self.data, self.at)
        self.at += size
        return values

    def need(self, size: int, field: str) -> None:
        left = len(self.data) - self.at
        if size > left:
            raise damaged(
                self.file, field, self.at, "the file ends inside the header", f"{left} bytes", f"{size} bytes"
            )


def decode(data: bytes, file: str) -> TensorFile:
    """The fields of `data` as read-only views into it: nothing is allocated by what the file claims.

    Every count, dimension and offset is held to the real length first. Raises `FileFormatError` naming `file`,
    field and offset. Fields may share bytes.
    """
    cursor = _Cursor(data, file)
    (magic,) = cursor.take("12s", "signature")
    if magic != MAGIC:
        raise damaged(file, "signature", 0, "not a tensor_file", repr(magic), repr(MAGIC))
    version = cursor.take("<BB", "container version")
    if version != (1, 0):
        raise damaged(file, "container version", 12, "unknown version", "{}.{}".format(*version), "1.0")
    (count,) = cursor.take("<I", "number of fields")
    fields: dict[str, Field] = {}
    end = 0
    for i in range(count):  # a wrong count ends at the first read past the file
        name, field = _read_field(cursor, i)
        if name in fields:
            raise damaged(file, name, cursor.at, "the name occurs twice", repr(name), "each field once")
        fields[name] = field
        end = max(end, field.offset + field.array.nbytes)
    return TensorFile(fields, max(len(data) - max(end, cursor.at), 0))


def _read_field(cursor: _Cursor, i: int) -> tuple[str, Field]:
    file = cursor.file
    start = cursor.at
    label = f"field {i}"
    (length,) = cursor.take("<H", label)
    (raw,) = cursor.take(f"{length}s", label)
    try:
        name = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise damaged(file, label, start + 2, "its name is not text", repr(raw[:32]), "UTF-8") from error
    label = repr(name) if len(name) <= 32 else repr(name[:32]) + "..."
    at = cursor.at
    dimensions, code, offset = cursor.take("<HBQ", label)
    if dimensions > MAX_DIMENSIONS:
        raise damaged(file, label, at, "too many dimensions", dimensions, f"at most {MAX_DIMENSIONS}")
    if code not in DTYPES:
        raise damaged(file, label, at + 2, "unknown type code", code, "1 to 11")
    shape = cursor.take(f"<{dimensions}Q", label)
    dtype = DTYPES[code]
    size = dtype.itemsize
    for n in shape:
        size *= n  # Python integers: 2^63 squared is no surprise
    available = len(cursor.data) - offset
    if size > available or offset > len(cursor.data) or any(n > len(cursor.data) for n in shape):
        wanted = " x ".join(str(n) for n in shape) or "1"
        raise damaged(
            file,
            label,
            at,
            "its data does not fit into the file",
            f"{wanted} of {dtype.name} at offset {offset}",
            f"at most {max(available, 0)} bytes",
        )
    flat = np.frombuffer(cursor.data, dtype, size // dtype.itemsize, offset)
    return name, Field(flat.reshape(shape), offset)


def encode(fields: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """The bytes of a file with these fields, in this order, each aligned to 8 bytes and padded with zeros."""
    codes = {dtype: code for code, dtype in DTYPES.items()}
    little = {n: np.asarray(a, a.dtype.newbyteorder("<"), order="C") for n, a in fields.items()}
    names = {name: name.encode("utf-8") for name in little}
    header = 18 + sum(2 + len(names[n]) + 11 + 8 * a.ndim for n, a in little.items())
    parts = [MAGIC, struct.pack("<BBI", 1, 0, len(little))]
    offsets, at = {}, header
    for name, array in little.items():
        at = -(-at // _ALIGN) * _ALIGN
        offsets[name] = at
        at += array.nbytes
        parts += [
            struct.pack("<H", len(names[name])),
            names[name],
            struct.pack("<HBQ", array.ndim, codes[array.dtype], offsets[name]),
            struct.pack(f"<{array.ndim}Q", *array.shape),
        ]
    at = header
    for name, array in little.items():
        parts += [bytes(offsets[name] - at), array.tobytes()]
        at = offsets[name] + array.nbytes
    return b"".join(parts)
