"""A measured material in the parameterisation it was measured in: half vectors spread by a visible-normal warp.

J. Dupuy, W. Jakob, "An adaptive parameterization for efficient material acquisition and rendering", ACM Trans.
Graph. 37(6), 2018, DOI 10.1145/3272127.3275059: the sample grid is dense where the material's own distribution of
visible normals is, so that 32 x 32 samples hold a lobe of any width without a visible error. Most of a file's arrays is
the density itself, which is smooth: at a quarter of its nodes an error of some thousandths is left.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, THETA_MAX, FloatArray
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.parameters import Parameter
from brdfcore.base.status import Status
from brdfcore.metrics import measured_flags
from brdfcore.tables.base.table import ArrayLookUp, BuildOptions, Progress, Table
from brdfcore.tables.vndf_warp.fit import checked_shape, fit, shape_within

Float32Array = npt.NDArray[np.float32]

#: Largest f_r cos(theta_o) of a table: divided by the horizon's cosine, 6e-17, it stays below float32's largest number.
MAX_VALUE = 1e21
#: Bytes, as an RGL file, of what a material in another parameterisation is fitted to where nothing is said; and those
#: of the tables that a tolerance tries.
DEFAULT_BYTES, FITTED_BYTES = 2e6, tuple(125e3 * 2**k for k in range(8))
#: Shares of the file's nodes of the visible normals' density, along azimuth and polar angle, that `candidates` tries.
THINNED = ((0.25, 0.5), (1 / 3, 0.5), (0.5, 0.5), (0.5, 1.0), (1.0, 1.0))
#: Nodes of theta_i are float32: a last node this close below pi/2 is pi/2.
_LAST_NODE_SLACK = 4 * 2.0**-23


class VndfWarp(Table):
    """f_r in the adaptive parameterisation of Dupuy and Jakob (2018), isotropic.

    Formula, with h the half vector, phi_h its azimuth from wi, u(theta) = sqrt(2 theta / pi) and
    u(phi) = (phi + pi) / (2 pi):

        f_r = spectra(s; theta_i) ndf(u(theta_h)) / (4 sigma(u(theta_i)) cos(theta_o))

    s, a point of the unit square, is (u(theta_h), u(phi_h)) mapped through the cumulative density of visible
    normals at theta_i: across azimuths the marginal, along the polar angle the conditional distribution of the
    bilinear density, normalised. Tables are bilinear in their own coordinates and linear between theta_i nodes.

    theta_i is the tabulated direction: wi, the light; theta_o is wo, the viewer. (Evaluated by the published
    renderers with their `wi`, the direction towards the camera, as the tabulated one: measured materials are not
    reciprocal, so exchanging the two changes values by several percent.) Beyond the first and last theta_i node
    the nearest slice is continued, `status` says extrapolated; sigma still follows theta_i.

    Horizon: the source states f_r cos(theta_o), which measurements do not bring to 0 at theta_o = pi/2, so f_r
    grows like 1 / cos(theta_o) and at pi/2 is the finite quotient by cos(pi/2) = 6.1e-17 of float64. The product
    f_r cos(theta_o) is right everywhere, and that is what light is multiplied with. At theta_i = pi/2 sigma and
    spectra are their last nodes.

    Arrays (float32 unless said), K nodes of theta_i, N samples an axis, C channels, n_y, n_x nodes of phi_h, theta_h:

        spectra      (K, N, N, C)      1; rows follow phi_h, columns theta_h
        theta_i      (K,)              radians, ascending
        theta_index  (G,) int32        slice of uniform steps of theta_i
        sigma, ndf   (n,)              projected area; distribution of normals, 1/sr
        warp         (K, n_y, n_x, 2)  density of visible normals, its integral along theta_h
        rows         (K, n_y, 2)       that integral over the whole row, and its integral along phi_h

    Look-ups run in the type of the angles. Against float64 sums the float32 storage costs 1e-8 (median).
    """

    name = "vndf_warp"
    SUMMARY = "the adaptive parameterisation of the RGL material database: exact for its files, fitted to others"
    PARAMETERS = (
        Parameter(
            "shape", "", "of an RGL file: nodes of the visible normals' density, at most the file's; of any other "
            "source: theta_i, samples an axis, and these", "", kind="text",
        ),
    )  # fmt: skip
    STEP = 0.0
    OFF_BY_HALF_VECTOR = True
    _checks_domain = True

    def __init__(self, arrays: Mapping[str, npt.NDArray[Any]], channels: Channels, flags: Mapping[str, bool]) -> None:
        """`arrays` as listed above; raises `FileFormatError` where they do not fit together."""
        super().__init__(channels, flags)
        checked = _checked(arrays, len(channels))
        self._arrays = checked
        #: What a file held beside the table, so that it can be written again; not stored, not part of the id.
        self._auxiliary: dict[str, npt.NDArray[Any]] | None = None
        names = ("spectra", "theta_i", "theta_index", "sigma", "ndf", "warp", "rows")
        self._flat = tuple(checked[n].reshape(-1) for n in names)
        self._last_theta_i = float(checked["theta_i"][-1])

    @classmethod
    def from_densities(
        cls,
        *,
        theta_i: Float32Array,
        sigma: Float32Array,
        ndf: Float32Array,
        vndf: Float32Array,
        spectra: Float32Array,
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        """From what a file tabulates: theta_i (K,), sigma (n,), ndf (m,), vndf (K, n_y, n_x), spectra (K, C, N, N).

        The density of visible normals is integrated by the trapezoidal rule, exact for a bilinear density, in
        float64, and normalised slice by slice. Raises `FileFormatError` (context `field`) as `from_arrays`, and for
        a slice without any visible normal.
        """
        density = vndf.astype(np.float64)
        along = _integral(density, axis=2)
        across = _integral(along[:, :, -1], axis=1)
        total = across[:, -1]
        if not (total > 0).all():
            raise _bad("vndf", f"an integral of 0 at theta_i node {int(np.argmin(total))}", "visible normals at each")
        warp = np.stack([density, along], axis=-1) / total[:, None, None, None]
        rows = np.stack([along[:, :, -1], across], axis=-1) / total[:, None, None]
        arrays = {
            "spectra": np.ascontiguousarray(np.moveaxis(spectra, 1, -1), np.float32),
            "theta_i": theta_i,
            "sigma": sigma,
            "ndf": ndf,
            "warp": warp.astype(np.float32),
            "rows": rows.astype(np.float32),
        }
        return cls(arrays, channels, flags)

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        return dict(self._arrays)

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        return cls(arrays, channels, flags)

    @classmethod
    def can_hold(cls, source: Brdf) -> bool:
        """Whether "auto" considers it: what already is in this parameterisation. `build` fits any other as well."""
        return isinstance(source, VndfWarp)

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """`source` itself as a new table; negatives="zero" sets negative samples to 0.

        Exactly, unless a shape (n_y, n_x) asks for fewer nodes of the density of visible normals: `thinned`. A source
        in another parameterisation is fitted (`tables.vndf_warp.fit`), shape (theta_i, samples) or with (n_y, n_x)
        after them; default: about 2 MB as an RGL file.
        """
        if options.fold or options.interpolation != "linear":
            raise InputError(
                "bad_option",
                "vndf_warp keeps the file's own samples: it takes no fold and no other interpolation",
                where="fold" if options.fold else "interpolation",
            )
        if not isinstance(source, VndfWarp):
            return cls._fitted(source, options, progress)
        arrays, flags, done = source.to_arrays(), source.flags, list(source.report.get("done", []))
        if options.shape is not None:
            most = arrays["warp"].shape[1:3]
            if len(options.shape) != 2 or not all(2 <= n <= m for n, m in zip(options.shape, most)):
                raise InputError(
                    "bad_shape",
                    f"shape = {list(options.shape)}: expected 2 numbers of nodes of the density of visible normals "
                    f"(azimuth, polar angle), from 2 to the file's own {list(most)}",
                    where="shape",
                    got=list(options.shape),
                    expected=f"2 whole numbers, up to {list(most)}",
                )
            if options.shape != most:
                arrays |= thinned(arrays["warp"], arrays["rows"], (options.shape[0], options.shape[1]))
                done.append(f"density of visible normals at {list(options.shape)} of the file's {list(most)} nodes")
        negative = int((arrays["spectra"] < 0).sum())
        if options.negatives == "zero" and negative:
            arrays["spectra"] = np.maximum(arrays["spectra"], np.float32(0))
            flags["non_negative"] = True
            done.append(f"{negative} negative samples set to zero, as asked")
        table = cls(arrays, source.channels, flags)
        table.source, table.report = dict(source.source), {**source.report, "done": done}
        table.metadata = dict(source.metadata)
        return table

    @classmethod
    def _fitted(cls, source: Brdf, options: BuildOptions, progress: Progress | None) -> Self:
        count = len(source.channels)
        if options.shape is None:
            shape = shape_within(DEFAULT_BYTES, max(count, 3), file=True)  # one channel is written as three
        else:
            shape = checked_shape(options.shape, count)
        if progress is not None:
            progress(0, 1, "fitting the warp")
        made = fit(source, shape)
        done = []
        negative = int((made["spectra"] < 0).sum())
        if options.negatives == "zero" and negative:
            made["spectra"] = np.maximum(made["spectra"], np.float32(0))
            done.append(f"{negative} negative samples set to zero, as asked")
        try:
            table = cls.from_densities(**made, channels=source.channels, flags=dict.fromkeys(FLAGS, False))
        except FileFormatError as error:
            raise InputError("source_not_held", f"vndf_warp: {error.detail}", where="source") from error
        flags = measured_flags(table) | {"non_negative": bool((made["spectra"] >= 0).all())}
        for flag in FLAGS:
            setattr(table, flag, flags[flag])
        table.source = dict(getattr(source, "source", {}) or {})
        table.metadata = dict(source.metadata)
        table.report = {"done": done}
        if progress is not None:
            progress(1, 1, "fitting the warp")
        return table

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        """Fewer nodes of the density of visible normals, down to a quarter by a half; and all of them.

        Of a source in another parameterisation: steps of about twice the bytes.
        """
        if options.fold or options.interpolation != "linear":
            return []
        if not isinstance(source, VndfWarp):
            sizes = FITTED_BYTES if max_bytes is None else (max_bytes,)
            found = []
            for size in sizes:
                s = shape_within(size, len(source.channels), file=False)
                of_shape = (s.incidences, s.samples, s.azimuths, s.polar)
                found.append(replace(options, shape=of_shape, nbytes=s.table_bytes(len(source.channels))))
            return found
        arrays = source.to_arrays()
        _, n_y, n_x, _ = arrays["warp"].shape
        found = []
        for y, x in THINNED:
            shape = (max(2, round(n_y * y)), max(2, round(n_x * x)))
            left = arrays["warp"].nbytes * (1 - shape[0] * shape[1] / (n_y * n_x))
            left += arrays["rows"].nbytes * (1 - shape[0] / n_y)
            whole = shape == (n_y, n_x)
            found.append(replace(options, shape=None if whole else shape, nbytes=round(source.nbytes - left)))
        fitting = [o for o in found if max_bytes is None or o.nbytes <= max_bytes]
        return fitting if max_bytes is None else fitting[-1:] or found[:1]

    @property
    def incidence_knots(self) -> Float32Array:
        """theta_i between which it is all but linear, radians."""
        return self._arrays["theta_i"]

    @cached_property
    def _scales(self) -> dict[np.dtype[Any], Any]:
        from brdfcore.kernels.tables.warp import warp_scale

        a = self._arrays
        slices, n_y, n_x, _ = a["warp"].shape
        sizes = (slices, (n_y, n_x), a["spectra"].shape[1], a["sigma"].size, a["ndf"].size, a["theta_index"].size)
        return {np.dtype(t): warp_scale(*sizes, t) for t in (np.float32, np.float64)}

    @cached_property
    def _kernel(self) -> Any:
        from brdfcore.kernels.tables import warp

        return warp.warp_rgb if len(self.channels) == 3 else warp.warp_many

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        scale = self._scales[theta_i.dtype]
        outside = self._kernel(theta_i.size, theta_i, theta_o, delta_phi, *self._flat, out.reshape(-1), scale)
        return bool(outside == 0)

    def array_look_up(self) -> ArrayLookUp:
        from brdfcore.kernels.tables import warp_arrays

        return ArrayLookUp(warp_arrays, dict(self._arrays), None)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        """Interpolated between the theta_i nodes, extrapolated beyond the first and the last."""
        first, last = float(self._arrays["theta_i"][0]), self._last_theta_i
        if last > HALF_PI - _LAST_NODE_SLACK:
            last = THETA_MAX
        beyond = (theta_i < first) | (theta_i > last)
        return np.where(beyond, np.uint8(Status.EXTRAPOLATED), np.uint8(Status.INTERPOLATED))


def thinned(warp: Float32Array, rows: Float32Array, shape: tuple[int, int]) -> dict[str, Float32Array]:
    """`warp` and `rows` at fewer nodes, (n_y, n_x), uniform again.

    The integrals at the new nodes are those of the density at all nodes, not of what is left of it: a half vector there
    keeps its place among the samples, and between two nodes moves by the second difference of the density.
    """
    density, along = (warp[..., k].astype(np.float64) for k in (0, 1))
    whole, across = (rows[..., k].astype(np.float64) for k in (0, 1))
    n_y, n_x = density.shape[1:]
    (i, v), (j, u) = (_between(n, last) for n, last in zip(shape, (n_y, n_x)))
    left, right = density[:, :, j], density[:, :, j + 1]
    values = left + (right - left) * u
    sums = along[:, :, j] + u * (left + 0.5 * u * (right - left)) / (n_x - 1)
    found = [x[:, i] + (x[:, i + 1] - x[:, i]) * v[:, None] for x in (values, sums)]
    low, high = whole[:, i], whole[:, i + 1]
    lines = [low + (high - low) * v, across[:, i] + v * (low + 0.5 * v * (high - low)) / (n_y - 1)]
    return {
        "warp": np.stack(found, axis=-1).astype(np.float32),
        "rows": np.stack(lines, axis=-1).astype(np.float32),
    }


def _between(n: int, nodes: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float64]]:
    """Cell and position in it of n uniform places over `nodes` uniform nodes, both ends included."""
    place = np.linspace(0, nodes - 1, n)
    cell = np.minimum(place.astype(np.intp), nodes - 2)
    return cell, place - cell


def _integral(density: npt.NDArray[np.float64], axis: int) -> npt.NDArray[np.float64]:
    """Running trapezoidal integral over [0, 1] along an axis, 0 at its first node."""
    low, high = (np.take(density, np.arange(density.shape[axis] - 1) + k, axis) for k in (0, 1))
    steps = np.cumsum(0.5 * (low + high) / (density.shape[axis] - 1), axis=axis)
    return np.concatenate([np.zeros_like(np.take(steps, [0], axis)), steps], axis=axis)


def _bad(field: str, got: str, expected: str) -> FileFormatError:
    return FileFormatError(
        "damaged_table",
        f"{field}: got {got}, expected {expected}",
        field=field,
        where=field,
        got=got,
        expected=expected,
    )


def _checked(arrays: Mapping[str, npt.NDArray[Any]], channels: int) -> dict[str, npt.NDArray[Any]]:
    """The arrays, contiguous, with shapes, ranges and `theta_index` checked: no look-up can leave them."""
    from brdfcore.kernels.tables.warp import theta_index

    dimensions = {"spectra": 4, "theta_i": 1, "sigma": 1, "ndf": 1, "warp": 4, "rows": 3}
    found: dict[str, npt.NDArray[Any]] = {}
    for name, ndim in dimensions.items():
        array = arrays.get(name)
        if array is None or array.dtype != np.float32 or array.ndim != ndim:
            got = "nothing" if array is None else f"{array.dtype} with {array.ndim} dimension(s)"
            raise _bad(name, got, f"float32 with {ndim} dimension(s)")
        if not np.isfinite(array).all():
            raise _bad(name, "a value that is not finite", "finite values")
        found[name] = np.require(array, requirements=("C", "A", "W"))  # as in conventions.flatten_angles
    slices, samples = found["spectra"].shape[:2]
    n_y, n_x = found["warp"].shape[1:3]
    shapes = {
        "theta_i": (slices,),
        "spectra": (slices, samples, samples, channels),
        "warp": (slices, n_y, n_x, 2),
        "rows": (slices, n_y, 2),
    }
    for name, shape in shapes.items():
        if found[name].shape != shape:
            raise _bad(name, str(found[name].shape), str(shape))
    sizes = {"theta_i": slices, "spectra": samples, "warp": min(n_y, n_x)}
    sizes |= {name: found[name].size for name in ("sigma", "ndf")}
    for name, size in sizes.items():
        if size < 2:
            raise _bad(name, f"{size} node(s) along an axis", "at least 2")
    nodes = found["theta_i"]
    if not ((np.diff(nodes) > 0).all() and nodes[0] >= 0 and nodes[-1] <= THETA_MAX):
        raise _bad("theta_i", str(nodes[:8].tolist()), "ascending angles in [0, pi/2]")
    if not (found["sigma"] > 0).all():
        raise _bad("sigma", f"{found['sigma'].min()}", "values > 0: it divides")
    for name in ("ndf", "warp", "rows"):
        if not (found[name] >= 0).all():
            raise _bad(name, f"{found[name].min()}", "a density, >= 0")
    largest = float(np.abs(found["spectra"]).max()) * float(found["ndf"].max()) / (4 * float(found["sigma"].min()))
    if largest > MAX_VALUE:
        raise _bad("spectra", f"f_r cos(theta_o) up to {largest:.3g}/sr", f"at most {MAX_VALUE:g}/sr")
    index = theta_index(nodes)
    if index is None:
        raise _bad("theta_i", f"nodes {float(np.diff(nodes).min()):.3g} rad apart", "at least 2.4e-5 rad apart")
    given = arrays.get("theta_index")
    if given is not None and not (given.dtype == np.int32 and np.array_equal(given, index)):
        raise _bad("theta_index", "other slices", "those of theta_i")
    found["theta_index"] = index
    return found
