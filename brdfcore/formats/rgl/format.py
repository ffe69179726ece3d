"""RGL material database: isotropic `tensor_file` measurements, RGB or spectral, read and written.

The files hold f_r cos(theta_o) in the parameterisation of `tables.vndf_warp`, and are read into it unchanged.
"""

from __future__ import annotations

import hashlib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import RGB, Channels
from brdfcore.base.conventions import THETA_MAX
from brdfcore.base.errors import FileFormatError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format, LossWarning, read_bytes
from brdfcore.formats.base.import_report import measures_of
from brdfcore.formats.rgl.fields import check_channels, fields_of_table
from brdfcore.formats.rgl.tensor_file import MAGIC, Field, TensorFile, damaged, decode, encode
from brdfcore.metrics import measured_flags
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.vndf_warp import DEFAULT_BYTES, VndfWarp, shape_within

#: Largest file read; the largest published isotropic one takes 15 MB.
MAX_BYTES = 2_000_000_000
#: Rows of sigma and ndf over azimuth are equal in an isotropic file, to rounding.
_SAME_ROWS = 1e-6

_CONVENTIONS = {
    "valid": "the bits of the field valid are counted and ignored on purpose, as the database's own reader does: most "
    "are not set in published files, and the samples behind them are interpolated like any other",
    "value": "the file tabulates f_r cos(theta_o); f_r in 1/sr is its quotient by cos(theta_o), also at the horizon",
    "directions": "theta_i of the file is theta_i here (wi, the tabulated direction); found by comparison with "
    "published evaluations, which differ when the directions are exchanged",
    "half vector": "u(theta_h) = sqrt(2 theta_h / pi), u(phi_h) = (phi_h + pi) / (2 pi), phi_h from wi",
    "angles": "radians",
    "beyond theta_i": "the slice of the nearest tabulated theta_i is continued",
}


class RglFormat(Format):
    """Isotropic measurements of the RGL material database (`tensor_file`), RGB or spectral.

    Read into a `VndfWarp`: exact, no resampling. Written byte for byte as read (what no look-up touches is kept
    beside the table for that), and any other `VndfWarp` in its own samples. Any other material is fitted to the
    parameterisation first (`tables.vndf_warp.fit`), so that what reads these files renders it: wavelengths, R, G, B, or
    one channel, which is written as three equal ones. A mirror part is left out. Anisotropic files are refused.
    """

    name = "rgl"
    SUMMARY = "RGL material database, isotropic measurement in its adaptive parameterisation"
    REFERENCE = (
        "J. Dupuy, W. Jakob, An adaptive parameterization for efficient material acquisition and rendering, "
        "ACM Trans. Graph. 37(6), 2018, DOI 10.1145/3272127.3275059"
    )
    EXTENSIONS = (".bsdf",)
    PARAMETERS = (
        Parameter("negatives", "", "what negative samples become", "keep", kind="choice", choices=("keep", "zero")),
    )
    WRITE_PARAMETERS = (
        Parameter(
            "max_bytes", "", "size that a material of another parameterisation is fitted to; its error falls with it",
            DEFAULT_BYTES, bounds=(1e4, 2e9), unit="bytes", per_channel=False,
        ),
    )  # fmt: skip
    writable = True

    def sniff(self, head: bytes) -> bool:
        return head.startswith(MAGIC)

    def keeps_every_bit(self, brdf: Brdf) -> bool:
        return isinstance(brdf, VndfWarp)

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file; `negatives`="zero" sets negative samples to 0, the number is in the report.

        Raises `StorageError` if it can't be opened, `FileFormatError` naming file, field and byte offset if it is
        damaged or anisotropic, `LimitError` above `MAX_BYTES`.
        """
        choice = resolve("format 'rgl'", self.PARAMETERS, options)["negatives"]
        data = read_bytes(path, MAX_BYTES)
        return _Reader(path.name, data).table(choice)

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write any material; `InputError` for channels that are no wavelengths, nor R, G, B, nor single.

        One that was read from a file is written byte for byte as it was; of another `vndf_warp` table, what no look-up
        reads is made anew (`fields_of_table`); anything else is fitted, to a file of about `max_bytes` at most.
        """
        chosen = resolve("writing format 'rgl'", self.WRITE_PARAMETERS, options)
        if not isinstance(brdf, VndfWarp):
            brdf = _fitted(brdf, chosen["max_bytes"])
        fields = brdf._auxiliary if brdf._auxiliary is not None else fields_of_table(brdf)
        return write_file(path, encode(fields), self.read)


def _fitted(brdf: Brdf, max_bytes: float) -> VndfWarp:
    """A `VndfWarp` of any material whose channels a file can hold."""
    single = len(brdf.channels) == 1 and brdf.channels.kind != "wavelength"
    if not single:
        check_channels(brdf.channels)
    if brdf.has_delta:
        warnings.warn("an RGL file holds no mirror part: it is left out", LossWarning, stacklevel=4)
    shape = shape_within(max_bytes, 3 if single else len(brdf.channels), file=True)
    nodes = (shape.incidences, shape.samples, shape.azimuths, shape.polar)
    table = VndfWarp.build(brdf, BuildOptions(shape=nodes))
    if single:
        arrays = table.to_arrays()
        arrays["spectra"] = np.repeat(arrays["spectra"], 3, axis=-1)
        three = VndfWarp.from_arrays(arrays, {}, RGB, table.flags)
        three.source, three.metadata = table.source, table.metadata
        table = three
    named = str(brdf.metadata.get("description", "")) or str(table.source.get("name", ""))
    named = named or str(brdf.metadata.get("model", "")) or "a material"
    table.metadata = {**table.metadata, "description": f"{named} (fitted)"}
    return table


class _Reader:
    """One file on its way to a table: each field checked, the report collected."""

    def __init__(self, file: str, data: bytes) -> None:
        self.file = file
        self.container: TensorFile = decode(data, file)
        self.fields: dict[str, Field] = self.container.fields
        self.done: list[str] = []
        self.warnings: list[str] = []
        self.valid: dict[str, int] = {}  # bits of the field valid
        self.size = len(data)
        self.sha256 = hashlib.sha256(data).hexdigest()

    # ---- fields -------------------------------------------------------------------------------

    def fail(self, field: str, reason: str, got: Any, expected: str, at: int | None = None) -> FileFormatError:
        offset = self.fields[field].offset if at is None and field in self.fields else at or 0
        return damaged(self.file, field, offset, reason, got, expected)

    def get(self, name: str, dtype: str, ndim: int) -> npt.NDArray[Any]:
        """A required field of this type and number of dimensions, finite, none of them empty."""
        if name not in self.fields:
            raise self.fail(name, "the field is missing", f"fields {', '.join(self.fields) or 'none'}", name)
        array = self.fields[name].array
        expected = f"{dtype} with {ndim} dimension(s)"
        if array.dtype != np.dtype(dtype) or array.ndim != ndim or array.size == 0:
            raise self.fail(name, "wrong type or shape", f"{array.dtype.name} {array.shape}", expected)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            place = int(np.flatnonzero(~np.isfinite(array))[0])
            value = str(array.reshape(-1)[place])
            at = self.fields[name].offset + place * array.dtype.itemsize
            raise self.fail(name, f"value {place} is not finite", value, "finite values", at)
        return array

    def held(self, name: str, good: npt.NDArray[np.bool_], reason: str, expected: str) -> None:
        """Refuse the field at its first value that is not `good`."""
        if not good.all():
            place = int(np.flatnonzero(~good)[0])
            array = self.fields[name].array
            at = self.fields[name].offset + place * array.dtype.itemsize
            raise self.fail(name, f"value {place} {reason}", float(array.reshape(-1)[place]), expected, at)

    def shaped(self, name: str, array: npt.NDArray[Any], expected: tuple[int | str, ...]) -> None:
        """Refuse shapes other than `expected`, in which letters stand for any length of at least 2."""
        sizes: dict[str, int] = {}
        for n, want in zip(array.shape, expected, strict=True):
            if n != (sizes.setdefault(want, n) if isinstance(want, str) else want) or (isinstance(want, str) and n < 2):
                named = " x ".join(str(w) for w in expected)
                raise self.fail(name, "wrong shape", " x ".join(map(str, array.shape)), f"{named}, letters >= 2")

    # ---- the table ----------------------------------------------------------------------------

    def table(self, negatives: str) -> VndfWarp:
        self._check_version()
        phi_i = self.get("phi_i", "<f4", 1)
        if phi_i.size > 2:
            raise FileFormatError(
                "anisotropic",
                f"{self.file}: phi_i at byte {self.fields['phi_i'].offset}: {phi_i.size} azimuths, so the material is "
                "anisotropic; only isotropic files (at most 2) can be read",
                where=self.file,
                field="phi_i",
                offset=self.fields["phi_i"].offset,
                got=int(phi_i.size),
                expected="at most 2",
            )
        theta_i = self.get("theta_i", "<f4", 1)
        self.shaped("theta_i", theta_i, ("K",))
        self.held("theta_i", (theta_i >= 0) & (theta_i <= THETA_MAX), "is no polar angle", "[0, pi/2]")
        self.held("theta_i", np.diff(theta_i, prepend=-1) > 0, "does not ascend", "ascending angles")
        sigma, ndf = self._profile("sigma"), self._profile("ndf")
        vndf = self.get("vndf", "<f4", 4)
        self.shaped("vndf", vndf, (phi_i.size, theta_i.size, "n_y", "n_x"))
        self.held("vndf", (vndf >= 0).reshape(-1), "is negative", "a density, >= 0")
        name, channels = self._channels()
        values = self.get(name, "<f4", 5)
        self.shaped(name, values, (phi_i.size, theta_i.size, len(channels), "N", "N"))
        self._check_auxiliary(phi_i.size, theta_i.size, values.shape[-1])
        for field, array in (("vndf", vndf), (name, values)):
            if not (array == array[:1]).all():
                raise self.fail(
                    field, "differs between the two azimuths phi_i: anisotropic", "two different slices", "equal slices"
                )
        negative = (values[:1] < 0).sum(axis=(0, 1, 3, 4))
        original = values
        if negatives == "zero" and negative.any():
            values = np.maximum(values, np.float32(0))
            self.done.append(f"{int(negative.sum())} negative samples set to zero, as asked")
        table = self._table(theta_i, sigma, ndf, vndf[0], values[0], channels)
        flags = measured_flags(table) | {"non_negative": bool((values >= 0).all())}  # known, not only sampled
        for flag in FLAGS:
            setattr(table, flag, flags[flag])
        # views into the bytes read: however the fields overlap, no more than the file is held
        table._auxiliary = {n: values if n == name else f.array for n, f in self.fields.items()}
        description = self._description()
        table.metadata = {"description": description}
        table.source = {"name": self.file, "format": "rgl", "sha256": self.sha256}
        table.report = {
            "format": "rgl",
            "file": self.file,
            "sha256": self.sha256,
            "bytes": self.size,
            "conventions": dict(_CONVENTIONS),
            "found": {
                "description": description,
                "channels": channels.to_json(),
                "resolution": {
                    "theta_i": int(theta_i.size),
                    "phi_i": int(phi_i.size),
                    "samples": [int(n) for n in values.shape[3:]],
                    "vndf": [int(n) for n in vndf.shape[2:]],
                    "ndf": int(ndf.size),
                    "sigma": int(sigma.size),
                },
                "theta_i": [float(t) for t in theta_i],
                "angles covered": f"theta_i {np.degrees(float(theta_i[0])):.4g} to "
                f"{np.degrees(float(theta_i[-1])):.4g} degrees; every theta_o and delta_phi",
                "negative": dict(zip(map(str, channels), map(int, negative), strict=True)),
                "samples": int(values[0].size),
                "jacobian": bool(self.fields["jacobian"].array[0]),
                "fields": list(self.fields),
                **({"valid bits": self.valid} if self.valid else {}),
            },
            "done": self.done,
            "warnings": self.warnings,
        }
        before = None if values is original else self._table(theta_i, sigma, ndf, vndf[0], original[0], channels)
        table.report |= measures_of(table, np.moveaxis(original[0], 1, -1), before)
        if negative.any() and negatives == "keep":
            self.warnings.append(
                f"{int(negative.sum())} of {values[0].size} samples are negative (measurement noise); they are kept"
            )
        return table

    def _table(
        self,
        theta_i: npt.NDArray[Any],
        sigma: npt.NDArray[np.float32],
        ndf: npt.NDArray[np.float32],
        vndf: npt.NDArray[Any],
        values: npt.NDArray[Any],
        channels: Channels,
    ) -> VndfWarp:
        jacobian = self.get("jacobian", "u1", 1)
        if jacobian.size != 1 or jacobian[0] > 1:
            raise self.fail("jacobian", "is no flag", jacobian[:8].tolist(), "one byte, 0 or 1")
        if not jacobian[0]:  # the samples then are f_r cos(theta_o) themselves: ndf / (4 sigma) becomes 1
            ndf, sigma = np.ones(2, np.float32), np.full(2, 0.25, np.float32)
        try:
            return VndfWarp.from_densities(
                theta_i=theta_i.astype(np.float32),
                sigma=sigma,
                ndf=ndf,
                vndf=vndf,
                spectra=values,
                channels=channels,
                flags=dict.fromkeys(FLAGS, False),
            )
        except FileFormatError as error:
            field = str(error.context["field"])
            place = {"spectra": self._channels()[0], "warp": "vndf"}.get(field, field)
            raise self.fail(place, "cannot be used", error.context["got"], str(error.context["expected"])) from error

    def _check_version(self) -> None:
        if "version" in self.fields:
            version = self.get("version", "<u4", 1)
            if version[0] != 1:
                raise self.fail("version", "unknown version", version[:4].tolist(), "1.x")
        if self.container.trailing:
            self.warnings.append(f"{self.container.trailing} bytes after the last field were not read")

    def _profile(self, name: str) -> npt.NDArray[np.float32]:
        """sigma or ndf over the polar angle; rows over azimuth have to be equal."""
        array = self.get(name, "<f4", 2)
        self.shaped(name, array, ("rows", "columns"))
        positive = array > 0 if name == "sigma" else array >= 0
        self.held(name, positive.reshape(-1), "is not positive" if name == "sigma" else "is negative", "a density")
        spread = float(np.abs(array - array[:1]).max())
        if spread > _SAME_ROWS * float(array.max()):
            raise self.fail(name, "varies with azimuth: anisotropic", f"a spread of {spread:.3g}", "equal rows")
        return np.asarray(array[0], np.float32)

    def _channels(self) -> tuple[str, Channels]:
        if "wavelengths" not in self.fields:
            return "rgb", RGB
        wavelengths = self.get("wavelengths", "<f4", 1)
        self.held("wavelengths", np.diff(wavelengths, prepend=0) > 0, "does not ascend from 0", "ascending nm > 0")
        return "spectra", Channels([float(w) for w in wavelengths], "wavelength")

    def _check_auxiliary(self, azimuths: int, thetas: int, samples: int) -> None:
        """Fields that no look-up reads: a damaged one means a damaged file."""
        if "luminance" in self.fields:
            luminance = self.get("luminance", "<f4", 4)
            self.shaped("luminance", luminance, (azimuths, thetas, samples, samples))
        if "valid" in self.fields:
            valid = self.get("valid", "u1", 1)
            bits = azimuths * thetas * samples * samples
            if valid.size != -(-bits // 8):
                raise self.fail("valid", "wrong size", f"{valid.size} bytes", f"{-(-bits // 8)}: one bit a sample")
            self.valid = {"set": int(np.unpackbits(valid)[:bits].sum()), "of": bits}

    def _description(self) -> str:
        if "description" not in self.fields:
            return ""
        array = self.fields["description"].array
        if array.dtype != np.uint8 or array.ndim != 1:
            raise self.fail("description", "wrong type or shape", f"{array.dtype.name} {array.shape}", "u1 text")
        return array.tobytes().decode("utf-8", errors="replace").strip("\x00 \n")
