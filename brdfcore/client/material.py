"""A material of a service as a `Brdf`: the same signature and the same bits, evaluated there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray, Outside
from brdfcore.base.errors import BrdfError
from brdfcore.client import exchanges
from brdfcore.client.connection import Connection
from brdfcore.client.described import Described
from brdfcore.client.exchanges import Exchange

View = Literal["polar", "hemisphere"]
Scale = Literal["linear", "log"]
Channel = str | float | None
Run = Callable[[Exchange[Any]], Any]


class RemoteBrdf(Described, Brdf):
    """A material that a service evaluates; made by `Client.material` and `Client.table`.

    It is the state of the material at that moment: questions go to its `id`, so that one object never answers from
    two tables. Once the material is replaced or deleted they end in `UnknownNameError`; ask the client for it again.

    Arguments are checked here, before anything is sent, and raise what a local `Brdf` raises; what fails on the way
    raises `ServiceError`, `DeadlineError` or what the service says (see `Client`). Values are the same bits as local
    ones, float32 or float64, of angles and of vectors.

    Its attributes are listed at `Described`.
    """

    def __init__(self, run: Run, connection: Connection, facts: Mapping[str, Any]) -> None:
        Brdf.__init__(self)
        self._run = run
        self._adopt(connection, facts)

    def evaluate(
        self,
        theta_i: npt.ArrayLike,
        theta_o: npt.ArrayLike,
        delta_phi: npt.ArrayLike,
        *,
        out: FloatArray | None = None,
        outside: Outside = "raise",
    ) -> FloatArray:
        """As `Brdf.evaluate`. Large batches go in several requests, with a bar on a terminal."""
        try:
            return super().evaluate(theta_i, theta_o, delta_phi, out=out, outside=outside)
        except BrdfError as error:
            raise exchanges.in_shape(error, theta_i, theta_o, delta_phi) from error

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        self._run(exchanges.evaluate(self.id, self.name, (theta_i, theta_o, delta_phi), out, self._connection))
        return True

    def evaluate_vectors(self, wi: npt.ArrayLike, wo: npt.ArrayLike, *, out: FloatArray | None = None) -> FloatArray:
        """As `Brdf.evaluate_vectors`: the directions are sent as they are."""
        vectors = conventions.flatten_vectors(wi, wo)
        values = conventions.prepare_out(out, (*vectors.shape, len(self.channels)), vectors.dtype)
        flat = np.empty((vectors.wi.shape[0], len(self.channels)), vectors.dtype)
        self._send_vectors(*self._as_given(wi, wo, vectors), flat)
        values[...] = flat.reshape(values.shape)
        return values

    def _evaluate_vectors(self, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64], out: FloatArray) -> None:
        # what a sum or a multiple asks, of unit vectors in float64 whatever the type of the values: a table looks up
        # their angles in that type, a formula takes the vectors and rounds at its end
        if self.facts.get("kind") != "model":
            super()._evaluate_vectors(wi, wo, out)
            return
        values = np.empty(out.shape)
        self._send_vectors(wi, wo, values)
        with np.errstate(over="ignore", under="ignore"):  # float32 rounds a peak above 3e38 to inf, as a model does
            out[...] = values.astype(out.dtype, copy=False)

    def _send_vectors(self, wi: FloatArray, wo: FloatArray, out: FloatArray) -> None:
        self._run(exchanges.evaluate_vectors(self.id, self.name, wi, wo, out, self._connection))

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        codes = self._run(
            exchanges.status(self.id, (theta_i, theta_o, delta_phi), len(self.channels), self._connection)
        )
        return np.asarray(codes, np.uint8)

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if not self.has_delta:
            return super()._delta_reflectance(theta_i)
        values = self._run(exchanges.reflectances(self.id, "delta_reflectance", theta_i, len(self.channels)))
        return np.asarray(values)

    def _albedo(
        self, theta_i: npt.ArrayLike, points: int, azimuths: int, tolerance: float | None, budget: int
    ) -> tuple[FloatArray, FloatArray]:
        # another integral than the service does is one of the values it gives
        if tolerance is not None or (points, azimuths) != (12, 64):
            return super()._albedo(theta_i, points, azimuths, tolerance, budget)
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, 0.0, 0.0))
        thetas = np.minimum(angles.theta_i.astype(np.float64), conventions.HALF_PI)
        flat = self._run(exchanges.reflectances(self.id, "values", thetas, len(self.channels)))
        values = np.asarray(flat).reshape((*angles.shape, len(self.channels)))
        return values, np.full_like(values, np.nan)

    def checks(self) -> dict[str, Any]:
        """What `bc.check` finds, computed by the service, as its JSON (`verdict`, `findings`); angles in radians."""
        found: dict[str, Any] = self._run(exchanges.analysis(self.id, "checks", {"angles": "rad"}))
        return found

    def gloss(self) -> dict[str, Any]:
        """What `bc.gloss` reads, computed by the service, as its JSON: `gloss` by angle, `haze`, in gloss units."""
        found: dict[str, Any] = self._run(exchanges.analysis(self.id, "gloss"))
        return found

    def harmonics(self, lmax: int = 32, *, target: str = "f_cos_cos", window: str = "none") -> dict[str, Any]:
        """What `bc.harmonic_summary` tells of an expansion to degree lmax, made by the service: errors, spectrum."""
        query = {"lmax": lmax, "target": target, "window": window}
        found: dict[str, Any] = self._run(exchanges.analysis(self.id, "harmonics", query))
        return found

    def import_report(self) -> dict[str, Any]:
        """What reading its source found and did, as `Brdf.report` of a local one; nearly empty for a model."""
        found: dict[str, Any] = self._run(exchanges.import_report(self.id))
        return found

    def sphere(self, light: str = "studio", *, size: int = 460, channel: Channel = None) -> bytes:
        """A lit sphere as PNG, `size` pixels wide, under "studio" or "sky" light."""
        found: bytes = self._run(exchanges.sphere(self.id, light, size, channel))
        return found

    def relight(
        self,
        normals: npt.ArrayLike,
        views: npt.ArrayLike,
        *,
        map: npt.ArrayLike | None = None,
        lights: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]] = (),
        lmax: int = 32,
    ) -> FloatArray:
        """Radiance that surfaces send towards the views, computed by the service: what `bc.relight` gives.

        normals, views  (..., 3), away from the surface, in the frame of the light (+z the zenith); they broadcast.
        map             equirectangular radiances (rows, columns) or (rows, columns, channels), row 0 at the zenith;
                        reflected through spherical harmonics to degree lmax. It travels as JSON: some 20 bytes a value.
        lights          (direction, irradiance on a plane that faces it) of directional lights, reflected exactly.

        Returns float64, broadcast shape + (channels,); 0 where the view is below the surface.
        """
        found: FloatArray = self._run(exchanges.relight(self.id, normals, views, map, lights, lmax))
        return found

    @overload
    def slice(
        self, theta_i: npt.ArrayLike, *, view: View = ..., format: Literal["json"] = ..., channel: Channel = ...
    ) -> dict[str, Any]: ...

    @overload
    def slice(
        self,
        theta_i: npt.ArrayLike,
        *,
        view: View = ...,
        format: Literal["svg", "png", "csv"],
        channel: Channel = ...,
        scale: Scale | None = ...,
    ) -> bytes: ...

    def slice(
        self,
        theta_i: npt.ArrayLike,
        *,
        view: View = "polar",
        format: Literal["json", "svg", "png", "csv"] = "json",
        channel: Channel = None,
        scale: Scale | None = None,
    ) -> dict[str, Any] | bytes:
        """A slice of the material: numbers in radians (json: a dict; csv: bytes), or a picture (svg, png: bytes).

        theta_i  polar angles of the light, radians; exactly one for view="hemisphere".
        view     "polar": the plane of incidence, theta_o positive on the mirror side; "hemisphere": all directions.
        scale    "linear" or "log", pictures only.
        channel  name, wavelength in nm or position; default: the picture's choice, or all of them as numbers.
        """
        result: dict[str, Any] | bytes = self._run(
            exchanges.slice(self.id, theta_i, format, view=view, channel=channel, scale=scale)
        )
        return result
