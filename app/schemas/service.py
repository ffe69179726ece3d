"""How the service is, and every failure."""

from __future__ import annotations

from typing import Any, Literal

from brdf_service.schemas.base import Strict
from pydantic import Field


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
