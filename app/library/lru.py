"""What is kept while there is room: `cachetools.LRUCache` by bytes. It is not thread-safe: its owner holds a lock."""

from __future__ import annotations

from typing import TypeVar

from cachetools import LRUCache

K = TypeVar("K")
V = TypeVar("V")


def keep(cache: LRUCache[K, V], key: K, value: V) -> bool:
    """Hold `value`, letting the least recently used go as needed. False, and nothing changed but `key` gone, if it
    alone is larger than the cache."""
    cache.pop(key, None)
    if cache.getsizeof(value) > cache.maxsize:
        return False
    cache[key] = value
    return True
