"""Light from all directions: an environment as real spherical harmonics, and directional lights beside it, exact.

    L(w) = sum_(l<=lmax) sum_m c_lm Y_lm(w) + sum_k E_k delta(w - w_k)

Y are the real, orthonormal harmonics of `harmonics.legendre` (row l^2 + l + m), so int L^2 dw = sum c^2 (Parseval). The
frame is the world's: theta from +z, the zenith, phi from +x towards +y; maps: `harmonics.environment`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels
from brdfcore.base.conventions import as_float, flatten_vectors
from brdfcore.base.errors import InputError
from brdfcore.harmonics.environment import LARGEST, checked_map, map_coefficients, map_energy
from brdfcore.harmonics.irradiance import irradiance_factors
from brdfcore.harmonics.legendre import SphericalHarmonics, checked_degree
from brdfcore.harmonics.rotation import MAX_ROTATED, checked_rotation, rotated
from brdfcore.harmonics.windows import factors

Float64Array = npt.NDArray[np.float64]

#: Values of Y held at a time.
_VALUES = 4_000_000


@dataclass(frozen=True, eq=False)
class Light:
    """Radiance from everywhere. Immutable; `a + b` shines both, `2 * a` is twice as bright.

    coefficients   float64 ((lmax+1)^2, channels), read-only.
    channels       as those of a BRDF, or one channel.
    left_out       (channels,): L2 norm over the sphere of what the coefficients leave out, at most; 0: nothing. A
                   window's change is in it.
    directions     (n, 3) unit vectors towards directional lights; `irradiances` (n, channels), on a surface that faces
                   them. They are kept as they are and never ring; `expanded` puts them into the coefficients.

    Raises `InputError` for shapes that don't fit and numbers that are not finite.

    >>> sun = bc.Light.directional([0.0, 0.0, 1.0], 3.0)
    >>> (2 * sun + sun).irradiances
    array([[6.],
           [3.]])
    """

    coefficients: Float64Array
    channels: Channels
    left_out: Float64Array = field(default_factory=lambda: np.zeros(1))
    directions: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))
    irradiances: Float64Array | None = None

    def __post_init__(self) -> None:
        c = np.array(as_float("coefficients", self.coefficients), np.float64)
        lmax = int(np.sqrt(len(c))) - 1 if c.ndim == 2 else -1
        if c.ndim != 2 or (lmax + 1) ** 2 != len(c) or not len(c) or c.shape[1] != len(self.channels):
            raise _bad("coefficients", c.shape, f"((lmax+1)^2, {len(self.channels)})")
        checked_degree(lmax, MAX_ROTATED)
        towards = self.directions
        if np.shape(towards) != (0, 3):
            towards = flatten_vectors(towards, (0.0, 0.0, 1.0)).wi
        power = np.zeros((0, len(self.channels))) if self.irradiances is None else self.irradiances
        power = np.array(as_float("irradiance", power), np.float64)
        if power.shape != (len(towards), len(self.channels)):
            raise _bad("irradiance", power.shape, f"({len(towards)}, {len(self.channels)}), a row a direction")
        left = np.array(np.broadcast_to(np.asarray(self.left_out, np.float64), (len(self.channels),)))
        for name, values in (("coefficients", c), ("irradiance", power)):
            if not np.isfinite(values).all():
                raise InputError("not_finite", f"{name}: expected finite numbers", where=name)
            if values.size and np.abs(values).max() > 10 * LARGEST:
                raise InputError("too_bright", f"{name}: expected numbers up to {LARGEST:g}", where=name)
        for name, values in (
            ("coefficients", c), ("directions", np.array(towards)), ("irradiances", power), ("left_out", left)
        ):  # fmt: skip
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    # ---- where light comes from -----------------------------------------------------------------

    @classmethod
    def from_map(cls, pixels: npt.ArrayLike, lmax: int = 32, *, channels: Channels | None = None) -> Light:
        """Of an equirectangular map (h, w, channels) of radiances, row 0 at the zenith (`harmonics.environment`).

        Pixels are constant over their solid angles, and what the degrees above `lmax` hold is known: `left_out`.
        """
        found = checked_map(pixels)
        lmax = checked_degree(lmax, MAX_ROTATED)
        c = map_coefficients(found, lmax)
        # a difference of squares: below 1e-8 of the whole it is rounding
        left = np.sqrt(np.maximum(map_energy(found) - (c * c).sum(axis=0), 0))
        return cls(c, _channels(channels, found.shape[2]), left)

    @classmethod
    def directional(
        cls, directions: npt.ArrayLike, irradiance: npt.ArrayLike, *, channels: Channels | None = None
    ) -> Light:
        """Lights at infinity: directions (n, 3) towards them and their irradiance on a surface that faces them,
        (n, channels); one direction (3,) with (channels,), and numbers for one channel, too."""
        towards = np.atleast_2d(as_float("directions", directions)).astype(np.float64)
        power = as_float("irradiance", irradiance).astype(np.float64)
        if power.ndim < 2:
            power = power.reshape(len(towards), -1) if power.size and power.size % len(towards) == 0 else power[None]
        size = power.shape[-1]
        return cls(np.zeros((1, size)), _channels(channels, size), np.zeros(size), towards, power)

    # ---- what it is -----------------------------------------------------------------------------

    @property
    def lmax(self) -> int:
        """Degree of the coefficients."""
        return int(np.sqrt(len(self.coefficients))) - 1

    def spectrum(self) -> Float64Array:
        """(lmax + 1, channels): energy sum_m c_lm^2 of each degree; the same after any rotation."""
        starts = np.arange(self.lmax + 1) ** 2
        return np.asarray(np.add.reduceat(self.coefficients**2, starts, axis=0))

    def error_by_degree(self) -> Float64Array:
        """(lmax + 1,): relative L2 error over the sphere, channels together, if it ended at degree 0 ... lmax. Of the
        map; directional lights don't count. Infinite for lights that were `expanded`."""
        if not np.isfinite(self.left_out).all():
            return np.full(self.lmax + 1, np.inf)
        kept = self.spectrum().sum(axis=1)
        left = float((self.left_out**2).sum()) + np.concatenate([np.cumsum(kept[:0:-1])[::-1], [0.0]])
        total = left[0] + kept[0]
        return np.asarray(np.sqrt(left / total)) if total > 0 else np.zeros(self.lmax + 1)

    # ---- what it does ---------------------------------------------------------------------------

    def radiance(self, directions: npt.ArrayLike) -> Float64Array:
        """Of the environment seen in `directions` (..., 3), (..., channels); rings, and may be negative."""
        return self._summed(directions, np.ones(self.lmax + 1))

    def irradiance(self, normals: npt.ArrayLike, lmax: int | None = 2) -> Float64Array:
        """int L max(n.w, 0) dw on surfaces with these normals (..., 3), (..., channels); directional lights exact.

        lmax  degrees of the environment that are used. At 2, nine coefficients hold 99.219 % of the energy of the
              kernel max(n.w, 0) and leave 8.839 % of relative L2 error of it (`harmonics.irradiance.kernel_energy`);
              None: all there are.
        """
        last = self.lmax if lmax is None else min(checked_degree(lmax), self.lmax)
        a = np.where(np.arange(self.lmax + 1) <= last, irradiance_factors(self.lmax), 0.0)
        found = self._summed(normals, a)
        if len(self.directions):
            n = flatten_vectors(normals, (0.0, 0.0, 1.0))
            assert self.irradiances is not None
            found += (np.maximum(n.wi @ self.directions.T, 0) @ self.irradiances).reshape(found.shape)
        return found

    def _summed(self, directions: npt.ArrayLike, a: Float64Array) -> Float64Array:
        """sum a_l c_lm Y_lm."""
        given = flatten_vectors(directions, (0.0, 0.0, 1.0))
        last = int(np.flatnonzero(a)[-1])
        c = (self.coefficients * np.repeat(a, 2 * np.arange(self.lmax + 1) + 1)[:, None])[: (last + 1) ** 2]
        found = np.empty((len(given.wi), len(self.channels)))
        step = max(_VALUES // len(c), 1)
        for k in range(0, len(found), step):
            x, y, z = given.wi[k : k + step].T
            functions = SphericalHarmonics(last).evaluate(np.arctan2(np.hypot(x, y), z), np.arctan2(y, x))
            found[k : k + step] = functions.T @ c
        return found.reshape(*given.shape, -1)

    # ---- what can be made of it -----------------------------------------------------------------

    def rotated(self, rotation: npt.ArrayLike) -> Light:
        """Carried along by a rotation matrix R (3, 3): what came from w comes from R w."""
        r = checked_rotation(rotation)
        return replace(self, coefficients=rotated(self.coefficients, r), directions=self.directions @ r.T)

    def truncated(self, lmax: int) -> Light:
        """Only degrees up to lmax; what is dropped counts as left out."""
        size = (checked_degree(lmax) + 1) ** 2
        dropped = (self.coefficients[size:] ** 2).sum(axis=0)
        return replace(self, coefficients=self.coefficients[:size], left_out=np.sqrt(self.left_out**2 + dropped))

    def windowed(self, window: str) -> Light:
        """Coefficients times a window's w_l (`harmonics.windows`): less ringing, less sharp."""
        w = np.repeat(factors(window, self.lmax), 2 * np.arange(self.lmax + 1) + 1)[:, None]
        changed = (((1 - w) * self.coefficients) ** 2).sum(axis=0)
        return replace(self, coefficients=w * self.coefficients, left_out=np.sqrt(self.left_out**2 + changed))

    def expanded(self, lmax: int) -> Light:
        """Directional lights put into the coefficients, E_k Y_lm(w_k), to degree lmax. A delta has no L2 norm: the
        error is infinite then, and what it lights tells how good that is."""
        if not len(self.directions):
            return self if lmax >= self.lmax else self.truncated(lmax)
        assert self.irradiances is not None
        x, y, z = self.directions.T
        lmax = checked_degree(lmax, MAX_ROTATED)
        functions = SphericalHarmonics(lmax).evaluate(np.arctan2(np.hypot(x, y), z), np.arctan2(y, x))
        spread = Light(functions @ self.irradiances, self.channels, np.full(len(self.channels), np.inf))
        map_only = Light(self.coefficients, self.channels, self.left_out)
        return spread + (map_only if lmax >= self.lmax else map_only.truncated(lmax))

    def __add__(self, other: Light) -> Light:
        if not isinstance(other, Light):
            return NotImplemented
        channels = Channels.common(self.channels, other.channels)
        a, b = (x._spread(channels, max(self.lmax, other.lmax)) for x in (self, other))
        assert a.irradiances is not None
        assert b.irradiances is not None
        return Light(
            a.coefficients + b.coefficients,
            channels,
            a.left_out + b.left_out,
            np.concatenate([a.directions, b.directions]),
            np.concatenate([a.irradiances, b.irradiances]),
        )

    def __mul__(self, factor: float) -> Light:
        scaled: Callable[[Float64Array], Float64Array] = lambda values: values * float(factor)  # noqa: E731
        assert self.irradiances is not None
        return replace(
            self,
            coefficients=scaled(self.coefficients),
            irradiances=scaled(self.irradiances),
            left_out=np.abs(scaled(self.left_out)),
        )

    __rmul__ = __mul__

    def _spread(self, channels: Channels, lmax: int) -> Light:
        """The same in these channels, with zeros up to degree lmax."""
        assert self.irradiances is not None
        c = np.zeros(((lmax + 1) ** 2, len(channels)))
        c[: len(self.coefficients)] = self.coefficients
        power = np.broadcast_to(self.irradiances, (len(self.directions), len(channels)))
        return Light(c, channels, np.broadcast_to(self.left_out, (len(channels),)), self.directions, power)


def _channels(given: Channels | None, size: int) -> Channels:
    found = given if given is not None else {1: Channels(["value"]), 3: Channels(["R", "G", "B"])}.get(size)
    if found is None or len(found) != size:
        got = "none" if found is None else f"{len(found)}"
        raise InputError(
            "bad_channels",
            f"channels: {got} given for {size} columns; name them (1 and 3 name themselves: value; R, G, B)",
            where="channels",
            got=got,
            expected=size,
        )
    return found


def _bad(name: str, got: tuple[int, ...], expected: str) -> InputError:
    return InputError(
        "bad_light", f"{name}: expected shape {expected}, got {got}", where=name, got=list(got), expected=expected
    )
