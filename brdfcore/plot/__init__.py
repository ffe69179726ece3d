"""Pictures of any `Brdf`, and the numbers they are drawn from.

`slice`, `SliceData` and `render_sphere` need numpy alone; `polar`, `hemisphere`, `sphere`, `expansion` (matplotlib
Figures) and `render` (a Figure as PNG or SVG bytes) import matplotlib when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_PUBLIC = {
    "SliceData": "brdfcore.plot.slices",
    "slice": "brdfcore.plot.slices",
    "polar": "brdfcore.plot.half_disc",
    "hemisphere": "brdfcore.plot.disc",
    "sphere": "brdfcore.plot.sphere",
    "render_sphere": "brdfcore.plot.lit",
    "coverage": "brdfcore.plot.coverage",
    "expansion": "brdfcore.plot.expansion",
    "render": "brdfcore.plot.rendering",
}

__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'brdfcore.plot' has no attribute {name!r}")
    try:
        value = getattr(import_module(_PUBLIC[name]), name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        from brdfcore.base.errors import missing_extra

        raise missing_extra("matplotlib", "core", "a picture") from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
