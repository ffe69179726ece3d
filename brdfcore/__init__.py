"""BRDF tables with a known error: models, measured files, compact tables, fast look-ups.

The names below are imported when first used, so that `import brdfcore` costs little and loads nothing heavy.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_PUBLIC = {
    "Brdf": "brdfcore.brdf",
    "Channels": "brdfcore.brdf",
    "BrdfError": "brdfcore.errors",
    "FileFormatError": "brdfcore.errors",
    "InputError": "brdfcore.errors",
    "LimitError": "brdfcore.errors",
    "MissingExtraError": "brdfcore.errors",
    "StorageError": "brdfcore.errors",
    "UnknownNameError": "brdfcore.errors",
    "Parameter": "brdfcore.parameters",
    "Status": "brdfcore.status",
    "Table": "brdfcore.tables.base",
    "compare": "brdfcore.metrics",
    "model": "brdfcore.catalogue",
    "models": "brdfcore.catalogue",
    "representations": "brdfcore.catalogue",
    "formats": "brdfcore.catalogue",
    "tabulate": "brdfcore.build",
    "open_table": "brdfcore.tables.store",
    "read": "brdfcore.io",
    "sniff": "brdfcore.io",
    "write": "brdfcore.io",
    "slice": "brdfcore.plot.slices",
    "starter_library": "brdfcore.starter",
    "plot": None,  # a package: brdfcore.plot.polar(...)
}

__all__ = [*_PUBLIC, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'brdfcore' has no attribute {name!r}")
    module = _PUBLIC[name]
    value = import_module(f"brdfcore.{name}") if module is None else getattr(import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
