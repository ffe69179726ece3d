"""One file format a file. The package is also the public function `brdfcore.formats()`: a package of that
name takes the place of a function of that name as soon as anything imports from it, so it is made callable.

>>> [p.name for p in bc.formats()["rgl"]]
['negatives']
"""

from __future__ import annotations

import sys
from types import ModuleType

from brdfcore.base.parameters import Parameter


class _CallablePackage(ModuleType):
    def __call__(self) -> dict[str, tuple[Parameter, ...]]:
        """Every file format with the options of its reader."""
        from brdfcore.base.catalogue import formats

        return formats()


sys.modules[__name__].__class__ = _CallablePackage
