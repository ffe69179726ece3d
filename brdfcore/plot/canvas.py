"""What both kinds of figure share: a canvas whose unit is the inch, its heading and its footnotes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextToPath

from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.names import Scale, choices
from brdfcore.plot import style
from brdfcore.plot.style import FAINT

Array = npt.NDArray[np.float64]


#: Below this size, inches, labels would meet. A smaller picture takes a lower dpi instead.
SMALLEST = (4.5, 3.4)
_WIDTHS = TextToPath()


def canvas(size: tuple[float, float], dpi: float) -> tuple[Figure, Axes]:
    """A figure with one frameless axes over all of it, in inches.

    Raises `InputError` for a size below `SMALLEST` or a dpi outside [20, 1200].
    """
    if not (size[0] >= SMALLEST[0] and size[1] >= SMALLEST[1] and 20 <= dpi <= 1200 and max(size) <= 100):
        raise InputError(
            "bad_size",
            f"size = {size}, dpi = {dpi}: expected at least {SMALLEST[0]} by {SMALLEST[1]} inches, at most 100, and a "
            "dpi from 20 to 1200; for a smaller picture lower the dpi, not the size",
            where="size",
        )
    figure = Figure(figsize=size, dpi=dpi, facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, size[0]), ylim=(0.0, size[1]))
    axes.set_axis_off()
    return figure, axes


def inches_of(text: str, points: float, weight: str = "normal") -> float:
    """How wide `text` is drawn."""
    font = FontProperties(family="DejaVu Sans", weight=weight, size=points)
    return float(_WIDTHS.get_text_width_height_descent(text, font, ismath=False)[0]) / 72


def fitted(text: str, inches: float, points: float, least: float, weight: str = "normal") -> tuple[str, float]:
    """`text` and its font size such that it is no wider than `inches`: first smaller, then shortened with "…"."""
    text = style.clean(text, 300)
    wide = inches_of(text, points, weight)
    if wide <= inches:
        return text, points
    if wide * least / points <= inches:
        return text, points * inches / wide
    room = inches * points / least
    keep = next(n for n in range(len(text) - 1, -1, -1) if n == 0 or inches_of(text[:n] + "…", points, weight) <= room)
    return text[:keep] + "…", least


def heading(axes: Axes, size: tuple[float, float], title: str, subtitle: str) -> None:
    x, room = size[0] / 2, size[0] - 0.3
    text, points = fitted(title, room, 11.0, 8.0, "bold")
    axes.text(x, size[1] - 0.14, text, ha="center", va="top", fontsize=points, parse_math=False, weight="bold")
    text, points = fitted(subtitle, room, 8.5, 7.0)
    axes.text(x, size[1] - 0.38, text, ha="center", va="top", fontsize=points, color=FAINT, parse_math=False)


def footnotes(axes: Axes, notes: list[str]) -> None:
    for k, note in enumerate(reversed(notes)):
        text, points = fitted(note, axes.get_xlim()[1] - 0.24, 7.5, 6.0)
        axes.text(0.12, 0.08 + 0.17 * k, text, va="bottom", fontsize=points, color=FAINT, parse_math=False)


def delta_notes(materials: Mapping[str, Brdf], lights: Array) -> list[str]:
    lines = []
    for label, b in materials.items():
        if b.has_delta:
            share = b.delta_reflectance(lights).mean(axis=-1)
            listed = ", ".join(
                f"{style.number_text(float(s))} at {style.degrees_text(float(t))}" for t, s in zip(lights, share)
            )
            who = f"{style.clean(label, 30)}: " if label else ""
            lines.append(
                style.clean(f"{who}the perfect mirror part is a delta, not in fᵣ (dotted); it reflects {listed}", 130)
            )
    return lines


def check_scale(scale: str) -> None:
    if scale not in choices(Scale):
        raise InputError(
            "bad_option",
            f"scale={scale!r}: expected 'linear' or 'log'",
            where="scale",
            got=str(scale)[:40],
            expected="'linear' or 'log'",
        )
