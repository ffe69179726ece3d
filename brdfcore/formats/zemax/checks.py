"""What a Zemax file's samples say of themselves: padding, azimuths, isotropy, and what they integrate to."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.formats.base.measurements import ANISOTROPY
from brdfcore.formats.base.rotations import anisotropic, loss_of_mean, lost_sentence
from brdfcore.formats.zemax.text import ZemaxFile, bad
from brdfcore.tables.base.mirror_coordinates import node_directions

Float64Array = npt.NDArray[np.float64]

#: TIS lines and integrals of the samples further apart than this share are reported.
_TIS_APART = 0.02
#: Pieces of a cell that the integral is summed over.
_FINE = 16
#: Azimuths that differ by less than this share do so by rounding.
_ROUNDING = 1e-9


def padding(values: Float64Array) -> npt.NDArray[np.bool_]:
    """Zeros from the first zero of the run that ends a row to its end; a row of zeros alone is all padding."""
    return np.asarray(np.logical_and.accumulate((values == 0)[..., ::-1], axis=-1)[..., ::-1])


def measured_limit(
    content: ZemaxFile, hole: npt.NDArray[np.bool_], axes: list[Float64Array], above: npt.NDArray[np.bool_]
) -> str:
    """Where padding begins, in words."""
    theta_o = np.degrees(node_directions(axes[0], axes[1][: content.azimuths.size], axes[2])[1])
    padded = hole.any(axis=(0, 1)) & above
    return f"at theta_o of {theta_o[padded].min():.4g} degrees or more"


def check_azimuths(content: ZemaxFile, file: str, bilateral: bool) -> None:
    last = 180.0 if bilateral else 360.0
    step = np.diff(content.azimuths).max(initial=0)
    if content.azimuths.size == 1:
        return
    whole = content.azimuths[0] == 0
    whole &= content.azimuths[-1] == last if bilateral else content.azimuths[-1] >= last - max(step, 1e-9) - 1e-9
    if not whole or (bilateral and content.azimuths[-1] > last):
        raise bad(
            file, "ScatterAzimuth", 0, f"{content.symmetry} samples cover another range",
            f"{content.azimuths[0]:g} to {content.azimuths[-1]:g} degrees", f"0 to {last:g} degrees",
        )  # fmt: skip
    if content.radials[0] != 0 or content.radials.size < 2:
        raise bad(file, "ScatterRadial", 0, "no sample at the mirror direction", f"{content.radials[0]:g}", "0 first")


def check_isotropic(content: ZemaxFile, hole: npt.NDArray[np.bool_], file: str, asked: str) -> list[str]:
    """What is done about sample rotations, in sentences; those that differ are refused, with the two that differ most
    and where, unless asked="mean"."""
    values = np.where(hole, np.nan, content.values)
    rotations = content.rotations
    both = ~hole[:, 1:] & ~hole[:, :1]
    worst, total, difference = (-1.0, 0, 0), 0.0, 0.0
    for k in range(rotations.size):
        for other in range(k):
            a, b = values[:, k], values[:, other]
            gap, size = float(np.nansum(np.abs(a - b))), float(np.nansum(np.abs(a) + np.abs(b) + 0 * (a - b)))
            difference, total = difference + gap, total + size
            if size > 0 and gap / size > worst[0]:
                worst = (gap / size, other, k)
    spread = difference / total if total > 0 else 0.0
    if not both.any():
        return [f"{rotations.size} sample rotations averaged; they share no direction: isotropy could not be tested"]
    if asked == "mean":
        weights = (np.sin(np.radians(content.radials)) * _cosines(content))[None]
        loss = loss_of_mean(np.moveaxis(values, 1, 0), weights)
        return [lost_sentence(f"{rotations.size} sample rotations", loss)]
    if spread <= ANISOTROPY:
        return [f"{rotations.size} sample rotations averaged"]
    share, low, high = worst
    a, b = values[:, low], values[:, high]
    off = np.where(np.isnan(a - b), 0, np.abs(a - b))
    channel, k, az, radial = (int(i) for i in np.unravel_index(int(off.argmax()), off.shape))
    place = (
        f"AngleOfIncidence {content.incidences[k]:g}, ScatterAzimuth {content.azimuths[az]:g}, ScatterRadial "
        f"{content.radials[radial]:g}"
    )
    found, seen = float(a[channel, k, az, radial]), float(b[channel, k, az, radial])
    raise anisotropic(
        file,
        "SampleRotation",
        spread,
        f"over all pairs of its {rotations.size} sample rotations the samples differ by {spread:.1%} of their sum "
        f"(limit {ANISOTROPY:.0%}). Rotations {rotations[low]:g} and {rotations[high]:g} degrees differ most, by "
        f"{share:.1%}; their largest difference: at {place} degrees they are {found:.4g} and {seen:.4g}/sr",
        offset=content.offset,
        expected=f"at most {ANISOTROPY}",
        rotations=[float(rotations[low]), float(rotations[high])],
        place=place,
        values=[found, seen],
    )


def check_normal(content: ZemaxFile, mean: Float64Array, file: str, asked: str) -> list[str]:
    """The same for the incidence 0, where the azimuth is the sample's own: samples `mean` (K, A, R, C), NaN in holes,
    that depend on it are of an anisotropic sample."""
    if content.incidences[0] != 0 or content.azimuths.size < 3:
        return []
    at = mean[0]  # (A, R, C)
    weights = (np.sin(np.radians(content.radials)) * np.maximum(np.cos(np.radians(content.radials)), 0))[:, None]
    loss = loss_of_mean(at, weights)
    if loss <= _ROUNDING:
        return []
    if asked == "mean":
        return [lost_sentence("at theta_i = 0, the samples of all azimuths", loss)]
    if loss <= ANISOTROPY:
        return [f"at theta_i = 0 the samples of all azimuths averaged: {loss:.2g} of them apart (L1)"]
    apart = np.where(np.isfinite(at), at, np.nan)
    radial = int(np.argmax(np.where(np.isfinite(at), at, 0).max(axis=(0, 2)) * weights[:, 0]))
    low, high = float(np.nanmin(apart[:, radial])), float(np.nanmax(apart[:, radial]))
    raise anisotropic(
        file,
        "ScatterAzimuth",
        loss,
        f"at AngleOfIncidence 0, where light has no azimuth, its samples differ by azimuth, {loss:.1%} of their energy "
        f"from their mean (limit {ANISOTROPY:.0%}): at ScatterRadial {content.radials[radial]:g} from {low:.4g} to "
        f"{high:.4g}/sr",
        offset=content.offset,
        expected=f"at most {ANISOTROPY}",
    )


def integrals(content: ZemaxFile, mean: Float64Array) -> Float64Array:
    """int f cos(theta_o) dwo of the samples (K, A, R, C) as they stand, (C, K): bilinear between them, 0 in holes,
    beyond the last distance and below the horizon."""
    bilateral = content.symmetry == "PlaneSymmetrical"
    azimuths, radials = np.radians(content.azimuths), np.radians(content.radials)
    fine_a, fine_r = (_middles(x, _FINE) for x in (azimuths, radials))
    along = np.stack([np.interp(fine_a, azimuths, row) for row in np.eye(azimuths.size)], axis=1)
    out = np.stack([np.interp(fine_r, radials, row) for row in np.eye(radials.size)], axis=1)
    steps = np.diff(np.interp(np.linspace(0, azimuths.size - 1, fine_a.size + 1), np.arange(azimuths.size), azimuths))
    widths = np.diff(np.interp(np.linspace(0, radials.size - 1, fine_r.size + 1), np.arange(radials.size), radials))
    found = np.empty((mean.shape[3], content.incidences.size))
    for k, theta in enumerate(np.radians(content.incidences)):
        cosine = np.cos(theta) * np.cos(fine_r) + np.sin(theta) * np.sin(fine_r) * np.cos(fine_a)[:, None]
        weight = np.maximum(cosine, 0) * np.sin(fine_r) * widths * steps[:, None]
        f = np.where(np.isfinite(mean[k]), mean[k], 0.0)
        found[:, k] = np.einsum("xa,arc,yr,xy->c", along, f, out, weight, optimize=True)
    return found * (2.0 if bilateral else 1.0)


def tis_remarks(content: ZemaxFile, integral: Float64Array) -> list[str]:
    """What the file's TIS lines say against the integrals (C, K) of its own samples."""
    stated = np.nanmean(content.tis, axis=1) if np.isfinite(content.tis).any() else np.full(integral.shape, np.nan)
    known = np.isfinite(stated) & (stated > 0) & (integral > 0)
    said = []
    if not np.isfinite(content.tis).all():
        said.append(f"{int((~np.isfinite(content.tis)).sum())} TIS lines say N/A")
    if not known.any():
        return said
    off = integral[known] / stated[known] - 1
    if np.abs(off).max() <= _TIS_APART:
        return said
    low, high = 100 * off.min(), 100 * off.max()
    if high < 0:
        words = f"{-high:.1f} to {-low:.1f} % less than"
    elif low > 0:
        words = f"{low:.1f} to {high:.1f} % more than"
    else:
        words = f"{-low:.1f} % less to {high:.1f} % more than"
    own, line = (", ".join(f"{x:.3g}" for x in row[0, :6]) for row in (integral, stated))
    said.append(
        f"the samples integrate to {words} the file's own TIS lines (integrals {own}; TIS {line}): TIS is defined "
        "otherwise, or the samples are not scaled to it; the samples are believed"
    )
    return said


def _cosines(content: ZemaxFile) -> Float64Array:
    """cos(theta_o) of the samples, at least 0, (K, A, R)."""
    theta, a, r = (np.radians(x) for x in (content.incidences, content.azimuths, content.radials))
    cosine = np.cos(theta)[:, None, None] * np.cos(r) + (
        np.sin(theta)[:, None, None] * np.sin(r) * np.cos(a)[None, :, None]
    )
    return np.asarray(np.maximum(cosine, 0.0))


def _middles(nodes: Float64Array, parts: int) -> Float64Array:
    """Middles of `parts` even pieces of each cell."""
    edges = np.interp(np.linspace(0, nodes.size - 1, (nodes.size - 1) * parts + 1), np.arange(nodes.size), nodes)
    return np.asarray(0.5 * (edges[1:] + edges[:-1]))
