"""f_r at directions: what is asked and answered."""

from __future__ import annotations

from typing import Annotated, Literal

from brdf_service.schemas.base import Strict, Unit, Vector
from pydantic import Field

Angle = Annotated[float | list[float], Field(description="a number, or a list of them; lists broadcast as in numpy")]
Vectors = Annotated[Vector | list[Vector], Field(description="a direction [x, y, z], or a list of them")]


class EvaluateRequest(Strict):
    """Directions to evaluate at."""

    theta_i: Angle = Field(description="polar angle of the light, from the normal, up to 90 degrees", examples=[30])
    theta_o: Angle = Field(
        description="polar angle of the viewer, from the normal, up to 90 degrees", examples=[[0, 30, 60]]
    )
    delta_phi: Angle = Field(description="phi_o - phi_i; the mirror direction is at 180 degrees", examples=[180])
    angles: Unit = Field("deg", description="unit of the angles")


class EvaluateVectors(Strict):
    """Directions to evaluate at as vectors, the normal being +z; they need not be of unit length."""

    wi: Vectors = Field(description="towards the light", examples=[[0, 0, 1]])
    wo: Vectors = Field(description="towards the viewer", examples=[[[0, 0, 1], [0.5, 0, 0.8]]])


class ErrorInShort(Strict):
    """Measured error of a table. Absent fields: not measured, or nothing to measure because the values are exact."""

    l1: float | None = Field(None, description="misplaced energy, as a fraction of the reflected energy")
    l1_stderr: float | None = Field(None, description="standard error of l1")
    warnings: list[str] = Field([], description="sentences for a person, if the table is bad")


class EvaluateAnswer(Strict):
    """f_r at each point, without the cosine."""

    values: list[list[float | None]] = Field(description="values[point][channel]; null where a value is not finite")
    channels: list[str | float] = Field(description="names of the channels, or their wavelengths in nm")
    unit: Literal["1/sr"]
    angles: Unit | None = Field(None, description="unit that the request's angles were read in; absent for vectors")
    id: str = Field(description="digest of everything the values depend on")
    error: ErrorInShort | None = Field(
        None,
        description="measured error of the table against its source; empty if there is none. Absent from a GET by id, "
        "which is kept for ever: the metadata has it",
    )
    has_delta: bool = Field(description="true if a perfect mirror part exists, which the values leave out")
    status: list[int] | None = Field(None, description="with status=true: where each point's value comes from")
    status_names: list[str] | None = Field(None, description="what the numbers in status mean: names by position")
    uncertainty: list[list[float | None]] | None = Field(
        None,
        description="with uncertainty=true: half-width of the 95 % interval of each value, 1/sr: [point][channel]",
    )
