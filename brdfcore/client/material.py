"""A material of a service: the same signature and the same bits as a local one, evaluated there."""

from __future__ import annotations

from collections.abc import Coroutine, Mapping, Sequence
from typing import Any, Generic, Literal, Protocol, TypeVar, overload

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray, Outside
from brdfcore.base.errors import BrdfError
from brdfcore.base.sampling import Sample
from brdfcore.base.status import Status
from brdfcore.client import exchanges
from brdfcore.client.driver import Driver
from brdfcore.client.exchanges import Exchange
from brdfcore.client.questions import Asked, Async, Sync, question
from brdfcore.names import Lighting, PictureFormat, Scale, SliceFormat, Target, View, Window

Channel = str | float | None
J = TypeVar("J", covariant=True)
B = TypeVar("B", covariant=True)


class SliceCall(Protocol, Generic[J, B]):
    """The signature of `slice`: J numbers as JSON, B the bytes of a file."""

    @overload
    def __call__(
        self, theta_i: npt.ArrayLike, *, view: View = ..., format: Literal["json"] = ..., channel: Channel = ...
    ) -> J: ...

    @overload
    def __call__(
        self,
        theta_i: npt.ArrayLike,
        *,
        view: View = ...,
        format: Literal["svg", "png", "csv"],
        channel: Channel = ...,
        scale: Scale | None = ...,
    ) -> B: ...


class Described:
    """What a service says of a material, as attributes, and what it can be asked.

    name, id    name on the service, and the digest of all that the values depend on.
    channels, bilateral, reciprocal, energy_conserving, non_negative, has_delta, metadata   as of any `Brdf`.
    nbytes      bytes a look-up touches there; 0 for an analytic model.
    error       measured error of a table, {} where there is none.
    source      name, format and sha256 of what a table was built from.
    facts       all of the metadata, as `describe()`.
    """

    name: str
    id: str
    channels: Channels
    bilateral: bool
    reciprocal: bool
    energy_conserving: bool
    non_negative: bool
    has_delta: bool
    metadata: dict[str, Any]
    nbytes: int
    error: dict[str, Any]
    source: dict[str, Any]
    facts: dict[str, Any]
    _driver: Driver

    def __init__(self, driver: Driver, facts: Mapping[str, Any]) -> None:
        super().__init__()
        self._driver = driver
        self.facts = dict(facts)
        self.name, self.id = str(facts["name"]), str(facts["id"])
        self.channels = Channels(facts["channels"], facts.get("channel_kind"))
        for flag in ("bilateral", "reciprocal", "energy_conserving", "non_negative", "has_delta"):
            setattr(self, flag, bool(facts[flag]))
        self.metadata = dict(facts.get("metadata") or {})
        self.nbytes = int(facts.get("nbytes") or 0)
        self.error = dict(facts.get("error") or {})
        self.source = dict(facts.get("source") or {})

    def describe(self) -> dict[str, Any]:
        """The service's metadata of this material, JSON-ready."""
        return dict(self.facts)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} at {self._driver.connection.base}, {self.id[:12]}>"

    # ---- values ---------------------------------------------------------------------------------

    @question
    def evaluate(
        self,
        theta_i: npt.ArrayLike,
        theta_o: npt.ArrayLike,
        delta_phi: npt.ArrayLike,
        *,
        out: FloatArray | None = None,
        outside: Outside = "raise",
    ) -> Exchange[FloatArray]:
        """f_r in 1/sr, shape broadcast(theta_i, theta_o, delta_phi) + (channels,); see `Brdf.evaluate`.

        Large batches go in several requests, with a bar on a terminal.
        """
        angles = conventions.flatten_angles(theta_i, theta_o, delta_phi)
        values = conventions.prepare_out(out, (*angles.shape, len(self.channels)), angles.theta_i.dtype)
        angles = conventions.check_domain(angles, outside)
        flat = np.empty((angles.theta_i.size, len(self.channels)), values.dtype)
        try:
            yield from exchanges.evaluate(self.id, self.name, angles[:3], flat, self._driver.connection)
        except BrdfError as error:
            raise exchanges.in_shape(error, theta_i, theta_o, delta_phi) from error
        if angles.outside is not None:
            flat[angles.outside] = np.nan
        values[...] = flat.reshape(values.shape)
        return values

    @question
    def evaluate_vectors(
        self, wi: npt.ArrayLike, wo: npt.ArrayLike, *, out: FloatArray | None = None
    ) -> Exchange[FloatArray]:
        """f_r in 1/sr from directions of shape (..., 3); see `Brdf.evaluate_vectors`. They are sent as they are."""
        vectors = conventions.flatten_vectors(wi, wo)
        values = conventions.prepare_out(out, (*vectors.shape, len(self.channels)), vectors.dtype)
        flat = np.empty((vectors.wi.shape[0], len(self.channels)), vectors.dtype)
        # the caller's own, in the dtype of the values, which holds them exactly: who evaluates normalises them, once,
        # as a local material would
        a, b = (
            np.broadcast_to(conventions.as_float(name, v), (*vectors.shape, 3)).reshape(-1, 3).astype(vectors.dtype)
            for name, v in (("wi", wi), ("wo", wo))
        )
        yield from exchanges.evaluate_vectors(self.id, self.name, a, b, flat, self._driver.connection)
        values[...] = flat.reshape(values.shape)
        return values

    def _status_codes(self, angles: exchanges.Flat) -> Exchange[npt.NDArray[np.uint8]]:
        return exchanges.status(self.id, angles, len(self.channels), self._driver.connection)

    def _reflectances(self, name: str, theta_i: npt.ArrayLike) -> Exchange[FloatArray]:
        """What the albedo answer calls `name`, theta_i.shape + (channels,), float64."""
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, 0.0, 0.0))
        thetas = np.minimum(angles.theta_i.astype(np.float64), conventions.HALF_PI)
        shape = (*angles.shape, len(self.channels))
        if name == "delta_reflectance" and not self.has_delta:
            return np.zeros(shape)
        found = yield from exchanges.reflectances(self.id, name, thetas, len(self.channels))
        return found.reshape(shape)

    # ---- analyses -------------------------------------------------------------------------------

    @question
    def checks(self) -> Exchange[dict[str, Any]]:
        """What `bc.check` finds, computed by the service, as its JSON (`verdict`, `findings`); angles in radians."""
        return exchanges.told(self.id, "checks", {"angles": "rad"})

    @question
    def gloss(self) -> Exchange[dict[str, Any]]:
        """What `bc.gloss` reads, computed by the service, as its JSON: `gloss` by angle, `haze`, in gloss units."""
        return exchanges.told(self.id, "gloss")

    @question
    def arrays(self) -> Exchange[bytes]:
        """The table's nodes as one safetensors file, what `bc.export` writes beside a shader (`bc.array_bytes`)."""
        return exchanges.drawn("tables", self.id, "arrays")

    @question
    def fit(
        self, model: str = "ggx", lobes: int | str = 1, loss: str = "auto", *, base: str = "lambert"
    ) -> Exchange[dict[str, Any]]:
        """What `bc.fit` finds, computed by the service, as its JSON: `terms`, `l1`, `estimates`."""
        return exchanges.told(self.id, "fit", {"model": model, "lobes": str(lobes), "loss": loss, "base": base})

    @question
    def harmonics(
        self, lmax: int = 32, *, target: Target = "f_cos_cos", window: Window = "none", symmetrise: bool = False
    ) -> Exchange[dict[str, Any]]:
        """What `bc.harmonic_summary` tells of an expansion to degree lmax, made by the service: errors, spectrum."""
        return exchanges.told(self.id, "harmonics", _expansion(lmax, target, window, symmetrise))

    @question
    def harmonics_picture(
        self,
        lmax: int = 32,
        *,
        target: Target = "f_cos_cos",
        window: Window = "none",
        symmetrise: bool = False,
        theta_i: npt.ArrayLike | None = None,
        channel: Channel = None,
        format: PictureFormat = "png",
    ) -> Exchange[bytes]:
        """The expansion that `harmonics` tells of as a picture: error by degree, spectrum, and slices over the
        original at one to four angles of the light, radians; default 0, 30 and 60 degrees."""
        query = {**_expansion(lmax, target, window, symmetrise), **_radians(theta_i), "channel": channel}
        return exchanges.drawn("tables", self.id, f"harmonics.{format}", query=query)

    @question
    def import_report(self) -> Exchange[dict[str, Any]]:
        """What reading its source found and did, as `Brdf.report` of a local one; nearly empty for a model."""
        return exchanges.import_report(self.id)

    @question
    def coverage(self, theta_i: npt.ArrayLike | None = None, format: PictureFormat = "png") -> Exchange[bytes]:
        """Where it was measured, as a picture: a disc of viewers for each angle of the light, radians; default: those
        of the measurements."""
        return exchanges.drawn("tables", self.id, f"coverage.{format}", query=_radians(theta_i))

    @question
    def sphere(self, light: Lighting = "studio", *, size: int = 460, channel: Channel = None) -> Exchange[bytes]:
        """A lit sphere as PNG, `size` pixels wide, under "studio" or "sky" light."""
        query = {"light": light, "size": size, "channel": channel}
        return exchanges.drawn("tables", self.id, "sphere.png", query=query)

    @question
    def sample(self, wi: npt.ArrayLike, u: npt.ArrayLike) -> Exchange[Sample]:
        """Directions drawn by the service, float64; see `Brdf.sample`. They travel as JSON."""
        return exchanges.sample(self.id, wi, u)

    @question
    def relight(
        self,
        normals: npt.ArrayLike,
        views: npt.ArrayLike,
        *,
        map: npt.ArrayLike | None = None,
        lights: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]] = (),
        lmax: int = 32,
    ) -> Exchange[FloatArray]:
        """Radiance that surfaces send towards the views, computed by the service: what `bc.relight` gives.

        normals, views  (..., 3), away from the surface, in the frame of the light (+z the zenith); they broadcast.
        map             equirectangular radiances (rows, columns) or (rows, columns, channels), row 0 at the zenith;
                        reflected through spherical harmonics to degree lmax. It travels as JSON: some 20 bytes a value.
        lights          (direction, irradiance on a plane that faces it) of directional lights, reflected exactly.

        Returns float64, broadcast shape + (channels,); 0 where the view is below the surface.
        """
        return exchanges.relight(self.id, normals, views, map, lights, lmax)

    def _slice(
        self,
        theta_i: npt.ArrayLike,
        *,
        view: View = "polar",
        format: SliceFormat = "json",
        channel: Channel = None,
        scale: Scale | None = None,
    ) -> Exchange[Any]:
        """A slice of the material: numbers in radians (json: a dict; csv: bytes), or a picture (svg, png: bytes).

        theta_i  polar angles of the light, radians; exactly one for view="hemisphere".
        view     "polar": the plane of incidence, theta_o positive on the mirror side; "hemisphere": all directions.
        scale    "linear" or "log", pictures only.
        channel  name, wavelength in nm or position; default: the picture's choice, or all of them as numbers.
        """
        query = {**_radians(theta_i), "view": view, "channel": channel, "scale": scale}
        if format == "json":
            return exchanges.told(self.id, "slice.json", query)
        return exchanges.drawn("tables", self.id, f"slice.{format}", query=query)

    slice: Asked[
        SliceCall[dict[str, Any], bytes],
        SliceCall[Coroutine[Any, Any, dict[str, Any]], Coroutine[Any, Any, bytes]],
    ] = Asked(_slice)


def _radians(theta_i: npt.ArrayLike | None) -> dict[str, Any]:
    """Angles as a query, with their unit; none is the service's choice."""
    if theta_i is None:
        return {}
    return {"theta_i": conventions.as_float("theta_i", theta_i).astype(np.float64), "angles": "rad"}


def _expansion(lmax: int, target: Target, window: Window, symmetrise: bool) -> dict[str, Any]:
    return {"lmax": lmax, "target": target, "window": window, "symmetrise": symmetrise or None}


class RemoteBrdf(Sync, Described, Brdf):
    """A material that a service evaluates; made by `Client.material` and `Client.table`.

    It is the state of the material at that moment: questions go to its `id`, so that one object never answers from
    two tables. Once the material is replaced or deleted they end in `UnknownNameError`; ask the client for it again.

    Arguments are checked here, before anything is sent, and raise what a local `Brdf` raises; what fails on the way
    raises `ServiceError`, `DeadlineError` or what the service says (see `Client`). Values are the same bits as local
    ones, float32 or float64, of angles and of vectors.

    Its attributes are listed at `Described`.
    """

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        connection = self._driver.connection
        self._ask(exchanges.evaluate(self.id, self.name, (theta_i, theta_o, delta_phi), out, connection))
        return True

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        # what a sum or a multiple asks, of vectors in float64 whatever the type of the values: a table looks up
        # their angles in that type, a formula takes the vectors and rounds at its end
        if self.facts.get("kind") != "model":
            super()._evaluate_vectors(wi, wo, out)
            return
        values = np.empty(out.shape)
        self._ask(exchanges.evaluate_vectors(self.id, self.name, wi, wo, values, self._driver.connection))
        with np.errstate(over="ignore", under="ignore"):  # float32 rounds a peak above 3e38 to inf, as a model does
            out[...] = values.astype(out.dtype, copy=False)

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        connection = self._driver.connection
        self._ask(exchanges.uncertainty(self.id, self.name, (theta_i, theta_o, delta_phi), out, connection))
        return True

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return self._ask(self._status_codes((theta_i, theta_o, delta_phi)))

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.asarray(self._ask(self._reflectances("delta_reflectance", theta_i)))

    def _albedo(
        self, theta_i: npt.ArrayLike, points: int, azimuths: int, tolerance: float | None, budget: int
    ) -> tuple[FloatArray, FloatArray]:
        # another integral than the service does is one of the values it gives
        if tolerance is not None or (points, azimuths) != (12, 64):
            return super()._albedo(theta_i, points, azimuths, tolerance, budget)
        values = self._ask(self._reflectances("values", theta_i))
        return values, np.full_like(values, np.nan)


class AsyncMaterial(Async, Described):
    """A material that a service evaluates; made by `AsyncClient.material` and `AsyncClient.table`.

    The methods of `RemoteBrdf`, same arguments, results, bits and errors, each to be awaited. No `Brdf`: the library's
    functions of a `Brdf` do not wait.
    """

    @question
    def status(
        self, theta_i: npt.ArrayLike, theta_o: npt.ArrayLike, delta_phi: npt.ArrayLike
    ) -> Exchange[npt.NDArray[np.uint8]]:
        """Where each value comes from: `Status` codes of the broadcast shape."""
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, theta_o, delta_phi), "nan")
        codes = yield from self._status_codes(angles[:3])
        if angles.outside is not None:
            codes = np.where(angles.outside, np.uint8(Status.OUTSIDE), codes)
        return codes.reshape(angles.shape)

    @question
    def uncertainty(
        self, theta_i: npt.ArrayLike, theta_o: npt.ArrayLike, delta_phi: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> Exchange[FloatArray]:
        """Half-widths of 95 % intervals of f_r; see `Brdf.uncertainty`."""
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, theta_o, delta_phi), outside)
        flat = np.empty((angles.theta_i.size, len(self.channels)), angles.theta_i.dtype)
        try:
            yield from exchanges.uncertainty(self.id, self.name, angles[:3], flat, self._driver.connection)
        except BrdfError as error:
            raise exchanges.in_shape(error, theta_i, theta_o, delta_phi) from error
        if angles.outside is not None:
            flat[angles.outside] = np.nan
        return flat.reshape((*angles.shape, len(self.channels)))

    @question
    def albedo(self, theta_i: npt.ArrayLike) -> Exchange[FloatArray]:
        """Directional-hemispherical reflectance, the delta part included; theta_i.shape + (channels,), float64."""
        return self._reflectances("values", theta_i)

    @question
    def delta_reflectance(self, theta_i: npt.ArrayLike) -> Exchange[FloatArray]:
        """Reflectance of the perfect mirror part; theta_i.shape + (channels,), float64."""
        return self._reflectances("delta_reflectance", theta_i)
