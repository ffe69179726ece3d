"""The directions of a request as vectors: wi and wo of shape (n, 3), in any of the three kinds of body."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from brdf_service.evaluate.angles import Array, Outside, Unit

import brdfcore as bc

VECTOR_NAMES = ("wi", "wo")
EXPECTED = "a direction [x, y, z], or a list of them"


class VectorRequest(NamedTuple):
    """Directions as the request gave them, each of shape (3,) or (n, 3): nobody has normalised them."""

    wi: Array
    wo: Array

    @property
    def points(self) -> int:
        """Length of the broadcast lists, or of the longer one where they do not broadcast (`evaluate` says so)."""
        sizes = (self.wi.size // 3, self.wo.size // 3)
        return 0 if 0 in sizes else max(sizes)

    @property
    def unit(self) -> None:
        """Vectors have no unit of angle."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the values."""
        return np.result_type(self.wi, self.wo)

    @property
    def single(self) -> bool:
        """True if the values have no axis of points."""
        return self.wi.ndim == self.wo.ndim == 1

    def evaluate(self, brdf: bc.Brdf, out: Array | None = None) -> Array:
        """f_r, exactly 0 below the horizon."""
        return brdf.evaluate_vectors(self.wi, self.wo, out=out)

    @property
    def uniform(self) -> bool:
        """True if each list has one direction or as many as there are points."""
        return all(x.size // 3 in (1, self.points) for x in self)

    def part(self, start: int, stop: int) -> VectorRequest:
        """Points start to stop of a uniform request."""
        a, b = (x[start:stop] if x.size > 3 else x for x in self)
        return VectorRequest(a, b)

    def status(self, brdf: bc.Brdf) -> npt.NDArray[np.uint8]:
        """Refused by `no_angle_options`."""
        raise NotImplementedError

    def explained(self, error: bc.InputError) -> bc.InputError:
        """The library names wi, wo and the index already."""
        return error


def no_angle_options(unit: Unit | None, outside: Outside, status: bool) -> None:
    """`InputError` for an option that vectors have no use for: it would be ignored in silence."""
    given = "angles" if unit is not None else "outside" if outside != "raise" else "status" if status else None
    if given is not None:
        why = {
            "angles": "vectors have no unit of angle",
            "outside": "a vector below the horizon has the value 0",
            "status": "status is given for angles only",
        }
        raise bc.InputError(
            "options_exclude",
            f"{given} goes with angles, not with wi and wo: {why[given]}; leave it out",
            where=given,
            expected=f"no {given}",
        )
