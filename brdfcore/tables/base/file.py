"""A table as one HDF5 file: its layout, what its header may hold, and how it is written, whole or not at all.

Layout, schema version 1 (little-endian, chunked, fletcher32 checksums):

    /header          uint8, JSON text: schema_version, representation, evaluation_version, channels, channel_kind,
                     flags, attributes, id; beside them source, report, error, metadata, code_version
    /arrays/NAME     each array a look-up touches
    /uncertainty/NAME  what `tables.base.local_error` holds, where there is one; its attributes are in the header

`tables.store` reads such files.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import T, write_file
from brdfcore.base.errors import InputError, missing_extra

try:
    import h5py as h5py
except ImportError as error:
    raise missing_extra("h5py", "core", "storing a table") from error

SCHEMA_VERSION = 1
#: Largest JSON header, bytes.
MAX_HEADER = 16_000_000
#: How deep objects of the header may lie in each other.
MAX_DEPTH = 16
#: Values a chunk: small enough that a damaged chunk is found by its own checksum.
_CHUNK = 65_536


def save(
    path: Path,
    header: dict[str, Any],
    groups: Mapping[str, Mapping[str, npt.NDArray[Any]]],
    check: Callable[[Path], T],
) -> T:
    """Write header and groups of arrays to `path` by `base.atomic.write_file`, and return what `check` read of the new
    file before it took the old one's place. The bytes depend on the table only.

    They are made in memory: the HDF5 library ends the whole process where it can't write out what it holds.

    Raises what `write_file` raises, and `InputError` for a source, report, error or metadata that JSON can't hold or
    that `tables.store.open_table` would refuse.
    """
    text = np.frombuffer(_header_text({"schema_version": SCHEMA_VERSION, **header}), np.uint8)
    # one piece of memory for all of it, so that there is room from the first byte or not at all
    room = text.nbytes + sum(array.nbytes for arrays in groups.values() for array in arrays.values())
    with h5py.File(
        path.name, "w", driver="core", backing_store=False, block_size=room + room // 8 + 2**20, track_order=False
    ) as file:
        _write(file, "header", text)
        for name, arrays in groups.items():
            group = file.create_group(name)
            for key, array in arrays.items():
                _write(group, key, array)
        file.flush()
        image = file.id.get_file_image()
    return write_file(path, image, check)


def _header_text(header: dict[str, Any]) -> bytes:
    for key in ("source", "report", "error", "metadata"):
        try:
            json.dumps(header[key], allow_nan=False)
            problem = refused(key, header[key])
        except (TypeError, ValueError, RecursionError) as error:
            problem = (key, str(error)[:200], "what JSON can hold: texts, finite numbers, lists, objects")
        if problem:
            where, got, expected = problem
            raise InputError(
                "bad_header",
                f"table.{where}: {got}; expected {expected}. The table was not saved.",
                where=where,
                got=got,
                expected=expected,
            )
    return json.dumps(header, sort_keys=True, allow_nan=False).encode()


def _write(group: Any, name: str, array: npt.NDArray[Any]) -> None:
    little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    chunks = list(little.shape)
    while np.prod(chunks) > _CHUNK:  # halve the longest axis
        longest = int(np.argmax(chunks))
        chunks[longest] = -(-chunks[longest] // 2)
    group.create_dataset(name, data=little, chunks=tuple(chunks), fletcher32=True, track_times=False)


#: What is read of `error`: a number or null; lists of them by name; a number or null by name.
_NUMBERS = (
    *("l1", "l1_stderr", "rel_l2", "delta", "tolerance"),
    *("negatives", "nan", "values", "directions", "seed"),
)
_Problem = tuple[str, str, str]


def refused(key: str, value: dict[str, Any]) -> _Problem | None:
    """What is wrong with a header's `source`, `report`, `error` or `metadata`: (where, got, expected)."""
    if _deeper_than(value, MAX_DEPTH):
        return key, "objects inside objects", f"at most {MAX_DEPTH} levels"
    texts = {"report": ("done", "warnings"), "error": ("warnings",)}.get(key, ())
    for name in texts:
        listed = value.get(name, [])
        if not isinstance(listed, list) or not all(isinstance(x, str) for x in listed):
            return f"{key}/{name}", _short(listed), "a list of texts"
    if key == "source":
        for name in ("name", "format", "sha256"):
            if not isinstance(value.get(name, ""), str):
                return f"{key}/{name}", _short(value[name]), "a text"
    return _stated_error(value) if key == "error" else None


def _stated_error(value: dict[str, Any]) -> _Problem | None:
    for name in _NUMBERS:
        if not _is_number(value.get(name)):
            return f"error/{name}", _short(value[name]), "a number or null"
    if not isinstance(value.get("regular", True), bool):
        return "error/regular", _short(value["regular"]), "true or false"
    for name, kind in (("albedo_bias", list), ("log_ratio", dict)):
        named = value.get(name, {})
        if not isinstance(named, dict):
            return f"error/{name}", _short(named), "an object"
        lists = named.values() if kind is list else [list(named.values())]
        if not all(isinstance(x, list) and all(_is_number(v) for v in x) for x in lists):
            return f"error/{name}", _short(named), "numbers or null" + (" in lists" if kind is list else "")
    return None


def _is_number(value: Any) -> bool:
    # whole numbers have no largest in JSON, and floats do
    return value is None or (isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= 1e300)


def _deeper_than(value: Any, levels: int) -> bool:
    if not isinstance(value, (dict, list)):
        return False
    inner = value.values() if isinstance(value, dict) else value
    return levels == 0 or any(_deeper_than(x, levels - 1) for x in inner)


def _short(value: Any) -> str:
    return json.dumps(value)[:60]
