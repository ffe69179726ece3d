"""Half vectors spread by a visible-normal warp: a file of the RGL database as it is, or any material fitted to it."""

from __future__ import annotations

from brdfcore.tables.vndf_warp.fit import shape_within
from brdfcore.tables.vndf_warp.table import DEFAULT_BYTES, VndfWarp, thinned

__all__ = ["DEFAULT_BYTES", "VndfWarp", "shape_within", "thinned"]
