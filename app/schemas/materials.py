"""Lists of materials."""

from __future__ import annotations

from typing import Any, Literal

from brdf_service.schemas.base import Strict
from pydantic import BaseModel, Field


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
