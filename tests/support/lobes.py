"""Lambertians with narrow lobes anywhere, whose energy is known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import FloatArray

Float64Array = npt.NDArray[np.float64]

#: theta_i up to which lobes exist, rad: beyond they would be cut by the horizon.
LAST = float(np.radians(80.0))
#: Centre (theta_o, delta_phi) of a lobe, of theta_i: at the mirror direction, at the light, off both.
CENTRES: dict[str, Callable[[Float64Array], tuple[Float64Array, Float64Array]]] = {
    "mirror": lambda t: (t, np.full_like(t, np.pi)),
    "light": lambda t: (t, np.zeros_like(t)),
    "off": lambda t: (0.5 * t + 0.2, np.full_like(t, 2.0)),
}


class Lobes(Brdf):
    """diffuse/pi + sum of lobes e exp(-4 sin^2(r/2)/w^2) / (pi w^2 cos theta_c), r the angle from the lobe's centre.

    The mean of cos theta_o around a centre is cos theta_c cos r, so each lobe reflects e (1 - w^2/2) of the light, for
    any theta_i up to `LAST`.
    """

    reciprocal = False
    energy_conserving = False

    def __init__(self, places: Sequence[str], width: float, energy: float = 0.3, diffuse: float = 0.3) -> None:
        super().__init__()
        self.places, self.width, self.energy, self.diffuse = tuple(places), width, energy, diffuse
        self.bilateral = "off" not in places

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        a, b, c = (np.asarray(x, np.float64) for x in (theta_i, theta_o, delta_phi))
        out[:, 0] = self.diffuse / np.pi
        for place in self.places:
            at, turn = CENTRES[place](a)
            s2 = np.sin(0.5 * (b - at)) ** 2 + np.sin(b) * np.sin(at) * np.sin(0.5 * (c - turn)) ** 2
            with np.errstate(under="ignore"):
                lobe = self.energy * np.exp(-4 * s2 / self.width**2) / (np.pi * self.width**2 * np.cos(at))
            out[:, 0] += np.where(a <= LAST, lobe, 0.0)
        return True

    @property
    def lobe_albedo(self) -> float:
        """Of all lobes together, at theta_i up to `LAST`."""
        return len(self.places) * self.energy * (1 - 0.5 * self.width**2)

    @property
    def lobe_share(self) -> float:
        """L1 of the Lambertian alone, against this: the lobes' energy of the whole, light from everywhere."""
        lobes = self.lobe_albedo * np.sin(LAST) ** 2
        return float(lobes / (lobes + self.diffuse))
