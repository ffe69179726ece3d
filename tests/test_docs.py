"""The documentation builds without a warning and loads nothing from elsewhere; docstrings become markup of any kind."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import brdfcore as bc
from tests.support.pages import ROOT

sys.path.append(str(ROOT / "docs"))
from docstrings import as_markup


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "docs", str(made), "-d", str(made / ".doctrees")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return made


@pytest.mark.slow
def test_every_page_is_there(site: Path) -> None:
    pages = {p.stem for p in (ROOT / "docs").glob("*.md")}
    assert pages <= {p.stem for p in site.glob("*.html")}


@pytest.mark.slow
def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|img|iframe|source|object|embed)\b[^>]*\s(?:src|data)=\"([^\"]+)\"", text)
        loaded += [
            href
            for tag in re.findall(r"<link\b[^>]*>", text)
            if re.search(r'rel="(?:stylesheet|preload|preconnect|icon|dns-prefetch)', tag)
            for href in re.findall(r'href="([^"]+)"', tag)
        ]
        assert loaded
        assert not [target for target in loaded if re.match(r"(?:https?:)?//", target)], page.name
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.search(r"(?:@import\s+[\"']|url\(\s*[\"']?)(?:https?:)?//", text), style.name


def test_every_public_name_is_in_the_reference() -> None:
    text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    names = set(bc.__all__) - {"__version__", "atomic", "names", "plot"}
    assert names == set(re.findall(r"^\.\. (?:auto|py:)\w+:: (\w+)", text, re.MULTILINE)) - {"brdfcore"}


@pytest.mark.parametrize(
    ("docstring", "markup"),
    [
        ("f_r of `b`, |f| and 2 * f\nin one line.", ["f\\_r of ``b``, \\|f\\| and 2 \\* f in one line.", ""]),
        (
            "name     a meaning\n         of two lines\nother    no\nProse after it.",
            ["``name``", "   a meaning of two lines", "``other``", "   no", "", "Prose after it.", ""],
        ),
        (
            "Returns\n-------\nTable\n    With its error.",
            ["**Returns**", "", "``Table``", "   With its error.", ""],
        ),
        (">>> 1 + 1\n2", [".. code-block:: pycon", "", "   >>> 1 + 1", "   2", ""]),
        ("    f = a | b", [".. code-block:: text", "", "   f = a | b", ""]),
    ],
)
def test_docstring_as_markup(docstring: str, markup: list[str]) -> None:
    assert list(as_markup(docstring.splitlines())) == markup
