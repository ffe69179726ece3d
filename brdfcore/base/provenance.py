"""Where the values of a BRDF come from, and how sure they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray, Outside
from brdfcore.base.status import Status


class Provenance:
    """`status` and `uncertainty` of a `Brdf`, which is what each entry makes of the two beginning with a line."""

    channels: Channels
    _checks_domain: bool

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        """Status of n pairs inside the domain."""
        return np.full(theta_i.shape, Status.MEASURED, np.uint8)

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        """Write half-widths of n pairs into `out`, (n, channels); arguments and result as of `Brdf._evaluate`.

        0 unless an entry knows better: what defines f_r is not off.
        """
        out[...] = 0
        return not self._checks_domain  # it has not looked

    def _terms(self) -> list[tuple[Provenance, Any]]:
        """(part, factor) of everything that this is the sum of."""
        return [(self, 1.0)]

    def status(self, theta_i: npt.ArrayLike, theta_o: npt.ArrayLike, delta_phi: npt.ArrayLike) -> npt.NDArray[np.uint8]:
        """Where each value comes from: `Status` codes, uint8, of the broadcast shape. OUTSIDE never raises.

        >>> [bc.Status(code).name for code in bc.model("lambert").status([0.1, 2.0], 0.3, 3.0)]
        ['MEASURED', 'OUTSIDE']
        """
        angles = conventions.check_domain(conventions.flatten_angles(theta_i, theta_o, delta_phi), "nan")
        codes = self._status(*angles[:3])
        if angles.outside is not None:
            codes = np.where(angles.outside, np.uint8(Status.OUTSIDE), codes)
        return codes.reshape(angles.shape)

    def uncertainty(
        self, theta_i: npt.ArrayLike, theta_o: npt.ArrayLike, delta_phi: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Half-width of a 95 % interval of f_r, 1/sr, of the shape and dtype of `evaluate`, with the same errors.

        Of a table: interpolation and rounding against what it was made of, whose own uncertainty is added in squares.
        Of measurements: prediction between them, their noise, and what the file states. 0 for a formula, rounding alone
        for a file's own table. Of a sum: in squares, as errors of different materials are independent; those of a part
        that is there twice add up. `InputError` ("missing_uncertainty") for a table that was stored without.

        >>> bc.model("lambert").uncertainty(0.1, 0.2, 0.3)
        array([0.])
        """
        angles = conventions.flatten_angles(theta_i, theta_o, delta_phi)
        flat = np.empty((angles.theta_i.size, len(self.channels)), angles.theta_i.dtype)
        if not (self._checks_domain and outside == "raise" and self._uncertainty(*angles[:3], flat)):
            angles = conventions.check_domain(angles, outside)
            self._uncertainty(*angles[:3], flat)
            if angles.outside is not None:
                flat[angles.outside] = np.nan
        return flat.reshape((*angles.shape, len(self.channels)))


def add_in_squares(
    terms: list[tuple[Provenance, Any]], angles: tuple[FloatArray, FloatArray, FloatArray], out: FloatArray
) -> None:
    """Half-widths of the sum of `terms`, (part, factor), at n pairs of directions into `out` (n, channels)."""
    out[...] = 0
    for part in {id(p): p for p, _ in terms}.values():
        factor = np.asarray(sum(f for p, f in terms if p is part), out.dtype)
        np.hypot(out, part.uncertainty(*angles) * factor, out=out)
