"""Coefficients of an environment map: an equirectangular picture of the radiance from all directions.

Row 0 is the zenith, the last row the nadir; column 0 begins at azimuth 0 (+x) and azimuths grow towards +y, which is to
the left where one looks at the horizon from inside. Pixel (r, c) covers theta in [r, r+1] pi/h and phi in
[c, c+1] 2 pi/w, and is constant there: the coefficients of that function are exact, whatever the degree and the size.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.conventions import as_float
from brdfcore.base.errors import InputError, LimitError
from brdfcore.harmonics.legendre import degrees, legendre, order_size

Float64Array = npt.NDArray[np.float64]

#: Largest map, pixels: one of 16,384 x 8,192.
MAX_PIXELS = 1 << 27
#: Largest radiance: squares of larger ones, summed, would not fit into a float64.
LARGEST = 1e140
#: Values of p_l^m, and of a map's rows in Fourier space, held at a time.
_VALUES = 4_000_000


def checked_map(pixels: npt.ArrayLike) -> npt.NDArray[Any]:
    """The map as a real array (h, w, channels); `InputError` unless it is finite, `LimitError` if it is too large."""
    found = as_float("map", pixels)
    if found.ndim == 2:
        found = found[..., None]
    if found.ndim != 3 or 0 in found.shape:
        raise InputError(
            "bad_map",
            f"map: expected pixels of shape (h, w) or (h, w, channels), got {found.shape}",
            where="map",
            got=list(found.shape),
            expected="(h, w, channels)",
        )
    count = found.shape[0] * found.shape[1]
    if count > MAX_PIXELS:
        raise LimitError(
            "map_too_large",
            f"the map has {count} pixels; the limit is {MAX_PIXELS}: average blocks of them first",
            where="map",
            got=count,
            limit=MAX_PIXELS,
        )
    for r, row in enumerate(found):
        bad = ~(np.abs(row, dtype=np.float64) <= LARGEST)  # true for NaN
        if bad.any():
            index = [r, *(int(k) for k in np.argwhere(bad)[0])]
            raise InputError(
                "bad_map",
                f"map{index} = {found[tuple(index)]}: expected finite radiances up to {LARGEST:g}",
                where="map",
                index=index,
                got=str(found[tuple(index)]),
                expected="finite numbers",
            )
    return found


def solid_angles(rows: int, columns: int) -> Float64Array:
    """(rows,): solid angle of a pixel in each row, 2 pi/w (cos theta_r - cos theta_r+1); all together 4 pi."""
    middle = (np.arange(rows) + 0.5) * np.pi / rows
    # difference of cosines as a product: exact beside the poles
    return np.asarray(2 * np.pi / columns * 2 * np.sin(middle) * np.sin(0.5 * np.pi / rows))


def map_energy(pixels: npt.NDArray[Any]) -> Float64Array:
    """(channels,): int L^2 dw of the map."""
    weights = solid_angles(*pixels.shape[:2])
    total = np.zeros(pixels.shape[2])
    for weight, row in zip(weights, pixels):
        total += weight * np.square(row, dtype=np.float64).sum(axis=0)
    return total


def map_coefficients(pixels: npt.NDArray[Any], lmax: int) -> Float64Array:
    """((lmax+1)^2, channels): int L Y dw of the real Y_l^m of `harmonics.legendre`, row l^2 + l + m.

    Azimuth: the integral of exp(-i m phi) over a pixel times the discrete Fourier transform of each row. Polar angle:
    int p_l^m sin theta dtheta over a row by Gauss-Legendre; p sin theta is a sum of waves of at most l + 1 periods.
    """
    rows, channels = pixels.shape[0], pixels.shape[2]
    # n nodes integrate exp(i k x) over [-1, 1] to rounding from about n = k/2 + 8, many waves from some more
    n = int(np.ceil(9 + 0.7 * (lmax + 1) * np.pi / (2 * rows)))
    x, w = np.polynomial.legendre.leggauss(n)
    step = np.pi / rows
    theta = step * (np.arange(rows)[:, None] + 0.5 * (x + 1))
    weights = 0.5 * step * w * np.sin(theta)
    waves = _waves(pixels, lmax)
    found = np.empty(((lmax + 1) ** 2, channels))
    first = 0
    while first <= lmax:
        last = first
        while last < lmax and sum(order_size(lmax, m) for m in range(first, last + 2)) * theta.size <= _VALUES:
            last += 1
        p = legendre(lmax, np.cos(theta), first_order=first, last_order=last)
        averaged = np.einsum("lrn,rn->lr", p, weights, optimize=True)
        at = 0
        for m in range(first, last + 1):
            listed = degrees(lmax, m)
            products = averaged[at : at + listed.size] @ waves[m]
            at += listed.size
            place = listed * listed + listed
            if m == 0:
                found[place] = products.real
            else:
                found[place + m] = np.sqrt(2) * products.real
                found[place - m] = -np.sqrt(2) * products.imag
        first = last + 1
    return found


def _waves(pixels: npt.NDArray[Any], lmax: int) -> npt.NDArray[np.complex128]:
    """(lmax + 1, h, channels): int L exp(-i m phi) dphi along each row."""
    rows, columns, channels = pixels.shape
    m = np.arange(lmax + 1)
    # over one pixel: its width times sinc, about its middle
    pixel = 2 * np.pi / columns * np.sinc(m / columns) * np.exp(-1j * np.pi * m / columns)
    found = np.empty((lmax + 1, rows, channels), np.complex128)
    block = max(_VALUES // (columns * channels), 1)
    for r in range(0, rows, block):
        # a row of pixels repeats in m; the second half is the first, conjugate
        spectrum = np.fft.fft(pixels[r : r + block].astype(np.float64), axis=1)
        found[:, r : r + block] = np.moveaxis(spectrum[:, m % columns] * pixel[:, None], 1, 0)
    return found
