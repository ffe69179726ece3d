"""What goes in and out, as types: they make the OpenAPI true and the tests hold every answer to them.

The handlers do not run them: a validator that touches each of a million floats would cost more than the look-ups.
"""

from __future__ import annotations

from brdf_service.schemas.analysis import AlbedoAnswer, ChecksAnswer, GlossAnswer, SliceAnswer
from brdf_service.schemas.evaluate import EvaluateAnswer, EvaluateRequest, EvaluateVectors
from brdf_service.schemas.harmonics import HarmonicsAnswer, RelightAnswer, RelightRequest
from brdf_service.schemas.materials import MaterialLine, MaterialList
from brdf_service.schemas.service import Live, Problem, Ready
from brdf_service.schemas.work import JobAnswer, MaterialModel, ParetoRequest, TabulateOptions
from pydantic import BaseModel

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

__all__ = [
    "SCHEMAS",
    "AlbedoAnswer",
    "ChecksAnswer",
    "EvaluateAnswer",
    "EvaluateRequest",
    "EvaluateVectors",
    "GlossAnswer",
    "HarmonicsAnswer",
    "JobAnswer",
    "Live",
    "MaterialLine",
    "MaterialList",
    "MaterialModel",
    "ParetoRequest",
    "Problem",
    "Ready",
    "RelightAnswer",
    "RelightRequest",
    "SliceAnswer",
    "TabulateOptions",
]
