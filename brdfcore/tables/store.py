"""Tables from their HDF5 files, trusted only as far as they were checked; layout and writing: `tables.base.file`.

The store knows `from_arrays` only; a representation never sees HDF5.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import FLAGS
from brdfcore.base.channels import Channels
from brdfcore.base.errors import FileFormatError, InputError, LimitError, StorageError
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.tables.base.file import MAX_HEADER, SCHEMA_VERSION, h5py, refused
from brdfcore.tables.base.local_error import LocalError
from brdfcore.tables.base.table import Table

SIGNATURE = b"\x89HDF\r\n\x1a\n"
#: Largest table read, bytes in memory; a file that declares more is refused before anything is read.
MAX_BYTES = 4_000_000_000
_DTYPES = frozenset(np.dtype(t) for t in ("<f2", "<f4", "<f8", "<i4", "<i8", "<u2", "<u4", "|u1"))


def open_table(path: str | PathLike[str], *, max_bytes: int = MAX_BYTES) -> Table:
    """Read a table whole into memory and close the file.

    Every structure is checked before it is read (hard links only; no external, virtual or variable-length data;
    no filter but fletcher32; shape x itemsize against `max_bytes` and against what the file really holds), every
    value after (finite, and the id again from what was read).

    A table written by an older evaluation of its representation answers as the present one does and gets the id of
    that; its id in the file can't be checked then, the checksums are. One written by a newer evaluation is refused.

    Raises `StorageError` if the file can't be opened, `FileFormatError` naming file and field, `LimitError`.

    >>> table = bc.tabulate(bc.model("lambert", reflectance=0.5), "angle_grid", shape=(4, 4, 5))
    >>> stored = table.save("white.h5")
    >>> same = bc.open_table("white.h5")
    >>> same.id == table.id, same.evaluate(0.3, 0.2, 1.0).round(6)
    (True, array([0.159155]))
    """
    path = Path(path)
    with _opened(path) as file:
        header = _read_header(path, file)
        if header["representation"] not in REPRESENTATIONS:
            known = ", ".join(REPRESENTATIONS.names())
            raise _damaged(path, "header/representation", repr(header["representation"])[:100], f"one of {known}")
        cls = REPRESENTATIONS.load(header["representation"])
        if header["evaluation_version"] > cls.EVALUATION_VERSION:
            raise FileFormatError(
                "evaluation_version",
                f"{path.name}: written by evaluation version {header['evaluation_version']} of {cls.name}, this "
                f"program has {cls.EVALUATION_VERSION} and would answer differently; use brdf-tables "
                f"{header.get('code_version', '')!r:.40} or newer",
                where="header/evaluation_version",
                file=path.name,
                got=header["evaluation_version"],
                expected=cls.EVALUATION_VERSION,
            )
        if header["evaluation_version"] < cls.OLDEST_EVALUATION:
            raise FileFormatError(
                "evaluation_version",
                f"{path.name}: written by evaluation version {header['evaluation_version']} of {cls.name}, whose "
                "look-ups were wrong and would be others now; make the table again from its source",
                where="header/evaluation_version",
                file=path.name,
                got=header["evaluation_version"],
                expected=cls.OLDEST_EVALUATION,
            )
        arrays = _read_group(path, file, "arrays", max_bytes)
        spread = None
        if "uncertainty" in header:
            spread = _read_group(path, file, "uncertainty", max_bytes - sum(a.nbytes for a in arrays.values()))
    try:
        channels = Channels(header["channels"], header["channel_kind"])
        table: Table = cls.from_arrays(arrays, header["attributes"], channels, header["flags"])
        if spread is not None:
            table.local_error = LocalError.from_arrays(spread, header["uncertainty"], len(channels))
    except (FileFormatError, InputError) as error:
        raise FileFormatError(
            error.code, f"{path.name}: {error.detail}", **{**error.context, "file": path.name}
        ) from error
    if header["evaluation_version"] == cls.EVALUATION_VERSION and table.id != header["id"]:
        raise _damaged(path, "header/id", table.id, str(header["id"]))
    table.source, table.report = header["source"], header["report"]
    table.error, table.metadata = header["error"], header["metadata"]
    return table


def read_header(path: str | PathLike[str]) -> dict[str, Any]:
    """The JSON header of a table file, without its arrays; for lists. Raises as `open_table`."""
    path = Path(path)
    with _opened(path) as file:
        return _read_header(path, file)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        with path.open("rb") as plain:
            head = plain.read(len(SIGNATURE))
    except OSError as error:
        raise StorageError(
            "cannot_open", f"{path}: {error.strerror or error}", where=str(path), got=error.strerror
        ) from error
    if head != SIGNATURE:
        raise FileFormatError(
            "not_a_table",
            f"{path.name}: not a table file (HDF5 signature missing at offset 0)",
            where=path.name,
            offset=0,
            got=repr(head),
            expected=repr(SIGNATURE),
        )
    try:
        # files are replaced, never changed in place, so no lock is needed (and network folders often have none)
        with h5py.File(path, "r", locking=False) as file:
            yield file
    except (FileFormatError, LimitError):
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:  # what h5py raises for damage
        raise _damaged(path, "file", str(error)[:200], "a whole, undamaged HDF5 file") from error


def _read_header(path: Path, file: Any) -> dict[str, Any]:
    raw = _read(path, file, "header", MAX_HEADER)
    try:
        header = json.loads(raw.tobytes(), parse_constant=_not_json)
    except (ValueError, RecursionError) as error:
        raise _damaged(path, "header", str(error), "JSON") from error
    expected: dict[str, type] = {
        "schema_version": int,
        "representation": str,
        "evaluation_version": int,
        "channels": list,
        "channel_kind": str,
        "flags": dict,
        "attributes": dict,
        "id": str,
        "source": dict,
        "report": dict,
        "error": dict,
        "metadata": dict,
    }
    if not isinstance(header, dict):
        raise _damaged(path, "header", type(header).__name__, "an object")
    for key, kind in expected.items():
        if not isinstance(header.get(key), kind) or isinstance(header[key], bool):
            raise _damaged(path, f"header/{key}", type(header.get(key)).__name__, kind.__name__)
    if not isinstance(header.get("uncertainty", {}), dict):
        raise _damaged(path, "header/uncertainty", type(header["uncertainty"]).__name__, "dict")
    if header["schema_version"] != SCHEMA_VERSION:
        raise FileFormatError(
            "schema_version",
            f"{path.name}: schema version {header['schema_version']}, this program reads {SCHEMA_VERSION}",
            where="header/schema_version",
            got=header["schema_version"],
            expected=SCHEMA_VERSION,
        )
    if not all(isinstance(header["flags"].get(flag), bool) for flag in FLAGS):
        raise _damaged(path, "header/flags", str(header["flags"])[:100], f"true or false for {', '.join(FLAGS)}")
    for key in ("source", "report", "error", "metadata"):
        problem = refused(key, header[key])
        if problem:
            raise _damaged(path, f"header/{problem[0]}", *problem[1:])
    return header


def _not_json(constant: str) -> Any:
    raise ValueError(f"{constant} is not JSON")


def _read_group(path: Path, file: Any, group: str, limit: int) -> dict[str, npt.NDArray[Any]]:
    """The arrays of a group, finite, of `limit` bytes in all."""
    arrays: dict[str, npt.NDArray[Any]] = {}
    held = _child(path, file, group, h5py.Group)
    for name in held:
        array = _read(path, held, name, limit)
        limit -= array.nbytes
        arrays[name] = array
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            place = [int(i) for i in np.argwhere(~np.isfinite(array))[0]]
            raise _damaged(path, f"{group}/{name}", f"a value that is not finite at {place}", "finite values")
    return arrays


def _child(path: Path, group: Any, name: str, kind: type) -> Any:
    link = group.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise _damaged(path, name, type(link).__name__ if link else "nothing", "a hard link")
    child = group[name]
    if not isinstance(child, kind):
        raise _damaged(path, name, type(child).__name__, kind.__name__)
    return child


def _read(path: Path, group: Any, name: str, limit: int) -> npt.NDArray[Any]:
    dataset = _child(path, group, name, h5py.Dataset)
    if dataset.dtype not in _DTYPES or dataset.shape is None:
        raise _damaged(path, name, str(dataset.dtype), "little-endian numbers: " + " ".join(sorted(map(str, _DTYPES))))
    layout = dataset.id.get_create_plist()
    filters = [layout.get_filter(k)[0] for k in range(layout.get_nfilters())]
    if any(f != h5py.h5z.FILTER_FLETCHER32 for f in filters):
        raise _damaged(path, name, f"filters {filters}", "no filter but fletcher32")
    if dataset.is_virtual or dataset.external or layout.get_layout() not in (h5py.h5d.CHUNKED, h5py.h5d.CONTIGUOUS):
        raise _damaged(path, name, "external, virtual or compact data", "data in this file")
    size = dataset.dtype.itemsize
    for n in dataset.shape:
        size *= int(n)
    if size > limit:
        raise LimitError(
            "table_too_large",
            f"{path.name}: {name} declares {size} bytes; the limit is {limit}",
            where=name,
            got=size,
            limit=limit,
        )
    if dataset.id.get_storage_size() < size:  # never-written chunks would be read as zeros
        raise _damaged(path, name, f"{dataset.id.get_storage_size()} bytes stored", f"{size} bytes")
    return np.asarray(dataset[()]).astype(dataset.dtype.newbyteorder("="), copy=False)


def _damaged(path: Path, field: str, got: str, expected: str) -> FileFormatError:
    return FileFormatError(
        "damaged_table",
        f"{path.name}: {field}: {got}; expected {expected}. The file is damaged or not one of ours.",
        where=field,
        file=path.name,
        got=got,
        expected=expected,
    )
