"""Measure and write the README's tables between their markers: `python -m tests.benchmarks.readme [MARKER ...]`.

Some minutes on an idle machine; needs the `bench` extra. Look at the difference before you commit it.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parents[2] / "README.md"
#: marker -> (module and arguments, whether its output is Markdown already)
TABLES = {
    "models": (["model_table", "--pictures"], True),
    "phong": (
        ["phong_against_torrance", "-o", str(README.parent / "app" / "web" / "phong-against-torrance.png")],
        True,
    ),
    "report": (["report", "--readme"], True),
    "accuracy": (["accuracy", "--markdown"], True),
    "tables": (["tables", "measured", "analytic", "speed"], False),
    "lookup": (["lookup"], False),
    "service": (["service"], False),
    "harmonics": (["harmonics", "files", "--degrees", "32"], True),
}


def main() -> None:
    for marker in sys.argv[1:] or TABLES:
        (module, *arguments), markdown = TABLES[marker]
        done = subprocess.run(
            [sys.executable, "-m", f"tests.benchmarks.{module}", *arguments],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )  # what it says of its progress is shown
        body = done.stdout.strip() if markdown else f"```text\n{done.stdout.strip()}\n```"
        text = README.read_text(encoding="utf-8")
        pattern = rf"(<!-- {marker} -->\n).*?(<!-- /{marker} -->)"
        text = re.sub(pattern, lambda m, body=body: f"{m[1]}{body}\n{m[2]}", text, flags=re.DOTALL)
        README.write_text(text, encoding="utf-8")
        print(f"{README.name}: {marker} written")


if __name__ == "__main__":
    main()
