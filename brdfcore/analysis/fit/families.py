"""Models that can be fitted: their free parameters, each on the scale that it is searched on, and their lobes.

A lobe is the registered model with specular = 1 and diffuse = 0. Its weight (`specular`, one a channel) and that of the
diffuse base are linear and found exactly for every choice of the others (`solve`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.catalogue import model
from brdfcore.base.errors import InputError

Float64Array = npt.NDArray[np.float64]
Angles = tuple[Float64Array, Float64Array, Float64Array]


@dataclass(frozen=True)
class Free:
    """A shape parameter of a model: searched from `low` to `high` on its own scale, begun at `starts`.

    scale  "log" log10 of the value; "amplitude" r = (n - 1)/(n + 1) of an index n, what Fresnel's formulas hold at
           normal incidence: from no interface (0) to a perfect reflector (1); "linear".
    """

    name: str
    scale: str
    low: float
    high: float
    starts: tuple[float, ...]

    def value(self, x: float) -> float:
        """The model's parameter at x of the scale."""
        if self.scale == "log":
            return float(10.0**x)
        return float((1 + x) / (1 - x)) if self.scale == "amplitude" else float(x)

    def slope(self, x: float) -> float:
        """d value/d x."""
        if self.scale == "log":
            return float(np.log(10.0) * 10.0**x)
        return float(2 / (1 - x) ** 2) if self.scale == "amplitude" else 1.0


#: alpha or rms slope: from a polished surface to a matt one (1.4: Blinn's distribution ends at pi/2), six a decade.
ROUGHNESS = Free("roughness", "log", -5.0, 0.15, tuple(np.linspace(-3.5, 0.0, 22)))
#: of a cosine; about 2/m^2 of a roughness m.
EXPONENT = Free("exponent", "log", -1.0, 10.0, tuple(np.linspace(-0.5, 7.0, 24)))
#: index 1.1 to 199: F at normal incidence .002 to .98.
IOR = Free("ior", "amplitude", 0.05, 0.99, (0.1, 0.2, 0.45, 0.8))
SIGMA = Free("sigma", "linear", 0.0, float(np.pi / 2), (0.1, 0.4, 0.9))


@dataclass(frozen=True)
class Family:
    """A lobe of a registered model: its free parameters, and choices that are fixed."""

    model: str
    free: tuple[Free, ...]
    fixed: Mapping[str, Any] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """What tells it from the other families."""
        return f"{self.model} {dict(self.fixed)} {[f.name for f in self.free]}"

    def parameters(self, shape: Sequence[float]) -> dict[str, Any]:
        """Those of the model, of a point of the search."""
        return {**self.fixed, **{f.name: f.value(x) for f, x in zip(self.free, shape)}}

    def lobe(self, shape: Sequence[float]) -> Brdf:
        """The model with specular 1 and no diffuse part."""
        return model(self.model, diffuse=0.0, specular=1.0, **self.parameters(shape))

    def column(self, shape: Sequence[float], angles: Angles) -> Float64Array:
        """f_r of `lobe` in 1/sr, (n,)."""
        return np.asarray(self.lobe(shape).evaluate(*angles)[:, 0], np.float64)

    def starts(self) -> list[tuple[float, ...]]:
        """The grid that the search begins on."""
        return list(product(*(f.starts for f in self.free)))


_FACETS = (ROUGHNESS, IOR)
#: What `model=` takes: a name of the registry, each with its variants.
FAMILIES: dict[str, tuple[Family, ...]] = {
    "ggx": (Family("ggx", _FACETS), Family("ggx", (ROUGHNESS,))),
    "cook_torrance": tuple(
        Family("cook_torrance", free, {"distribution": d, "fresnel": "dielectric" if len(free) > 1 else "none"})
        for d in ("beckmann", "blinn")
        for free in (_FACETS, (ROUGHNESS,))
    ),
    "ward": (Family("ward", (ROUGHNESS,)),),
    "phong": (Family("phong", (EXPONENT,)),),
    "blinn_phong": (Family("blinn_phong", (EXPONENT,)),),
}
#: The diffuse part under the lobes.
BASES = ("lambert", "oren_nayar")


def families(name: str) -> list[Family]:
    """Those of a model's name; of all for "auto"."""
    if name == "auto":
        return [f for each in FAMILIES.values() for f in each]
    if name not in FAMILIES:
        expected = "one of " + ", ".join(["auto", *FAMILIES])
        said = f"model = {name!r}: no such model can be fitted; expected {expected}"
        raise InputError("unknown_model", said, where="model", got=name, expected=expected)
    return list(FAMILIES[name])


def base_columns(base: str, sigma: float, angles: Angles) -> tuple[Float64Array, Float64Array]:
    """(A, B), (n,) each: the base of reflectance r is r A + r^2 B (B: light reflected twice in a groove)."""
    if base == "lambert":
        return np.full(angles[0].shape, 1 / np.pi), np.zeros(angles[0].shape)
    one, half = (model("oren_nayar", reflectance=r, sigma=sigma).evaluate(*angles)[:, 0] for r in (1.0, 0.5))
    return 4 * half - one, 2 * one - 4 * half
