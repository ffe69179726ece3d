"""Directional-hemispherical reflectance of whatever can be evaluated: the integral, and what is known of its error."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.peaks import changes_beside, peaks, smooth_elsewhere
from brdfcore.base.quadrature import integrate_hemisphere

#: Estimated error of an albedo, relative to max(1, albedo), at which `Brdf.albedo` is content, and the evaluations an
#: angle that it may spend on getting there.
ALBEDO_TOLERANCE = 5e-7
ALBEDO_BUDGET = 400_000
#: The tolerance for tables and measurements. Interpolated values have kinks everywhere, across which the estimate is 10
#: to 100 times the error: measured ones end within 1.4e-4 of the truth, after a tenth of the budget.
DATA_ALBEDO_TOLERANCE = 1e-3
#: Albedos that an analytic model remembers, one an angle and precision.
ALBEDOS_KEPT = 1024


class Reflectance:
    """`albedo` and `albedo_error` of a `Brdf`."""

    channels: Channels
    bilateral: bool
    evaluate: Any
    _delta_reflectance: Any
    _albedos: dict[tuple[float, ...], tuple[FloatArray, FloatArray]]
    #: True if f is a formula, smooth but for few kinks: the albedo is then refined until its error is small.
    _analytic: bool = False
    _smooth_elsewhere: bool = False  #: True if, though no formula, it has no narrow lobe away from mirror and light
    #: True if f is stored and never changes while the object lives: albedos are kept, as those of a formula are.
    _fixed: bool = False

    def albedo(self, theta_i: npt.ArrayLike, *, points: int = 12, azimuths: int = 64) -> FloatArray:
        """Directional-hemispherical reflectance int f_r cos_o dwo, the delta part included.

        Quadrature over the half vector, graded towards the mirror direction (`quadrature.hemisphere_rule`); `points`
        and `azimuths` set the size of its panels, which are halved until the estimated error is below 5e-7 of
        max(1, albedo) for an analytic model, 1e-3 for anything else, or 4e5 evaluations an angle are spent. The error
        itself is far smaller (`albedo_error`). Shape theta_i.shape + (channels,), float64.

        >>> bc.model("lambert", reflectance=0.5).albedo([0.0, 1.2]).round(6)
        array([[0.5],
               [0.5]])
        """
        return self._albedo(theta_i, points, azimuths, None, ALBEDO_BUDGET)[0]

    def albedo_error(
        self, theta_i: npt.ArrayLike, *, tolerance: float | None = ALBEDO_TOLERANCE, budget: int = ALBEDO_BUDGET
    ) -> tuple[FloatArray, FloatArray]:
        """(albedo, its estimated error): panels are halved until the estimate is below `tolerance` max(1, albedo).

        With None it is the tolerance of `albedo`, and the values are its. Ends earlier when `budget` evaluations an
        angle are spent: the estimate says how far it came. The estimate is well above the error where f is smooth.
        Both of shape theta_i.shape + (channels,), float64.
        """
        return self._albedo(theta_i, 12, 64, tolerance, budget)

    def _albedo(
        self, theta_i: npt.ArrayLike, points: int, azimuths: int, tolerance: float | None, budget: int
    ) -> tuple[FloatArray, FloatArray]:
        """(albedo, estimated error); tolerance None: the entry's own."""
        if tolerance is None:
            tolerance = ALBEDO_TOLERANCE if self._analytic else DATA_ALBEDO_TOLERANCE
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, 0.0, 0.0))
        thetas = np.minimum(angles.theta_i.astype(np.float64), conventions.HALF_PI)
        values = np.array(self._delta_reflectance(thetas))
        errors = np.zeros_like(values)
        for k, theta in enumerate(thetas):
            key = (float(theta), points, azimuths, tolerance, budget)
            found = self._albedos.get(key)
            if found is None:
                found = integrate_hemisphere(
                    partial(self.evaluate, theta),
                    key[0],
                    points=points,
                    azimuths=azimuths,
                    bilateral=self.bilateral,
                    tolerance=tolerance,
                    budget=budget,
                    centres=self._centres(float(theta)),
                )
                # refining costs tens of milliseconds an angle, and comparing one material with several tables asks
                # for the same angles each time
                if (self._analytic or self._fixed) and len(self._albedos) < ALBEDOS_KEPT:
                    self._albedos[key] = found
            values[k] += found[0]
            errors[k] = found[1]
        shape = (*angles.shape, len(self.channels))
        return values.reshape(shape), errors.reshape(shape)

    def _centres(self, theta_i: float) -> list[tuple[float, float]]:
        """Directions (theta_o, delta_phi) of lobes elsewhere than at the mirror direction: what an integral must know.

        The light's own, if f_r changes beside it, from 1e-9 rad up; and the peaks of a scan, for what is no formula.
        """

        def total(*angles: FloatArray) -> npt.NDArray[np.float64]:
            with np.errstate(over="ignore", invalid="ignore"):
                return np.asarray(self.evaluate(*angles).sum(axis=1), np.float64)

        found = [(theta_i, 0.0)] if changes_beside(total, theta_i) else []
        if not smooth_elsewhere(self):
            found += [(float(t), float(d)) for t, d in peaks(total, theta_i, bilateral=self.bilateral)]
        return found
