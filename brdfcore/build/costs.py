"""What a look-up costs, from a table measured once: choices then depend on the material, not on the moment."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

#: Of a representation that the table does not know.
UNKNOWN = 50.0
#: What is less than this many times the time of the fastest is taken for as fast.
AS_FAST = 1.25


@cache
def table() -> dict[str, Any]:
    """{"machine", "nbytes": [...], "channels": [...], "ns": {"representation interpolation": [[...], ...]}}.

    ns[k][j]: nanoseconds a look-up of channels[k] and nbytes[j], float32 angles, a million at a time, one thread
    (`python -m tests.benchmarks.costs` measures and writes it).
    """
    found: dict[str, Any] = json.loads(files("brdfcore.build").joinpath("costs.json").read_text("utf-8"))
    return found


def nanoseconds(representation: str, interpolation: str, channels: int, nbytes: float) -> float:
    """Of one look-up: linear in the channels, and in the logarithm of the bytes, at the ends continued flat."""
    costs = table()
    ns = costs["ns"].get(f"{representation} {interpolation}", costs["ns"].get(f"{representation} linear"))
    if ns is None:
        return UNKNOWN * channels
    sizes = np.log(np.asarray(costs["nbytes"], np.float64))
    of_size = [float(np.interp(np.log(max(nbytes, 1.0)), sizes, row)) for row in ns]
    counts = costs["channels"]
    if channels > counts[-1]:  # look-ups of many channels take their time channel by channel
        return of_size[-1] * channels / float(counts[-1])
    return float(np.interp(channels, counts, of_size))
