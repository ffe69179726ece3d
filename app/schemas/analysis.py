"""What is said about a material: albedo, checks, gloss, slices."""

from __future__ import annotations

from typing import Any, Literal

from brdf_service.schemas.base import Strict, Unit
from pydantic import BaseModel, Field

import brdfcore as bc

Verdict = Literal["pass", "note", "fail"]


class AlbedoAnswer(Strict):
    """Fraction of the light that is reflected, the mirror part included."""

    theta_i: list[float]
    angles: Unit
    values: list[list[float | None]] = Field(description="values[theta_i][channel]")
    delta_reflectance: list[list[float]] = Field(description="the mirror part alone: [theta_i][channel]")
    channels: list[str | float]
    id: str
    has_delta: bool = Field(description="true if a perfect mirror part exists, which the values contain")


class WorstDirection(Strict):
    """Where a check found most; null: the finding is not about that angle."""

    theta_i: float | None
    theta_o: float | None
    delta_phi: float | None
    channel: str
    detail: str


class CheckFinding(Strict):
    """One check."""

    name: str = Field(description="energy, reciprocity, positivity, bilateral, normal or horizon")
    verdict: Verdict
    value: float | None = Field(description="misplaced reflectance of the worst channel; energy: albedo - 1")
    error: float | None = Field(description="standard error, or error of the quadrature, of the value")
    by_channel: list[float | None]
    relative: float | None = Field(description="the value as a fraction of the light that is reflected")
    declared: bool | None = Field(description="whether the material says that this holds; null: it says nothing")
    found: bool | None = Field(description="whether it holds")
    fails_above: float | None = Field(description="the value above which it fails whatever is declared")
    because: str = Field(description="why there")
    says: str = Field(description="a sentence for a person")
    worst: list[WorstDirection]


class ChecksAnswer(Strict):
    """Whether a material is physical."""

    verdict: Verdict = Field(description="the worst of all")
    unit: Literal["albedo"]
    angles: Unit = Field(description="unit of the worst directions")
    channels: list[str | float]
    albedo: float | None = Field(description="mean albedo of the channels for uniform light")
    directions: int
    seed: int
    findings: list[CheckFinding]
    id: str


class FittedParameter(Strict):
    """One parameter of a fitted model."""

    name: str
    value: float
    stderr: float | None
    low: float | None = Field(description="lower end of the 95 % interval; null: the data do not tell, see why")
    high: float | None
    why: str = Field(description="why there is no interval: at its bound, not identified, of a lobe that is not used")


class FitAnswer(Strict):
    """The analytic model nearest to a material, and what it loses."""

    terms: list[dict[str, Any]] = Field(description="their sum is the model, as in a model file")
    loss: dict[str, str | float] = Field(description="name and value of what was made small")
    l1: float = Field(description="share of the reflected energy that the model misplaces")
    l1_stderr: float | None = Field(description="its standard error; null: of measured points, over these")
    condition: float | None = Field(description="condition number of the problem, columns scaled to length 1")
    estimates: list[FittedParameter]
    correlated: list[dict[str, str | float]] = Field(description="parameters that the data hardly tell apart")
    angles: dict[str, list[float]] = Field(description="what it was fitted for, radians")
    remarks: list[str]
    id: str


class GlossGeometry(Strict):
    """A glossmeter's geometry, degrees: pairs are in the plane of incidence, and across it."""

    name: str
    theta: float
    source: list[float]
    receptor: list[float]
    offsets: list[float] = Field(description="of the receptor's centre from the mirror direction; fluxes are added")


class GlossReading(Strict):
    """What one geometry reads, in gloss units."""

    geometry: GlossGeometry
    values: list[float | None] = Field(description="by channel")
    error: list[float | None] = Field(description="of the integration, by channel")
    of_delta: list[float | None] = Field(description="the part of the values that the perfect mirror part gives")
    luminance: float | None
    luminance_error: float | None
    reference: float = Field(description="reflectance of the black glass")
    evaluations: int
    converged: bool = Field(description="whether the error is within the tolerance")


class HazeIndex(Strict):
    """A difference of gloss readings, in gloss units."""

    values: list[float | None]
    error: list[float | None]
    luminance: float | None
    luminance_error: float | None


class Haze(Strict):
    """Haze by standard."""

    astm_d4039: HazeIndex = Field(description="G60 - G20")
    astm_e430: GlossReading = Field(description="beside the 20 degree image")


class GlossAnswer(Strict):
    """Gloss and haze."""

    channels: list[str | float]
    unit: Literal["GU"]
    angles: Literal["deg"]
    gloss: dict[str, GlossReading]
    haze: Haze
    luminance_of: str = Field(description="what the luminance is of, or why there is none")
    reference_ior: float
    tolerance: float
    standards: list[str]
    id: str


class SliceAnswer(BaseModel):
    """f_r over a slice; what each array's axes are depends on the view."""

    view: bc.names.View
    angles: Unit
    unit: Literal["1/sr"]
    channels: list[str | float]
    theta_i: list[float]
    theta_o: list[Any] = Field(description="polar: [theta_i][direction], signed; hemisphere: [row]")
    delta_phi: list[Any] = Field(description="polar: [theta_i][direction]; hemisphere: [column]")
    values: list[list[list[float | None]]] = Field(
        description="polar: [theta_i][direction][channel]; hemisphere: [row][column][channel]"
    )
