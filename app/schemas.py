"""What goes in and out, as types: they make the OpenAPI true and the tests hold every answer to them.

The handlers do not run them: a validator that touches each of a million floats would cost more than the look-ups.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

import brdfcore as bc

Unit = Literal["deg", "rad"]
Angle = Annotated[float | list[float], Field(description="a number, or a list of them; lists broadcast as in numpy")]


Direction = Annotated[list[float], Field(min_length=3, max_length=3)]
Vectors = Annotated[Direction | list[Direction], Field(description="a direction [x, y, z], or a list of them")]


class Strict(BaseModel):
    """No field beside those listed."""

    model_config = ConfigDict(extra="forbid")


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


Verdict = Literal["pass", "note", "fail"]


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


#: What the representations offer, each once.
_INTERPOLATIONS = dict.fromkeys(
    choice
    for parameters in bc.representations().values()
    for parameter in parameters
    if parameter.name == "interpolation"
    for choice in parameter.choices
)


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
    target: Literal["f_cos_cos", "f", "f_cos_o"]
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


Vector = Annotated[list[float], Field(min_length=3, max_length=3)]


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


class TabulateOptions(Strict):
    """What `brdfcore.tabulate` is asked for."""

    representation: str = Field("auto", max_length=64, description="name of a representation, or auto")
    tolerance: float | None = Field(None, gt=0, allow_inf_nan=False, description="error to reach (L1)")
    max_bytes: int | None = Field(None, gt=0, le=2**40, description="the smallest error within so many bytes")
    shape: list[Annotated[int, Field(ge=2, le=2**31)]] | None = Field(
        None, min_length=1, max_length=8, description="nodes per axis, both ends included"
    )
    interpolation: str = Field(
        "linear",
        max_length=64,
        pattern=f"^(?:{'|'.join(_INTERPOLATIONS)})$",
        description="between the nodes, if the representation offers it",
        json_schema_extra={"enum": list(_INTERPOLATIONS)},
    )
    negatives: Literal["keep", "zero"] = Field("keep", description="negative values of the source")
    fold: list[Literal["bilateral", "reciprocal"]] | None = Field(
        None, max_length=2, description="average over a symmetry that the source does not have"
    )


class MaterialModel(Strict):
    """A model and its parameters."""

    model: str = Field(max_length=64, description="name of a model", examples=["cook_torrance"])
    parameters: dict[str, Any] = Field({}, examples=[{"roughness": 0.2, "ior": "gold"}])
    about: str = Field("", max_length=1000, description="a sentence for people")
    tabulate: TabulateOptions | None = Field(None, description="store a table of it instead of the model itself")


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
    kind: Literal["upload", "tabulate", "pareto"]
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


class SliceAnswer(BaseModel):
    """f_r over a slice; what each array's axes are depends on the view."""

    view: Literal["polar", "hemisphere"]
    angles: Unit
    unit: Literal["1/sr"]
    channels: list[str | float]
    theta_i: list[float]
    theta_o: list[Any] = Field(description="polar: [theta_i][direction], signed; hemisphere: [row]")
    delta_phi: list[Any] = Field(description="polar: [theta_i][direction]; hemisphere: [column]")
    values: list[list[list[float | None]]] = Field(
        description="polar: [theta_i][direction][channel]; hemisphere: [row][column][channel]"
    )


class Fault(Strict):
    """Why a file of the data folder is not used."""

    code: str
    detail: str


class MaterialLine(BaseModel):
    """One material: either its facts, or `problem`."""

    name: str
    kind: Literal["table", "model"] | None = None
    id: str | None = None
    nbytes: int | None = Field(None, description="bytes a look-up touches; 0 for a model")
    channels: list[str | float] | None = None
    error: dict[str, Any] | None = None
    problem: Fault | None = Field(None, description="present if the file cannot be used")
    links: dict[str, str] = Field(description="paths of this material's answers")


class MaterialList(Strict):
    """A page of the list."""

    materials: list[MaterialLine]
    total: int
    offset: int
    limit: int
    next: str | None = Field(description="path of the next page")
    skipped: list[str] = Field(description="files whose names cannot be addressed, and are therefore not served")


class Live(Strict):
    """The process answers."""

    status: Literal["live"]
    version: str


class Ready(Strict):
    """The kernels are compiled: no request waits for a compiler."""

    status: Literal["ready"]
    version: str


class ProblemEntry(Strict):
    """Where and what."""

    where: str | None = Field(None, description="argument, field or header")
    index: list[int] | None = Field(None, description="position in the list that the request gave")
    got: Any = Field(None, description="the offending value, cut to 80 characters")
    expected: Any = None
    limit: int | None = None
    hint: str | None = None
    offset: int | None = Field(None, description="position in the body")


class Problem(Strict):
    """Every failure, after RFC 9457."""

    type: str
    title: str
    status: int
    code: str = Field(description="stable name of the problem")
    detail: str = Field(description="what, where, expected, what to do")
    errors: list[ProblemEntry]
    request_id: str = Field(description="the X-Request-Id of the answer, to be found in the log")


SCHEMAS: tuple[type[BaseModel], ...] = (
    EvaluateRequest,
    EvaluateVectors,
    EvaluateAnswer,
    AlbedoAnswer,
    ChecksAnswer,
    GlossAnswer,
    HarmonicsAnswer,
    RelightRequest,
    RelightAnswer,
    MaterialModel,
    ParetoRequest,
    JobAnswer,
    SliceAnswer,
    MaterialLine,
    MaterialList,
    Live,
    Ready,
    Problem,
)
