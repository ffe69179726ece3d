"""What one would see of an error: a lit sphere of each material, and the difference by FLIP.

P. Andersson, J. Nilsson, T. Akenine-Moeller, M. Oskarsson, K. Astrom, M. D. Fairchild, "FLIP: a difference evaluator
for alternating images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020, DOI 10.1145/3406183; computed by its
authors' library, flip-evaluator.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import MissingExtraError, missing_extra
from brdfcore.plot.colour import screen_weights, to_srgb
from brdfcore.plot.lit import lit
from brdfcore.plot.style import default_channel

Array = npt.NDArray[np.float64]

PIXELS = 192
#: Around the sphere, sRGB, the same in both pictures.
SURROUND = 0.32
LIGHT = "studio"
#: Pixels a degree of the viewer's field that FLIP assumes: its default, a 0.7 m wide 4K screen seen from 0.7 m.
PIXELS_A_DEGREE = 67.0


@dataclass(frozen=True)
class Appearance:
    """sRGB pictures (n, n, 3) within [0, 1] and the FLIP map (n, n) of the two; `mean` and 95th percentile over the
    pixels that the sphere covers; `light` is the lighting's name. None where flip-evaluator is not installed."""

    reference: Array
    candidate: Array
    difference: Array | None
    mean: float | None
    p95: float | None
    light: str = LIGHT

    def to_json(self) -> dict[str, Any]:
        return {"mean": self.mean, "p95": self.p95, "light": self.light, "pixels": int(self.reference.shape[0])}


def appearance(reference: Brdf, candidate: Brdf, *, pixels: int = PIXELS, need_flip: bool = True) -> Appearance:
    """A lit sphere of each, and how different they look.

    need_flip  True: a missing flip-evaluator is a `MissingExtraError`; False: the pictures alone are given.
    """
    images, cover = [], np.zeros((pixels, pixels))
    for b in (reference, candidate):
        found = lit(b, pixels, LIGHT, _weights(b))
        cover = found.coverage
        inside = np.nan_to_num(found.radiance, nan=0.0, posinf=1.0, neginf=0.0)
        behind = ((SURROUND + 0.055) / 1.055) ** 2.4
        images.append(to_srgb(np.clip(inside, 0.0, 1.0) + (1 - cover[..., None]) * behind))
    try:
        difference = flip(images[0], images[1])
    except MissingExtraError:
        if need_flip:
            raise
        return Appearance(images[0], images[1], None, None, None)
    inside = difference[cover > 0]
    return Appearance(images[0], images[1], difference, float(inside.mean()), float(np.quantile(inside, 0.95)))


def flip(reference: Array, candidate: Array) -> Array:
    """LDR-FLIP of two sRGB pictures (n, m, 3) within [0, 1]: a map (n, m) in [0, 1]. Needs the `flip` extra."""
    try:
        import flip_evaluator
    except ModuleNotFoundError:
        raise missing_extra("flip-evaluator", "flip", "FLIP") from None

    pictures = [np.ascontiguousarray(x, np.float32) for x in (reference, candidate)]
    found = flip_evaluator.evaluate(
        *pictures, "LDR", applyMagma=False, computeMeanError=False, parameters={"ppd": PIXELS_A_DEGREE}
    )
    difference: Array = np.asarray(found[0], np.float64).reshape(*reference.shape[:2], -1)[..., 0]
    return difference


def _weights(b: Brdf) -> Array:
    found = screen_weights(b.channels)
    if found is not None:
        return found[0]
    weights = np.zeros((len(b.channels), 3))
    weights[default_channel(b.channels)] = 1.0
    return weights
