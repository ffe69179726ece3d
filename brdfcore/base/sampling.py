"""Directions drawn in proportion to f_r cos theta_o, and the density that they are drawn with."""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError

#: Who makes samplers, by its name: it stands on kernels, which this room knows nothing of.
_MAKER = "brdfcore.sampling.quantiles"


class Sample(NamedTuple):
    """Directions drawn.

    wo      (..., 3) unit vectors, normal +z.
    weight  (..., channels) f_r cos theta_o / pdf; of a draw from the mirror part its reflectance over its probability.
    pdf     (...) density over solid angle, 1/sr; inf where the mirror part was drawn, which has none; 0 where nothing
            can be (wi below the horizon), and the weight with it.

    >>> drawn = bc.model("mirror", ior=1.5).sample([0, 0, 1], [0.5, 0.5])
    >>> drawn.delta, drawn.wo.tolist(), drawn.weight.round(6).tolist()
    (np.True_, [-0.0, -0.0, 1.0], [0.04])
    """

    wo: FloatArray
    weight: FloatArray
    pdf: FloatArray

    @property
    def delta(self) -> npt.NDArray[np.bool_]:
        """True where wo is the mirror direction of a perfect mirror part."""
        return np.isinf(self.pdf)


class Sampling:
    """`sample` and `pdf` of a `Brdf`."""

    channels: Channels
    has_delta: bool
    _takes_vectors: bool
    _sampler: Any = None

    def sample(self, wi: npt.ArrayLike, u: npt.ArrayLike) -> Sample:
        """One direction wo for each wi and pair of numbers u: importance sampling.

        wi is held and wo drawn, whichever of the two a renderer calls light: weight = f_r(wi, wo) cos theta_o / pdf.
        A material that is not reciprocal answers f_r(wo, wi) otherwise, so a path traced from the camera that wants
        the light drawn has to give `wi` = view only where that is meant.

        Parameters
        ----------
        wi : array_like, shape (..., 3)
            Directions, normal +z, of any length.
        u : array_like, shape (..., 2)
            Numbers in [0, 1), random or from a sequence of low discrepancy; broadcast with wi. Near ones draw near
            directions. float32 results only if both are float32.

        The mean of `weight` over u is the albedo, the mirror part included. The first call prepares tables from some
        200,000 values of f_r (`sampling.quantiles`). Drawn is in proportion to the mean of the channels, with .4 % of
        an even part. Raises `InputError` for vectors without direction, and for u outside [0, 1).

        >>> drawn = bc.model("lambert", reflectance=0.5).sample([0, 0, 1], [[0.1, 0.2], [0.7, 0.9]])
        >>> drawn.weight.round(2).tolist(), (drawn.wo[:, 2] > 0).tolist()
        ([[0.5], [0.5]], [True, True])
        """
        held, given, shape = _paired(wi, u)
        maker, chosen, part = self._made_sampler(), None, np.zeros(0)
        if self.has_delta:
            held, given = _checked(held, given, shape)
            given, chosen, part = self._split(held, given)
        wo, pdf, usable = maker.draw(held, given)
        if not usable:  # an error, or vectors of extreme length
            held, given = _checked(held, given, shape)
            wo, pdf, _ = maker.draw(held, given)
        weight = self._values(maker, held, wo)
        maker.weigh(weight, wo, pdf)
        if chosen is not None:
            rest = (1 - part).astype(held.dtype)
            pdf *= rest
            weight /= np.where(rest > 0, rest, 1)[:, None]
            theta_i = _polar(held[chosen])
            wo[chosen], pdf[chosen] = _unit(held[chosen]) * np.array([-1, -1, 1]), np.inf
            weight[chosen] = self.delta_reflectance(theta_i) / part[chosen, None]  # type: ignore[attr-defined]
        return Sample(wo.reshape(*shape, 3), weight.reshape(*shape, len(self.channels)), pdf.reshape(shape))

    def pdf(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> FloatArray:
        """Density over solid angle of wo, 1/sr, with which `sample` draws wo for wi; shape as broadcast, without the
        last axis. 0 where either has z <= 0. A mirror part adds nothing: it has no density.

        >>> float(bc.model("lambert").pdf([0, 0, 1], [0, 0.6, 0.8]).round(2))  # cos / pi
        0.25
        """
        vectors = conventions.scaled_vectors(conventions.raw_vectors(wi, wo))
        found: FloatArray = self._made_sampler().density(vectors.wi, vectors.wo)
        if self.has_delta:
            found *= (1 - self._delta_part(vectors.wi)).astype(found.dtype)
        return found.reshape(vectors.shape)

    def _values(self, maker: Any, wi: FloatArray, wo: FloatArray) -> FloatArray:
        """f_r of n pairs; of float32 vectors by angles in float32, where there is no look-up by vectors."""
        values: FloatArray
        if self._takes_vectors or wi.dtype != np.float32:
            values = self.evaluate_vectors(wi, wo)  # type: ignore[attr-defined]
        else:
            values = self.evaluate(*maker.angles(wi, wo))  # type: ignore[attr-defined]
        return values

    def _made_sampler(self) -> Any:
        if self._sampler is None:
            self._sampler = import_module(_MAKER).make_sampler(self)
        return self._sampler

    def _delta_part(self, wi: FloatArray) -> npt.NDArray[np.float64]:
        """Probability of the mirror part, (n,): its share of the reflectance."""
        theta_i = _polar(wi)
        mirror = self.delta_reflectance(theta_i).mean(axis=-1)  # type: ignore[attr-defined]
        regular = self._made_sampler().regular_reflectance(np.sin(theta_i))
        total = mirror + regular
        part: npt.NDArray[np.float64] = np.divide(mirror, total, out=np.zeros_like(total), where=total > 0)
        return np.where(wi[:, 2] > 0, part, 0.0)

    def _split(
        self, wi: FloatArray, u: FloatArray
    ) -> tuple[FloatArray, npt.NDArray[np.bool_], npt.NDArray[np.float64]]:
        """u with its first number spread over [0, 1) again; where it chose the mirror part; that part's probability."""
        part = self._delta_part(wi)
        chosen = u[:, 0] < part
        spread = np.divide(u[:, 0] - part, 1 - part, out=np.zeros(len(u)), where=part < 1)
        below = np.nextafter(u.dtype.type(1), u.dtype.type(0))
        first = np.clip(np.where(chosen, 0, spread), 0, below).astype(u.dtype)
        return np.ascontiguousarray(np.stack([first, u[:, 1]], axis=1)), chosen, part


def _paired(wi: npt.ArrayLike, u: npt.ArrayLike) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
    """wi (n, 3) and u (n, 2), contiguous and of one type, and their broadcast shape."""
    numbers = conventions.as_float("u", u)
    if numbers.ndim == 0 or numbers.shape[-1] != 2:
        raise InputError(
            "not_pairs",
            f"u: expected numbers of shape (..., 2), got {numbers.shape}",
            where="u",
            got=list(numbers.shape),
            expected="(..., 2)",
        )
    given = conventions.as_float("wi", wi)
    if given.ndim == 0 or given.shape[-1] != 3:
        conventions.raw_vectors(given, np.ones(3))  # the error that says so
    shape = conventions.broadcast_shape(("wi", "u"), (given.shape[:-1], numbers.shape[:-1]))
    dtype = given.dtype if given.dtype == numbers.dtype else np.dtype(np.float64)
    flat = []
    for x in (given, numbers):
        last = x.shape[-1]
        full = x if x.shape == (*shape, last) else np.broadcast_to(x, (*shape, last))
        one = np.ascontiguousarray(full, dtype=dtype).reshape(-1, last)
        # as in conventions.raw_vectors: kernels are compiled for memory that may be written
        flat.append(one if one.flags.behaved else one.copy())
    return flat[0], flat[1], shape


def _checked(wi: FloatArray, u: FloatArray, shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """The same, of moderate length; an `InputError` that names what is no direction or no number in [0, 1)."""
    inside = (u >= 0) & (u < 1)
    if not inside.all():
        n, c = (int(k) for k in np.argwhere(~inside)[0])
        index = [*(int(k) for k in np.unravel_index(n, shape)), c] if shape else [c]
        got = float(u[n, c])
        said = f"u{index} = {got!r} is outside [0, 1)"
        raise InputError("number_outside", said, where="u", index=index, got=str(got), expected="[0, 1)")
    scaled = conventions.scaled_vectors(conventions.Vectors(wi, np.ones_like(wi), shape, wi.dtype))
    return np.ascontiguousarray(scaled.wi), u


def _polar(w: FloatArray) -> npt.NDArray[np.float64]:
    """theta of n vectors, rad; the horizon for those below it."""
    wide = w.astype(np.float64)
    theta: npt.NDArray[np.float64] = np.arctan2(np.hypot(wide[:, 0], wide[:, 1]), np.maximum(wide[:, 2], 0))
    return theta


def _unit(w: FloatArray) -> npt.NDArray[np.float64]:
    wide = w.astype(np.float64)
    made: npt.NDArray[np.float64] = wide / np.sqrt((wide * wide).sum(axis=1))[:, None]
    return made
