"""Tables about the centre of a lobe, with the light's angle as an axis of its own."""

from __future__ import annotations

from brdfcore.tables.lobe_grid.table import LobeGrid

__all__ = ["LobeGrid"]
