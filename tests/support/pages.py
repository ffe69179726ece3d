"""The README and the pages of docs/ as something to follow: their blocks, run in order as a reader would."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: What is run, and what is only shown.
RUN, SHOWN = ("sh", "python"), ("text", "yaml")
ADDRESS = "http://127.0.0.1:8000"


def blocks(page: Path) -> list[tuple[str, str]]:
    """(language, text) of every fenced block; directives of the documentation aside."""
    found = re.findall(r"^```(\S*)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [(kind, text) for kind, text in found if not kind.startswith("{")]


def environment(folder: Path) -> dict[str, str]:
    """With `.venv` in `folder` as the README's first command leaves it: commands of this interpreter's environment."""
    scripts = folder / ".venv" / "bin"
    scripts.mkdir(parents=True, exist_ok=True)
    (scripts / "activate").write_text(f'export PATH="{Path(sys.executable).parent}:$PATH"\n')
    return {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


def follow(page: Path, folder: Path, address: str) -> list[str]:
    """Run the blocks of `page` in `folder`, the service at `address`; what each printed, in order.

    The two commands that make an environment are not run, as that would install another one. `AssertionError` with
    the block and what it said if one fails.
    """
    variables, printed = environment(folder), []
    for kind, text in blocks(page):
        assert kind in RUN + SHOWN, f"{page.name}: a block of {kind!r}"
        if kind in SHOWN or "-m venv" in text:
            continue
        source = text.replace(ADDRESS, address).replace("curl -s ", "curl -sS --fail-with-body ")
        program = (
            [sys.executable, "-W", "error", "-c"] if kind == "python" else [str(_bash()), "-euo", "pipefail", "-c"]
        )
        done = subprocess.run(
            [*program, source], cwd=folder, env=variables, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{page.name}:\n{source}\n{done.stdout}{done.stderr}"
        printed.append(done.stdout)
    return printed


def _bash() -> str:
    found = shutil.which("bash")
    assert found, "bash is not installed"
    return found
