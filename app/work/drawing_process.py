"""The process that draws: `python -m brdf_service.work.drawing_process`, one picture after the other until stdin ends.

A task is a line of JSON on stdin: {"name", "path", "kind", "id"} of the material's file and "picture", the fields of
`Picture`. The answer, on what was stdout, is a line of JSON: {"bytes": n} and n bytes; {"problem": {...}}, an error of
the library; {"failed": true}, any other, whose traceback is on stderr; or {"changed": true}: the file does not hold
that material any more.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import Any

#: Bytes of tables kept open: those of a page of pictures.
_TABLE_BYTES = 64 * 2**20
#: What a material counts for at least: a model has no arrays.
_LEAST_BYTES = 64 * 2**10


def main() -> None:
    """Draw what is asked for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group: the service ends this one itself
    said = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not be taken for an answer
    with contextlib.suppress(OSError):
        os.nice(5)  # look-ups go first
    from brdf_service.library.lru import ByteLru

    held: ByteLru[str, Any] = ByteLru(_TABLE_BYTES)
    for line in sys.stdin.buffer:
        head, body = _answered(json.loads(line), held)
        try:
            said.write(json.dumps(head, default=str).encode() + b"\n" + body)
            said.flush()
        except BrokenPipeError:  # the service is gone
            return


def _answered(task: dict[str, Any], held: Any) -> tuple[dict[str, Any], bytes]:
    from brdf_service.library.materials import open_material
    from brdf_service.work import pictures
    from brdf_service.work.subprocesses import told

    import brdfcore as bc

    try:
        material = held.get(task["id"])
        if material is None:
            try:
                material = open_material(task["name"], Path(task["path"]), task["kind"])
            except Exception:
                return {"changed": True}, b""
            if material.id != task["id"]:
                return {"changed": True}, b""
            held.put(material.id, material, max(material.nbytes, _LEAST_BYTES))
        body = pictures.draw(material.brdf, pictures.Picture(*task["picture"]))
    except bc.BrdfError as error:
        return {"problem": told(error)}, b""
    except Exception:
        traceback.print_exc()
        return {"failed": True}, b""
    return {"bytes": len(body)}, body


if __name__ == "__main__":
    main()
