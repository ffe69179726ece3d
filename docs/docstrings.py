"""Docstrings of this project as the documentation shows them: they are laid out for `help()`, not as markup.

A paragraph is prose; `name   meaning` in columns and the sections of numpydoc become lists of definitions; what is
indented stays as it stands, and `>>>` are examples.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby
from textwrap import dedent
from typing import Any

_COLUMNS = re.compile(r"(\S.*?)\s{2,}(\S.*)")


def as_markup(lines: list[str]) -> Iterator[str]:
    """Lines of reStructuredText, warnings of whose parser nothing in `lines` can cause."""
    for blank, group in groupby(lines, lambda line: not line.strip()):
        if not blank:
            yield from _paragraph(list(group))
            yield ""


def _paragraph(lines: list[str]) -> Iterator[str]:
    if lines[0].lstrip().startswith(">>>"):
        yield from _literal(lines, "pycon")
    elif len(lines) > 1 and set(lines[1].strip()) == {"-"}:
        yield f"**{lines[0].strip()}**"
        yield ""
        yield from _definitions(_entries(lines[2:]))
    elif lines[0].startswith(" "):
        inner = dedent("\n".join(lines)).splitlines()
        yield from _columns(inner) if _COLUMNS.fullmatch(inner[0]) else _literal(lines, "text")
    elif _COLUMNS.fullmatch(lines[0]):
        yield from _columns(lines)
    else:
        yield _escaped(" ".join(line.strip() for line in lines))


def _columns(lines: list[str]) -> Iterator[str]:
    """Lines of `name   meaning`, each perhaps continued by indented ones; prose may follow."""
    entries: list[tuple[str, str]] = []
    for k, line in enumerate(lines):
        if line.startswith(" ") and entries:
            entries[-1] = (entries[-1][0], f"{entries[-1][1]} {line.strip()}")
        elif found := _COLUMNS.fullmatch(line):
            entries.append((found[1], found[2]))
        else:
            yield from _definitions(entries)
            yield ""
            yield _escaped(" ".join(rest.strip() for rest in lines[k:]))
            return
    yield from _definitions(entries)


def _entries(lines: list[str]) -> list[tuple[str, str]]:
    """(name, meaning) of a numpydoc section: names at the left, meanings indented."""
    found: list[tuple[str, str]] = []
    for line in lines:
        if line.startswith(" ") and found:
            found[-1] = (found[-1][0], f"{found[-1][1]} {line.strip()}".strip())
        else:
            found.append((line.strip(), ""))
    return found


def _definitions(entries: list[tuple[str, str]]) -> Iterator[str]:
    for name, meaning in entries:
        yield f"``{name.replace('`', '')}``"
        yield f"   {_escaped(meaning) or '..'}"


def _literal(lines: list[str], language: str) -> Iterator[str]:
    yield f".. code-block:: {language}"
    yield ""
    yield from (f"   {line}" for line in dedent("\n".join(lines)).splitlines())


def _escaped(text: str) -> str:
    """`code` as code, and nothing else with a meaning."""
    parts = re.split(r"`+([^`]+)`+", text)  # text, code, text, ...
    return "".join(f"``{part}``" if k % 2 else re.sub(r"([*|_\\`])", r"\\\1", part) for k, part in enumerate(parts))


def _process(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = as_markup(lines)


def setup(app: Any) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True}
