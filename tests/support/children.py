"""Programs that tests start as processes of their own: `python -m tests.support.children NAME [ARG ...]`.

Each prints one JSON line and exits with 0, or fails with a traceback that the test shows.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

LARGE = 20_000


def a_table() -> Any:
    """A small table with a value that identifies its build."""
    import brdfcore as bc

    return bc.tabulate(bc.model("cook_torrance", roughness=0.3, ior="gold"), "angle_grid", shape=(12, 12, 13))


def some_angles(n: int = LARGE) -> list[Any]:
    rng = np.random.default_rng(5)
    return [rng.uniform(0, top, n).astype(np.float32) for top in (1.57, 1.57, 6.28)]


def threads(seconds: str) -> dict[str, Any]:
    """8 threads evaluate batches large and small for some seconds; every answer is the same bits."""
    import numba

    table, angles = a_table(), some_angles()
    expected = table.evaluate(*angles)
    wrong, counts = [], [0] * 8
    stop = time.monotonic() + float(seconds)

    def work(number: int) -> None:
        rng = np.random.default_rng(number)
        while time.monotonic() < stop:
            n = int(rng.choice([1, 100, 9_000, LARGE]))
            found = table.evaluate(*(x[:n] for x in angles))
            if not np.array_equal(found, expected[:n]):
                wrong.append(number)
            counts[number] += 1

    workers = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return {"layer": numba.threading_layer(), "calls": counts, "wrong": len(wrong)}


def threads_without_tbb(seconds: str) -> dict[str, Any]:
    """`threads` where the tbb package is not installed and no such library is on the system's path."""
    import importlib.metadata

    installed = importlib.metadata.files

    def files(name: str) -> Any:
        if name == "tbb":
            raise importlib.metadata.PackageNotFoundError(name)
        return installed(name)

    importlib.metadata.files = files
    return threads(seconds)


def compile_once(_: str = "") -> dict[str, Any]:
    """Which kernels were compiled here, not loaded, for one look-up; the processor features they were compiled for."""
    from numba.core import event
    from numba.core.registry import cpu_target

    from brdfcore.kernels.machine import jit  # noqa: F401

    with event.install_recorder("numba:compile") as recorded:
        value = float(a_table().evaluate(0.5, 0.5, 3.0)[0])
    found = {e.data["dispatcher"].py_func.__qualname__ for _, e in recorded.buffer if e.is_start}
    _, name, features = cpu_target.target_context.codegen().magic_tuple()
    return {"value": value, "compiled": sorted(found), "name": name, "features": features.split(",")}


def evaluate_once(_: str = "") -> dict[str, Any]:
    """One large batch; says where the compiled code was cached."""
    table, angles = a_table(), some_angles()
    values = table.evaluate(*angles)
    from brdfcore.kernels.tables.trilinear import trilinear_one

    cache = getattr(trilinear_one.parallel, "_cache", None)
    return {"sum": float(values.sum(dtype=np.float64)), "cache": getattr(cache, "cache_path", None)}


def _in_child(queue: Any) -> None:
    queue.put(evaluate_once()["sum"])


def fork(_: str = "") -> dict[str, Any]:
    """Evaluate in parallel here, then again in a forked child."""
    import numba

    from brdfcore.kernels.machine import launch

    here = evaluate_once()["sum"]
    layer = numba.threading_layer()
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(60)  # a hang becomes a death that the parent sees
        os.write(write, json.dumps([evaluate_once()["sum"], launch.threads()]).encode())
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert status == 0, f"the forked child ended with status {status}"
    there, count = json.loads(os.read(read, 1000))
    return {"layer": layer, "same": here == there, "threads_in_child": count}


def spawn(_: str = "") -> dict[str, Any]:
    """Evaluate in parallel here, then again in a spawned child."""
    context = multiprocessing.get_context("spawn")
    here = evaluate_once()["sum"]
    queue = context.Queue()
    child = context.Process(target=_in_child, args=(queue,))
    child.start()
    there = queue.get(timeout=120)
    child.join()
    return {"same": here == there, "exitcode": child.exitcode}


def killed_while_saving(folder: str, times: str) -> dict[str, Any]:
    """Fork a child that saves two different tables in turn to one name, kill -9 it at a random moment, look; again.

    Forked from here, where everything is imported and nothing parallel was launched, so that many kills fit
    into a second and most hit the middle of a save.
    """
    import brdfcore as bc

    path = Path(folder) / "kept.h5"
    tables = [bc.tabulate(bc.model("lambert", reflectance=r), "angle_grid", shape=(40, 40, 40)) for r in (0.25, 0.75)]
    tables[0].save(path)
    ids = {table.id for table in tables}
    rng = np.random.default_rng()
    found: list[str] = []
    saves = leftovers = 0
    for _ in range(int(times)):
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            while True:
                for table in tables:
                    table.save(path)
                    os.write(write, b".")
        time.sleep(float(rng.uniform(0.01, 0.12)))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(write)
        while chunk := os.read(read, 65_536):
            saves += len(chunk)
        os.close(read)
        found.append(bc.open_table(path).id)  # reads and checks everything
        leftovers += len(list(path.parent.glob(".*.tmp")))
    tables[0].save(path)
    return {
        "kills": len(found),
        "whole": sum(i in ids for i in found),
        "saves": saves,
        "leftovers": leftovers,
        "leftovers_after_next_save": len(list(path.parent.glob(".*.tmp"))),
    }


PROGRAMS = {
    f.__name__: f for f in (threads, threads_without_tbb, compile_once, evaluate_once, fork, spawn, killed_while_saving)
}

if __name__ == "__main__":
    print(json.dumps(PROGRAMS[sys.argv[1]](*sys.argv[2:])), flush=True)
