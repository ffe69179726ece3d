"""Expansions in spherical harmonics, and surfaces lit through them."""

from __future__ import annotations

from typing import Any

from brdf_service.schemas.base import Strict, Vector
from pydantic import BaseModel, Field

import brdfcore as bc


class Norms(BaseModel):
    """Relative L2 errors over all pairs of directions."""

    target: float = Field(description="of what is expanded")
    f: float = Field(description="of f_r itself, which grazing angles rule")


class Spectrum(Strict):
    """Shares of the energy by degree."""

    light: list[float]
    viewer: list[float]


class HarmonicsAnswer(BaseModel):
    """An expansion in spherical harmonics of both directions."""

    lmax: int
    target: bc.names.Target
    window: dict[str, Any] = Field(description="its name, and what it does to a step: undershoot and l2")
    coefficients: int = Field(description="a channel, symmetric ones once")
    bytes: int
    larger_than_merl: bool
    bilateral: bool
    reciprocal: bool
    truncation: Norms = Field(description="what is left out, by Parseval")
    quadrature: Norms = Field(description="what sampling did to the coefficients")
    error_by_degree: list[float] = Field(description="of the target if it ended at degree 0, 1, ..., lmax")
    spectrum: Spectrum
    minimum: float = Field(description="smallest f_r found, 1/sr: negative where it rings")
    maximum: float
    minimum_at: list[float] = Field(description="theta_i, theta_o, delta_phi in degrees")
    id: str


class DirectionalLight(Strict):
    """A light at infinity."""

    direction: Vector = Field(description="towards the light", examples=[[1, 0, 1]])
    irradiance: float | list[float] = Field(description="on a surface that faces it; a number, or one a channel")


class RelightRequest(Strict):
    """Surfaces, views and light, all in one frame whose +z is the zenith of the map."""

    normals: list[Vector] = Field(min_length=1, examples=[[[0, 0, 1]]])
    views: list[Vector] = Field(min_length=1, description="one, or as many as normals", examples=[[[0, 0, 1]]])
    map: list[list[float]] | list[list[list[float]]] | None = Field(
        None, description="radiances [row][column], or [row][column][channel]; row 0 at the zenith"
    )
    lights: list[DirectionalLight] | None = None


class EnvironmentInShort(Strict):
    """What the coefficients of the map leave out of it."""

    lmax: int
    error: float = Field(description="relative L2 over the sphere")
    error_by_degree: list[float]


class RelightAnswer(Strict):
    """Radiance towards each view; 0 where it is below the surface."""

    radiance: list[list[float | None]] = Field(description="radiance[normal][channel]")
    channels: list[str | float]
    environment: EnvironmentInShort | None
    expansion: dict[str, Any] | None = Field(description="lmax, bytes and errors of the material's expansion")
    id: str
    has_delta: bool
