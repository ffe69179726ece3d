"""What every stored representation is: a `Brdf` made of named arrays, with an identity and a known error."""

from __future__ import annotations

import hashlib
import json
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from brdfcore.brdf import Brdf, Channels
from brdfcore.parameters import Parameter

#: Called as progress(done, total, stage) while a table is built and measured.
Progress = Callable[[int, int, str], None]

FLAGS = ("bilateral", "reciprocal", "energy_conserving", "non_negative")


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """What `tabulate` was asked for; see there. shape None means the representation's default."""

    shape: tuple[int, ...] | None = None
    interpolation: str = "linear"
    negatives: str = "keep"
    fold: frozenset[str] = frozenset()


class Table(Brdf):
    """A representation that is stored: arrays, attributes, flags, an id and a measured error.

    A subclass keeps every array that a look-up reads in `to_arrays()` and every number that changes an
    answer in `attributes()`; store, id and nbytes follow from these two.

    error   dict of the measured error against the source (`build.tabulate` fills it), {} if never measured.
    source  dict with name, format, sha256 of what the table was built from.
    """

    #: Registry name.
    name: ClassVar[str]
    #: Raised whenever `_evaluate` answers differently for the same arrays.
    EVALUATION_VERSION: ClassVar[int] = 1
    #: What `tabulate` may be asked for, beside source and channels.
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    #: One sentence for lists.
    SUMMARY: ClassVar[str] = ""

    def __init__(self, channels: Channels, flags: Mapping[str, bool]) -> None:
        super().__init__()
        self.channels = channels
        self.bilateral = bool(flags["bilateral"])
        self.reciprocal = bool(flags["reciprocal"])
        self.energy_conserving = bool(flags["energy_conserving"])
        self.non_negative = bool(flags["non_negative"])
        self.error: dict[str, Any] = {}
        self.source: dict[str, Any] = {}

    @abstractmethod
    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Every array a look-up touches, by name; not copied."""

    def attributes(self) -> dict[str, Any]:
        """JSON-ready settings that change an answer, e.g. the interpolation."""
        return {}

    @classmethod
    @abstractmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        """The inverse of `to_arrays` and `attributes`; raises `FileFormatError` where they do not fit together."""

    @classmethod
    @abstractmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        """Sample `source`; raises `InputError` where the options or the source do not suit."""

    @classmethod
    def can_hold(cls, source: Brdf) -> bool:
        """Whether `build` can represent `source` at all; what "auto" considers."""
        return True

    @classmethod
    def candidates(cls, source: Brdf, options: BuildOptions, max_bytes: int | None) -> Iterable[BuildOptions]:
        """Options to try, cheapest first; with `max_bytes`, the best that should fit."""
        return (options,)

    @classmethod
    def worth_refining(cls, l1: float, tolerance: float) -> bool:
        """Whether a larger candidate could reach `tolerance` when this one has error `l1`."""
        return True

    @property
    def flags(self) -> dict[str, bool]:
        return {name: getattr(self, name) for name in FLAGS}

    @property
    def nbytes(self) -> int:
        """Bytes of every array a look-up touches."""
        return sum(a.nbytes for a in self.to_arrays().values())

    @cached_property
    def id(self) -> str:
        """sha256 over all that evaluate() reads, hex: representation and its evaluation version, channels,
        flags, attributes, and each array as name, dtype, shape, bytes."""
        digest = hashlib.sha256()
        head = {
            "representation": self.name,
            "evaluation_version": self.EVALUATION_VERSION,
            "channels": self.channels.to_json(),
            "channel_kind": self.channels.kind,
            "flags": self.flags,
            "attributes": self.attributes(),
        }
        digest.update(json.dumps(head, sort_keys=True).encode())
        for name, array in sorted(self.to_arrays().items()):
            little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
            digest.update(json.dumps([name, little.dtype.str, list(little.shape)]).encode())
            digest.update(little.data)
        return digest.hexdigest()

    def save(self, path: str | PathLike[str]) -> None:
        """Write an HDF5 file; a killed process leaves the old file or the new one (`tables.store.save`)."""
        from brdfcore.tables import store

        store.save(self, path)

    def describe(self) -> dict[str, Any]:
        return {
            **super().describe(),
            "representation": self.name,
            "nbytes": self.nbytes,
            "id": self.id,
            "error": self.error,
            "source": self.source,
            "attributes": self.attributes(),
            "shapes": {name: list(a.shape) for name, a in self.to_arrays().items()},
        }
