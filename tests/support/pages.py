"""The README and the pages of docs/ as something to follow: their blocks, run in order as a reader would."""

from __future__ import annotations

import json
import os
import re
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


def follow(page: Path, folder: Path, address: str) -> None:
    """Run the blocks of `page` in `folder`, the service at `address`; Python in one interpreter, as a reader would.

    The two commands that make an environment are not run, as that would install another one. `AssertionError` with
    the block and what it said if one fails.
    """
    variables = environment(folder)
    with Interpreter(folder, variables) as python:
        for kind, text in blocks(page):
            assert kind in RUN + SHOWN, f"{page.name}: a block of {kind!r}"
            if kind in SHOWN or "-m venv" in text:
                continue
            source = text.replace(ADDRESS, address).replace("curl -s ", "curl -sS --fail-with-body ")
            failed = python.run(source) if kind == "python" else _shell(source, folder, variables)
            assert failed is None, f"{page.name}:\n{source}\n{failed}"


def _shell(source: str, folder: Path, variables: dict[str, str]) -> str | None:
    program = ["bash", "-euo", "pipefail", "-c", source]
    done = subprocess.run(program, cwd=folder, env=variables, capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else done.stdout + done.stderr


class Interpreter:
    """A Python that keeps its names from block to block and takes every warning for an error."""

    _LOOP = """
import json, sys
names = {"__name__": "__main__"}
for line in sys.stdin:
    exec(compile(json.loads(line), "<block>", "exec"), names)
    print("\\0", flush=True)
"""

    def __init__(self, folder: Path, variables: dict[str, str]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-W", "error", "-c", self._LOOP],
            cwd=folder,
            env=variables,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, source: str) -> str | None:
        """What it said if it failed."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(source) + "\n")
        self.process.stdin.flush()
        said = []
        for line in self.process.stdout:
            if line == "\0\n":
                return None
            said.append(line)
        return "".join(said)

    def __enter__(self) -> Interpreter:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()
