"""Measure and write what is generated in the README and in docs/: `python -m tests.benchmarks.pages [MARKER ...]`.

Each part stands between two markers of its page. Without a marker all are made: some minutes on an idle machine; needs
the `bench` extra. `headline`, the README's table, is read out of the pages, so it comes last. Look at the difference
before you commit it.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: marker -> (page, module and arguments, whether its output is Markdown already)
PARTS = {
    "models": ("docs/models.md", ["model_pages", "--pictures"], True),
    "phong": ("docs/phong.md", ["phong_against_torrance", "-o", "docs/pictures/phong-against-torrance.png"], True),
    "report": ("docs/accuracy.md", ["report", "--table"], True),
    "accuracy": ("docs/accuracy.md", ["accuracy", "--markdown"], True),
    "tables": ("docs/accuracy.md", ["tables", "measured", "analytic", "speed"], False),
    "lookup": ("docs/speed.md", ["lookup"], False),
    "service": ("docs/speed.md", ["service"], False),
    "harmonics": ("docs/harmonics.md", ["harmonics", "files", "--degrees", "32"], True),
    "licences": ("docs/licences.md", ["licences"], True),
    "headline": ("README.md", ["headline", "--pictures"], True),
}


def held(page: str, marker: str) -> str:
    """What stands between the markers of `page`; `ValueError` if they are not there."""
    found = re.search(rf"<!-- {marker} -->\n\n?(.*?)\n*<!-- /{marker} -->", _text(page), re.DOTALL)
    if found is None:
        raise ValueError(f"{page} has no <!-- {marker} --> ... <!-- /{marker} -->")
    return found[1]


def replaced(page: str, marker: str, body: str) -> str:
    """The text of `page` with `body` between the markers, blank lines around it."""
    held(page, marker)
    pattern = rf"(<!-- {marker} -->\n).*?(<!-- /{marker} -->)"
    return re.sub(pattern, lambda m: f"{m[1]}\n{body}\n\n{m[2]}", _text(page), flags=re.DOTALL)


def _text(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def main() -> None:
    for marker in sys.argv[1:] or PARTS:
        page, (module, *arguments), markdown = PARTS[marker]
        command = [sys.executable, "-m", f"tests.benchmarks.{module}", *arguments]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)  # its progress is shown
        body = done.stdout.strip() if markdown else f"```text\n{done.stdout.strip()}\n```"
        (ROOT / page).write_text(replaced(page, marker, body), encoding="utf-8")
        print(f"{page}: {marker} written")


if __name__ == "__main__":
    main()
