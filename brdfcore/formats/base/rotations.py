"""Files of several rotations of the sample: what is lost when their mean is read as an isotropic material."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import FileFormatError
from brdfcore.base.parameters import Parameter

Float64Array = npt.NDArray[np.float64]

#: Option of every reader of files that may hold rotations.
ISOTROPIC = Parameter(
    "isotropic", "", "an anisotropic sample: refused, or its mean over rotation", "refuse", kind="choice",
    choices=("refuse", "mean"),
)  # fmt: skip


def loss_of_mean(values: Float64Array, weights: npt.ArrayLike = 1.0) -> float:
    """What the mean over axis 0 loses as L1: sum |f - mean| w / sum |mean| w, over all but NaN.

    `weights` (cosines times solid angles, say) broadcast against `values`, (rotations, ...).
    """
    count = np.isfinite(values).sum(axis=0)
    mean = np.where(np.isfinite(values), values, 0.0).sum(axis=0) / np.where(count, count, 1)
    w = np.broadcast_to(np.asarray(weights, np.float64), values.shape)
    own = np.isfinite(values)
    lost = np.where(own, np.abs(values - mean) * w, 0.0).sum()
    whole = np.where(own, np.abs(np.broadcast_to(mean, values.shape)) * w, 0.0).sum()
    return float(lost / whole) if whole > 0 else 0.0


def lost_sentence(what: str, loss: float) -> str:
    """What `isotropic="mean"` did, for the report."""
    return f"{what} averaged over rotation, as asked: the mean misplaces {loss:.3g} of the reflected energy (L1)"


def anisotropic(file: str, field: str, spread: float | str, evidence: str, **context: Any) -> FileFormatError:
    """The refusal of an anisotropic sample: what differs by how much, where, and what may be asked instead."""
    return FileFormatError(
        "anisotropic",
        f"{file}: the sample is anisotropic, and only isotropic ones can be read: {evidence}; isotropic='mean' reads "
        "its mean over rotation and says what that loses",
        where=file,
        file=file,
        field=field,
        got=spread,
        hint="isotropic='mean'",
        options="isotropic=mean",
        **context,
    )
