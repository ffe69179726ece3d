"""Every public name that can be called has an example in its docstring, and every example says what is so."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc

#: These build and time many tables.
HEAVY = ("pareto", "plan", "report", "starter_library")
#: Kinds of `BrdfError`, whose example is their parent's.
KINDS = tuple(n for n in bc.__all__ if n.endswith("Error") and n != "BrdfError")
NAMES = [n for n in bc.__all__ if not n.startswith("__") and n not in (*KINDS, "atomic", "names", "plot")]


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in HEAVY else n for n in NAMES])
def test_examples(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With `import numpy as np` and `import brdfcore as bc`, in an empty folder."""
    thing = getattr(bc, name)
    finder = doctest.DocTestFinder(exclude_empty=True)
    found = [t for t in finder.find(thing, name, module=False, globs={"bc": bc, "np": np}) if t.examples]
    assert ">>>" in (inspect.getdoc(thing) or ""), f"bc.{name} has no example"
    flags = doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
    for number, test in enumerate(found):
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        said: list[str] = []
        failed, tried = doctest.DocTestRunner(optionflags=flags).run(test, out=said.append)
        assert tried
        assert not failed, "".join(said)
