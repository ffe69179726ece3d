"""Compile every kernel and have a figure drawn by the process that draws, so that no request waits for a compiler."""

from __future__ import annotations

import logging
import time

import numpy as np
from brdf_service.http.errors import MaterialDamagedError, NotFoundError
from brdf_service.library.materials import Library
from brdf_service.work.drawing import Drawing
from brdf_service.work.pictures import Picture

import brdfcore as bc

log = logging.getLogger("brdf.service")

#: Two sizes: kernels have a version for a few points and one for many.
_COUNTS = (1, 20_000)
_SLICE = Picture("slice", "", {"theta_i": [0.0], "view": "polar", "scale": "linear", "channel": None, "format": "png"})


def warm_up(library: Library, drawing: Drawing) -> None:
    """Evaluate one material of each representation and number of channels, and have one slice drawn of each."""
    begun = time.perf_counter()
    seen: set[tuple[object, ...]] = set()
    try:
        lines = library.page(0, 100).lines
    except bc.StorageError as error:
        log.warning("no warm-up: %s", error)
        return
    for line in lines:
        facts = line.facts
        if not line.usable or _look(facts) in seen:
            continue
        seen.add(_look(facts))
        try:
            material = library.get(line.name)
            for count in _COUNTS:
                material.brdf.evaluate(np.zeros(count), 0.0, 0.0)
            # the other process starts, looks for fonts and loads the same kernels
            drawing.draw(material, _SLICE)
        except (NotFoundError, MaterialDamagedError):  # gone since it was listed
            continue
        except Exception:
            # a warm-up that fails costs time later; it is no reason not to serve the other materials
            log.exception("warm-up of %s failed", line.name)
    log.info("warm after %.1f s: %d kinds of material", time.perf_counter() - begun, len(seen))


def _look(facts: dict[str, object]) -> tuple[object, ...]:
    """What decides which machine code a material needs."""
    channels = facts.get("channels")
    count = len(channels) if isinstance(channels, list) else 0
    attributes = facts.get("attributes")
    # tables have one kernel for one channel, one for three and one for any other number
    return (
        facts.get("representation", facts["kind"]),
        count if count in (1, 3) else 0,
        facts.get("bilateral"),
        facts.get("has_delta"),
        attributes.get("interpolation") if isinstance(attributes, dict) else None,
    )
