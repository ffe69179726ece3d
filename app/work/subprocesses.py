"""The child processes of the service, and what both ends speak: lines of JSON to a child, lines of JSON and bytes back.

A child is `python -P -m brdf_service.work.MODULE`. Files of a stranger in the folder where the service was started, an
app/ or a numpy.py, are nothing to it.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import brdfcore as bc

_LONGEST_LINE = 2**20


class Child:
    """A process that was just started; `close` it. All but `kill` belongs to one thread at a time.

    module   its name in this package.
    errors   where its stderr goes; default: to that of the service.
    changes  of its environment.
    """

    def __init__(self, module: str, *, errors: IO[bytes] | None = None, **changes: str) -> None:
        pipe, command = subprocess.PIPE, [sys.executable, "-P", "-m", f"{__package__}.{module}"]
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=errors, env=_environment(changes))
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._to, self._from = self.process.stdin, self.process.stdout
        #: True if it was ended because it took too long.
        self.late = False

    def kill(self) -> None:
        """End it: who waits for its answer hears that it has ended."""
        self.process.kill()

    def close(self) -> None:
        """End it and let go of it."""
        self.kill()
        self.process.wait()
        for end in (self._to, self._from):
            with contextlib.suppress(OSError):  # what was meant for a process that is gone
                end.close()

    @contextlib.contextmanager
    def within(self, seconds: float) -> Iterator[None]:
        """End it if the block takes longer."""

        def give_up() -> None:
            self.late = True
            self.kill()

        timer = threading.Timer(seconds, give_up)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def send(self, task: dict[str, Any]) -> None:
        """Give it a task."""
        with contextlib.suppress(OSError):  # if it has ended, there will be no answer
            self._to.write(json.dumps(task).encode() + b"\n")
            self._to.flush()

    def hear(self) -> dict[str, Any] | None:
        """Its next line, waited for; {} if that makes no sense, None if it has ended."""
        line = self._from.readline(_LONGEST_LINE)
        with contextlib.suppress(ValueError):
            said = json.loads(line)
            return said if isinstance(said, dict) else {}
        return {} if line else None

    def read(self, size: int) -> bytes:
        """The bytes after its line; fewer if it ends before."""
        return self._from.read(size)


def _environment(changes: dict[str, str]) -> dict[str, str]:
    """That of the service, without its key, and with its places to import from, without the current folder: unless the
    package itself was found there."""
    here = None
    with contextlib.suppress(OSError):  # the folder may be gone
        here = os.path.realpath(os.getcwd())
    own = {os.path.realpath(Path(file).parents[up]) for file, up in ((__file__, 2), (str(bc.__file__), 1))}
    # "" is the current folder
    places = {path: os.path.realpath(path) for path in sys.path if path or here in own}
    kept = [path for path, real in places.items() if real != here or real in own]
    environment = {k: v for k, v in os.environ.items() if k != "BRDF_API_KEY"}
    return {**environment, "PYTHONPATH": os.pathsep.join(kept), **changes}


def told(error: bc.BrdfError) -> dict[str, Any]:
    """The error as JSON; its class travels as a name that `rebuilt` looks up in the library's own list."""
    kind = next(k.__name__ for k in type(error).__mro__ if hasattr(bc, k.__name__))
    return {"kind": kind, "code": error.code, "detail": error.detail, "context": error.context}


def rebuilt(problem: dict[str, Any]) -> bc.BrdfError:
    """The error that `told` told of."""
    kind = getattr(bc, str(problem.get("kind")), None)
    if not (isinstance(kind, type) and issubclass(kind, bc.BrdfError)):
        kind = bc.BrdfError
    return kind(str(problem["code"]), str(problem["detail"]), **(problem.get("context") or {}))


# ---- the child's end ----------------------------------------------------------------------------------


class Parent:
    """The service, as a child hears and answers it."""

    def __init__(self) -> None:
        self._to = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)  # what a library prints must not be taken for an answer
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group: the service ends its children
        with contextlib.suppress(OSError):
            os.nice(5)  # look-ups go first

    def tasks(self) -> Iterator[dict[str, Any]]:
        """What the service asks for, until it ends."""
        yield from map(json.loads, sys.stdin.buffer)

    def say(self, what: dict[str, Any], body: bytes = b"") -> None:
        """A line, and bytes after it."""
        self._to.write(json.dumps(what, default=str).encode() + b"\n" + body)
        self._to.flush()
