"""A lit sphere as a picture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.plot import style
from brdfcore.plot.canvas import canvas, footnotes, heading
from brdfcore.plot.colour import screen_weights, to_srgb
from brdfcore.plot.lit import LAMP_RADIUS, Light, Lit, lit
from brdfcore.plot.rendering import drawing

Array = npt.NDArray[np.float64]

#: Around the sphere, sRGB: dark enough for a black material's outline, neutral so that it takes no colour from it.
SURROUND = 0.32
#: Height of what stands above the picture, inches.
_HEAD, _MARGIN = 0.62, 0.22


def sphere(
    b: Brdf,
    light: Light = "studio",
    *,
    channel: str | float | None = None,
    exposure: float = 1.0,
    title: str | None = None,
    size: tuple[float, float] = (4.6, 5.0),
    dpi: float = 100,
) -> Figure:
    """A sphere of the material under white light, as a camera far away sees it.

    light     "studio", "sky" or directions (k, 3) of lamps; see `render_sphere`. A white Lambertian sphere reaches a
              linear 0.9, whatever the light.
    channel   one only, in grey. None: R, G, B as linear sRGB, wavelengths as the CIE observer sees them, anything else
              as the middle channel in grey. The picture says which.
    exposure  factor on the linear values before sRGB; what is then above 1 or below 0 is clipped, and said.
    size      inches, with dpi the pixels of a PNG. Other parameters and errors as `polar`.
    """
    if not (isinstance(exposure, (int, float)) and 0 < exposure < 1e6):
        raise InputError(
            "bad_option", f"exposure = {str(exposure)[:40]}: expected a number > 0", where="exposure", expected="> 0"
        )
    weights, what = _weights(b, channel)
    with drawing():
        figure, axes = canvas(size, dpi)
        room = min(size[0] - 2 * _MARGIN, size[1] - _HEAD - _MARGIN - 0.68)
        whole = max(18, round(room * dpi))
        border = whole // 26
        pixels = whole - 2 * border
        picture = lit(b, pixels, light, weights)
        image, notes = _developed(picture, exposure)
        image = np.pad(image, ((border, border), (border, border), (0, 0)), constant_values=SURROUND)
        # pixel on pixel: nothing is resampled
        left, bottom = round((size[0] - room) / 2 * dpi) / dpi, round((size[1] - _HEAD - room) * dpi) / dpi
        axes.imshow(
            image, extent=(left, left + whole / dpi, bottom, bottom + whole / dpi), aspect="auto",
            interpolation="nearest", zorder=1,
        )  # fmt: skip
        heading(axes, size, title if title is not None else style.name_of(b), f"sphere, {_said(light)}, {what}")
        if b.has_delta:
            notes.append(
                "the perfect mirror part shows the light itself"
                + ("" if isinstance(light, str) else f", lamps as discs of {style.degrees_text(LAMP_RADIUS)} radius")
            )
        footnotes(axes, notes)
    return figure


def _said(light: Light) -> str:
    if isinstance(light, str):
        return f"{light} light"
    lamps = len(np.atleast_2d(light))
    return "one lamp" if lamps == 1 else f"{lamps} lamps"


def _weights(b: Brdf, channel: str | float | None) -> tuple[Array, str]:
    """What of the channels is shown, (channels, 3), and in words."""
    found = screen_weights(b.channels) if channel is None else None
    if found is not None:
        return found
    pick = style.default_channel(b.channels) if channel is None else b.channels.find(channel)
    weights = np.zeros((len(b.channels), 3))
    weights[pick] = 1.0
    return weights, f"channel {b.channels.labels()[pick]} in grey"


def _developed(picture: Lit, exposure: float) -> tuple[Array, list[str]]:
    """sRGB (size, size, 3) on the surround, and what had to be clipped."""
    linear = exposure * picture.radiance
    inside = picture.coverage > 0
    whole = int(inside.sum())
    high, low = ((inside & m.any(axis=-1)).sum() for m in (linear > 1 + 1e-9, linear < -1e-9))  # rounding is no clip
    notes = [f"exposure {style.number_text(exposure)}, linear to sRGB; a white Lambertian sphere reaches 0.9"]
    if high:
        most = style.number_text(float(linear.max()))
        notes.append(f"{_percent(int(high), whole)} of the sphere clipped as brighter than white (up to {most})")
    if low:
        least = style.number_text(float(linear.min()))
        notes.append(f"{_percent(int(low), whole)} below 0, outside what a screen shows (least {least})")
    if picture.not_finite:
        notes.append(f"{picture.not_finite} values of fᵣ not finite, counted as 0")
    cover = picture.coverage[..., None]
    # the edge mixes light, not codes: the surround goes back to linear first
    behind = ((SURROUND + 0.055) / 1.055) ** 2.4
    return to_srgb(np.clip(linear, 0.0, 1.0) + (1 - cover) * behind), notes


def _percent(part: int, whole: int) -> str:
    share = 100 * part / whole
    return f"{share:.1f} %" if share >= 0.1 else "less than 0.1 %"
