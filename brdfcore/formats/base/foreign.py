"""Files that are recognised and not read, by name, with what to do: better than "unknown format".

Recognised by their first bytes, never by their extension: .bsdf alone is RGL's, Zemax's, LightTools', pbrt's.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from brdfcore.base.errors import FileFormatError


class Foreign(NamedTuple):
    """A kind of file: what it is called, what its owner can do, and how it is told.

    starts    the first bytes after a byte order mark, blanks and (where `comments`) lines that begin with #: any of
              these. Empty: whatever.
    contains  any of these among the first bytes; empty: whatever.
    test      asked of the first bytes beside these.
    """

    name: str
    advice: str
    starts: tuple[bytes, ...] = ()
    contains: tuple[bytes, ...] = ()
    comments: bool = False
    test: Callable[[bytes], bool] | None = None


_HDF5 = b"\x89HDF\r\n\x1a\n"
_COLUMNS = "export the values as columns (theta_i, phi_i, theta_o, phi_o, f_r in 1/sr) and read those"

FOREIGN = (
    Foreign(
        "XML file",
        "of XML only the BSDF files of WINDOW and Radiance (<WindowElement>) are read",
        starts=(b"<?xml", b"<!DOCTYPE"),
    ),
    Foreign(
        "Radiance scattering interpolant (BSDF_RBFmesh)",
        "read the goniometer data that it was made from",
        starts=(b"#?RADIANCE",),
        contains=(b"FORMAT=BSDF_RBFmesh",),
    ),
    Foreign("Radiance picture or data file", "it holds no reflectance table", starts=(b"#?RADIANCE",)),
    Foreign(
        "pbrt-v3 Fourier BSDF (SCATFUN)",
        f"it holds Fourier coefficients; evaluate it with pbrt-v3 or layerlab and {_COLUMNS}",
        starts=(b"SCATFUN",),
    ),
    Foreign(
        "Speos surface file (OPTIS)",
        f"open it in Speos and export it as a Zemax tabular BSDF, or {_COLUMNS}",
        starts=(b"OPTIS - ",),
    ),
    Foreign(
        "FRED tabular scatter file",
        f"its columns can be read once they stand in one table: {_COLUMNS}",
        starts=(b"type bsdf_data", b"type\tbsdf_data"),
        comments=True,
    ),
    Foreign(
        "LightTools BSDF",
        f"export it as a Zemax tabular BSDF, or {_COLUMNS}",
        contains=(b"\nAOI ", b"\nAOI\t"),
    ),
    Foreign(
        "pab or Radiance goniophotometer file",
        f"it holds one angle of incidence: join the files of a sample into one table; {_COLUMNS}",
        starts=(b"#",),
        contains=(b"#datapoints_in_file", b"#format: theta"),
    ),
    Foreign("J&C RT-300S goniometer file", _COLUMNS, starts=(b"DataType:\tBRDF(",)),
    Foreign("IES photometric file", "it describes a luminaire, not a surface", starts=(b"IESNA",)),
    Foreign(
        "refractiveindex.info file of optical constants",
        "it holds n and k of a metal or glass, not a BRDF; pass them as ior=(n, k) or ior=NAME to a model",
        starts=(b"REFERENCES:", b"COMMENTS:", b"DATA:"),
        comments=True,
    ),
    Foreign(
        "ASAM OpenMATERIAL 3D material file",
        'read the look-up table files that it lists in "brdfUris" (*_brdf.xompt)',
        starts=(b"{",),
        contains=(b'"materialProperties"', b'"brdfUris"'),
    ),
    Foreign(
        "ASAM OpenMATERIAL 3D table without a BRDF",
        "it holds material constants or reflection coefficients; read the *_brdf.xompt file of the material",
        starts=(b"{",),
        contains=(b'"electromagneticProperties"', b'"opticalProperties"', b'"reflectionCoefficient"'),
    ),
    Foreign("glTF scene (binary)", "it holds a scene, not measurements", starts=(b"glTF",)),
    Foreign("gzip archive", "unpack it (gunzip) and read the file inside", starts=(b"\x1f\x8b",)),
    Foreign(
        "zip archive",
        "unpack it (unzip) and read the files inside; a sheet of a spreadsheet has to be saved as CSV",
        starts=(b"PK\x03\x04",),
    ),
    Foreign("spreadsheet (.xls)", "save the sheet as CSV and read that", starts=(b"\xd0\xcf\x11\xe0",)),
    Foreign(
        "picture",
        "it holds no reflectance table",
        starts=(b"\x89PNG", b"\xff\xd8\xff", b"\x76\x2f\x31\x01", b"II*\0", b"MM\0*", b"GIF8"),
    ),
    Foreign("numpy array", f"an array alone says nothing of its axes; {_COLUMNS}", starts=(b"\x93NUMPY",)),
    Foreign("MATLAB data file", _COLUMNS, starts=(b"MATLAB 5.0",)),
    Foreign("MATLAB 7.3 data file (HDF5)", f"save it with -v7 or, from MATLAB, {_COLUMNS}", starts=(b"MATLAB 7.3",)),
    Foreign(
        "AxF material of X-Rite",
        "its container is read by X-Rite's own library only: in Pantora or with the AxF SDK export the BRDF, or "
        f"evaluate it there and {_COLUMNS}",
        starts=(_HDF5,),
        contains=(b"com.xrite", b"X-Rite", b"AxF"),
    ),
    Foreign(
        "netCDF file (HDF5)",
        f"what its variables mean is the data set's own; {_COLUMNS}",
        starts=(_HDF5,),
        contains=(b"_NCProperties", b"_Netcdf4", b"NETCDF"),
    ),
    Foreign("netCDF file", f"what its variables mean is the data set's own; {_COLUMNS}", starts=(b"CDF",)),
    Foreign(
        "HDF5 file that is no table of this project",
        f"what its data sets mean is its own; {_COLUMNS}",
        starts=(_HDF5,),
    ),
    Foreign(
        "MERL file with its bytes swapped (big-endian)",
        "turn its numbers round: with numpy, three int32 and then float64, .byteswap() each and written again",
        test=lambda head: _is_merl(head, ">", "f8"),
    ),
    Foreign(
        "MERL file of float32",
        "the database has float64: with numpy, keep the first 12 bytes and write the rest .astype('<f8')",
        test=lambda head: _is_merl(head, "<", "f4"),
    ),
    Foreign(
        "MERL file of float32 with its bytes swapped (big-endian)",
        "the database has little-endian float64: with numpy, turn three int32 and the numbers round, and write these "
        ".astype('<f8')",
        test=lambda head: _is_merl(head, ">", "f4"),
    ),
    Foreign("PDF document", "it holds no reflectance table", starts=(b"%PDF",)),
)


def _is_merl(head: bytes, order: str, kind: str) -> bool:
    """Three plausible numbers of cells, and nine in ten of what follows of sane size, in this byte order and type."""
    if len(head) < 64 or not all(2 <= n <= 4_096 for n in struct.unpack_from(f"{order}3i", head)):
        return False
    width = int(kind[1])
    size = np.abs(np.frombuffer(head, order + kind, (len(head) - 12) // width, 12).astype(np.float64))
    sane = (size == 0) | ((size >= 1e-12) & (size <= 1e8))
    return bool(sane.mean() >= 0.9)


def refuse_foreign(head: bytes, file: str) -> None:
    """`FileFormatError` naming the kind of file and what to do, if `head` begins one of `FOREIGN`."""
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    body = text
    while body.startswith(b"#"):
        body = body.partition(b"\n")[2].lstrip()
    for kind in FOREIGN:
        begins = not kind.starts or (body if kind.comments else text).startswith(kind.starts)
        begins = begins and (kind.test is None or kind.test(head))
        if begins and (not kind.contains or any(word in head for word in kind.contains)):
            raise FileFormatError(
                "format_not_read",
                f"{file}: {kind.name}: this kind of file is not read; {kind.advice}",
                where=file,
                file=file,
                offset=0,
                got=kind.name,
                hint=kind.advice,
            )
