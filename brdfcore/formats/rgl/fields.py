"""The fields of an RGL file for a `vndf_warp` table that no longer has its file: what renderers need beside the table.

Published loaders ask for every field named here. What no look-up reads is made anew and said in the description.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import RGB, Channels
from brdfcore.base.errors import InputError
from brdfcore.tables.vndf_warp import VndfWarp

#: Luminance of linear RGB as the database's own files have it: a fit to all samples of one leaves 1e-15 of its square.
LUMINANCE = (0.212671, 0.71516, 0.072169)
#: Wavelengths, nm, whose mean stands for the luminance of a spectral table; it only steers a renderer's sampling.
_VISIBLE = (400.0, 700.0)


def check_channels(channels: Channels) -> None:
    """`InputError` unless they are R, G, B or ascending wavelengths."""
    if channels != RGB and channels.kind != "wavelength":
        raise InputError(
            "channels_not_held",
            f"an RGL file holds channels R, G, B or wavelengths in nm; this has {', '.join(map(str, channels)):.80}",
            where="brdf",
            got=channels.to_json(),
            expected="R, G, B or wavelengths",
        )
    if channels.kind == "wavelength" and list(channels) != sorted(channels):
        raise InputError(
            "channels_not_held", "an RGL file lists its wavelengths ascending", where="brdf", got=channels.to_json()
        )


def fields_of_table(table: VndfWarp) -> dict[str, npt.NDArray[Any]]:
    """Fields in the order of the database's files; the samples and profiles are the table's own bits.

    The density of visible normals is the table's, normalised in float32; a reader normalises it again, which may move
    values by a few 1e-7 of themselves. Raises `InputError` for channels that are neither RGB nor wavelengths.
    """
    arrays, channels = table.to_arrays(), table.channels
    check_channels(channels)
    samples = np.ascontiguousarray(np.moveaxis(arrays["spectra"], -1, 1))[None]  # (1, K, C, N, N)
    density = arrays["warp"][..., 0]
    # a power of two keeps the bits; the database's own files sum to about 1 as well
    scale = np.float32(2.0 ** -round(math.log2(density.shape[1] * density.shape[2])))
    text = str(table.metadata.get("description", "")) or str(table.source.get("name", "")) or "a vndf_warp table"
    spectral = channels.kind == "wavelength"
    made: dict[str, npt.NDArray[Any]] = {
        "version": np.array([1, 0], np.uint32),
        "description": np.frombuffer(text.encode(), np.uint8),
        "phi_i": np.zeros(1, np.float32),
        "theta_i": arrays["theta_i"],
        "sigma": np.tile(arrays["sigma"], (2, 1)),
        "ndf": np.tile(arrays["ndf"], (2, 1)),
        "vndf": (density * scale)[None],
        "luminance": _luminance(samples, table),
    }
    if spectral:
        made["wavelengths"] = np.array(channels, np.float32)
    made["spectra" if spectral else "rgb"] = samples
    made["jacobian"] = np.ones(1, np.uint8)  # with the profiles of a table made without, the factor is 1 all the same
    bits = samples.shape[1] * samples.shape[3] * samples.shape[4]
    valid = np.full(-(-bits // 8), 255, np.uint8)
    if bits % 8:
        valid[-1] = (0xFF << (8 - bits % 8)) & 0xFF
    made["valid"] = valid
    return made


def _luminance(samples: npt.NDArray[np.float32], table: VndfWarp) -> npt.NDArray[np.float32]:
    """(1, K, N, N), not below 0: what renderers draw directions by."""
    if table.channels.kind == "wavelength":
        nm = np.array(table.channels)
        seen = (nm >= _VISIBLE[0]) & (nm <= _VISIBLE[1])
        weights = seen / seen.sum() if seen.any() else np.full(nm.size, 1 / nm.size)
    else:
        weights = np.array(LUMINANCE)
    return np.maximum(np.tensordot(samples, weights, (2, 0)), 0).astype(np.float32)
