"""From linear channels to the colours of a screen: wavelengths to linear sRGB, linear sRGB to bytes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels

Array = npt.NDArray[np.float64]

#: CIE 1931 colour matching functions as sums of (height, centre nm, width below, width above) Gaussians;
#: C. Wyman, P. Sloan and P. Shirley, JCGT 2(2), 2013, http://jcgt.org/published/0002/02/01, equation 4.
_MATCHING = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)
#: XYZ to linear sRGB, IEC 61966-2-1.
_XYZ_TO_RGB = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]], dtype=np.float64
)
#: Wavelengths that have to be covered for a colour to mean something, nm: beyond, the eye sees next to nothing.
_BLUE, _RED, _WIDEST_GAP = 470.0, 630.0, 60.0


def screen_weights(channels: Channels) -> tuple[Array, str] | None:
    """(channels, 3) weights that make linear sRGB of the channels, and what they are; None: they are no colour.

    R, G, B stay as they are. Wavelengths from blue to red without a wide gap are seen by the CIE observer under a
    light of equal energy, white scaled to (1, 1, 1).
    """
    if channels.kind == "name":
        names = [str(c).upper() for c in channels]
        if sorted(names) != ["B", "G", "R"]:
            return None
        return np.eye(3)[["RGB".index(n) for n in names]], "channels R, G, B as linear sRGB"
    nm = np.array(channels, dtype=np.float64)
    order = np.argsort(nm)
    inside = nm[order][(nm[order] > _BLUE - _WIDEST_GAP) & (nm[order] < _RED + _WIDEST_GAP)]
    if inside.size < 3 or inside[0] > _BLUE or inside[-1] < _RED or np.diff(inside).max() > _WIDEST_GAP:
        return None
    xyz = matching(nm) * _widths(nm)[:, None]
    rgb = xyz @ _XYZ_TO_RGB.T
    return rgb / rgb.sum(axis=0), f"{nm.size} wavelengths as the CIE observer sees them"


def matching(nm: Array) -> Array:
    """CIE 1931 x, y, z at each wavelength, (n,) -> (n, 3)."""
    seen = np.zeros((nm.size, 3))
    for k, lobes in enumerate(_MATCHING):
        for height, centre, below, above in lobes:
            seen[:, k] += height * np.exp(-0.5 * ((nm - centre) / np.where(nm < centre, below, above)) ** 2)
    return seen


def _widths(nm: Array) -> Array:
    """Trapezium weights of unordered nodes."""
    order = np.argsort(nm)
    steps = np.diff(nm[order])
    widths = np.empty_like(nm)
    widths[order] = (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / 2
    return widths


def to_srgb(linear: Array) -> Array:
    """Linear sRGB to sRGB (IEC 61966-2-1), clipped to [0, 1]: what a screen cannot show is at its limit."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
