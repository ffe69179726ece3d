"""Lists of materials."""

from __future__ import annotations

from typing import Literal

from brdf_service.schemas.base import Strict
from brdf_service.schemas.evaluate import ErrorInShort
from pydantic import BaseModel, Field


class Fault(Strict):
    """Why a file of the data folder is not used."""

    code: str
    detail: str


class IncidenceError(BaseModel):
    """Measured error of a table under light from one angle."""

    theta_i: float = Field(description="radians, as the library's `Table.error` has them")
    l1: float | None = Field(description="misplaced energy, as a fraction of what is reflected there")
    l1_stderr: float | None
    albedo_ratio: list[float | None] = Field(description="albedo of the table over that of its source, by channel")
    albedo_error: float | None = Field(description="how far the albedo is off, as a fraction; of the worst channel")


class MeasuredError(ErrorInShort, extra="allow"):
    """All of it, as the library's `Table.error`; empty where there is none."""

    by_theta_i: list[IncidenceError] = Field([], description="by angle of incidence")
    between: list[IncidenceError] = Field([], description="the same at angles between those, where no node is")


class MaterialLine(BaseModel):
    """One material: either its facts, or `problem`."""

    name: str
    kind: Literal["table", "model"] | None = None
    id: str | None = None
    nbytes: int | None = Field(None, description="bytes a look-up touches; 0 for a model")
    channels: list[str | float] | None = None
    error: MeasuredError | None = None
    warnings: list[str] = Field([], description="what the reader of its file doubts, in sentences")
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
