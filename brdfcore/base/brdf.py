"""The one signature of everything that can be evaluated: models, measured files, tables, remote materials."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.channels import VALUE, Channels
from brdfcore.base.conventions import FloatArray, Outside
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown
from brdfcore.base.peaks import smooth_elsewhere
from brdfcore.base.pole import evaluate_by_angles
from brdfcore.base.provenance import Provenance, add_in_squares
from brdfcore.base.reflectance import Reflectance
from brdfcore.base.sampling import Sampling
from brdfcore.base.status import weaker

#: What is claimed of a BRDF, as attributes of it.
FLAGS = ("bilateral", "reciprocal", "energy_conserving", "non_negative")


class Brdf(Provenance, Sampling, Reflectance, ABC):
    """A bidirectional reflectance distribution function f_r(theta_i, theta_o, delta_phi), isotropic.

    Attributes
    ----------
    channels : Channels
        What the last axis of every value array means.
    bilateral, reciprocal, energy_conserving, non_negative : bool
        f even in delta_phi; f equal with the directions swapped; albedo <= 1; f >= 0. Declared by a model,
        measured for data.
    has_delta : bool
        True if a perfect mirror part exists; `evaluate` leaves it out, `delta_reflectance` gives it.
    metadata, report : mappings
        JSON-ready facts about the source; what an import found and what it did about it.

    >>> white, gold = bc.model("lambert", reflectance=0.5), bc.model("mirror", ior="gold")
    >>> both = white + 0.5 * gold
    >>> both.has_delta, both.reciprocal, list(both.channels)
    (True, True, ['value'])
    """

    channels: Channels = VALUE
    bilateral: bool = True
    reciprocal: bool = True
    energy_conserving: bool = True
    non_negative: bool = True
    has_delta: bool = False
    #: True if `_evaluate` notices inputs outside the plain domain itself (compiled kernels do, in the same pass).
    _checks_domain: bool = False
    #: True if `_evaluate_raw_vectors` exists: vectors of any length, in their own type, checked in the same pass.
    _takes_vectors: bool = False

    def __init__(self) -> None:
        self.metadata: dict[str, Any] = {}
        self.report: dict[str, Any] = {}
        self._albedos: dict[tuple[float, ...], tuple[FloatArray, FloatArray]] = {}

    # ---- what an entry implements -------------------------------------------------------------

    @abstractmethod
    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        """Write f_r of n pairs into `out` (n, channels); inputs (n,), contiguous, of one float dtype.

        Returns True if every input was in the plain domain: theta in [0, pi/2], |delta_phi| <= 3 pi, no NaN.
        An entry that does not look (`_checks_domain` False) is only given such inputs and returns True.
        """

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        """f_r of vectors (n, 3), float64, of lengths from 1/2 to 4, both with z > 0, into `out` (n, channels)."""
        evaluate_by_angles(self._evaluate, wi, wo, out)

    def _evaluate_raw_vectors(self, wi: FloatArray, wo: FloatArray, out: FloatArray) -> bool:
        """f_r of vectors as they were given, (n, 3) contiguous, of the type of `out`; 0 where z <= 0.

        Returns True if every vector was finite, not zero, and of a squared length within [1e-12, 1e12].
        """
        raise NotImplementedError

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Reflectance of the mirror part, (n,) -> (n, channels)."""
        return np.zeros((theta_i.size, len(self.channels)))

    # ---- the public signature -----------------------------------------------------------------

    def evaluate(
        self,
        theta_i: npt.ArrayLike,
        theta_o: npt.ArrayLike,
        delta_phi: npt.ArrayLike,
        *,
        out: FloatArray | None = None,
        outside: Outside = "raise",
    ) -> FloatArray:
        """f_r in 1/sr, without the cosine and without the delta part.

        Parameters
        ----------
        theta_i, theta_o : array_like
            Polar angles of light and viewer, radians, [0, pi/2]. They broadcast with delta_phi.
        delta_phi : array_like
            phi_o - phi_i, radians, any finite number; the mirror direction is pi.
        out : ndarray, optional
            Result array of exactly the result's shape and dtype. After an error its contents are undefined.
        outside : {"raise", "nan", "clip"}
            What angles outside the domain mean; see `conventions`.

        Returns
        -------
        ndarray, shape broadcast(theta_i, theta_o, delta_phi) + (channels,)
            float32 if all inputs are float32, else float64.

        Raises
        ------
        InputError
            An angle is NaN, infinite or past the horizon (names argument, index and value); shapes do not
            broadcast; `out` does not fit.

        >>> white = bc.model("lambert", reflectance=[0.8, 0.4, 0.2])
        >>> (np.pi * white.evaluate([0.1, 0.2], 0.3, np.pi)).round(12)
        array([[0.8, 0.4, 0.2],
               [0.8, 0.4, 0.2]])
        >>> white.evaluate(2.0, 0.3, np.pi)
        Traceback (most recent call last):
            ...
        brdfcore.base.errors.InputError: ...
        >>> white.evaluate(2.0, 0.3, np.pi, outside="nan")
        array([nan, nan, nan])
        """
        if out is None and outside == "raise":
            one = conventions.plain_floats(theta_i, theta_o, delta_phi)
            if one is not None:  # the same bits as of arrays, without the checks of arrays: a third of the time
                single = np.empty((1, len(self.channels)))
                self._evaluate(one[0:1], one[1:2], one[2:3], single)
                return single.reshape(-1)
        angles = conventions.flatten_angles(theta_i, theta_o, delta_phi)
        count = len(self.channels)
        values = conventions.prepare_out(out, (*angles.shape, count), angles.theta_i.dtype)
        # kernels may read an input after writing the result of another point: never where they share memory
        direct = values.flags.carray and (out is None or not any(np.may_share_memory(out, x) for x in angles[:3]))
        flat = values.reshape(-1, count) if direct else np.empty((angles.theta_i.size, count), values.dtype)
        if not (self._checks_domain and outside == "raise" and self._evaluate(*angles[:3], flat)):
            angles = conventions.check_domain(angles, outside)
            self._evaluate(*angles[:3], flat)
            if angles.outside is not None:
                flat[angles.outside] = np.nan
        if not direct:
            values[...] = flat.reshape(values.shape)
        return values

    def evaluate_vectors(self, wi: npt.ArrayLike, wo: npt.ArrayLike, *, out: FloatArray | None = None) -> FloatArray:
        """f_r in 1/sr from directions of shape (..., 3), normal +z; exactly 0 where either has z <= 0.

        Vectors need not be unit. A zero, NaN or infinite vector is an `InputError`. Result shape is the
        broadcast shape without the last axis + (channels,); float32 if both inputs are float32.

        >>> bc.model("lambert", reflectance=0.5).evaluate_vectors([0, 0, 1], [[0.5, 0, 0.8], [0.5, 0, -0.8]])
        array([[0.15915494],
               [0.        ]])
        """
        if self._takes_vectors:
            return self._evaluate_in_place(wi, wo, out)
        vectors = conventions.flatten_vectors(wi, wo, unit=False)
        count = len(self.channels)
        values = conventions.prepare_out(out, (*vectors.shape, count), vectors.dtype)
        above = (vectors.wi[:, 2] > 0) & (vectors.wo[:, 2] > 0)
        flat = np.zeros((above.size, count), values.dtype)
        if above.all():
            self._evaluate_vectors(vectors.wi, vectors.wo, flat)
        elif above.any():
            some = np.empty((int(above.sum()), count), values.dtype)
            self._evaluate_vectors(vectors.wi[above], vectors.wo[above], some)
            flat[above] = some
        values[...] = flat.reshape(values.shape)
        return values

    def _evaluate_in_place(self, wi: npt.ArrayLike, wo: npt.ArrayLike, out: FloatArray | None) -> FloatArray:
        """`evaluate_vectors` by `_evaluate_raw_vectors`: no copies of vectors that can be read as they are."""
        vectors = conventions.raw_vectors(wi, wo)
        count = len(self.channels)
        values = conventions.prepare_out(out, (*vectors.shape, count), vectors.dtype)
        shared = out is not None and any(np.may_share_memory(out, v) for v in (vectors.wi, vectors.wo))
        direct = values.flags.carray and not shared
        flat = values.reshape(-1, count) if direct else np.empty((len(vectors.wi), count), values.dtype)
        if not self._evaluate_raw_vectors(vectors.wi, vectors.wo, flat):
            usable = conventions.scaled_vectors(vectors)
            self._evaluate_raw_vectors(usable.wi, usable.wo, flat)
        if not direct:
            values[...] = flat.reshape(values.shape)
        return values

    def delta_reflectance(self, theta_i: npt.ArrayLike) -> FloatArray:
        """Reflectance of the perfect mirror part, in [0, 1]; shape theta_i.shape + (channels,), float64.

        >>> bc.model("mirror", ior=1.5).delta_reflectance(0.0)  # ((n - 1)/(n + 1))^2
        array([0.04])
        """
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, 0.0, 0.0))
        values = self._delta_reflectance(np.minimum(angles.theta_i.astype(np.float64), conventions.HALF_PI))
        return values.reshape((*angles.shape, len(self.channels)))

    def describe(self) -> dict[str, Any]:
        """JSON-ready facts: channels, flags, metadata."""
        return {
            "channels": self.channels.to_json(),
            "channel_kind": self.channels.kind,
            **{flag: getattr(self, flag) for flag in FLAGS},
            "has_delta": self.has_delta,
            "metadata": dict(self.metadata),
        }

    #: So that numpy leaves `array * brdf` to `__rmul__`; it would make an array of objects.
    __array_ufunc__ = None

    def __add__(self, other: object) -> Brdf:
        return Sum(self, other) if isinstance(other, Brdf) else NotImplemented

    def __radd__(self, other: object) -> Brdf:
        # sum() begins with 0
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def __mul__(self, factor: Any) -> Brdf:
        return NotImplemented if isinstance(factor, Brdf) else Scaled(self, factor)

    __rmul__ = __mul__


class Sum(Brdf):
    """a + b. Reciprocal, bilateral and non-negative if both are; energy conservation is not claimed."""

    def __init__(self, a: Brdf, b: Brdf) -> None:
        super().__init__()
        self.parts = (a, b)
        self.channels = Channels.common(a.channels, b.channels)
        self.bilateral = a.bilateral and b.bilateral
        self.reciprocal = a.reciprocal and b.reciprocal
        self.non_negative = a.non_negative and b.non_negative
        self.energy_conserving = False  # each may reflect all light
        self.has_delta = a.has_delta or b.has_delta
        self._analytic = a._analytic and b._analytic
        self._smooth_elsewhere = smooth_elsewhere(a) and smooth_elsewhere(b)
        self.metadata = {"sum": [a.describe()["metadata"], b.describe()["metadata"]]}

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        a, b = (p.evaluate(theta_i, theta_o, delta_phi) for p in self.parts)
        np.add(a, b, out=out)
        return True

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        parts = []
        for p in self.parts:
            values = np.empty((wi.shape[0], len(p.channels)), out.dtype)
            p._evaluate_vectors(wi, wo, values)
            parts.append(values)
        np.add(parts[0], parts[1], out=out)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return weaker(*(p._status(theta_i, theta_o, delta_phi) for p in self.parts))

    def _terms(self) -> list[tuple[Provenance, Any]]:
        return [term for part in self.parts for term in part._terms()]

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        add_in_squares(self._terms(), (theta_i, theta_o, delta_phi), out)
        return True

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        a, b = (p._delta_reflectance(theta_i) for p in self.parts)
        return a + b


class Scaled(Brdf):
    """factor * brdf, the factor a number >= 0 or one per channel; the delta part is scaled with it."""

    def __init__(self, part: Brdf, factor: Any) -> None:
        super().__init__()
        try:
            scale = np.atleast_1d(np.asarray(factor, dtype=np.float64))
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError("bad_factor", f"factor: expected numbers, got {shown(factor)}", where="factor") from error
        usable = scale.ndim == 1 and scale.size in (1, len(part.channels))
        if not usable or not (np.isfinite(scale) & (scale >= 0)).all():
            raise InputError(
                "bad_factor",
                f"factor: expected a number >= 0, or {len(part.channels)} of them (one per channel); "
                f"got {shown(factor)}",
                where="factor",
                expected=f"1 or {len(part.channels)} finite numbers >= 0",
            )
        self.part = part
        self.factor = scale
        self.channels = part.channels
        self.bilateral, self.reciprocal, self.non_negative = part.bilateral, part.reciprocal, part.non_negative
        self.energy_conserving = part.energy_conserving and bool((scale <= 1).all())
        self.has_delta = part.has_delta
        self._analytic, self._smooth_elsewhere = part._analytic, part._smooth_elsewhere
        self.metadata = {"scaled": part.describe()["metadata"], "factor": scale.tolist()}
        self.report = part.report

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        self.part.evaluate(theta_i, theta_o, delta_phi, out=out)
        np.multiply(out, self.factor.astype(out.dtype), out=out)
        return True

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        self.part._evaluate_vectors(wi, wo, out)
        np.multiply(out, self.factor.astype(out.dtype), out=out)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return self.part._status(theta_i, theta_o, delta_phi)

    def _terms(self) -> list[tuple[Provenance, Any]]:
        return [(part, factor * self.factor) for part, factor in self.part._terms()]

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = self.part.uncertainty(theta_i, theta_o, delta_phi) * self.factor.astype(out.dtype)
        return True

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return self.part._delta_reflectance(theta_i) * self.factor

    def _albedo(
        self, theta_i: npt.ArrayLike, points: int, azimuths: int, tolerance: float | None, budget: int
    ) -> tuple[FloatArray, FloatArray]:
        albedo, error = self.part._albedo(theta_i, points, azimuths, tolerance, budget)
        return albedo * self.factor, error * self.factor
