"""What a report holds of each material."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brdfcore.analysis.pareto.pareto import Pareto
from brdfcore.base.brdf import Brdf
from brdfcore.reporting import words
from brdfcore.reporting.appearance import Appearance
from brdfcore.reporting.error_map import ErrorMap


@dataclass(frozen=True)
class Subject:
    """One material of a report: what it is called, how a shell names it, and the file it comes from, if any."""

    label: str
    brdf: Brdf
    source: str = ""
    path: Path | None = None


@dataclass
class Item:
    """What is known of one material.

    shown       what pictures compare with the reference: what was chosen; the best table where that is the formula.
    table_path  where the table was written; None: not asked for, or none is right enough.
    verified    of that table, read again, on other directions: `build.judge.verified`.
    """

    subject: Subject
    found: Pareto
    shown: Brdf
    shown_name: str
    look: Appearance
    where: ErrorMap
    table_path: Path | None = None
    verified: dict[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        head = self.found.to_json()
        return {
            **head,
            "source": self.subject.source,
            "table_path": None if self.table_path is None else str(self.table_path),
            "verified": self.verified,
            "advice": words.advice(self.found),
            "alternatives": words.alternatives(self.found),
            "flip": {**self.look.to_json(), "of": self.shown_name},
        }
