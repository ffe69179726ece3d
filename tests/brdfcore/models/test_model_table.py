"""The README's table of models is the registry's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from brdfcore.base.registry import MODELS
from tests.benchmarks import model_table

README = Path(__file__).parents[3] / "README.md"
COMMAND = "python -m tests.benchmarks.readme models"


def test_readme_holds_what_the_registry_says() -> None:
    held = re.search(r"<!-- models -->\n(.*?)\n?<!-- /models -->", README.read_text(encoding="utf-8"), re.DOTALL)
    assert held, f"{README.name} has no <!-- models --> marker"
    assert held[1] == model_table.table(), f"{README.name} is not what the registry says; write it with: {COMMAND}"


@pytest.mark.parametrize("name", MODELS.entries)
def test_each_model_has_a_small_picture(name: str) -> None:
    path = model_table.picture_of(name)
    assert path.exists(), f"{path.name} is missing; draw it with: {COMMAND}"
    assert path.stat().st_size <= model_table.LARGEST
    assert model_table.drawn(name).startswith(b"\x89PNG")
