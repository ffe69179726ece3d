"""Directions drawn: what is asked and answered."""

from __future__ import annotations

from typing import Annotated

from brdf_service.schemas.base import Strict
from brdf_service.schemas.evaluate import Vectors
from pydantic import Field

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]


class SampleRequest(Strict):
    """Directions to draw for, and the numbers to draw by; one wi serves all."""

    wi: Vectors = Field(description="towards the light, normal +z, of any length", examples=[[0, 0, 1]])
    u: Pair | list[Pair] = Field(description="two numbers in [0, 1), or a list of pairs", examples=[[[0.25, 0.5]]])


class SampleAnswer(Strict):
    """One direction for each pair of wi and u."""

    wo: list[list[float]] = Field(description="unit vectors, normal +z")
    weight: list[list[float | None]] = Field(
        description="f_r cos theta_o / pdf: [point][channel]; the mean is the albedo"
    )
    pdf: list[float | None] = Field(description="density over solid angle, 1/sr; null where the mirror part was drawn")
    delta: list[bool] = Field(description="true where wo is the mirror direction of a perfect mirror part")
    channels: list[str | float] = Field(description="names of the channels, or their wavelengths in nm")
    id: str = Field(description="digest of everything the values depend on")
    has_delta: bool = Field(description="true if a perfect mirror part exists")
