"""The process that reads a stranger's file, tabulates or weighs representations: one task for each start of it.

It takes limits of memory and processor time upon itself before anything else, so that whatever a file does to its
reader, the service goes on. The task is JSON on stdin; what happens is told in JSON lines on what was stdout:
{"progress": [done, total, stage]}, then {"made": suffix} or {"problem": {...}}.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from pathlib import Path
from typing import Any, TextIO

#: Room for what the file system adds to the arrays of a table.
_FILE_SLACK = 64 * 2**20


def main() -> None:
    """Do the task on stdin."""
    task = json.loads(sys.stdin.read())
    said = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints must not be taken for our lines
    _limit(task)
    try:
        suffix = _work(task, said)
    except Exception as error:
        _say(said, {"problem": _explained(error)})
    else:
        _say(said, {"made": suffix})


def _limit(task: dict[str, Any]) -> None:
    try:
        import resource
    except ImportError:  # not POSIX
        return
    for kind, most in (
        (resource.RLIMIT_AS, task["memory"]),
        (resource.RLIMIT_FSIZE, task["max_bytes"] + _FILE_SLACK),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (task["seconds"], task["seconds"] + 5))  # SIGXCPU, and then SIGKILL
    os.nice(5)  # look-ups go first


def _work(task: dict[str, Any], said: TextIO) -> str:
    """Make the material's file; its suffix."""
    import brdfcore as bc

    result = Path(task["result"])
    if "pareto" in task:
        return _report(task, result, said)
    options = task["tabulate"]
    b = bc.model(task["model"], **task["parameters"]) if "model" in task else _read(task, said)
    if task.get("about"):
        b.metadata["about"] = task["about"]
    if options is None and not isinstance(b, bc.Table):
        if "model" in b.metadata and b.report.get("format") == "model":
            bc.write(b, result, "model")  # an analytic model stays one, and exact
            return ".json"
        options = {}
    if options is not None:

        def progress(done: int, total: int, stage: str) -> None:
            _say(said, {"progress": [done, total, stage]})

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what the table's error says as well
            b = bc.tabulate(b, progress=progress, **options)
    assert isinstance(b, bc.Table)
    if b.nbytes > task["max_bytes"]:
        raise bc.LimitError(
            "table_too_large",
            f"the table has {b.nbytes} bytes; the limit is {task['max_bytes']}",
            where="tabulate",
            got=b.nbytes,
            limit=task["max_bytes"],
        )
    _say(said, {"progress": [0, 1, "writing"]})
    b.save(result)
    return ".h5"


def _report(task: dict[str, Any], result: Path, said: TextIO) -> str:
    """Weigh the representations of a stored material; JSON into the result's file, the picture beside it."""
    import brdfcore as bc

    def progress(done: int, total: int, stage: str) -> None:
        _say(said, {"progress": [done, total, stage]})

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = bc.report({task["material"]: bc.read(task["input"])}, progress=progress, **task["pareto"])
        result.write_bytes(made.render("json"))
        result.with_name(task["picture"]).write_bytes(made.render("png"))
    return ".json"


def _read(task: dict[str, Any], said: TextIO) -> Any:
    import brdfcore as bc

    _say(said, {"progress": [0, 1, "reading"]})
    return bc.read(task["input"], task["format"], **task["options"])


def _explained(error: Exception) -> dict[str, Any]:
    """The error as JSON; its class travels as a name that the service looks up in its own table."""
    from brdf_service.work.subprocesses import told

    import brdfcore as bc

    if isinstance(error, bc.BrdfError):
        return told(error)
    if isinstance(error, MemoryError):
        return {"kind": "LimitError", "code": "job_memory", "detail": "it needs more memory than a job may take"}
    import traceback

    traceback.print_exception(error)
    detail = f"it could not be read or tabulated ({type(error).__name__})"
    return {"kind": "FileFormatError", "code": "job_failed", "detail": detail}


def _say(said: TextIO, what: dict[str, Any]) -> None:
    said.write(json.dumps(what, default=str) + "\n")
    said.flush()


if __name__ == "__main__":
    main()
