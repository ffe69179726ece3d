"""Before the first start: the data folder is made, and filled with the starter library."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from brdf_service.settings import Settings

import brdfcore as bc


def fill(settings: Settings) -> None:
    """Make the data folder, and the starter library if it holds no material and that is wanted.

    A hidden file marks a library that is being built, so that a start that was interrupted is finished by the next.
    Raises `StorageError` if the folder cannot be used.
    """
    data = settings.data
    unfinished = data / ".starter-unfinished"
    try:
        data.mkdir(parents=True, exist_ok=True)
        empty = not any(p.suffix in (".h5", ".json") for p in data.iterdir())
        wanted = settings.starter and (empty or unfinished.exists())
        if wanted:
            unfinished.touch()
    except OSError as error:
        why = f"cannot be used as the data folder ({error.strerror}); choose another with --data"
        raise bc.StorageError("data_folder", f"{data}: {why}", where="data") from error
    if wanted:
        with _progress(data) as progress:
            bc.starter_library(data, progress=progress)
        unfinished.unlink(missing_ok=True)


@contextmanager
def _progress(folder: Path) -> Iterator[Callable[[int, int, str], None] | None]:
    """A line, and a progress bar on a terminal; a log is not to be full of bars."""
    print(f"building the starter library in {folder}", file=sys.stderr, flush=True)
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda done, total, stage: bar.update(task, completed=done, total=total, description=stage)
