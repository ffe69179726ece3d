"""What the processes that the service starts have in common: their environment, and how an error comes back."""

from __future__ import annotations

import os
import sys
from typing import Any

import brdfcore as bc


def environment(**more: str) -> dict[str, str]:
    """That of the service, without its key, and with all of its places to import from; `more` goes last."""
    kept = {k: v for k, v in os.environ.items() if k != "BRDF_API_KEY"}
    paths = os.pathsep.join([os.getcwd() if p == "" else p for p in sys.path])
    return {**kept, "PYTHONPATH": paths, **more}


def told(error: bc.BrdfError) -> dict[str, Any]:
    """The error as JSON; its class travels as a name that `rebuilt` looks up in the library's own list."""
    kind = next(k.__name__ for k in type(error).__mro__ if hasattr(bc, k.__name__))
    return {"kind": kind, "code": error.code, "detail": error.detail, "context": error.context}


def rebuilt(problem: dict[str, Any]) -> bc.BrdfError:
    """The error that `told` told of."""
    kind = getattr(bc, str(problem.get("kind")), bc.BrdfError)
    context = problem.get("context") or {}
    made: bc.BrdfError = kind(str(problem["code"]), str(problem["detail"]), **context)
    return made
