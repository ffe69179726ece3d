"""Directions as plain numbers, bare or as a .npy file: angles in three C-order rows theta_i, theta_o, delta_phi, shape
(3, n), or vectors in two C-order blocks wi, wo, shape (2, n, 3)."""

from __future__ import annotations

import math
import re
import struct
from typing import Any, Literal

import numpy.typing as npt
from brdf_service.evaluate.directions import Angles, Directions, Vectors, check_points
from brdf_service.evaluate.json_body import Form
from brdf_service.http.bodies import Bytes
from brdf_service.http.errors import MalformedBodyError
from brdf_service.http.query import Outside, Unit
from brdf_service.settings import Settings

import brdfcore as bc

Precision = Literal["f4", "f8"]

_MAGIC = b"\x93NUMPY"
#: The format writes the header with its keys sorted; anything else is refused before it is interpreted.
_HEADER = re.compile(
    rb"\{'descr': '([<>=|]?[a-zA-Z][0-9]{0,3})', 'fortran_order': (True|False), "
    rb"'shape': \(([0-9]{0,18}(?:, ?[0-9]{1,18}){0,7}),?\),? ?\}[ \n]*"
)
_LONGEST_HEADER = 4096
#: Shape before the points, after them, and what that is in words.
_LAYOUT: dict[Form, tuple[int, tuple[int, ...], str]] = {
    "angles": (3, (), "three rows of"),
    "vectors": (2, (3,), "two blocks of three"),
}


def directions_from_octets(
    body: Bytes, form: Form, precision: Precision, unit: Unit, outside: Outside, settings: Settings
) -> Directions:
    """The directions of an octet-stream body: views into it, nothing is copied on a little-endian machine."""
    first, last, words = _LAYOUT[form]
    row = first * math.prod(last) * int(precision[1])
    if len(body) % row:
        said = f"the body has {len(body)} bytes; expected a multiple of {row}: {words} {precision} numbers"
        said += " a point" if last else ""
        raise bc.InputError("bad_length", said, where="body", got=len(body), expected=f"a multiple of {row}")
    check_points(len(body) // row, settings)
    return _directions(body.view(f"<{precision}").reshape(first, -1, *last), unit, outside)


def directions_from_npy(
    body: Bytes, form: Form, precision: Precision | None, unit: Unit, outside: Outside, settings: Settings
) -> Directions:
    """The directions of a .npy body. Raises `MalformedBodyError` for what is no such file."""
    first, last, _ = _LAYOUT[form]
    found, shape, _ = _npy_header(body)
    wanted = (first, None, *last)
    expected = f"a .npy array of shape {str(wanted).replace('None', 'n')}, float32 or float64"
    if len(shape) != len(wanted) or any(w not in (None, n) for w, n in zip(wanted, shape, strict=True)):
        raise _bad_array(found, shape, expected)
    if precision is not None and found[1:] != precision:
        said = f"dtype: the query says {precision}, the file {found[1:]}"
        raise bc.InputError("given_twice", said, where="dtype", expected=found[1:])
    check_points(shape[1], settings)
    return _directions(_npy_array(body, expected), unit, outside)


def map_from_npy(body: Bytes) -> npt.NDArray[Any]:
    """The pixels of a .npy body of shape (h, w) or (h, w, channels). Raises `MalformedBodyError` for no such file."""
    expected = "a .npy array of shape (h, w) or (h, w, channels), float32 or float64"
    dtype, shape, _ = _npy_header(body)
    if len(shape) not in (2, 3):
        raise _bad_array(dtype, shape, expected)
    return _npy_array(body, expected)


def npy_head(shape: tuple[int, ...], dtype: str) -> bytes:
    """What stands before the data of a .npy file (format 1.0), a multiple of 64 bytes long."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return _MAGIC + b"\x01\x00" + struct.pack("<H", len(text)) + text


def _directions(numbers: npt.NDArray[Any], unit: Unit, outside: Outside) -> Directions:
    native: npt.NDArray[Any] = numbers.astype(numbers.dtype.newbyteorder("="), copy=False)
    if len(native) == 2:
        return Vectors(native[0], native[1])
    return Angles(native[0], native[1], native[2], unit, outside)


def _npy_array(body: Bytes, expected: str) -> npt.NDArray[Any]:
    """The numbers of a .npy body whose shape is right."""
    dtype, shape, start = _npy_header(body)
    if dtype not in ("<f4", "<f8", ">f4", ">f8", "=f4", "=f8"):
        raise _bad_array(dtype, shape, expected)
    wanted, got = math.prod(shape) * int(dtype[2]), len(body) - start
    if got != wanted:
        said = f"the file declares {wanted} bytes of data and has {got}"
        raise MalformedBodyError("bad_npy", said, where="body", offset=start, got=got, expected=wanted)
    fortran = b"'fortran_order': True" in body[:start].tobytes()
    return body[start:].view(dtype.replace("=", "<")).reshape(shape, order="F" if fortran else "C")


def _npy_header(body: Bytes) -> tuple[str, tuple[int, ...], int]:
    """(dtype, shape, byte at which the data begins)."""
    head = body[: _LONGEST_HEADER + 12].tobytes()
    if head[:6] != _MAGIC or len(head) < 12 or head[6] not in (1, 2, 3):
        raise MalformedBodyError("bad_npy", "the body is no .npy file: it begins with other bytes", where="body")
    start, length = (10, head[8] + 256 * head[9]) if head[6] == 1 else (12, struct.unpack_from("<I", head, 8)[0])
    found = _HEADER.fullmatch(head[start : start + length]) if length <= _LONGEST_HEADER else None
    if found is None or start + length > len(body):
        said = "the body: its header is not one that numpy writes for an array of numbers"
        raise MalformedBodyError("bad_npy", said, where="body", offset=start)
    return found[1].decode(), tuple(int(n) for n in found[3].split(b",") if n.strip()), start + length


def _bad_array(dtype: str, shape: tuple[int, ...], expected: str) -> bc.InputError:
    said = f"the array is {dtype} of shape {shape}; expected {expected}"
    return bc.InputError("bad_array", said, where="body", got=f"{dtype} {shape}", expected=expected)
