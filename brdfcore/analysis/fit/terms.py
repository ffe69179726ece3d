"""A fitted state as models of the registry: {"model", "parameters"}, and "factor" where a model's bounds demand it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.fit.solve import State
from brdfcore.base.catalogue import model
from brdfcore.base.errors import InputError

Float64Array = npt.NDArray[np.float64]


def terms_of(state: State) -> list[dict[str, Any]]:
    """f is the sum of the terms; one, where one lobe on a Lambertian base is a model's own `diffuse` and `specular`."""
    base, lobes = state.weights[:, 0], state.weights[:, 1:]
    used = [k for k in range(lobes.shape[1]) if lobes[:, k].any()]
    if state.base == "lambert" and len(used) == 1:
        k = used[0]
        parameters = {"diffuse": _numbers(base), "specular": _numbers(lobes[:, k])}
        term = {"model": state.lobes[k].model, "parameters": {**parameters, **_shape(state, k)}}
        if _is_model(term):
            return [term]
    terms = [_term(state.lobes[k].model, "specular", lobes[:, k], {"diffuse": 0.0, **_shape(state, k)}) for k in used]
    if base.any() or not terms:
        more = {} if state.base == "lambert" else {"sigma": state.sigma}
        terms.insert(0, _term(state.base, "reflectance", base, more))
    return terms


def _shape(state: State, k: int) -> dict[str, Any]:
    return state.lobes[k].parameters(state.shapes[k])


def _term(name: str, weight: str, values: Float64Array, parameters: dict[str, Any]) -> dict[str, Any]:
    term = {"model": name, "parameters": {**parameters, weight: _numbers(values)}}
    if _is_model(term):
        return term
    most = float(values.max())
    return {"model": name, "parameters": {**parameters, weight: _numbers(values / most)}, "factor": most}


def _is_model(term: dict[str, Any]) -> bool:
    try:
        model(term["model"], **term["parameters"])
    except InputError:
        return False
    return True


def _numbers(values: Float64Array) -> Any:
    return float(values[0]) if values.size == 1 else [float(v) for v in values]
