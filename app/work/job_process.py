"""The process that reads a stranger's file, tabulates or weighs representations: one task, and it ends.

It takes limits of memory and processor time upon itself before anything else, so that whatever a file does to its
reader, the service goes on. What happens is told as it happens: {"progress": [done, total, stage]}, then
{"made": suffix} or {"problem": {...}}.
"""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from brdf_service.work.subprocesses import Parent, told

import brdfcore as bc

#: Room for what the file system adds to the arrays of a table.
_FILE_SLACK = 64 * 2**20


def main() -> None:
    """Do the task."""
    parent = Parent()
    task = next(parent.tasks(), None)
    if task is None:  # the service ended before it said what to do
        return
    _limit(task)

    def progress(done: int, total: int, stage: str) -> None:
        parent.say({"progress": [done, total, stage]})

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what the table's error says as well
            made = (_pareto if "pareto" in task else _material)(task, progress)
    except Exception as error:
        parent.say({"problem": _explained(error)})
    else:
        parent.say({"made": made})


def _material(task: dict[str, Any], progress: Callable[[int, int, str], None]) -> str:
    """Make a material's file; its suffix."""
    options, result = task["tabulate"], Path(task["result"])
    if "model" in task:
        b = bc.model_from_json(task["model"])
    else:
        progress(0, 1, "reading")
        b = bc.read(task["input"], task["format"], **task["options"])
    if task.get("about"):
        b.metadata["about"] = task["about"]
    if options is None and not isinstance(b, bc.Table):
        if b.report.get("format") == "model":
            bc.write(b, result, "model")  # an analytic model stays one, and exact
            return ".json"
        options = {}
    if options is not None:
        b = bc.tabulate(b, progress=progress, **options)
    assert isinstance(b, bc.Table)
    size, limit = b.nbytes, task["max_bytes"]
    if size > limit:
        text = f"the table has {size} bytes; the limit is {limit}"
        raise bc.LimitError("table_too_large", text, where="tabulate", got=size, limit=limit)
    progress(0, 1, "writing")
    b.save(result)
    return ".h5"


def _pareto(task: dict[str, Any], progress: Callable[[int, int, str], None]) -> str:
    """Weigh the representations of a stored material; JSON and a picture, a file each."""
    made = bc.report({task["material"]: bc.read(task["input"])}, progress=progress, **task["pareto"])
    Path(task["result"]).write_bytes(made.render("json"))
    Path(task["picture"]).write_bytes(made.render("png"))
    return ".json"


def _limit(task: dict[str, Any]) -> None:
    try:
        import resource
    except ImportError:  # not POSIX
        return
    size, seconds = task["max_bytes"] + _FILE_SLACK, task["seconds"]
    resource.setrlimit(resource.RLIMIT_AS, (task["memory"],) * 2)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))  # SIGXCPU, and then SIGKILL


def _explained(error: Exception) -> dict[str, Any]:
    if isinstance(error, bc.BrdfError):
        return told(error)
    if isinstance(error, MemoryError):
        return told(bc.LimitError("job_memory", "it needs more memory than a job may take"))
    traceback.print_exception(error)
    return told(bc.FileFormatError("job_failed", f"it could not be read or tabulated ({type(error).__name__})"))


if __name__ == "__main__":
    main()
