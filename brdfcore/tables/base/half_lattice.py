"""What tables over half/difference coordinates share: the arrays that `kernels.tables.half_difference` reads.

In these coordinates the mirror direction is one face of the lattice, theta_h = 0, so a lobe of any width lies along
an axis (S. Rusinkiewicz, "A new change of variables for efficient BRDF representation", EGWR 1998,
DOI 10.1007/978-3-7091-6453-2_2). How the nodes are found is each representation's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.metrics import ALBEDO_SLACK
from brdfcore.tables.base.half_fit import Fitter
from brdfcore.tables.base.layout import FACTORS, STEPS_Z, Layout
from brdfcore.tables.base.seen import EVERYWHERE, Seen
from brdfcore.tables.base.table import (
    ArrayLookUp,
    BuildOptions,
    Progress,
    Table,
    checked_delta,
    interpolated_delta,
    sampled_delta,
)

#: Largest magnitude of a stored node: below float16's 65,504, so that rounding can't reach infinity.
_LARGEST = 60_000.0
#: Largest node before scaling: its 2^112 part has to stay a float32 (`kernels.tables.half_difference`).
_MOST_NODE = 2.0**24
_ARRAYS: dict[str, npt.DTypeLike] = {
    "values": np.float16,
    "guide_h": np.uint16,
    "guide_d": np.uint16,
    "map_h": np.uint16,
    "map_d": np.uint16,
    "map_p": np.uint16,
}
#: theta_i, degrees, at which a table built from an energy conserving source is checked.
_ENERGY_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0)
#: Bounds of the attributes that are numbers; the guide's exponents stay within float32's.
_NUMBERS = {"scale": (1e-30, 1e30), "guide_low": (-75.0, 75.0), "guide_step": (0.0, 61.0 / 65_535)}


class HalfLattice(Table):
    """f_r = 2^(guide_h(theta_h) + guide_d(theta_d)) K(theta_i, theta_o) values(theta_h, theta_d, phi_d).

    Trilinear in warped coordinates. Arrays: `tables.half_difference`; coordinates, maps and K:
    `kernels.tables.half_difference`.
    """

    _checks_domain = True
    _takes_vectors = True

    def __init__(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        scale: float,
        guide: tuple[float, float],
        factor: str,
        mirror: int,
        channels: Channels,
        flags: Mapping[str, bool],
        delta: npt.NDArray[np.float64] | None = None,
        seen: Seen = EVERYWHERE,
    ) -> None:
        super().__init__(channels, flags)
        self.arrays = {name: np.require(arrays[name], requirements=("C", "A", "W")) for name in _ARRAYS}
        self.scale, self.guide, self.factor, self.mirror, self.delta = scale, guide, factor, mirror, delta
        self.has_delta = delta is not None
        self.seen = seen
        #: phi_d is folded by these; the flags say what holds, the fold what is stored.
        self._reciprocal_fold = self.arrays["map_p"].size - 1 == steps_z(self.bilateral, True)
        self._n_d, self._n_p = (np.int32(n) for n in self.arrays["values"].shape[1:3])
        self._flat = (
            self.arrays["values"].reshape(-1).view(np.int16),
            *(self.arrays[name] for name in ("guide_h", "guide_d", "map_h", "map_d", "map_p")),
        )

    @classmethod
    def largest_gain(cls, interpolation: str, ratio: float) -> float:
        return ratio  # its order is 2/3; on few nodes a lobe that is just resolved gains more

    @staticmethod
    def _module() -> tuple[Any, Any]:
        """The kernels' module, and what makes their constants."""
        from brdfcore.kernels.tables import half_difference

        return half_difference, half_difference.table_scale

    @cached_property
    def _scales(self) -> dict[np.dtype[Any], Any]:

        shape, factor, make = self.arrays["values"].shape[:3], FACTORS[self.factor], self._module()[1]
        return {
            np.dtype(t): make(shape, STEPS_Z, self.guide, factor, self.mirror, 1 / self.scale, self.bilateral, t)
            for t in (np.float32, np.float64)
        }

    @cached_property
    def _kernels(self) -> tuple[Any, Any]:
        """From angles, from vectors."""
        kernels = self._module()[0]
        one, three = (kernels.angles_one, kernels.vectors_one), (kernels.angles_three, kernels.vectors_three)
        return {1: one, 3: three}.get(len(self.channels), (kernels.angles_many, kernels.vectors_many))

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        outside = self._kernels[0](
            theta_i.size, theta_i, theta_o, delta_phi, *self._flat, out.reshape(-1), self._scales[theta_i.dtype],
            self.bilateral, self._reciprocal_fold, self._n_d, self._n_p,
        )  # fmt: skip
        return bool(outside == 0)

    def _evaluate_raw_vectors(self, wi: FloatArray, wo: FloatArray, out: FloatArray) -> bool:
        outside = self._kernels[1](
            len(wi), wi.reshape(-1), wo.reshape(-1), *self._flat, out.reshape(-1), self._scales[wi.dtype],
            self.bilateral, self._reciprocal_fold, self._n_d, self._n_p,
        )  # fmt: skip
        return bool(outside == 0)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return self.seen.status(theta_i, theta_o)

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if self.delta is None:
            return super()._delta_reflectance(theta_i)
        return interpolated_delta(self.delta, theta_i)

    # ---- build --------------------------------------------------------------------------------

    @classmethod
    def fitted(
        cls,
        source: Brdf,
        options: BuildOptions,
        fitter: Fitter,
        layout: Layout,
        shape: Sequence[int],
        bilateral: bool,
        reciprocal: bool,
        progress: Progress | None,
    ) -> Self:
        """A table of this shape, its nodes fitted to `source`; `reciprocal`: folded so."""
        told = None if progress is None else lambda done, total: progress(done, total, "fitting the nodes")
        nodes = fitter.nodes(layout, (shape[0], shape[1], shape[2]), told)
        done = [f"averaged over the {name} symmetry, as asked" for name in sorted(options.fold)]
        negative = int((nodes < 0).sum())
        if negative and (options.negatives == "zero" or source.non_negative):
            nodes = np.maximum(nodes, 0)  # a fit may dip below a source that does not
            if not source.non_negative:
                done.append(f"{negative} negative nodes set to zero, as asked")
        arrays, scale, guide = lattice_arrays(nodes, layout)
        flags = {
            "bilateral": bilateral,
            "reciprocal": reciprocal and layout.factor in ("sum", "both", "none"),
            "energy_conserving": source.energy_conserving,
            "non_negative": bool((arrays["values"] >= 0).all()),
        }
        table = cls(
            arrays,
            scale,
            guide,
            layout.factor,
            layout.mirror,
            source.channels,
            flags,
            sampled_delta(source),
            options.seen,
        )
        if flags["energy_conserving"]:
            table.energy_conserving = bool((table.albedo(np.radians(_ENERGY_ANGLES)) <= 1 + ALBEDO_SLACK).all())
        table.source = dict(getattr(source, "source", {}) or {"name": "", "format": "", "sha256": ""})
        table.report = {**source.report, "done": [*source.report.get("done", []), *done]}
        return table

    # ---- arrays -------------------------------------------------------------------------------

    def array_look_up(self) -> ArrayLookUp:
        from brdfcore.kernels.tables import half_difference_arrays
        from brdfcore.kernels.tables.half_difference import SHORT, WORDS

        kernels, (low, step) = self._module()[0], self.guide
        nodes = {"values": self.arrays["values"].astype(np.float64) / self.scale}
        nodes["guide_h"] = self.arrays["guide_h"] * step + low
        nodes["guide_d"] = self.arrays["guide_d"] * step
        for name, n in zip(("map_h", "map_d", "map_p"), self.arrays["values"].shape):
            nodes[name] = self.arrays[name] * ((n - 1) / WORDS)
        settings = half_difference_arrays.HalfSettings(
            lobe=kernels.__name__.endswith("lobe_grid"),
            centre=int(self.mirror),
            octaves_u=(kernels.FIRST_U, kernels.LAST_U, kernels.STEPS_U),
            octaves_w=(kernels.FIRST_W, kernels.LAST_W, kernels.STEPS_W),
            steps_z=STEPS_Z * SHORT,
            factor=tuple(map(float, FACTORS[self.factor])),
            bilateral=self.bilateral,
            reciprocal=self._reciprocal_fold,
        )
        return ArrayLookUp(half_difference_arrays, nodes, settings)

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        return self.arrays if self.delta is None else {**self.arrays, "delta": self.delta}

    def attributes(self) -> dict[str, Any]:
        low, step = self.guide
        numbers = {"scale": self.scale, "guide_low": low, "guide_step": step}
        return {**numbers, "factor": self.factor, **self._kind(), **self.seen.attributes()}

    def _kind(self) -> dict[str, Any]:
        """The attribute that says what u is."""
        return {"mirror": self.mirror}

    @classmethod
    def _read_kind(cls, attributes: Mapping[str, Any]) -> int:
        mirror = attributes.get("mirror")
        if not isinstance(mirror, bool):
            raise cls._bad("mirror", repr(mirror)[:40], "true or false")
        return mirror

    @classmethod
    def _steps_z(cls, bilateral: bool) -> set[int]:
        """Steps of the map of z that such a table may have."""
        return {steps_z(bilateral, r) for r in ((True, False) if bilateral else (False,))}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        kernels = cls._module()[0]
        folds = {steps + 1 for steps in cls._steps_z(bool(flags["bilateral"]))}
        sizes = {"map_h": {kernels.grid_u().size}, "map_d": {kernels.grid_w().size}, "map_p": folds}
        sizes |= {"guide_h": sizes["map_h"], "guide_d": sizes["map_d"]}
        for name, dtype in _ARRAYS.items():
            array, ndim = arrays.get(name), 4 if name == "values" else 1
            if array is None or array.dtype != dtype or array.ndim != ndim:
                got = "nothing" if array is None else f"{array.dtype} {array.shape}"
                raise cls._bad(name, got, f"{np.dtype(dtype)} with {ndim} dimension(s)")
            # any word is a node position within the table: no look-up can leave it
            if name in sizes and array.size not in sizes[name]:
                raise cls._bad(name, str(array.shape), f"a length in {sorted(sizes[name])}")
        values = arrays["values"]
        if not np.isfinite(values).all():
            raise cls._bad("values", "not finite everywhere", "finite numbers")
        if min(values.shape[:3]) < 3 or values.shape[3] != len(channels) or values.size >= 2**31:
            raise cls._bad("values", str(values.shape), f"at least 3 nodes an axis, {len(channels)} channel(s)")
        if flags["non_negative"] and values.min() < 0:
            raise cls._bad("values", f"as low as {values.min()}", "no value below 0, as the flag non_negative says")
        delta = checked_delta(cls.name, arrays, len(channels))
        numbers = {}
        for name, (least, most) in _NUMBERS.items():
            number = attributes.get(name)
            if not isinstance(number, (int, float)) or not least < number < most:
                raise cls._bad(name, repr(number)[:40], f"a number between {least:g} and {most:g}")
            numbers[name] = float(number)
        factor = attributes.get("factor")
        if factor not in FACTORS:
            raise cls._bad("factor", repr(factor)[:40], ", ".join(FACTORS))
        mirror = cls._read_kind(attributes)
        guide = (numbers["guide_low"], numbers["guide_step"])
        seen = Seen.from_attributes(cls.name, attributes)
        return cls(arrays, numbers["scale"], guide, str(factor), mirror, channels, flags, delta, seen)

    @classmethod
    def _bad(cls, field: str, got: str, expected: str) -> FileFormatError:
        return FileFormatError(
            "bad_field", f"{cls.name}: {field} is {got}; expected {expected}", where=field, got=got, expected=expected
        )


def check_linear(name: str, interpolation: str) -> None:
    if interpolation != "linear":
        raise InputError(
            "bad_option",
            f"interpolation = {interpolation!r}: {name} offers 'linear'",
            where="interpolation",
            got=interpolation,
            expected="linear",
        )


def check_shape(shape: Sequence[int], axes: str, channels: int) -> None:
    if len(shape) != 3 or min(shape) < 3 or np.prod([float(n) for n in shape]) * channels >= 2**31:
        raise InputError(
            "bad_shape",
            f"shape = {list(shape)}: expected 3 numbers of nodes ({axes}), each at least 3, "
            "with fewer than 2^31 values in all",
            where="shape",
            got=list(shape),
            expected="3 whole numbers >= 3",
        )


def lattice_arrays(
    nodes: npt.NDArray[np.float64], layout: Layout
) -> tuple[dict[str, npt.NDArray[Any]], float, tuple[float, float]]:
    """(arrays, scale, guide) of nodes (n_h, n_d, n_p, channels) placed by `layout`."""
    words, low, step = layout.words()
    size = float(np.abs(nodes).max())
    if size > _MOST_NODE:  # a float32 look-up has no room for it in the nodes' factor: it goes into the guide
        octaves = float(np.floor(np.log2(size)))
        nodes, low, size = nodes * 2.0**-octaves, low + octaves, size * 2.0**-octaves
    scale = _LARGEST / max(size, 1e-300)
    return {"values": (nodes * scale).astype(np.float16), **words}, scale, (low, step)


def steps_z(bilateral: bool, reciprocal: bool) -> int:
    """Steps of the map of z."""

    return STEPS_Z * (1 if reciprocal else 2) * (1 if bilateral else 2)
