"""Names to classes, imported when first used. One line here adds a model, a format or a representation.

Other packages add entries through the entry-point groups `brdfcore.models`, `brdfcore.representations`
and `brdfcore.formats`; a built-in name can't be taken over.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType
from typing import Any

from brdfcore.base.errors import UnknownNameError


class Registry:
    """An immutable map from a name to a lazily imported class ("module:Class")."""

    def __init__(self, kind: str, entries: dict[str, str]) -> None:
        self.kind = kind
        self.group = f"brdfcore.{kind}s"
        self.entries = MappingProxyType(entries)

    def names(self) -> tuple[str, ...]:
        """All names: built-in ones in the order listed, then those of installed packages."""
        return (*self.entries, *(n for n in _plugins(self.group) if n not in self.entries))

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.entries or name in _plugins(self.group)

    def load(self, name: str) -> Any:
        """The class registered under `name`; `UnknownNameError` with close names on a miss."""
        if isinstance(name, str) and name in self.entries:
            module, _, attribute = self.entries[name].partition(":")
            return getattr(import_module(module), attribute)
        if isinstance(name, str) and name in _plugins(self.group):
            return _plugins(self.group)[name].load()
        raise self._unknown(name)

    def _unknown(self, name: object) -> UnknownNameError:
        names = self.names()
        close = difflib.get_close_matches(str(name), names, n=3, cutoff=0.5)
        meant = f"; did you mean {' or '.join(repr(c) for c in close)}?" if close else "."
        return UnknownNameError(
            f"unknown_{self.kind}",
            f"no {self.kind} is called {str(name)[:80]!r}{meant} Known: {', '.join(names)}",
            where=self.kind,
            got=str(name)[:80],
            expected=", ".join(names),
        )


@cache
def _plugins(group: str) -> dict[str, EntryPoint]:
    return {e.name: e for e in entry_points(group=group)}


MODELS = Registry(
    "model",
    {
        "lambert": "brdfcore.models.lambert:Lambert",
        "mirror": "brdfcore.models.mirror:Mirror",
        "phong": "brdfcore.models.phong:Phong",
        "blinn_phong": "brdfcore.models.blinn_phong:BlinnPhong",
        "ward": "brdfcore.models.ward:Ward",
        "cook_torrance": "brdfcore.models.cook_torrance:CookTorrance",
        "ggx": "brdfcore.models.ggx:GGX",
        "oren_nayar": "brdfcore.models.oren_nayar:OrenNayar",
    },
)

REPRESENTATIONS = Registry(
    "representation",
    {
        "angle_grid": "brdfcore.tables.angle_grid:AngleGrid",
        "lobe_grid": "brdfcore.tables.lobe_grid:LobeGrid",
        "half_difference": "brdfcore.tables.half_difference:HalfDifference",
        "vndf_warp": "brdfcore.tables.vndf_warp:VndfWarp",
        "harmonic": "brdfcore.harmonics.expansion:HarmonicExpansion",
        "half_angle_grid": "brdfcore.tables.half_angle_grid:HalfAngleGrid",
        "scattered": "brdfcore.tables.scattered.table:Scattered",
        "specular_grid": "brdfcore.tables.specular_grid:SpecularGrid",
        "node_grid": "brdfcore.tables.node_grid:NodeGrid",
        "patch_grid": "brdfcore.tables.patch_grid:PatchGrid",
    },
)

FORMATS = Registry(
    "format",
    {
        "rgl": "brdfcore.formats.rgl.format:RglFormat",
        "astm": "brdfcore.formats.astm:AstmFormat",
        "zemax": "brdfcore.formats.zemax.format:ZemaxFormat",
        "openmaterial": "brdfcore.formats.openmaterial.format:OpenMaterialFormat",
        "table": "brdfcore.formats.table:TableFormat",
        "model": "brdfcore.formats.model_file:ModelFormat",
        "alta": "brdfcore.formats.alta:AltaFormat",
        "bird": "brdfcore.formats.bird:BirdFormat",
        "pbrt": "brdfcore.formats.pbrt:PbrtFormat",
        "tracepro": "brdfcore.formats.tracepro:TraceProFormat",
        "bsdf_xml": "brdfcore.formats.bsdf_xml.format:BsdfXmlFormat",
        "mbsdf": "brdfcore.formats.mbsdf:MbsdfFormat",
        "speos": "brdfcore.formats.speos.format:SpeosFormat",
        "merl": "brdfcore.formats.merl:MerlFormat",
        # last: any rows of numbers may be one
        "csv": "brdfcore.formats.csv.format:CsvFormat",
    },
)
