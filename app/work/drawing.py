"""The service's end of the process that draws.

matplotlib is Python all through. In a thread of the service a picture takes ten times as long as alone, because the
thread gives the interpreter's lock to the event loop every millisecond, and all other requests wait for it as often.
"""

from __future__ import annotations

import contextlib
import json
import logging
import subprocess
import sys
import threading
from typing import Any

from brdf_service.http.errors import BusyError
from brdf_service.library.materials import Material
from brdf_service.work.pictures import Picture
from brdf_service.work.subprocesses import environment, rebuilt

log = logging.getLogger("brdf.service")

#: Seconds that one picture may take; the largest takes about one.
PATIENCE = 60.0
_RETRY = 5


class Artist:
    """Draws one picture at a time. Methods block, and may be called from several threads."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._drawing = threading.Lock()
        self._stopped = threading.Event()

    def draw(self, material: Material, picture: Picture) -> bytes | None:
        """The picture; None if the material's file has changed since it was loaded, or the service is ending.

        Raises what `pictures.draw` raises, `BusyError` if the process ends or takes too long over it.
        """
        task = {
            "name": material.name,
            "path": str(material.path),
            "kind": material.facts["kind"],
            "id": material.id,
            "picture": picture,
        }
        line = json.dumps(task, allow_nan=False).encode() + b"\n"
        with self._drawing:
            # it may have been killed since the last picture, which is no fault of this one
            for _ in range(2):
                process = self._running()
                if process is None:
                    return None
                answer, late = self._asked(process, line)
                if answer is not None:
                    break
                log.warning("the process that draws ended with %s over a %s", process.returncode, picture.kind)
                if late:
                    raise _failed(f"drawing took more than {PATIENCE:.0f} s")
            else:
                raise _failed("the process that draws ended before the picture was done")
        head, body = answer
        if "problem" in head:
            raise rebuilt(head["problem"])
        if "failed" in head:
            raise RuntimeError("the picture could not be drawn; the traceback stands above")
        return None if "changed" in head else body

    def stop(self) -> None:
        """End the process, also in the middle of a picture; no other starts."""
        self._stopped.set()
        process = self._process
        if process is not None:
            process.kill()
        with self._drawing:  # who waited for it has noticed
            self._let_go()

    def _running(self) -> subprocess.Popen[bytes] | None:
        if self._process is not None and self._process.poll() is not None:
            self._let_go()
        if self._process is None and not self._stopped.is_set():
            self._process = subprocess.Popen(
                [sys.executable, "-m", "brdf_service.work.drawing_process"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                # one thread: the cores are for look-ups
                env=environment(NUMBA_NUM_THREADS="1", OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1"),
            )
            if self._stopped.is_set():  # in between
                self._process.kill()
        return None if self._stopped.is_set() else self._process

    def _let_go(self) -> None:
        """Forget a process that was ended."""
        process, self._process = self._process, None
        if process is not None:
            process.wait()
            for pipe in (process.stdin, process.stdout):
                assert pipe is not None
                with contextlib.suppress(OSError):  # what was meant for a process that is gone
                    pipe.close()

    def _asked(self, process: subprocess.Popen[bytes], line: bytes) -> tuple[tuple[dict[str, Any], bytes] | None, bool]:
        """(its answer, None if it ended before; whether it was ended because it took too long)."""
        late = threading.Event()

        def give_up() -> None:
            late.set()
            process.kill()

        watch = threading.Timer(PATIENCE, give_up)
        watch.daemon = True
        watch.start()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(line)
            process.stdin.flush()
            head = json.loads(process.stdout.readline())
            body = process.stdout.read(head.get("bytes", 0))
            if len(body) == head.get("bytes", 0):
                return (head, body), False
        except (OSError, ValueError):
            pass
        finally:
            watch.cancel()
        process.kill()
        process.wait()
        return None, late.is_set()


def _failed(why: str) -> BusyError:
    return BusyError("drawing_failed", f"{why}; try again later", retry_after=_RETRY)
