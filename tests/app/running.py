"""`brdf serve` as a process of its own, asked over the wire."""

from __future__ import annotations

import contextlib
import http.client
import os
import queue
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple


class Answer(NamedTuple):
    """An answer read to its end."""

    status: int
    headers: dict[str, str]
    body: bytes


class Running:
    """A service on a free port."""

    def __init__(
        self,
        data: Path,
        *arguments: str,
        program: Sequence[str] = (sys.executable, "-m", "brdfcore.cli"),
        folder: Path | None = None,
        **environment: str,
    ) -> None:
        """`program` is brdf, started in `folder`."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith("BRDF_")}
        command = [*program, "serve", "--port", "0", "--data", str(data), *arguments]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command, stdout=pipe, stderr=pipe, text=True, cwd=folder, env={**kept, **environment}
        )
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        lines: queue.Queue[str] = queue.Queue()
        self.errors: list[str] = []
        self._reading = [
            threading.Thread(target=lambda out: [lines.put(x) for x in out], args=(self.process.stdout,), daemon=True),
            # read all the time: a full pipe would stop the service
            threading.Thread(target=lambda out: self.errors.extend(out), args=(self.process.stderr,), daemon=True),
        ]
        for thread in self._reading:
            thread.start()
        self.line = lines.get(timeout=60)
        found = re.match(r"listening on http://(?:127\.0\.0\.1|0\.0\.0\.0):(\d+) ", self.line)
        assert found, self.line
        self.port = int(found[1])

    def ask(self, path: str, method: str = "GET", body: Any = None, timeout: float = 20, **headers: str) -> Answer:
        # http.client sends the path as it is, where others tidy it up first
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout)
        with contextlib.closing(connection):
            connection.request(method, path, body, {k.replace("_", "-"): v for k, v in headers.items()})
            answer = connection.getresponse()
            return Answer(answer.status, dict(answer.headers.items()), answer.read())

    def stop(self) -> tuple[int, str]:
        """Ask it to end; its exit code and what it wrote to stderr."""
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(timeout=20)
        return self.end()

    def kill(self) -> tuple[int, str]:
        """End it without a word."""
        self.process.kill()
        self.process.wait(timeout=20)
        return self.end()

    def end(self) -> tuple[int, str]:
        for thread in self._reading:
            thread.join(10)
        for pipe in (self.process.stdout, self.process.stderr):
            assert pipe is not None
            pipe.close()
        return self.process.returncode, "".join(self.errors)


@contextlib.contextmanager
def running(data: Path, *arguments: str, **environment: str) -> Iterator[Running]:
    """A service that is gone afterwards."""
    made = Running(data, *arguments, **environment)
    try:
        yield made
    finally:
        if made.process.poll() is None:
            made.kill()
