"""The documentation's page of models is the registry's."""

from __future__ import annotations

import pytest

from brdfcore.base.registry import MODELS
from tests.benchmarks import model_pages
from tests.benchmarks.pages import held

COMMAND = "python -m tests.benchmarks.pages models"


def test_page_holds_what_the_registry_says() -> None:
    assert held("docs/models.md", "models") == model_pages.text(), f"docs/models.md differs; write it with: {COMMAND}"


@pytest.mark.parametrize("name", MODELS.entries)
def test_each_model_has_a_small_picture(name: str) -> None:
    path = model_pages.picture_of(name)
    assert path.exists(), f"{path.name} is missing; draw it with: {COMMAND}"
    assert path.stat().st_size <= model_pages.LARGEST
    assert model_pages.drawn(name).startswith(b"\x89PNG")
