"""f_r as averages over patches of directions: what a Klems matrix or a tensor tree of WINDOW and Radiance holds.

A step function, as these programs read it: constant within a patch, no interpolation. A patch of a Klems matrix is ten
degrees wide, so this is for exchange; render with another representation of the material that it was made from.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter
from brdfcore.base.status import Status
from brdfcore.tables.base.sampled import bad_field
from brdfcore.tables.base.table import BuildOptions, Progress, Table

Float64Array = npt.NDArray[np.float64]

COORDINATES = ("rings", "disk")
_MOST_VALUES = 2**31 - 1
#: Directions evaluated at a time: bounds the memory.
_CHUNK = 262_144
#: A projected length this close below a patch's edge belongs to the next: rounding of sin and cos.
_EDGE = 1e-12


class PatchGrid(Table):
    """f_r constant within patches, in one of two coordinates.

    rings  theta_i and theta_o by rings, whose edges are given, delta_phi by even cells: bilateral over [0, pi], else
           over [0, 2 pi). values (I, O, D, C), theta_i (I + 1,), theta_o (O + 1,) rad, from 0 to pi/2.
    disk   sin(theta_i) by even cells of [0, 1]; wo by even cells of the square that Shirley and Chiu map, area for
           area, onto the disk of projected directions, turned so that the mirror direction lies on the square's axis
           x: values (I, X, Y, C).

    Arrays: values float64; theta_i, theta_o float64 with coordinates="rings".
    """

    name = "patch_grid"
    SUMMARY = "averages over patches of directions, a step function: Klems matrices and tensor trees"
    PARAMETERS = (
        Parameter("interpolation", "", "none: constant within a patch", "nearest", kind="choice", choices=("nearest",)),
    )
    #: For files: a step function is never the best table.
    FOR_AUTO: ClassVar[bool] = False

    def __init__(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        channels: Channels,
        flags: Mapping[str, bool],
        coordinates: str,
    ) -> None:
        super().__init__(channels, flags)
        self.values = arrays["values"]
        self.theta_i, self.theta_o = arrays.get("theta_i"), arrays.get("theta_o")
        self.coordinates = coordinates

    # ---- look-up ------------------------------------------------------------------------------

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        flat = self.values.reshape(-1, self.values.shape[3])
        for start in range(0, theta_i.size, _CHUNK):
            piece = slice(start, start + _CHUNK)
            i, o = (np.minimum(a[piece].astype(np.float64), HALF_PI) for a in (theta_i, theta_o))
            out[piece] = flat[self._patch(i, o, delta_phi[piece].astype(np.float64))]
        return True

    def _patch(self, theta_i: Float64Array, theta_o: Float64Array, delta_phi: Float64Array) -> npt.NDArray[np.int64]:
        """Index of the patch of each pair among all, in C order."""
        _, n, m, _ = self.values.shape
        if self.theta_i is None or self.theta_o is None:
            i = _cell(np.sin(theta_i), self.values.shape[0])
            x, y = square(np.sin(theta_o), delta_phi)
            return np.asarray((i * n + _cell(x, n)) * m + _cell(y, m))
        i, o = _ring(theta_i, self.theta_i), _ring(theta_o, self.theta_o)
        turn = np.abs(delta_phi)
        turn = np.where(turn > 2 * np.pi, turn - 2 * np.pi, turn)
        if self.bilateral:
            share = np.where(turn > np.pi, 2 * np.pi - turn, turn) / np.pi
        else:
            share = np.where(delta_phi < 0, 2 * np.pi - turn, turn) / (2 * np.pi)
        d = _cell(share, m) if self.bilateral else np.floor(share * m + _EDGE).astype(np.int64) % m
        return np.asarray((i * n + o) * m + d)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        # an average over a patch is the source's own number nowhere in particular
        return np.full(theta_i.shape, Status.INTERPOLATED, np.uint8)

    # ---- making one ---------------------------------------------------------------------------

    @classmethod
    def can_hold(cls, source: Brdf) -> bool:
        return isinstance(source, cls)

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """A patch grid's own patches: nothing else is made one here, but by the writer of a format that needs it."""
        if not isinstance(source, cls) or options.interpolation not in ("nearest", "linear") or options.shape:
            what = "interpolation" if options.interpolation not in ("nearest", "linear") else "representation"
            raise InputError(
                "not_patches",
                "patch_grid is what files of patch averages are read to; tabulate the material as another "
                "representation, or write it as such a file and read that",
                where=what,
                got=getattr(source, "name", type(source).__name__),
                expected="a patch_grid",
            )
        made = cls(source.to_arrays(), source.channels, source.flags, source.coordinates)
        made.source, made.report = dict(source.source), dict(source.report)
        return made

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        return (options,)

    # ---- arrays -------------------------------------------------------------------------------

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        arrays: dict[str, npt.NDArray[Any]] = {"values": self.values}
        if self.theta_i is not None and self.theta_o is not None:
            arrays |= {"theta_i": self.theta_i, "theta_o": self.theta_o}
        return arrays

    def attributes(self) -> dict[str, Any]:
        return {"coordinates": self.coordinates}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        coordinates = attributes.get("coordinates")
        if not isinstance(coordinates, str) or coordinates not in COORDINATES:
            raise bad_field(cls.name, "coordinates", repr(coordinates)[:40], " or ".join(COORDINATES))
        values = arrays.get("values")
        if values is None or values.dtype != np.float64 or values.ndim != 4 or 0 in values.shape:
            got = "nothing" if values is None else f"{values.dtype} {values.shape}"
            raise bad_field(cls.name, "values", got, "float64 with 4 dimensions")
        if values.shape[3] != len(channels) or values.size > _MOST_VALUES or not np.isfinite(values).all():
            raise bad_field(cls.name, "values", str(values.shape), f"finite values of {len(channels)} channel(s)")
        for axis, name in enumerate(("theta_i", "theta_o")):
            edges = arrays.get(name)
            if coordinates == "disk":
                if edges is not None:
                    raise bad_field(cls.name, name, "edges of rings", "none with coordinates='disk'")
                continue
            if edges is None or edges.dtype != np.float64 or edges.shape != (values.shape[axis] + 1,):
                raise bad_field(cls.name, name, "missing, or of another size", f"float64 ({values.shape[axis] + 1},)")
            if edges[0] != 0 or edges[-1] > HALF_PI or not (np.diff(edges) > 0).all():
                raise bad_field(cls.name, name, str(edges[:8].tolist())[:80], "ascending edges from 0 to pi/2")
        if flags["non_negative"] and values.min() < 0:
            raise bad_field(cls.name, "values", f"as low as {values.min()}", "none below 0, as non_negative says")
        return cls(arrays, channels, flags, coordinates)


def square(rho: Float64Array, delta_phi: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Place in the unit square of projected directions: length `rho` in [0, 1], the mirror direction at azimuth 0.

    P. Shirley and K. Chiu, A low distortion map between disk and square, Journal of Graphics Tools 2(3), 1997: a wedge
    of a quarter turn about an axis becomes a triangle, the length its height and the azimuth the place across.
    """
    azimuth = delta_phi - np.pi
    azimuth = azimuth - 2 * np.pi * np.floor((azimuth + np.pi / 4) / (2 * np.pi))  # from -pi/4 to 7 pi/4
    wedge = np.minimum(np.floor((azimuth + np.pi / 4) / (np.pi / 2)), 3)
    across = rho * (azimuth - wedge * (np.pi / 2)) / (np.pi / 4)
    a = np.choose(wedge.astype(np.int64), [rho, -across, -rho, across])
    b = np.choose(wedge.astype(np.int64), [across, rho, -across, -rho])
    return 0.5 * (a + 1), 0.5 * (b + 1)


def disk(x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
    """The inverse of `square`: (rho, delta_phi in [0, 2 pi))."""
    a, b = 2 * x - 1, 2 * y - 1
    upright = np.abs(a) >= np.abs(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        low = np.where(a >= 0, 0.0, np.pi) + np.pi / 4 * b / a
        high = np.where(b >= 0, 0.5, 1.5) * np.pi - np.pi / 4 * a / b
    rho = np.where(upright, np.abs(a), np.abs(b))
    azimuth = np.where(rho > 0, np.where(upright, low, high), 0.0)
    return rho, np.mod(azimuth + np.pi, 2 * np.pi)


def _cell(x: Float64Array, count: int) -> npt.NDArray[np.int64]:
    return np.clip(np.floor(x * count + _EDGE), 0, count - 1).astype(np.int64)


def _ring(theta: Float64Array, edges: Float64Array) -> npt.NDArray[np.int64]:
    return np.clip(np.searchsorted(edges, theta, side="right") - 1, 0, edges.size - 2)
