"""The documentation's table of licences, from what is installed: `python -m tests.benchmarks.licences`.

Every package that pyproject.toml names, with the extra that brings it, and every package that these bring. All extras
have to be installed; what is not keeps the licence that the page has, and a new one is an error.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from importlib import metadata

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.benchmarks.pages import ROOT, held

PAGE = "docs/licences.md"
_ENVIRONMENT: dict[str, str] = {k: str(v) for k, v in default_environment().items()}
#: Extras that a user installs; what they bring is listed as well.
SHIPPED = ("", "client", "core", "service", "colour")
#: Names of classifiers as SPDX calls them.
SPDX = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "MIT License": "MIT",
    "MIT": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "ISC License (ISCL)": "ISC",
    "The Unlicense (Unlicense)": "Unlicense",
}


def declared() -> dict[str, list[str]]:
    """{package: extras that name it}; "" is what everybody gets."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lists = {"": project["dependencies"], **project["optional-dependencies"]}
    found: dict[str, list[str]] = {}
    for extra, requirements in lists.items():
        for line in requirements:
            name = canonicalize_name(Requirement(line).name)
            if name != canonicalize_name(project["name"]):
                found.setdefault(name, []).append(extra)
    return dict(sorted(found.items()))


def brought() -> dict[str, list[str]]:
    """{package: packages that bring it} of what `SHIPPED` brings and pyproject.toml does not name."""
    names = declared()
    waiting = [name for name, extras in names.items() if set(extras) & set(SHIPPED)]
    found: dict[str, set[str]] = {}
    seen = set(waiting)
    while waiting:
        parent = waiting.pop()
        for name in _required(parent):
            if name not in names:
                found.setdefault(name, set()).add(parent)
            if name not in seen:
                seen.add(name)
                waiting.append(name)
    return {name: sorted(parents) for name, parents in sorted(found.items())}


def _required(name: str) -> Iterator[str]:
    try:
        lines = metadata.requires(name) or []
    except metadata.PackageNotFoundError:
        return
    for line in lines:
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({**_ENVIRONMENT, "extra": ""}):
            yield canonicalize_name(requirement.name)


def licence(name: str) -> str | None:
    """SPDX expression, else the short text, else the classifiers; None if the package is not installed."""
    try:
        about = metadata.metadata(name)
    except metadata.PackageNotFoundError:
        return None
    short = (about.get("License") or "").strip()
    classified = [c.rpartition(" :: ")[2] for c in about.get_all("Classifier", []) if c.startswith("License :: ")]
    named = [SPDX.get(c, c) for c in classified if c != "OSI Approved"]
    text = about.get("License-Expression") or (short if 0 < len(short) < 40 else "") or ", ".join(named)
    return SPDX.get(text, text) or "not stated"


def family(text: str) -> frozenset[str]:
    """What kinds of licence a text names, however it spells them."""
    kinds = ("AGPL", "LGPL", "GPL", "MPL", "Apache", "BSD", "MIT", "PSF", "ISC", "Intel")
    return frozenset(kind for kind in kinds if re.search(rf"(?<![A-Za-z]){kind}", text))


def rows(pairs: dict[str, list[str]], kept: dict[str, str]) -> Iterator[tuple[str, str, str]]:
    for name, extras in pairs.items():
        text = licence(name) or kept.get(name)
        if text is None:
            sys.exit(f"{name} is not installed, and {PAGE} does not have it: install it, then write the page again")
        yield name, text, ", ".join(f"`{e}`" if e else "always" for e in extras)


def listed() -> dict[str, str]:
    """{package: licence} as the page has it."""
    return dict(re.findall(r"^\| ([\w.-]+) \| ([^|]+?) \|", held(PAGE, "licences"), re.MULTILINE))


def text() -> str:
    kept = listed()
    first = [("package", "licence", "extra"), ("---", "---", "---"), *rows(declared(), kept)]
    second = [("package", "licence", "brought by"), ("---", "---", "---"), *rows(brought(), kept)]
    tables = ["\n".join(f"| {' | '.join(cells)} |" for cells in table) for table in (first, second)]
    return f"{tables[0]}\n\nWhat these bring, on Linux:\n\n{tables[1]}"


if __name__ == "__main__":
    print(text())
