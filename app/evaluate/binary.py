"""Directions as plain numbers, bare or as a .npy file: angles in three C-order rows theta_i, theta_o, delta_phi, shape
(3, n), or vectors in two C-order blocks wi, wo, shape (2, n, 3)."""

from __future__ import annotations

import math
import re
import struct
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from brdf_service.evaluate.angles import AngleRequest, Array, Outside, Unit, check_points
from brdf_service.evaluate.vectors import VectorRequest
from brdf_service.http.bodies import Bytes
from brdf_service.http.errors import MalformedBodyError
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


def precision_of(array: npt.NDArray[Any]) -> Precision:
    """ "f4" or "f8"."""
    return "f4" if array.dtype == np.float32 else "f8"


def angles_from_octets(
    body: Bytes, precision: Precision, unit: Unit, outside: Outside, settings: Settings
) -> AngleRequest:
    """The angles of an octet-stream body: views into it, nothing is copied on a little-endian machine."""
    row = 3 * int(precision[1])
    if len(body) % row:
        raise bc.InputError(
            "bad_length",
            f"the body has {len(body)} bytes; expected a multiple of {row}: three rows of {precision} numbers",
            where="body",
            got=len(body),
            expected=f"a multiple of {row}",
        )
    check_points(len(body) // row, settings)
    return _rows(body.view(f"<{precision}").reshape(3, -1), unit, outside)


def vectors_from_octets(body: Bytes, precision: Precision, settings: Settings) -> VectorRequest:
    """The vectors of an octet-stream body: views into it."""
    row = 6 * int(precision[1])
    if len(body) % row:
        raise bc.InputError(
            "bad_length",
            f"the body has {len(body)} bytes; expected a multiple of {row}: two blocks of three {precision} numbers a "
            "point",
            where="body",
            got=len(body),
            expected=f"a multiple of {row}",
        )
    check_points(len(body) // row, settings)
    return _vectors(body.view(f"<{precision}").reshape(2, -1, 3))


def vectors_from_npy(body: Bytes, precision: Precision | None, settings: Settings) -> VectorRequest:
    """The vectors of a .npy body of shape (2, n, 3). Raises `MalformedBodyError` for what is no such file."""
    return _vectors(_npy_array(body, precision, (2, None, 3), settings))


def angles_from_npy(
    body: Bytes, precision: Precision | None, unit: Unit, outside: Outside, settings: Settings
) -> AngleRequest:
    """The angles of a .npy body of shape (3, n). Raises `MalformedBodyError` for what is no such file."""
    return _rows(_npy_array(body, precision, (3, None), settings), unit, outside)


def _npy_array(
    body: Bytes, precision: Precision | None, wanted_shape: tuple[int | None, ...], settings: Settings
) -> npt.NDArray[Any]:
    """The array of a .npy body, of that shape; None stands for the number of points."""
    dtype, fortran, shape, start = _npy_header(body)
    expected = f"a .npy array of shape {str(wanted_shape).replace('None', 'n')}, float32 or float64"
    fits = len(shape) == len(wanted_shape) and all(w in (None, n) for w, n in zip(wanted_shape, shape, strict=True))
    if dtype not in ("<f4", "<f8", ">f4", ">f8", "=f4", "=f8") or not fits:
        raise bc.InputError(
            "bad_array",
            f"the array is {dtype} of shape {shape}; expected {expected}",
            where="body",
            got=f"{dtype} {shape}",
            expected=expected,
        )
    if precision is not None and dtype[1:] != precision:
        raise bc.InputError(
            "given_twice", f"dtype: the query says {precision}, the file {dtype[1:]}", where="dtype", expected=dtype[1:]
        )
    check_points(shape[1], settings)
    wanted = math.prod(shape) * int(dtype[2])
    if len(body) - start != wanted:
        raise MalformedBodyError(
            "bad_npy",
            f"the file declares {wanted} bytes of data and has {len(body) - start}",
            where="body",
            offset=start,
            got=len(body) - start,
            expected=wanted,
        )
    flat = body[start:].view(dtype.replace("=", "<"))
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)


def map_from_npy(body: Bytes) -> npt.NDArray[Any]:
    """The pixels of a .npy body of shape (h, w) or (h, w, channels). Raises `MalformedBodyError` for no such file."""
    dtype, fortran, shape, start = _npy_header(body)
    expected = "a .npy array of shape (h, w) or (h, w, channels), float32 or float64"
    if dtype not in ("<f4", "<f8", ">f4", ">f8", "=f4", "=f8") or len(shape) not in (2, 3):
        raise bc.InputError(
            "bad_array",
            f"the array is {dtype} of shape {shape}; expected {expected}",
            where="body",
            got=f"{dtype} {shape}",
            expected=expected,
        )
    wanted = math.prod(shape) * int(dtype[2])
    if len(body) - start != wanted:
        raise MalformedBodyError(
            "bad_npy",
            f"the file declares {wanted} bytes of data and has {len(body) - start}",
            where="body",
            offset=start,
            got=len(body) - start,
            expected=wanted,
        )
    flat = body[start:].view(dtype.replace("=", "<"))
    return flat.reshape(shape, order="F" if fortran else "C")


def npy_head(shape: tuple[int, ...], dtype: str) -> bytes:
    """What stands before the data of a .npy file (format 1.0), a multiple of 64 bytes long."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return _MAGIC + b"\x01\x00" + struct.pack("<H", len(text)) + text


def _rows(rows: npt.NDArray[Any], unit: Unit, outside: Outside) -> AngleRequest:
    native: Array = rows.astype(rows.dtype.newbyteorder("="), copy=False)
    return AngleRequest(native[0], native[1], native[2], unit, outside)


def _vectors(blocks: npt.NDArray[Any]) -> VectorRequest:
    native: Array = blocks.astype(blocks.dtype.newbyteorder("="), copy=False)
    return VectorRequest(native[0], native[1])


def _npy_header(body: Bytes) -> tuple[str, bool, tuple[int, ...], int]:
    """(dtype, Fortran order, shape, byte at which the data begins)."""
    head = body[: _LONGEST_HEADER + 12].tobytes()
    if head[:6] != _MAGIC or len(head) < 12 or head[6] not in (1, 2, 3):
        raise _no_npy("no .npy file: it begins with other bytes", 0)
    start, length = (10, head[8] + 256 * head[9]) if head[6] == 1 else (12, struct.unpack_from("<I", head, 8)[0])
    found = _HEADER.fullmatch(head[start : start + length]) if length <= _LONGEST_HEADER else None
    if found is None or start + length > len(body):
        raise _no_npy("its header is not one that numpy writes for an array of numbers", start)
    shape = tuple(int(n) for n in found[3].split(b",") if n.strip())
    return found[1].decode(), found[2] == b"True", shape, start + length


def _no_npy(what: str, offset: int) -> MalformedBodyError:
    return MalformedBodyError(
        "bad_npy", f"the body is {what}" if offset == 0 else f"the body: {what}", where="body", offset=offset
    )
