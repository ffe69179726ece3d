"""Expansions of materials in spherical harmonics, made when first asked for and kept while there is room."""

from __future__ import annotations

import contextlib
import math
import threading
from typing import NamedTuple

from brdf_service.library.materials import Material
from cachetools import LRUCache

import brdfcore as bc

#: Bytes of expansions that are kept.
KEPT_BYTES = 128 * 2**20


class Degree(NamedTuple):
    """What an expansion is asked for, beside its material: the arguments of `brdfcore.project`."""

    lmax: int
    target: str = "f_cos_cos"
    window: str = "none"
    symmetrise: bool = False


class Expansions:
    """May be called from several threads; expansions are made one after the other, as each takes all cores."""

    def __init__(self) -> None:
        self._kept: LRUCache[tuple[str, Degree], bc.HarmonicExpansion] = LRUCache(
            KEPT_BYTES, getsizeof=lambda expansion: expansion.nbytes
        )
        self._making, self._looking = threading.Lock(), threading.Lock()

    def get(self, material: Material, asked: Degree) -> bc.HarmonicExpansion:
        """The expansion; raises what `brdfcore.project` raises."""
        key = (material.id, asked)
        found = self._look(key)
        if found is None:
            with self._making:
                found = self._look(key)  # somebody else's wait may have made it
                if found is None:
                    found = bc.project(material.brdf, **asked._asdict())
                    with self._looking, contextlib.suppress(ValueError):  # larger than all that is kept
                        self._kept[key] = found
        return found

    def _look(self, key: tuple[str, Degree]) -> bc.HarmonicExpansion | None:
        with self._looking:
            return self._kept.get(key)


def projection_seconds(channels: int, lmax: int) -> float:
    """About how long a projection takes: its directions and sums grow with the degree, but a small degree of a sharp
    lobe still takes many directions."""
    return 0.08 * channels * max(0.5, math.pow(lmax / 32, 2.5))


def check_lmax(lmax: int, limit: int) -> None:
    """`LimitError` above the service's largest degree: the work grows with its cube."""
    if lmax > limit:
        text = f"lmax = {lmax}; the limit is {limit}; project with the library or the command line for more"
        raise bc.LimitError("lmax_too_large", text, where="lmax", got=lmax, limit=limit)
