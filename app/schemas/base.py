"""What all of them share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

import brdfcore as bc

Unit = bc.names.AngleUnit
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]


class Strict(BaseModel):
    """No field beside those listed."""

    model_config = ConfigDict(extra="forbid")
