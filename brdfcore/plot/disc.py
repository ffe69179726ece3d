"""The hemisphere of viewers as a disc: radius theta_o, angle delta_phi, colour f_r."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from brdfcore.base import conventions
from brdfcore.base.brdf import Brdf
from brdfcore.names import Scale
from brdfcore.plot import style
from brdfcore.plot.canvas import canvas, check_scale, delta_notes, footnotes, heading
from brdfcore.plot.rendering import drawing
from brdfcore.plot.slices import slice as slice_of
from brdfcore.plot.style import FAINT, INK, Radial

Array = npt.NDArray[np.float64]


def hemisphere(
    b: Brdf,
    theta_i: float = np.pi / 6,
    *,
    scale: Scale = "linear",
    channel: str | float | None = None,
    title: str | None = None,
    points: int | None = None,
    size: tuple[float, float] = (6.0, 4.9),
    dpi: float = 150,
) -> Figure:
    """f_r over all viewers for one theta_i, as a disc: radius theta_o, angle delta_phi, colour f_r.

    Seen from above with the light from the left, so that the plane of incidence is the horizontal diameter,
    mirror side right, as in `polar`. A ring marks the mirror direction, a disc the light.

    theta_i  one polar angle of the light, radians.
    channel  None: the middle one (G of R, G, B); the picture says which.
    Other parameters and errors as `polar`.
    """
    check_scale(scale)
    pick = style.default_channel(b.channels) if channel is None else b.channels.find(channel)
    data = slice_of(b, theta_i, view="hemisphere", channel=b.channels[pick], points=points)
    light = float(data.theta_i[0])
    values = data.values[..., 0]
    horizon = np.broadcast_to(style.at_horizon(data.theta_o)[:, None], values.shape)
    radial = Radial.fit(values, scale, horizon)
    shown = np.where(np.isnan(radial(values)), np.nan, values)
    peak = np.unravel_index(int(np.argmax(np.where(np.isnan(shown), -np.inf, shown))), values.shape)

    with drawing():
        notes = [*radial.notes(values), *delta_notes({"": b}, np.array([light]))]
        notes = [n.replace("lie in the centre", "have the lowest colour") for n in notes]
        notes = [n.replace("not drawn", "are grey").replace(" (dotted)", "") for n in notes]
        notes += _narrow_note(data.theta_o, shown, light) if scale == "linear" else []
        figure, axes = canvas(size, dpi)
        below = 0.5 + 0.17 * len(notes)
        radius = max(min((size[0] - 2.1) / 2, (size[1] - below - 1.15) / 2), 0.2)
        centre = (0.55 + radius, below + 0.3 + radius)
        norm = LogNorm(10.0**radial.low, 10.0**radial.high) if scale == "log" else Normalize(0.0, radial.high)

        def xy(theta: Any, phi: Any) -> tuple[Any, Any]:
            r = theta / conventions.HALF_PI * radius
            return centre[0] - r * np.cos(phi), centre[1] - r * np.sin(phi)

        pixels = 2 * round(radius * dpi)
        image = _raster(data.theta_o, data.delta_phi, shown, pixels)
        left, bottom = (round((c - radius) * dpi) / dpi for c in centre)  # pixel on pixel: nothing is resampled away
        extent = (left, left + pixels / dpi, bottom, bottom + pixels / dpi)
        mesh = axes.imshow(
            np.ma.masked_invalid(image), norm=norm, cmap=_colours(), extent=extent, origin="lower", aspect="auto",
            interpolation="nearest", zorder=1,
        )  # fmt: skip
        mesh.set_clip_path(Circle(centre, radius, transform=axes.transData))
        _dial(axes, xy, centre, radius)
        halo = [withStroke(linewidth=2.4, foreground="white")]
        mark: dict[str, Any] = {
            "linestyle": "none",
            "markeredgecolor": "black",
            "path_effects": halo,
            "zorder": 4,
            "clip_on": False,
        }
        mirror = Line2D(*_points(xy(light, np.pi)), marker="o", ms=11, mfc="none", label="mirror direction", **mark)
        source = Line2D(*_points(xy(light, 0.0)), marker="o", ms=6, mfc="#FFD43B", label="light", **mark)
        for line in (mirror, source):
            axes.add_line(line)
        bar_axes = figure.add_axes(
            (
                (centre[0] + radius + 0.62) / size[0],
                (centre[1] - radius) / size[1],
                0.16 / size[0],
                2 * radius / size[1],
            )
        )
        bar = Colorbar(bar_axes, mesh, ticks=radial.tick_values())
        bar.ax.set_yticklabels(radial.tick_labels(), fontsize=8)
        bar.ax.minorticks_off()
        bar.set_label(f"fᵣ (1/sr){', log scale' if scale == 'log' else ''}", fontsize=9)
        what = f"θᵢ = {style.degrees_text(light)}, channel {b.channels.labels()[pick]}"
        if values.min() == values.max():
            what += f"; all values {style.number_text(float(values[peak]))}"
        elif np.isfinite(shown[peak]):
            what += (
                f"; largest value {style.number_text(float(values[peak]))} at θₒ = "
                f"{style.degrees_text(_tidy(data.theta_o[peak[0]]))}, "
                f"Δφ = {style.degrees_text(_tidy(data.delta_phi[peak[1]]))}"
            )
        heading(axes, size, title if title is not None else style.name_of(b), what)
        figure.legend(
            handles=[mirror, source], loc="lower center", ncols=2, frameon=False, fontsize=8.5, handletextpad=0.3,
            bbox_to_anchor=(centre[0] / size[0], (0.06 + 0.17 * len(notes)) / size[1]), borderaxespad=0.0,
        )  # fmt: skip
        footnotes(axes, notes)
    return figure


def _dial(axes: Axes, xy: Any, centre: tuple[float, float], radius: float) -> None:
    """Rings of theta_o and spokes of delta_phi over the map, labelled in degrees."""
    for deg in (30, 60):
        axes.add_patch(Circle(centre, radius * deg / 90, fill=False, ec="white", lw=0.5, alpha=0.6, zorder=2))
    axes.add_patch(Circle(centre, radius, fill=False, ec=INK, lw=0.8, zorder=3, clip_on=False))
    rim = np.pi / 2 * np.array([1.0, 1.0 + 0.05 / radius])
    ticks = [np.column_stack(xy(rim, p)) for p in np.radians(np.arange(0, 360, 45))]
    axes.add_collection(LineCollection(ticks, colors=INK, linewidths=0.8, zorder=2))
    halo = [withStroke(linewidth=1.6, foreground="black")]
    for deg in (30, 60):
        x, y = xy(np.radians(deg), np.radians(67.5))
        axes.text(x, y, f"{deg}°", color="white", fontsize=7.5, ha="center", va="center", path_effects=halo, zorder=3)
    for deg in range(0, 360, 45):
        x, y = xy(np.pi / 2 * (1 + 0.2 / radius), np.radians(deg))
        text = f"Δφ = {deg}°" if deg == 90 else f"{deg}°"
        axes.text(x, y, text, ha="center", va="center", fontsize=8.5)
    x, y = xy(np.pi / 2, np.radians(67.5))
    axes.text(x - 0.06, y - 0.1, "θₒ = 90°", ha="center", va="top", fontsize=7.5, color=FAINT)


def _narrow_note(theta_o: Array, values: Array, theta_i: float) -> list[str]:
    """A lobe narrower than the picture can show has to be said: it looks like no lobe at all."""
    along = values[:, values.shape[1] // 2]  # delta_phi = pi
    upper = theta_o[np.nan_to_num(along) > np.nan_to_num(values).max() / 2]
    width = float(np.ptp(upper)) if upper.size else 0.0
    if upper.size == 0 or width > np.radians(2.0) or abs(float(upper.mean()) - theta_i) > 0.1:
        return []
    return [f"the lobe is {np.degrees(width):.2g}° wide at half its height: see the polar view or the log scale"]


def _raster(theta_o: Array, delta_phi: Array, values: Array, pixels: int) -> Array:
    """The map as (pixels, pixels) values, bottom row first: of the nearest node or, where several nodes fall into
    one pixel, the largest of them, so that a lobe narrower than a pixel is still a bright pixel."""
    centres = (np.arange(pixels) + 0.5) / pixels * 2 - 1
    x, y = centres[None, :], centres[:, None]
    theta = np.minimum(np.hypot(x, y), 1.0) * conventions.HALF_PI
    phi = np.arctan2(-y, -x) % (2 * np.pi)
    image = values[_nearest(theta_o, theta), _nearest(delta_phi, phi)]
    r = theta_o[:, None] / conventions.HALF_PI
    column = np.clip(((1 - r * np.cos(delta_phi)) / 2 * pixels).astype(int), 0, pixels - 1)
    row = np.clip(((1 - r * np.sin(delta_phi)) / 2 * pixels).astype(int), 0, pixels - 1)
    np.fmax.at(image, (row, column), values)
    return image


def _nearest(nodes: Array, wanted: Array) -> npt.NDArray[np.intp]:
    return np.searchsorted((nodes[1:] + nodes[:-1]) / 2, wanted)


def _tidy(angle: float) -> float:
    """To a tenth of a degree: closer, the grid would speak, not the material."""
    return float(np.radians(np.round(np.degrees(angle), 1)))


def _points(xy: tuple[Any, Any]) -> tuple[Sequence[float], Sequence[float]]:
    return [float(xy[0])], [float(xy[1])]


def _colours() -> Any:
    from matplotlib import colormaps

    return colormaps[style.COLOUR_MAP].with_extremes(bad="#BDBDBD")
