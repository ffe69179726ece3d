"""BRDF tables with a known error: models, measured files, compact tables, fast look-ups.

The names below are imported when first used, so that `import brdfcore` costs little and loads nothing heavy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from brdfcore.version import __version__

_PUBLIC = {
    "Brdf": "brdfcore.base.brdf",
    "Channels": "brdfcore.base.channels",
    "Sample": "brdfcore.base.sampling",
    "BrdfError": "brdfcore.base.errors",
    "FileFormatError": "brdfcore.base.errors",
    "InputError": "brdfcore.base.errors",
    "LimitError": "brdfcore.base.errors",
    "MissingExtraError": "brdfcore.base.errors",
    "StorageError": "brdfcore.base.errors",
    "UnknownNameError": "brdfcore.base.errors",
    "Parameter": "brdfcore.base.parameters",
    "Status": "brdfcore.base.status",
    "Table": "brdfcore.tables.base.table",
    "check": "brdfcore.analysis.check.checks",
    "gloss": "brdfcore.analysis.gloss.gloss",
    "Fit": "brdfcore.analysis.fit.fit",
    "fit": "brdfcore.analysis.fit.fit",
    "repair": "brdfcore.analysis.check.repair",
    "compare": "brdfcore.reporting.comparison",
    "pareto": "brdfcore.analysis.pareto.pareto",
    "plan": "brdfcore.analysis.plan.plan",
    "report": "brdfcore.reporting.report",
    "model": "brdfcore.base.catalogue",
    "model_from_json": "brdfcore.base.catalogue",
    "models": None,  # a package that is callable: brdfcore.models()
    "representations": "brdfcore.base.catalogue",
    "formats": None,
    "extensions": "brdfcore.base.catalogue",
    "tabulate": "brdfcore.build.tabulate",
    "project": "brdfcore.build.project",
    "project_slice": "brdfcore.harmonics.slices",
    "harmonic_summary": "brdfcore.harmonics.summary",
    "HarmonicExpansion": "brdfcore.harmonics.expansion",
    "Light": "brdfcore.harmonics.light",
    "relight": "brdfcore.harmonics.transfer",
    "open_table": "brdfcore.tables.store",
    "read": "brdfcore.formats.io.files",
    "sniff": "brdfcore.formats.io.files",
    "write": "brdfcore.formats.io.files",
    "convert": "brdfcore.formats.io.conversion",
    "array_function": "brdfcore.out.array_function",
    "array_bytes": "brdfcore.out.array_file",
    "export": "brdfcore.out.shader",
    "slice": "brdfcore.plot.slices",
    "starter_library": "brdfcore.starter",
    "example_files": "brdfcore.examples",
    "to_radians": "brdfcore.base.conventions",
    "to_rgb": "brdfcore.base.colour",
    "names": None,  # a module: types and lists of choices
    "atomic": "brdfcore.base.atomic:",  # a module: files written whole or not at all
    "plot": None,  # a package: brdfcore.plot.polar(...)
}

if TYPE_CHECKING:  # the same names for type checkers, which would see Any through __getattr__
    from brdfcore import names as names
    from brdfcore import plot as plot
    from brdfcore.analysis.check.checks import check as check
    from brdfcore.analysis.check.repair import repair as repair
    from brdfcore.analysis.fit.fit import Fit as Fit
    from brdfcore.analysis.fit.fit import fit as fit
    from brdfcore.analysis.gloss.gloss import gloss as gloss
    from brdfcore.analysis.pareto.pareto import pareto as pareto
    from brdfcore.analysis.plan.plan import plan as plan
    from brdfcore.base import atomic as atomic
    from brdfcore.base.brdf import Brdf as Brdf
    from brdfcore.base.catalogue import extensions as extensions
    from brdfcore.base.catalogue import formats as formats
    from brdfcore.base.catalogue import model as model
    from brdfcore.base.catalogue import model_from_json as model_from_json
    from brdfcore.base.catalogue import models as models
    from brdfcore.base.catalogue import representations as representations
    from brdfcore.base.channels import Channels as Channels
    from brdfcore.base.colour import to_rgb as to_rgb
    from brdfcore.base.conventions import to_radians as to_radians
    from brdfcore.base.errors import BrdfError as BrdfError
    from brdfcore.base.errors import FileFormatError as FileFormatError
    from brdfcore.base.errors import InputError as InputError
    from brdfcore.base.errors import LimitError as LimitError
    from brdfcore.base.errors import MissingExtraError as MissingExtraError
    from brdfcore.base.errors import StorageError as StorageError
    from brdfcore.base.errors import UnknownNameError as UnknownNameError
    from brdfcore.base.parameters import Parameter as Parameter
    from brdfcore.base.sampling import Sample as Sample
    from brdfcore.base.status import Status as Status
    from brdfcore.build.project import project as project
    from brdfcore.build.tabulate import tabulate as tabulate
    from brdfcore.examples import example_files as example_files
    from brdfcore.formats.io.conversion import convert as convert
    from brdfcore.formats.io.files import read as read
    from brdfcore.formats.io.files import sniff as sniff
    from brdfcore.formats.io.files import write as write
    from brdfcore.harmonics.expansion import HarmonicExpansion as HarmonicExpansion
    from brdfcore.harmonics.light import Light as Light
    from brdfcore.harmonics.slices import project_slice as project_slice
    from brdfcore.harmonics.summary import harmonic_summary as harmonic_summary
    from brdfcore.harmonics.transfer import relight as relight
    from brdfcore.out.array_file import array_bytes as array_bytes
    from brdfcore.out.array_function import array_function as array_function
    from brdfcore.out.shader import export as export
    from brdfcore.plot.slices import slice as slice
    from brdfcore.reporting.comparison import compare as compare
    from brdfcore.reporting.report import report as report
    from brdfcore.starter import starter_library as starter_library
    from brdfcore.tables.base.table import Table as Table
    from brdfcore.tables.store import open_table as open_table

__all__ = [*_PUBLIC, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'brdfcore' has no attribute {name!r}")
    module = _PUBLIC[name]
    if module is None or module.endswith(":"):  # the name of a module
        value = import_module(module.rstrip(":") if module else f"brdfcore.{name}")
    else:
        value = getattr(import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
