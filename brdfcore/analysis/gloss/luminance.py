"""Weights that make one luminance of a material's channels, and what they assume."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels

Float64Array = npt.NDArray[np.float64]

#: Luminance of linear R, G, B with the primaries and white of ITU-R BT.709 (sRGB).
_RGB = (0.2126, 0.7152, 0.0722)
#: Wavelengths, nm, that the eye sees.
_VISIBLE = (380.0, 780.0)


def luminance_weights(channels: Channels) -> tuple[Float64Array | None, str]:
    """(weights that add up to 1, what they are), or (None, why there are none).

    R, G, B in any order: luminance of linear BT.709 primaries. Wavelengths: V(lambda) of CIE 1931 in the multi-lobe fit
    of C. Wyman, P.-P. Sloan and P. Shirley (JCGT 2(2), 2013), equal-energy illuminant E, trapezoid over the channels.
    """
    if channels.kind == "wavelength":
        return _photopic(np.array(channels, dtype=np.float64))
    names = [str(c).upper() for c in channels]
    if sorted(names) == ["B", "G", "R"]:
        return np.array([_RGB["RGB".index(n)] for n in names]), "luminance of linear R, G, B (ITU-R BT.709)"
    if len(channels) == 1:
        return np.ones(1), "the only channel"
    return None, "these channels have no known luminance"


def _photopic(nm: Float64Array) -> tuple[Float64Array | None, str]:
    seen = (nm >= _VISIBLE[0]) & (nm <= _VISIBLE[1])
    if int(seen.sum()) < 2:
        return None, "fewer than two wavelengths are visible"
    order = np.argsort(nm)
    widths = np.zeros(nm.size)
    widths[order] = np.gradient(nm[order])
    weights = np.where(seen, widths * photopic(nm), 0.0)
    return weights / weights.sum(), "V(lambda) of CIE 1931, illuminant E, trapezoid over the channels"


def photopic(nm: Float64Array) -> Float64Array:
    """V(lambda), the CIE 1931 luminous efficiency, within .01 (fit of Wyman, Sloan and Shirley 2013)."""
    broad = (nm - 568.8) * np.where(nm < 568.8, 0.0213, 0.0247)
    narrow = (nm - 530.9) * np.where(nm < 530.9, 0.0613, 0.0322)
    value: Float64Array = 0.821 * np.exp(-0.5 * broad**2) + 0.286 * np.exp(-0.5 * narrow**2)
    return value
