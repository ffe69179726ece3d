"""The documentation's page of models is the registry's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from brdfcore.base.registry import MODELS
from tests.benchmarks import model_pages

PAGE = Path(__file__).parents[3] / "docs" / "models.md"
COMMAND = "python -m tests.benchmarks.pages models"


def test_page_holds_what_the_registry_says() -> None:
    held = re.search(r"<!-- models -->\n(.*?)\n?<!-- /models -->", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert held, f"{PAGE.name} has no <!-- models --> marker"
    assert held[1] == model_pages.text(), f"{PAGE.name} is not what the registry says; write it with: {COMMAND}"


@pytest.mark.parametrize("name", MODELS.entries)
def test_each_model_has_a_small_picture(name: str) -> None:
    path = model_pages.picture_of(name)
    assert path.exists(), f"{path.name} is missing; draw it with: {COMMAND}"
    assert path.stat().st_size <= model_pages.LARGEST
    assert model_pages.drawn(name).startswith(b"\x89PNG")
