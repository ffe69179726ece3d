"""The representation in spherical harmonics: coefficients rho_ll'm of f_r, or of f_r times cosines.

    f = sum_(m>=0) (2-d_m0) sum_(l,l'>=m) rho_ll'm p_l^m(c_i) p_l'^m(c_o) cos(m delta_phi) / (c_i c_o)

for the target f_cos_cos, whose l+m and l'+m are odd; other targets, extensions and parities: `harmonics.targets`.
Without bilateral symmetry sines follow. Normalisation and signs are those of `harmonics.legendre`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels
from brdfcore.base.conventions import HALF_PI, FloatArray, check_domain, flatten_angles
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.status import Status
from brdfcore.harmonics.factors import Order
from brdfcore.harmonics.grids import albedo
from brdfcore.harmonics.legendre import Parity
from brdfcore.harmonics.targets import TARGETS, Block, Target, blocks, count, degrees_of
from brdfcore.harmonics.windows import WINDOWS
from brdfcore.tables.base.table import Table, checked_delta, interpolated_delta

Float64Array = npt.NDArray[np.float64]

#: Largest degree of an expansion: its coefficients are then some 10^8 a channel.
MAX_LMAX = 1_024
#: Points times coefficients of a block that one thread takes: half a millisecond.
_BLOCK_WORK = 2**18


class Series(Table):
    """Coefficients of an expansion to degree `lmax`, and the sums that answer from them.

    lmax, target, window   what was expanded and how far; the window's factors are in the coefficients.
    packed                 the source is bilateral and reciprocal: rho is symmetric, and half of it is stored.

    Arrays:

        cores   float64 or float32, flat   of each order, cosines of every channel, then sines where not bilateral: the
                core between the bases, its upper triangle if packed; the coefficients where there are no bases
        ranks   int32 (orders, 2)          sizes of the core; as many as there are degrees: no basis
        bases   as cores, flat             of each order the left basis (rank, degrees), then, unless packed, the right

    `coefficients(m)` gives rho of an order whole. Values are sums in float64 whatever the arrays' type; packed ones are
    reciprocal to the bit.
    """

    _checks_domain = True
    _smooth_elsewhere = True  # waves of no more than `lmax` turns

    def __init__(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        lmax: int,
        target: str,
        window: str,
        packed: bool,
        channels: Channels,
        flags: Mapping[str, bool],
        delta: Float64Array | None = None,
    ) -> None:
        super().__init__(channels, flags)
        self.lmax, self.target, self.window, self.packed = lmax, target, window, packed
        self._ranks = np.require(arrays["ranks"], requirements=("C", "A", "W"))
        self._cores = np.require(arrays["cores"], requirements=("C", "A", "W"))
        bases = arrays.get("bases")
        self._bases = (
            np.zeros(0, self._cores.dtype) if bases is None else np.require(bases, requirements=("C", "A", "W"))
        )
        self.delta = delta
        self.has_delta = delta is not None

    # ---- coefficients -------------------------------------------------------------------------

    @cached_property
    def blocks(self) -> list[Block]:
        """Orders of cosines, then of sines unless bilateral: sizes of their coefficients (`targets.blocks`)."""
        return blocks(self.lmax, self._target, self.bilateral)

    @property
    def orders(self) -> int:
        """Orders m = 0 ... orders - 1 have coefficients."""
        return len(self._ranks)

    def coefficients(self, m: int, *, sines: bool = False) -> Float64Array:
        """rho_ll'm of an order, float64 (channels, k, k'); l and l' by `degrees`. sines: those of sin(m delta_phi)."""
        if not 0 <= m < self.orders:
            raise InputError("bad_order", f"m = {m}: expected 0 to {self.orders - 1}", where="m", got=m)
        found = self._order(m)
        core = found.sines if sines else found.cosines
        if core is None:  # bilateral, or m = 0
            return np.zeros((len(self.channels), self.blocks[m].rows, self.blocks[m].columns))
        return found.coefficients(core)

    def degrees(self, m: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """l of rho's rows (theta_i) and l' of its columns (theta_o)."""
        return degrees_of(self.blocks[m], self.lmax, self._target)

    @property
    def size(self) -> int:
        """Coefficients rho_ll'm a channel, symmetric ones once: what `cores` would hold without bases."""
        return count(self.lmax, self._target, self.bilateral, self.packed)

    @property
    def target_parities(self) -> tuple[Parity, Parity]:
        """Parities of l - m of the degrees of theta_i and of theta_o."""
        return self._target.parity_i, self._target.parity_o

    @property
    def _target(self) -> Target:
        return TARGETS[self.target]

    def _order(self, m: int) -> Order:
        row, channels = self._layout[m], len(self.channels)
        rows, columns, rank_i, rank_o = (int(n) for n in row[:4].tolist())

        def basis(start: int, rank: int, size: int) -> Float64Array | None:
            if rank == size:
                return None
            return self._bases[start : start + rank * size].reshape(rank, size).astype(np.float64)

        def core(start: int) -> Float64Array | None:
            if start < 0:
                return None
            if not self.packed:
                flat = self._cores[start : start + channels * rank_i * rank_o].astype(np.float64)
                return flat.reshape(channels, rank_i, rank_o)
            upper = np.triu_indices(rank_i)
            found = np.empty((channels, rank_i, rank_i))
            flat = self._cores[start : start + channels * upper[0].size].astype(np.float64).reshape(channels, -1)
            found[:, upper[0], upper[1]] = flat
            found[:, upper[1], upper[0]] = flat
            return found

        left = basis(int(row[4]), rank_i, rows)
        right = left if self.packed else basis(int(row[5]), rank_o, columns)
        cosines = core(int(row[6]))
        assert cosines is not None
        return Order(left, right, cosines, core(int(row[7])))

    @cached_property
    def _layout(self) -> npt.NDArray[np.int64]:
        return layout_of(self._ranks, self.blocks, len(self.channels), self.packed)

    # ---- evaluation ---------------------------------------------------------------------------

    @cached_property
    def _steps(self) -> tuple[npt.NDArray[np.int64], Float64Array, Float64Array]:
        """Layout with the places of the recursion's coefficients, p_m^m ratios, and those coefficients."""
        from brdfcore.kernels.harmonics.harmonic import STEPS_I, STEPS_O, steps

        layout, found, at = self._layout.copy(), [], 0
        odd = (bool(self._target.cos_i), bool(self._target.cos_o))
        for m in range(len(layout)):
            for column, side in ((STEPS_I, 0), (STEPS_O, 1)):
                if side == 1 and odd[0] == odd[1]:
                    layout[m, column] = layout[m, STEPS_I]
                    continue
                found.append(steps(self.lmax, m, odd[side]))
                layout[m, column] = at
                at += len(found[-1])
        orders = np.arange(1, len(layout))
        ratios = np.concatenate([[1 / np.sqrt(4 * np.pi)], np.sqrt((2 * orders + 1) / (2 * orders))])
        return layout, ratios, np.concatenate(found)

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        from brdfcore.kernels.harmonics.harmonic import LANES, harmonic_values
        from brdfcore.kernels.machine.blocks import run

        shared = (
            *self._steps, self._bases, self._cores, len(self.channels), self.packed,
            theta_i.dtype.type(HALF_PI), LANES,
        )  # fmt: skip
        flat = out.reshape(-1)
        # a block takes as long as thousands of plain look-ups, and is made of whole groups of points
        block = LANES * max(1, _BLOCK_WORK // max(self._cores.size, 1) // LANES)
        if theta_i.size <= block:
            return bool(harmonic_values(theta_i, theta_o, delta_phi, flat, *shared) == 0)

        def work(start: int, stop: int) -> bool:
            angles = theta_i[start:stop], theta_o[start:stop], delta_phi[start:stop]
            values = flat[start * len(self.channels) : stop * len(self.channels)]
            return bool(harmonic_values(*angles, values, *shared) == 0)

        return run(work, theta_i.size, block, 2 * block)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return np.full(theta_i.shape, Status.INTERPOLATED, np.uint8)

    def _albedo(
        self, theta_i: npt.ArrayLike, points: int, azimuths: int, tolerance: float | None, budget: int
    ) -> tuple[FloatArray, FloatArray]:
        # in closed form, whatever quadrature is asked for: its sums round to some 1e-16 a degree
        angles = check_domain(flatten_angles(theta_i, 0.0, 0.0))
        thetas = np.minimum(angles.theta_i.astype(np.float64), HALF_PI)
        values = self._delta_reflectance(thetas) + albedo(self, thetas)
        errors = np.finfo(np.float64).eps * self.lmax * np.abs(values)
        shape = (*angles.shape, len(self.channels))
        return values.reshape(shape), errors.reshape(shape)

    def _delta_reflectance(self, theta_i: Float64Array) -> Float64Array:
        if self.delta is None:
            return super()._delta_reflectance(theta_i)
        return interpolated_delta(self.delta, theta_i)

    # ---- arrays ---------------------------------------------------------------------

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        arrays = {"cores": self._cores, "ranks": self._ranks}
        if self._bases.size:
            arrays["bases"] = self._bases
        if self.delta is not None:
            arrays["delta"] = self.delta
        return arrays

    def attributes(self) -> dict[str, Any]:
        return {"lmax": self.lmax, "target": self.target, "window": self.window, "packed": self.packed}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        lmax, target, window, packed = (attributes.get(k) for k in ("lmax", "target", "window", "packed"))
        if isinstance(lmax, bool) or not isinstance(lmax, int) or not 0 < lmax <= MAX_LMAX:
            raise _bad("lmax", repr(lmax)[:40], f"a whole number, 1 to {MAX_LMAX}")
        if not isinstance(target, str) or target not in TARGETS:
            raise _bad("target", repr(target)[:40], ", ".join(TARGETS))
        if not isinstance(window, str) or window not in WINDOWS:
            raise _bad("window", repr(window)[:40], ", ".join(WINDOWS))
        bilateral = bool(flags["bilateral"])
        if not isinstance(packed, bool) or (packed and not (bilateral and TARGETS[target].symmetric)):
            raise _bad("packed", repr(packed)[:40], "true or false; false unless bilateral, of a symmetric target")
        listed = blocks(lmax, TARGETS[target], bilateral)
        cosines = [b for b in listed if not b.sine]
        ranks, cores, bases = arrays.get("ranks"), arrays.get("cores"), arrays.get("bases")
        if ranks is None or ranks.dtype != np.int32 or ranks.shape != (len(cosines), 2):
            got = "nothing" if ranks is None else f"{ranks.dtype} {ranks.shape}"
            raise _bad("ranks", got, f"int32 ({len(cosines)}, 2)")
        largest = np.array([(b.rows, b.columns) for b in cosines])
        if (ranks < 1).any() or (ranks > largest).any() or (packed and (ranks[:, 0] != ranks[:, 1]).any()):
            raise _bad("ranks", "sizes that no basis has", "1 to the degrees of the order, equal if packed")
        layout = layout_of(ranks, listed, len(channels), packed)
        for name, array, size in (("cores", cores, layout[-1, -1]), ("bases", bases, layout[-1, -2])):
            if array is None and name == "bases" and size == 0:
                continue
            fits = array is not None and array.dtype in (np.float32, np.float64) and array.shape == (size,)
            if not fits or array is None or not np.isfinite(array).all():
                got = "nothing" if array is None else f"{array.dtype} {array.shape}, or not finite"
                raise _bad(name, got, f"{size} finite numbers, float32 or float64")
        if bases is not None and cores is not None and bases.dtype != cores.dtype:
            raise _bad("bases", str(bases.dtype), f"{cores.dtype}, as cores")
        delta = checked_delta(cls.name, arrays, len(channels))
        return cls(arrays, lmax, target, window, packed, channels, flags, delta)


def layout_of(ranks: npt.NDArray[Any], listed: list[Block], channels: int, packed: bool) -> npt.NDArray[np.int64]:
    """int64 (orders, 10) of `kernels.harmonics.harmonic`; its last two columns hold, until the recursion's steps are
    known, the ends of the order's bases and cores."""
    cosines = [b for b in listed if not b.sine]
    with_sines = {b.m for b in listed if b.sine}
    found = np.zeros((len(cosines), 10), np.int64)
    basis = core = 0
    for m, (block, (rank_i, rank_o)) in enumerate(zip(cosines, ranks.tolist())):
        found[m, :4] = block.rows, block.columns, rank_i, rank_o
        found[m, 4] = basis
        basis += rank_i * block.rows if rank_i < block.rows else 0
        found[m, 5] = found[m, 4] if packed else basis
        if not packed:
            basis += rank_o * block.columns if rank_o < block.columns else 0
        size = channels * (rank_i * (rank_i + 1) // 2 if packed else rank_i * rank_o)
        found[m, 6] = core
        core += size
        found[m, 7] = core if block.m in with_sines else -1
        core += size if block.m in with_sines else 0
        found[m, 8:] = basis, core
    return found


def packed_arrays(orders: list[Order], packed: bool, dtype: npt.DTypeLike) -> dict[str, npt.NDArray[Any]]:
    """The arrays of an expansion from its orders."""
    cores, bases, ranks = [], [], []
    for order in orders:
        rank_i, rank_o = order.cosines.shape[1:]
        ranks.append((rank_i, rank_o))
        for basis in (order.left,) if packed else (order.left, order.right):
            bases += [] if basis is None else [basis.reshape(-1)]
        upper = np.triu_indices(rank_i)
        for core in (order.cosines, order.sines):
            cores += [] if core is None else [(core[:, upper[0], upper[1]] if packed else core).reshape(-1)]
    found = {"cores": np.concatenate(cores).astype(dtype), "ranks": np.array(ranks, np.int32)}
    if bases:
        found["bases"] = np.concatenate(bases).astype(dtype)
    return found


def _bad(field: str, got: str, expected: str) -> FileFormatError:
    return FileFormatError(
        "bad_field", f"harmonic: {field} is {got}; expected {expected}", where=field, got=got, expected=expected
    )
