"""What a service says of a material, as attributes: the same for a synchronous and an asynchronous one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.client.connection import Connection


class Described:
    """Attributes that come from the service's metadata.

    name, id    name on the service, and the digest of all that the values depend on.
    channels, bilateral, reciprocal, energy_conserving, non_negative, has_delta, metadata   as of any `Brdf`.
    nbytes      bytes a look-up touches there; 0 for an analytic model.
    error       measured error of a table, {} where there is none.
    source      name, format and sha256 of what a table was built from.
    facts       all of the metadata, as `describe()`.
    """

    name: str
    id: str
    channels: Channels
    bilateral: bool
    reciprocal: bool
    energy_conserving: bool
    non_negative: bool
    has_delta: bool
    metadata: dict[str, Any]
    nbytes: int
    error: dict[str, Any]
    source: dict[str, Any]
    facts: dict[str, Any]
    _connection: Connection

    def _adopt(self, connection: Connection, facts: Mapping[str, Any]) -> None:
        self._connection = connection
        self.facts = dict(facts)
        self.name, self.id = str(facts["name"]), str(facts["id"])
        self.channels = Channels(facts["channels"], facts.get("channel_kind"))
        for flag in ("bilateral", "reciprocal", "energy_conserving", "non_negative", "has_delta"):
            setattr(self, flag, bool(facts[flag]))
        self.metadata = dict(facts.get("metadata") or {})
        self.nbytes = int(facts.get("nbytes") or 0)
        self.error = dict(facts.get("error") or {})
        self.source = dict(facts.get("source") or {})

    def describe(self) -> dict[str, Any]:
        """The service's metadata of this material, JSON-ready."""
        return dict(self.facts)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} at {self._connection.base}, {self.id[:12]}>"

    @staticmethod
    def _as_given(wi: npt.ArrayLike, wo: npt.ArrayLike, vectors: conventions.Vectors) -> tuple[FloatArray, FloatArray]:
        """The caller's own directions, (n, 3), in the dtype of the values, which holds them exactly: who evaluates
        normalises them, once, as a local material would."""
        a, b = (
            np.broadcast_to(conventions.as_float(name, v), (*vectors.shape, 3)).reshape(-1, 3).astype(vectors.dtype)
            for name, v in (("wi", wi), ("wo", wo))
        )
        return a, b
