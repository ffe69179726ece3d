"""What takes a while: options of tabulate, models to store, reports, and the jobs that make them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from brdf_service.schemas.base import Strict
from pydantic import AfterValidator, Field, WithJsonSchema

import brdfcore as bc

#: pi/2 in float32, which `tabulate` takes for the horizon.
_HORIZON = float(np.float32(np.pi / 2))


def _of_polar_angles(given: list[float]) -> list[float]:
    """As `brdfcore.tabulate` refuses it, but before there is a job."""
    if len(given) != 2 or not 0 <= given[0] < given[1] <= _HORIZON:
        raise ValueError(f"got {str(given)[:60]}; expected [from, to] in radians, 0 <= from < to <= pi/2")
    return given


Range = Annotated[
    list[float],
    AfterValidator(_of_polar_angles),
    WithJsonSchema(
        {
            "type": "array",
            "items": {"type": "number", "minimum": 0, "maximum": _HORIZON},
            "minItems": 2,
            "maxItems": 2,
            "examples": [[0, 1.2]],
        }
    ),
]


class TabulateOptions(Strict):
    """What `brdfcore.tabulate` is asked for."""

    representation: str = Field("auto", max_length=64, description="name of a representation, or auto")
    tolerance: float | None = Field(None, gt=0, allow_inf_nan=False, description="error to reach (L1)")
    max_bytes: int | None = Field(None, gt=0, le=2**40, description="the smallest error within so many bytes")
    shape: list[Annotated[int, Field(ge=2, le=2**31)]] | None = Field(
        None, min_length=1, max_length=8, description="nodes per axis, both ends included"
    )
    interpolation: bc.names.Interpolation = Field(
        "linear", description="between the nodes, if the representation offers it"
    )
    negatives: Literal["keep", "zero"] = Field("keep", description="negative values of the source")
    fold: list[Literal["bilateral", "reciprocal"]] | None = Field(
        None, max_length=2, description="average over a symmetry that the source does not have"
    )
    light: Range | None = Field(
        None, description="theta_i from, to, radians, that the table is made for; its error is measured there"
    )
    view: Range | None = Field(None, description="the same of theta_o")


class ModelTerm(Strict):
    """One model of a sum."""

    model: str = Field(max_length=64, description="name of a model", examples=["cook_torrance"])
    parameters: dict[str, Any] = Field({}, examples=[{"roughness": 0.2, "ior": "gold"}])


class MaterialModel(Strict):
    """A model and its parameters, or a sum of models."""

    model: str | None = Field(None, max_length=64, description="name of a model", examples=["cook_torrance"])
    parameters: dict[str, Any] = Field({}, examples=[{"roughness": 0.2, "ior": "gold"}])
    sum: list[ModelTerm] | None = Field(None, min_length=1, max_length=8, description="models, instead of one")
    about: str = Field("", max_length=1000, description="a sentence for people")
    tabulate: TabulateOptions | None = Field(None, description="store a table of it instead of the model itself")

    @property
    def described(self) -> dict[str, Any]:
        """As `brdfcore.model_from_json` takes it."""
        return self.model_dump(include={"sum"} if self.sum is not None else {"model", "parameters"})


class ParetoRequest(Strict):
    """What the representations of a material are weighed for."""

    tolerance: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="error (L1) that is right enough: 0.01"
    )
    max_bytes: int | None = Field(None, gt=0, le=2**40, description="nothing larger is chosen")
    seconds: float = Field(60.0, ge=1, le=240, description="about how long it may take; fewer sizes are tried in less")


class JobProgress(Strict):
    """How far."""

    done: int
    total: int
    stage: str


class JobProblem(Strict):
    """Why a job failed."""

    status: int
    code: str
    detail: str


class JobAnswer(Strict):
    """A job."""

    id: str
    kind: Literal["upload", "import", "tabulate", "pareto"]
    material: str
    state: Literal["receiving", "queued", "running", "done", "failed", "cancelled"]
    progress: JobProgress
    ahead: int = Field(description="jobs that come before it")
    created: str
    finished: str | None
    problem: JobProblem | None
    result: dict[str, Any] | None = Field(
        description="once it is done: id, bytes and measured error of the material; of a report its materials"
    )
    links: dict[str, str]


class JobList(Strict):
    """Jobs, the newest first."""

    jobs: list[JobAnswer]
