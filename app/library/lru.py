"""A mapping that holds at most so many bytes and lets the least recently used entries go."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class ByteLru(Generic[K, V]):
    """Not thread-safe by itself: its owner holds a lock."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.nbytes = 0
        self._entries: OrderedDict[K, tuple[V, int]] = OrderedDict()

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, key: K) -> bool:
        return key in self._entries

    def get(self, key: K) -> V | None:
        """The value, now the most recently used; None if it is not held."""
        if key not in self._entries:
            return None
        self._entries.move_to_end(key)
        return self._entries[key][0]

    def put(self, key: K, value: V, nbytes: int) -> bool:
        """Hold `value`, letting others go as needed. False, and nothing changed but `key` gone, if it alone is
        larger than the limit."""
        self.drop(key)
        if nbytes > self.limit:
            return False
        while self.nbytes + nbytes > self.limit:
            self.drop(next(iter(self._entries)))
        self._entries[key] = (value, nbytes)
        self.nbytes += nbytes
        return True

    def drop(self, key: K) -> None:
        """Forget `key` if it is held."""
        if key in self._entries:
            self.nbytes -= self._entries.pop(key)[1]
