"""This project's own table files (HDF5) as a format, so that `read` and `write` take them like any other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.formats.base.format import Format
from brdfcore.tables.base.table import Table


class TableFormat(Format):
    """HDF5 table of this project; see `brdfcore.tables.store` for its layout."""

    name = "table"
    SUMMARY = "this project's table file (HDF5)"
    EXTENSIONS = (".h5", ".hdf5")
    writable = True

    def sniff(self, head: bytes) -> bool:
        """An HDF5 file that has the two names of ours in its root group: others' data are HDF5 too."""
        return head.startswith(b"\x89HDF\r\n\x1a\n") and b"header" in head and b"arrays" in head

    def read(self, path: Path, **options: Any) -> Brdf:
        from brdfcore.base.parameters import resolve
        from brdfcore.tables.store import open_table

        resolve("format 'table'", self.PARAMETERS, options)
        return open_table(path)

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        if not isinstance(brdf, Table):
            raise InputError(
                "not_a_table",
                "only a table can be stored in this format; tabulate() the material first",
                where="brdf",
                got=type(brdf).__name__,
                expected="a Table",
            )
        return brdf.save(path)
