"""The nodes of a table as one binary file, which shaders and other programs read: safetensors.

Layout (https://huggingface.co/docs/safetensors, version 0.5): uint64 little-endian n; n bytes of JSON, {name: {"dtype":
"F32" or "I32", "shape", "data_offsets": [first, end]}, "__metadata__": {name: text}}; then the arrays, little-endian, C
order, one after the other without gaps. Here n + 8 is a multiple of 64, and an array "padding" ends the file at a
multiple of 2,048 numbers, so that all of it is one texture of that width.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.tables.base.table import Table

#: Numbers a row of the texture: every WebGL2 takes textures of this width.
WIDTH = 2_048
#: The nodes begin at a multiple of this.
_ALIGNED = 64


def array_bytes(table: Brdf) -> bytes:
    """The nodes of a table (half_difference, lobe_grid, angle_grid, vndf_warp) as the bytes of a safetensors file.

    Numbers are float32, halves and 16-bit words decoded, indices int32; metadata: representation, id, channels,
    settings. Raises `InputError` for another material or representation.

    >>> table = bc.tabulate(bc.model("lambert", reflectance=0.5), "angle_grid", shape=(3, 3, 3))
    >>> data = bc.array_bytes(table)
    >>> header = int.from_bytes(data[:8], "little")
    >>> np.frombuffer(data, "<f4", 27, 8 + header)[:3].round(6)
    array([0.159155, 0.159155, 0.159155], dtype=float32)
    """
    held = as_table(table)
    look_up = held.array_look_up()
    arrays = {name: _plain(array) for name, array in look_up.nodes.items()}
    numbers = sum(a.size for a in arrays.values())
    arrays["padding"] = np.zeros(-numbers % WIDTH, "<f4")
    metadata = {
        "representation": held.name,
        "id": held.id,
        "channels": json.dumps(held.channels.to_json()),
        "settings": json.dumps(_settings(look_up.settings)),
    }
    header: dict[str, Any] = {"__metadata__": metadata}
    for name, first in offsets(arrays).items():
        array = arrays[name]
        kind = "I32" if array.dtype.kind == "i" else "F32"
        header[name] = {
            "dtype": kind,
            "shape": list(array.shape),
            "data_offsets": [4 * first, 4 * (first + array.size)],
        }
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-(len(text) + 8) % _ALIGNED)
    return b"".join([len(text).to_bytes(8, "little"), text, *(a.tobytes() for a in arrays.values())])


def offsets(arrays: dict[str, npt.NDArray[Any]]) -> dict[str, int]:
    """Number of each array's first number, in the order of the file."""
    found, first = {}, 0
    for name, array in arrays.items():
        found[name] = first
        first += array.size
    return found


def as_table(brdf: Brdf) -> Table:
    """`brdf`, or an `InputError` unless it is a table."""
    if not isinstance(brdf, Table):
        raise InputError(
            "not_a_table",
            f"only a table has arrays, not a {type(brdf).__name__}; tabulate() the material first",
            where="table",
            got=type(brdf).__name__,
            expected="a Table",
        )
    return brdf


def _plain(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.ascontiguousarray(array, "<i4" if array.dtype.kind == "i" else "<f4")


def _settings(settings: Any) -> dict[str, Any]:
    return {} if settings is None else {name: getattr(settings, name) for name in settings.__dataclass_fields__}
