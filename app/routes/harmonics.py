"""Expansions in spherical harmonics: their errors as JSON, and as a picture."""

from __future__ import annotations

from functools import partial

import numpy as np
from anyio.to_thread import run_sync
from brdf_service.evaluate.directions import polar_angles
from brdf_service.http.json import to_json
from brdf_service.http.query import ANGLES, Flag, Numbers, Query, Unit, WholeNumber, numbers
from brdf_service.library.materials import Material
from brdf_service.routes.address import Found
from brdf_service.routes.pictures import PNG, SVG, Channel
from brdf_service.routes.resource import Draw, Resource, explained
from brdf_service.schemas.harmonics import HarmonicsAnswer
from brdf_service.state import State
from brdf_service.work.expansions import Degree, check_lmax, projection_seconds
from brdf_service.work.stoppable import run_stoppable
from pydantic import Field
from starlette.requests import Request

import brdfcore as bc


class HarmonicsQuery(Query):
    """An expansion."""

    lmax: WholeNumber = Field(32, ge=1, le=10**6, description="largest degree of the expansion")
    target: bc.names.Target = Field(
        "f_cos_cos",
        description="what is expanded: f_r times the cosines of both directions, f_r, or f_r times that of the viewer",
    )
    window: bc.names.Window = Field("none", description="factors of the coefficients against ringing")
    symmetrise: Flag = Field(False, description="true: only the reciprocal part of a source that is not reciprocal")

    @property
    def degree(self) -> Degree:
        """What the cache of expansions is asked for."""
        return Degree(self.lmax, self.target, self.window, self.symmetrise)


class HarmonicsPictureQuery(HarmonicsQuery):
    """An expansion over slices of the original."""

    theta_i: Numbers | None = numbers(
        "polar angles of the light of the slices, one to four; default: 0, 30 and 60 degrees", default=None
    )
    channel: Channel = Field(None, description="name, wavelength in nm or position of one channel")
    angles: Unit = ANGLES


async def expanded(request: Request, state: State, material: Material, asked: Degree) -> bc.HarmonicExpansion:
    """The expansion, made where it is not kept: one at a time, and only as long as its client waits."""
    return await run_stoppable(request, partial(state.expansions.get, material, asked), state.projecting)


def _check(state: State, asked: HarmonicsQuery) -> None:
    check_lmax(asked.lmax, state.settings.max_lmax)


async def _summary(request: Request, state: State, found: Found, asked: HarmonicsQuery, _: str) -> bytes:
    made = await expanded(request, state, found.material, asked.degree)
    return await run_sync(lambda: to_json({**bc.harmonic_summary(made), "id": found.material.id}), limiter=state.large)


def _drawn(format: str) -> Draw:
    async def draw(request: Request, state: State, found: Found, asked: HarmonicsPictureQuery, etag: str) -> bytes:
        if etag not in state.drawing:
            # not among those who draw: they would wait for a projection
            await expanded(request, state, found.material, asked.degree)
        return await state.drawing.made(etag, partial(_picture, state, found, asked, format))

    return draw


def _picture(state: State, found: Found, asked: HarmonicsPictureQuery, format: str) -> bytes:
    made = state.expansions.get(found.material, asked.degree)
    given = asked.theta_i
    theta_i = np.radians([0.0, 30.0, 60.0]) if given is None else polar_angles(given, asked.angles).radians()[0]
    try:
        figure = bc.plot.expansion(found.material.brdf, made, theta_i, channel=asked.channel, title=found.title)
    except bc.InputError as error:
        raise explained(error, asked) from error
    drawn: bytes = bc.plot.render(figure, format)
    return drawn


HARMONICS = (
    Resource(
        "harmonics",
        "errors of an expansion in spherical harmonics",
        HarmonicsQuery,
        HarmonicsAnswer,
        "Relative L2 error of what is left out at each degree (Parseval), at the last one also that of f_r itself; the "
        "spectrum; the smallest value; the bytes of the coefficients.",
        "the expansion",
        draw=_summary,
        check=_check,
        seconds=lambda channels, asked: projection_seconds(channels, asked.lmax),
        example="lmax=16",
    ),
    *(
        Resource(
            f"harmonics.{format}",
            f"an expansion in spherical harmonics as {format.upper()}",
            HarmonicsPictureQuery,
            media_type,
            "Error by degree, spectrum, and slices over the original, where it rings.",
            "the picture",
            draw=_drawn(format),
            check=_check,
            seconds=lambda channels, asked: projection_seconds(channels, asked.lmax),
            title="spherical harmonics" if format == "svg" else "",
        )
        for format, media_type in (("png", PNG), ("svg", SVG))
    ),
)
