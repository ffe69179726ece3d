"""Two tiers of tests: a plain run, and what `-m slow` adds to it."""

from __future__ import annotations

from typing import Any

import pytest


def first_fast(first: Any, *others: Any) -> list[Any]:
    """The values of a `parametrize`, one name or a tuple of several: the first in every run, the others slow."""
    each = (x if isinstance(x, tuple) else (x,) for x in others)
    return [first, *(pytest.param(*x, marks=pytest.mark.slow) for x in each)]
