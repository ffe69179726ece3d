"""The process that reads a stranger's file, tabulates or weighs representations: one task, and it ends.

It takes limits of memory and processor time upon itself before anything else, so that whatever a file does to its
reader, the service goes on. What happens is told as it happens: {"progress": [done, total, stage]}, then
{"made": suffix} or {"problem": {...}}.
"""

from __future__ import annotations

import traceback
import warnings
from pathlib import Path
from typing import Any

from brdf_service.work.subprocesses import Parent, told

import brdfcore as bc

#: Room for what the file system adds to the arrays of a table.
_FILE_SLACK = 64 * 2**20


class _Work:
    """One task."""

    def __init__(self, task: dict[str, Any], parent: Parent) -> None:
        self.task, self.parent, self.result = task, parent, Path(task["result"])

    def progress(self, done: int, total: int, stage: str) -> None:
        self.parent.say({"progress": [done, total, stage]})

    def material(self) -> str:
        """Make a material's file; its suffix."""
        task, options = self.task, self.task["tabulate"]
        if "model" in task:
            b = bc.model(task["model"], **task["parameters"])
        else:
            self.progress(0, 1, "reading")
            b = bc.read(task["input"], task["format"], **task["options"])
        if task.get("about"):
            b.metadata["about"] = task["about"]
        if options is None and not isinstance(b, bc.Table):
            if "model" in b.metadata and b.report.get("format") == "model":
                bc.write(b, self.result, "model")  # an analytic model stays one, and exact
                return ".json"
            options = {}
        if options is not None:
            b = bc.tabulate(b, progress=self.progress, **options)
        assert isinstance(b, bc.Table)
        if b.nbytes > task["max_bytes"]:
            raise bc.LimitError(
                "table_too_large",
                f"the table has {b.nbytes} bytes; the limit is {task['max_bytes']}",
                where="tabulate",
                got=b.nbytes,
                limit=task["max_bytes"],
            )
        self.progress(0, 1, "writing")
        b.save(self.result)
        return ".h5"

    def pareto(self) -> str:
        """Weigh the representations of a stored material; JSON into the result's file, the picture beside it."""
        source = {self.task["material"]: bc.read(self.task["input"])}
        made = bc.report(source, progress=self.progress, **self.task["pareto"])
        self.result.write_bytes(made.render("json"))
        Path(self.task["picture"]).write_bytes(made.render("png"))
        return ".json"


def main() -> None:
    """Do the task."""
    parent = Parent()
    task = next(parent.tasks(), None)
    if task is None:  # the service ended before it said what to do
        return
    _limit(task)
    work = _Work(task, parent)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what the table's error says as well
            made = work.pareto() if "pareto" in task else work.material()
    except Exception as error:
        parent.say({"problem": _explained(error)})
    else:
        parent.say({"made": made})


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


def _explained(error: Exception) -> dict[str, Any]:
    if isinstance(error, bc.BrdfError):
        return told(error)
    if isinstance(error, MemoryError):
        return told(bc.LimitError("job_memory", "it needs more memory than a job may take"))
    traceback.print_exception(error)
    text = f"it could not be read or tabulated ({type(error).__name__})"
    return told(bc.FileFormatError("job_failed", text))


if __name__ == "__main__":
    main()
