"""BRDF tables with a known error: models, measured files, compact tables, fast look-ups.

The names below are imported when first used, so that `import brdfcore` costs little and loads nothing heavy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from brdfcore.version import __version__

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
    "check": "brdfcore.analysis.checks",
    "gloss": "brdfcore.analysis.gloss",
    "repair": "brdfcore.analysis.repair",
    "compare": "brdfcore.reporting.comparison",
    "pareto": "brdfcore.analysis.pareto",
    "plan": "brdfcore.analysis.plan",
    "report": "brdfcore.reporting.report",
    "model": "brdfcore.catalogue",
    "models": None,  # a package that is callable: brdfcore.models()
    "representations": "brdfcore.catalogue",
    "formats": None,
    "tabulate": "brdfcore.build",
    "project": "brdfcore.expand",
    "project_slice": "brdfcore.harmonics.slices",
    "harmonic_summary": "brdfcore.harmonics.summary",
    "HarmonicExpansion": "brdfcore.harmonics.expansion",
    "Light": "brdfcore.harmonics.light",
    "relight": "brdfcore.harmonics.transfer",
    "open_table": "brdfcore.tables.store",
    "read": "brdfcore.io",
    "sniff": "brdfcore.io",
    "write": "brdfcore.io",
    "convert": "brdfcore.conversion",
    "slice": "brdfcore.plot.slices",
    "starter_library": "brdfcore.starter",
    "to_radians": "brdfcore.conventions",
    "to_rgb": "brdfcore.colour",
    "plot": None,  # a package: brdfcore.plot.polar(...)
}

if TYPE_CHECKING:  # the same names for type checkers, which would see Any through __getattr__
    from brdfcore import plot as plot
    from brdfcore.analysis.checks import check as check
    from brdfcore.analysis.gloss import gloss as gloss
    from brdfcore.analysis.pareto import pareto as pareto
    from brdfcore.analysis.plan import plan as plan
    from brdfcore.analysis.repair import repair as repair
    from brdfcore.brdf import Brdf as Brdf
    from brdfcore.brdf import Channels as Channels
    from brdfcore.build import tabulate as tabulate
    from brdfcore.catalogue import formats as formats
    from brdfcore.catalogue import model as model
    from brdfcore.catalogue import models as models
    from brdfcore.catalogue import representations as representations
    from brdfcore.colour import to_rgb as to_rgb
    from brdfcore.conventions import to_radians as to_radians
    from brdfcore.conversion import convert as convert
    from brdfcore.errors import BrdfError as BrdfError
    from brdfcore.errors import FileFormatError as FileFormatError
    from brdfcore.errors import InputError as InputError
    from brdfcore.errors import LimitError as LimitError
    from brdfcore.errors import MissingExtraError as MissingExtraError
    from brdfcore.errors import StorageError as StorageError
    from brdfcore.errors import UnknownNameError as UnknownNameError
    from brdfcore.expand import project as project
    from brdfcore.harmonics.expansion import HarmonicExpansion as HarmonicExpansion
    from brdfcore.harmonics.light import Light as Light
    from brdfcore.harmonics.slices import project_slice as project_slice
    from brdfcore.harmonics.summary import harmonic_summary as harmonic_summary
    from brdfcore.harmonics.transfer import relight as relight
    from brdfcore.io import read as read
    from brdfcore.io import sniff as sniff
    from brdfcore.io import write as write
    from brdfcore.parameters import Parameter as Parameter
    from brdfcore.plot.slices import slice as slice
    from brdfcore.reporting.comparison import compare as compare
    from brdfcore.reporting.report import report as report
    from brdfcore.starter import starter_library as starter_library
    from brdfcore.status import Status as Status
    from brdfcore.tables.base import Table as Table
    from brdfcore.tables.store import open_table as open_table

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
