"""Small BRDFs with known answers that tests evaluate and tabulate."""

from __future__ import annotations

import numpy as np

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB
from brdfcore.base.conventions import FloatArray


class Skewed(Brdf):
    """Neither bilateral nor reciprocal, negative in places, three channels: every flag is false.

    f = (1 + cos(theta_i) sin(theta_o) sin(delta_phi), .5 cos^2(theta_o), cos(theta_i) - .9) smooth everywhere.
    """

    channels = RGB
    bilateral = reciprocal = energy_conserving = non_negative = False

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[:, 0] = 1 + np.cos(theta_i) * np.sin(theta_o) * np.sin(delta_phi)
        out[:, 1] = 0.5 * np.cos(theta_o) ** 2
        out[:, 2] = np.cos(theta_i) - 0.9
        return True


class Multilinear(Brdf):
    """Linear in each angle: trilinear interpolation is exact but for rounding."""

    reciprocal = energy_conserving = False

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        azimuth = np.abs(np.remainder(delta_phi + np.pi, 2 * np.pi) - np.pi)
        out[:, 0] = 1 + theta_i + 2 * theta_o * azimuth + 0.5 * theta_i * theta_o
        return True


class Constant(Brdf):
    """f = value in one channel."""

    def __init__(self, value: float) -> None:
        super().__init__()
        self.value = value

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = self.value
        return True
