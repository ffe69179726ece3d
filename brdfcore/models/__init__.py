"""One analytic model a file. The package is also the public function `brdfcore.models()`: a package of that
name takes the place of a function of that name as soon as anything imports from it, so it is made callable.

>>> list(bc.models())[:3]
['lambert', 'mirror', 'phong']
"""

from __future__ import annotations

import sys
from types import ModuleType

from brdfcore.base.parameters import Parameter


class _CallablePackage(ModuleType):
    def __call__(self) -> dict[str, tuple[Parameter, ...]]:
        """Every analytic model with its parameters."""
        from brdfcore.base.catalogue import models

        return models()


sys.modules[__name__].__class__ = _CallablePackage
