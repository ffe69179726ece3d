"""A material of a service for asyncio: what a `RemoteBrdf` answers, to be awaited."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.conventions import FloatArray, Outside
from brdfcore.base.errors import BrdfError
from brdfcore.base.status import Status
from brdfcore.client import exchanges
from brdfcore.client.connection import Connection
from brdfcore.client.described import Described
from brdfcore.client.exchanges import Exchange
from brdfcore.client.material import Channel, Scale, View

AsyncRun = Callable[[Exchange[Any]], Awaitable[Any]]


class AsyncMaterial(Described):
    """A material that a service evaluates; made by `AsyncClient.material` and `AsyncClient.table`.

    The methods of `RemoteBrdf`, same arguments, results, bits and errors, each to be awaited. No `Brdf`: the library's
    functions of a `Brdf` do not wait.
    """

    def __init__(self, run: AsyncRun, connection: Connection, facts: Mapping[str, Any]) -> None:
        self._run = run
        self._adopt(connection, facts)

    async def evaluate(
        self,
        theta_i: npt.ArrayLike,
        theta_o: npt.ArrayLike,
        delta_phi: npt.ArrayLike,
        *,
        out: FloatArray | None = None,
        outside: Outside = "raise",
    ) -> FloatArray:
        """f_r in 1/sr, shape broadcast(theta_i, theta_o, delta_phi) + (channels,); see `Brdf.evaluate`."""
        angles = conventions.flatten_angles(theta_i, theta_o, delta_phi)
        values = conventions.prepare_out(out, (*angles.shape, len(self.channels)), angles.theta_i.dtype)
        angles = conventions.check_domain(angles, outside)
        try:
            flat = await self._evaluate(*angles[:3])
        except BrdfError as error:
            raise exchanges.in_shape(error, theta_i, theta_o, delta_phi) from error
        if angles.outside is not None:
            flat[angles.outside] = np.nan
        values[...] = flat.reshape(values.shape)
        return values

    async def evaluate_vectors(
        self, wi: npt.ArrayLike, wo: npt.ArrayLike, *, out: FloatArray | None = None
    ) -> FloatArray:
        """f_r in 1/sr from directions of shape (..., 3); see `Brdf.evaluate_vectors` and `RemoteBrdf`."""
        vectors = conventions.flatten_vectors(wi, wo)
        values = conventions.prepare_out(out, (*vectors.shape, len(self.channels)), vectors.dtype)
        flat = np.empty((vectors.wi.shape[0], len(self.channels)), vectors.dtype)
        wi_sent, wo_sent = self._as_given(wi, wo, vectors)
        await self._run(exchanges.evaluate_vectors(self.id, self.name, wi_sent, wo_sent, flat, self._connection))
        values[...] = flat.reshape(values.shape)
        return values

    async def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> FloatArray:
        flat = np.empty((theta_i.size, len(self.channels)), theta_i.dtype)
        await self._run(exchanges.evaluate(self.id, self.name, (theta_i, theta_o, delta_phi), flat, self._connection))
        return flat

    async def status(
        self, theta_i: npt.ArrayLike, theta_o: npt.ArrayLike, delta_phi: npt.ArrayLike
    ) -> npt.NDArray[np.uint8]:
        """Where each value comes from: `Status` codes of the broadcast shape."""
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, theta_o, delta_phi), "nan")
        codes = await self._run(exchanges.status(self.id, angles[:3], len(self.channels), self._connection))
        if angles.outside is not None:
            codes = np.where(angles.outside, np.uint8(Status.OUTSIDE), codes)
        return np.asarray(codes, np.uint8).reshape(angles.shape)

    async def albedo(self, theta_i: npt.ArrayLike) -> FloatArray:
        """Directional-hemispherical reflectance, the delta part included; theta_i.shape + (channels,), float64."""
        return await self._reflectances("values", theta_i)

    async def delta_reflectance(self, theta_i: npt.ArrayLike) -> FloatArray:
        """Reflectance of the perfect mirror part; theta_i.shape + (channels,), float64."""
        return await self._reflectances("delta_reflectance", theta_i)

    async def _reflectances(self, name: str, theta_i: npt.ArrayLike) -> FloatArray:
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, 0.0, 0.0))
        thetas = np.minimum(angles.theta_i.astype(np.float64), conventions.HALF_PI)
        shape = (*angles.shape, len(self.channels))
        if name == "delta_reflectance" and not self.has_delta:
            return np.zeros(shape)
        found = await self._run(exchanges.reflectances(self.id, name, thetas, len(self.channels)))
        return np.asarray(found).reshape(shape)

    async def checks(self) -> dict[str, Any]:
        """What `bc.check` finds, computed by the service, as its JSON (`verdict`, `findings`); angles in radians."""
        found: dict[str, Any] = await self._run(exchanges.analysis(self.id, "checks", {"angles": "rad"}))
        return found

    async def gloss(self) -> dict[str, Any]:
        """What `bc.gloss` reads, computed by the service, as its JSON: `gloss` by angle, `haze`, in gloss units."""
        found: dict[str, Any] = await self._run(exchanges.analysis(self.id, "gloss"))
        return found

    async def harmonics(self, lmax: int = 32, *, target: str = "f_cos_cos", window: str = "none") -> dict[str, Any]:
        """What `bc.harmonic_summary` tells of an expansion to degree lmax, made by the service: errors, spectrum."""
        query = {"lmax": lmax, "target": target, "window": window}
        found: dict[str, Any] = await self._run(exchanges.analysis(self.id, "harmonics", query))
        return found

    async def import_report(self) -> dict[str, Any]:
        """What reading its source found and did, as `Brdf.report` of a local one; nearly empty for a model."""
        found: dict[str, Any] = await self._run(exchanges.import_report(self.id))
        return found

    async def sphere(self, light: str = "studio", *, size: int = 460, channel: Channel = None) -> bytes:
        """A lit sphere as PNG, `size` pixels wide, under "studio" or "sky" light."""
        found: bytes = await self._run(exchanges.sphere(self.id, light, size, channel))
        return found

    async def relight(
        self,
        normals: npt.ArrayLike,
        views: npt.ArrayLike,
        *,
        map: npt.ArrayLike | None = None,
        lights: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]] = (),
        lmax: int = 32,
    ) -> FloatArray:
        """Radiance towards `views`, broadcast shape + (channels,), float64; see `RemoteBrdf.relight`."""
        found: FloatArray = await self._run(exchanges.relight(self.id, normals, views, map, lights, lmax))
        return found

    @overload
    async def slice(
        self, theta_i: npt.ArrayLike, *, view: View = ..., format: Literal["json"] = ..., channel: Channel = ...
    ) -> dict[str, Any]: ...

    @overload
    async def slice(
        self,
        theta_i: npt.ArrayLike,
        *,
        view: View = ...,
        format: Literal["svg", "png", "csv"],
        channel: Channel = ...,
        scale: Scale | None = ...,
    ) -> bytes: ...

    async def slice(
        self,
        theta_i: npt.ArrayLike,
        *,
        view: View = "polar",
        format: Literal["json", "svg", "png", "csv"] = "json",
        channel: Channel = None,
        scale: Scale | None = None,
    ) -> dict[str, Any] | bytes:
        """A slice as numbers in radians or as a picture; see `RemoteBrdf.slice`."""
        result: dict[str, Any] | bytes = await self._run(
            exchanges.slice(self.id, theta_i, format, view=view, channel=channel, scale=scale)
        )
        return result
