"""The plane of incidence as a half-disc: one or several materials, angles of incidence or channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from brdfcore.base import conventions
from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.names import Scale
from brdfcore.plot import style
from brdfcore.plot.canvas import canvas, check_scale, delta_notes, fitted, footnotes, heading, inches_of
from brdfcore.plot.rendering import drawing
from brdfcore.plot.slices import slice as slice_of
from brdfcore.plot.style import FAINT, INK, RING, Radial
from brdfcore.plot.sure import WEAK_DASHES, Sure, sure_notes, sure_of

Array = npt.NDArray[np.float64]

#: More curves than this can't be told apart on paper.
CURVES_MAX = 12
#: One theta_i shows every channel up to this many, otherwise this many spread evenly.
CHANNELS_SHOWN = 6


@dataclass(frozen=True)
class _Curve:
    """A curve over signed theta_o, how sure its values are, and what was measured on it."""

    material: str
    label: str
    colour: str
    dashes: Any
    theta_o: Array
    values: Array
    sure: Sure


def polar(
    b: Brdf | Mapping[str, Brdf],
    theta_i: npt.ArrayLike = (0.0, np.pi / 6, np.pi / 3),
    *,
    scale: Scale = "linear",
    channel: str | float | None = None,
    title: str | None = None,
    points: int | None = None,
    size: tuple[float, float] = (6.4, 4.6),
    dpi: float = 150,
) -> Figure:
    """f_r in the plane of incidence as a half-disc: normal up, mirror side right, the light from the left.

    A band is the 95 % interval of `Brdf.uncertainty`, a thin dashed part of a curve extrapolated or filled (`status`),
    and circles are measurements at that theta_i where the material is made of some.

    b        a material, or several by label, drawn over each other.
    theta_i  polar angles of the light, radians.
    scale    "linear": the radius is f_r. "log": the radius is log10 f_r, from a floor chosen from the data (at
             most six decades below the top). What has no place (zero on a log scale, negative, not finite) is
             not drawn and counted in a note, as are values at the horizon that exceed ten times all others.
    channel  name, wavelength or position. None: with one material and one theta_i every channel (six spread
             evenly if there are more), otherwise the middle one (G of R, G, B). The picture says which.
    title    default: the material's name. Plain text, never mathematics.
    points   evenly spaced directions of each curve (default 361); more are added at the mirror direction.
    size     inches, at least 4.5 by 3.4; with dpi the pixels of a PNG.

    Raises `InputError` for more than 12 curves, a bad scale or angle, `UnknownNameError` for the channel.
    """
    check_scale(scale)
    materials = dict(b) if isinstance(b, Mapping) else {"": b}
    if not materials:
        raise InputError("wrong_number", "polar: expected at least one material, got none", where="b")
    lights = np.atleast_1d(conventions.as_float("theta_i", theta_i)).astype(np.float64).ravel()
    curves, what = _curves(materials, lights, channel, points)
    everything = np.concatenate([c.values for c in curves])
    horizon = np.concatenate([style.at_horizon(c.theta_o) for c in curves])
    radial = Radial.fit(everything, scale, horizon)

    with drawing():
        # two columns of names fit beside their lines and angles
        room = size[0] / 2 - (1.6 if any(c.material and c.label for c in curves) else 0.9)
        curves = [_named(c, max(0.9, room)) for c in curves]
        widest = max(inches_of(c.label, 8.5) for c in curves) + 0.75  # with its line and a gap
        columns = min(len(curves), 4, max(1, int((size[0] - 0.2) / widest)))
        rows = -(-len(curves) // columns) if len(curves) > 1 else 0
        notes = [*radial.notes(everything), *sure_notes([c.sure for c in curves]), *delta_notes(materials, lights)]
        if _coincide([radial(c.values) for c in curves]):
            notes.insert(0, f"the {len(curves)} curves coincide")
        below = 0.66 + 0.17 * rows + 0.17 * len(notes)
        figure, axes = canvas(size, dpi)
        radius = min((size[0] - 1.3) / 2, size[1] - 1.15 - below)
        centre = (size[0] / 2, below)
        plane = _HalfDisc(axes, centre, max(radius, 0.2))
        plane.grid(radial, f"fᵣ (1/sr){', log scale' if scale == 'log' else ''}")
        for curve in curves:
            plane.curve(curve, radial)
        colours = {float(t): INK for t in lights}
        if len(lights) > 1:
            colours = {float(t): c for t, (c, _) in zip(lights, style.line_looks())}
        for t, colour in colours.items():
            plane.light(t, colour)
            if any(m.has_delta for m in materials.values()):
                plane.delta(t, colour)
        text = title if title is not None else " | ".join(k or style.name_of(m) for k, m in materials.items())
        heading(axes, size, text, f"plane of incidence, {what}; arrows: the light")
        if rows:
            _legend(figure, curves, columns, size, 0.1 + 0.17 * len(notes))
        footnotes(axes, notes)
    return figure


def _curves(
    materials: Mapping[str, Brdf], lights: Array, channel: str | float | None, points: int | None
) -> tuple[list[_Curve], str]:
    """The curves, and what they are in words."""
    per_channel = len(materials) == 1 and lights.size == 1 and channel is None
    curves: list[_Curve] = []
    looks = style.line_looks()
    angle = "" if lights.size > 1 else f", θᵢ = {style.degrees_text(float(lights[0]))}" if lights.size else ""
    if per_channel:
        (b,) = materials.values()
        data = slice_of(b, lights, points=points)
        labels = b.channels.labels()
        shown = np.arange(len(labels))
        if len(labels) > CHANNELS_SHOWN:
            shown = np.unique(np.linspace(0, len(labels) - 1, CHANNELS_SHOWN).round().astype(int))
        for k, (colour, dashes) in zip(shown.tolist(), islice(looks, len(shown))):
            colour = style.CHANNEL_COLOURS.get(labels[k], colour)
            sure = sure_of(b, float(lights[0]), data.theta_o[0], k)
            curves.append(_Curve("", labels[k], colour, dashes, data.theta_o[0], data.values[0, :, k], sure))
        if len(labels) == 1:
            return curves, f"channel {labels[0]}{angle}"
        count = f"{len(shown)} of {len(labels)}" if len(shown) < len(labels) else f"all {len(labels)}"
        return curves, f"{count} channels{angle}"

    if len(materials) * lights.size > CURVES_MAX:
        raise InputError(
            "too_many_curves",
            f"theta_i: {lights.size} angle(s) of {len(materials)} material(s) are {len(materials) * lights.size} "
            f"curves, more than the {CURVES_MAX} that can be told apart; ask for fewer",
            where="theta_i",
            got=len(materials) * lights.size,
            expected=f"at most {CURVES_MAX} curves",
        )
    drawn: list[str] = []
    colours = [c for c, _ in islice(style.line_looks(), lights.size)]
    for n, (label, b) in enumerate(materials.items()):
        pick = style.default_channel(b.channels) if channel is None else b.channels.find(channel)
        drawn.append(b.channels.labels()[pick])
        data = slice_of(b, lights, channel=b.channels[pick], points=points)
        for k, t in enumerate(lights):
            colour, dashes = next(looks)
            if len(materials) > 1 and lights.size > 1:  # colour tells the angle, the dashes the material
                colour, dashes = colours[k], style.STYLES[n % len(style.STYLES)]
            text = f"θᵢ = {style.degrees_text(float(t))}" if len(materials) == 1 or lights.size > 1 else ""
            name = label if len(materials) > 1 else ""
            sure = sure_of(b, float(t), data.theta_o[k], pick)
            curves.append(_Curve(name, text, colour, dashes, data.theta_o[k], data.values[k, :, 0], sure))
    return curves, f"channel {' | '.join(dict.fromkeys(drawn))}{angle}"


def _named(curve: _Curve, inches: float) -> _Curve:
    """With the material's name, no wider than `inches`, in the label."""
    if not curve.material:
        return curve
    short, _ = fitted(curve.material, inches, 8.5, 8.5)
    return replace(curve, label=f"{short}, {curve.label}" if curve.label else short)


class _HalfDisc:
    """Polar coordinates of signed theta_o (0 up, positive right) in axes whose unit is the inch."""

    def __init__(self, axes: Axes, centre: tuple[float, float], radius: float) -> None:
        self.axes, self.centre, self.radius = axes, centre, radius

    def xy(self, theta: Any, r: Any) -> tuple[Any, Any]:
        return (
            self.centre[0] + self.radius * r * np.sin(theta),
            self.centre[1] + self.radius * r * np.cos(theta),
        )

    def grid(self, radial: Radial, axis_title: str) -> None:
        rim = np.radians(np.linspace(-90, 90, 181))
        ticks = (np.asarray(radial.ticks) - radial.low) / (radial.high - radial.low)
        rings = [np.column_stack(self.xy(rim, r)) for r in ticks if r > 0]
        spokes = [np.array([self.xy(t, 0.0), self.xy(t, 1.0)]) for t in np.radians(np.arange(-60, 61, 30))]
        self.axes.add_collection(LineCollection([*rings, *spokes], colors=RING, linewidths=0.6, zorder=1))
        outline = np.vstack([np.column_stack(self.xy(rim, 1.0)), self.xy(-np.pi / 2, 1.0)])
        self.axes.plot(*outline.T, color=INK, lw=0.8, zorder=1.5)
        for deg in range(-90, 91, 30):
            x, y = self.xy(np.radians(deg), 1.0 + 0.3 / self.radius)
            sides = "center" if deg == 0 else "right" if deg < 0 else "left"  # away from the arrows
            x -= float(np.sign(deg)) * 0.1
            self.axes.text(x, y, f"{deg}°".replace("-", "−"), ha=sides, va="center", fontsize=9)
        labels = radial.tick_labels()
        # labels need about 0.4 inch each; the outermost is always kept
        step = max(1, int(np.ceil((len(ticks) - 1) * 0.48 / self.radius)))
        for k in range(len(ticks) - 1, -1, -step):
            for side in (-1, 1) if ticks[k] > 0 else (1,):
                x, y = self.xy(side * np.pi / 2, ticks[k])
                self.axes.plot([x, x], [y, y - 0.04], color=INK, lw=0.8, zorder=1.5)
                self.axes.text(x, y - 0.07, labels[k], ha="center", va="top", fontsize=8, color=FAINT)
        x, y = self.centre
        self.axes.text(x, y - 0.27, axis_title, ha="center", va="top", fontsize=9)
        self.axes.text(x - self.radius, y - 0.27, "Δφ = 0°", ha="center", va="top", fontsize=8, color=FAINT)
        self.axes.text(x + self.radius, y - 0.27, "Δφ = 180°", ha="center", va="top", fontsize=8, color=FAINT)
        self.axes.text(x, y + self.radius + 0.47, "θₒ", ha="center", va="center", fontsize=9, color=FAINT)

    def curve(self, curve: _Curve, radial: Radial) -> None:
        sure = curve.sure
        if sure.widths is not None:
            ends = [radial.clipped(curve.values + side * sure.widths) for side in (1, -1)]
            sides = [np.column_stack(self.xy(curve.theta_o, end)) for end in ends]
            band = Polygon(
                np.vstack([sides[0], sides[1][::-1]]), closed=True, fc=curve.colour, ec="none", alpha=0.2, zorder=2.5
            )
            self.axes.add_patch(band)
        x, y = self.xy(curve.theta_o, radial(curve.values))
        for weak, dashes, width in ((False, curve.dashes, 1.6), (True, WEAK_DASHES, 1.1)):
            shown = sure.weak == weak
            if not shown.any():
                continue
            # each part begins where the one before ends
            shown[1:] |= shown[:-1] if not weak else False
            # round joins: a mitred tip of a sharp lobe would stand above its true peak
            self.axes.plot(
                np.where(shown, x, np.nan) if not shown.all() else x, y, color=curve.colour, ls=dashes, lw=width,
                zorder=3, label="" if weak else curve.label,
                solid_joinstyle="round", dash_joinstyle="round", dash_capstyle="butt",
            )  # fmt: skip
        if sure.measured is not None:
            x, y = self.xy(sure.measured[0], radial(sure.measured[1]))
            self.axes.plot(x, y, ls="none", marker="o", ms=2.6, mew=0.5, mfc="white", mec=curve.colour, zorder=3.5)

    def light(self, theta_i: float, colour: str) -> None:
        """An arrow outside the rim on the side of the light."""
        gap = 1.0 / self.radius
        self.axes.annotate(
            "",
            xy=self.xy(-theta_i, 1.0 + 0.02 * gap),
            xytext=self.xy(-theta_i, 1.0 + 0.19 * gap),
            arrowprops={
                "arrowstyle": "-|>",
                "color": colour,
                "lw": 1.4,
                "mutation_scale": 9,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=4,
        )

    def delta(self, theta_i: float, colour: str) -> None:
        """A perfect mirror part has a direction and no height: a thin dotted spoke to the rim."""
        self.axes.plot(*zip(self.xy(theta_i, 0.0), self.xy(theta_i, 1.0)), color=colour, ls=":", lw=1.0, zorder=2)


def _legend(figure: Figure, curves: list[_Curve], columns: int, size: tuple[float, float], y: float) -> None:
    handles = [Line2D([], [], color=c.colour, ls=c.dashes, lw=1.6, label=c.label) for c in curves]
    legend = figure.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, y / size[1]), ncols=columns, frameon=False,
        fontsize=8.5, handlelength=3.0, columnspacing=1.6, labelspacing=0.3, borderaxespad=0.0, borderpad=0.0,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)


def _coincide(radii: list[Array]) -> bool:
    """True if several curves lie on each other to less than a line's width."""
    if len(radii) < 2:
        return False
    drawn = np.nan_to_num(np.stack(radii))  # their theta_o differ by a fraction of the spacing only
    return bool(np.ptp(drawn, axis=0).max() < 0.003 and drawn.max() > 0)
