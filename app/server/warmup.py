"""Warming up: every kernel is compiled, and a figure drawn by the process that draws, so that no request waits for a
compiler."""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import sys
import threading
import time
from typing import Any

import numpy as np
from brdf_service.http.errors import MaterialDamagedError, NotFoundError
from brdf_service.library.materials import Library
from brdf_service.state import State
from brdf_service.work.drawing import Drawing
from brdf_service.work.pictures import Picture

import brdfcore as bc

log = logging.getLogger("brdf.service")

_THREAD = "warm-up"
#: Two sizes: kernels have a version for a few points and one for many.
_COUNTS = (1, 20_000)
_SLICE = Picture("slice", "", {"theta_i": [0.0], "view": "polar", "scale": "linear", "channel": None, "format": "png"})


def start(state: State, *, warm: bool) -> None:
    """Warm up in the background, or with `warm` False say at once that the service is ready."""

    def warm_then_ready() -> None:
        if warm:
            _warm_up(state.library, state.drawing)
            # what is loaded by now stays: the collector need not look through it again and again
            gc.collect()
            gc.freeze()
        state.ready = True

    # a daemon: a service that is told to stop does not wait for the compiler
    threading.Thread(target=warm_then_ready, name=_THREAD, daemon=True).start()


def leave() -> None:
    """Wait a little for a warm-up that is still compiling, then end the process without it.

    The interpreter ends a daemon thread wherever it is; inside the compiler's C++ frames that aborts the process.
    """
    warming = [t for t in threading.enumerate() if t.name == _THREAD]
    for thread in warming:
        thread.join(3)
    if any(t.is_alive() for t in warming):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _warm_up(library: Library, drawing: Drawing) -> None:
    """Evaluate one material of each representation and number of channels, and have one slice drawn of each."""
    begun, seen = time.perf_counter(), set()
    try:
        lines = library.page(0, 100).lines
    except bc.StorageError as error:
        log.warning("no warm-up: %s", error)
        return
    for line in lines:
        if not line.usable or (kind := _machine_code(line.facts)) in seen:
            continue
        seen.add(kind)
        try:
            material = library.get(line.name)
            for count in _COUNTS:
                material.brdf.evaluate(np.zeros(count), 0.0, 0.0)
                with contextlib.suppress(bc.InputError):  # an older table, without
                    material.brdf.uncertainty(np.zeros(count), 0.0, 0.0)
            # the other process starts, looks for fonts and loads the same kernels
            drawing.draw(material, _SLICE)
        except (NotFoundError, MaterialDamagedError):  # gone since it was listed
            continue
        except Exception:
            # a warm-up that fails costs time later; it is no reason not to serve the other materials
            log.exception("warm-up of %s failed", line.name)
    log.info("warm after %.1f s: %d kinds of material", time.perf_counter() - begun, len(seen))


def _machine_code(facts: dict[str, Any]) -> tuple[object, ...]:
    """What decides which machine code a material needs."""
    count = len(facts.get("channels", ()))
    # tables have one kernel for one channel, one for three and one for any other number
    kernel = (facts.get("representation", facts["kind"]), count if count in (1, 3) else 0)
    return *kernel, facts.get("bilateral"), facts.get("has_delta"), facts.get("attributes", {}).get("interpolation")
