"""An expansion in spherical harmonics as a picture: error by degree, spectrum, slices over the original."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from brdfcore.base import conventions
from brdfcore.base.brdf import Brdf
from brdfcore.base.errors import InputError
from brdfcore.harmonics.expansion import HarmonicExpansion
from brdfcore.harmonics.summary import harmonic_summary
from brdfcore.plot import style
from brdfcore.plot.canvas import canvas, delta_notes, footnotes, heading
from brdfcore.plot.rendering import drawing
from brdfcore.plot.style import COLOURS, FAINT, INK, RING

Array = npt.NDArray[np.float64]

#: Slices side by side.
MOST_SLICES = 4
#: Directions of a slice: 20 or so to a wave of degree 128.
_DIRECTIONS = 1_441
_BLUE, _RED, _GOLD = COLOURS[:3]


def expansion(
    b: Brdf,
    expanded: HarmonicExpansion,
    theta_i: npt.ArrayLike = (0.0, np.pi / 6, np.pi / 3),
    *,
    channel: str | float | None = None,
    title: str | None = None,
    size: tuple[float, float] = (9.0, 7.0),
    dpi: float = 150,
) -> Figure:
    """What an expansion of `b` keeps, and how it rings.

    Above: the error by degree in the target's norm, with that of f at the degree of the expansion, and the spectrum.
    Below: f_r cos theta_o in the plane of incidence, original and expansion over each other, what is negative filled.

    theta_i  one to four polar angles of the light, radians.
    channel  of the slices; None: the middle one.

    Raises `InputError` for angles outside the domain or too many, `UnknownNameError` for an unknown channel.
    """
    angles = conventions.check_domain(conventions.flatten_angles(theta_i, 0.0, 0.0))
    lights = np.minimum(angles.theta_i.astype(np.float64), conventions.HALF_PI)
    if not 1 <= lights.size <= MOST_SLICES:
        raise InputError(
            "wrong_number",
            f"theta_i: expected 1 to {MOST_SLICES} angles, got {lights.size}",
            where="theta_i",
            got=int(lights.size),
            expected=f"1 to {MOST_SLICES}",
        )
    pick = style.default_channel(b.channels) if channel is None else b.channels.find(channel)
    told = harmonic_summary(expanded)
    with drawing():
        figure, page = canvas(size, dpi)
        what = (
            f"spherical harmonics to degree {expanded.lmax}, {expanded.size} coefficients a channel, "
            f"{style.number_text(expanded.nbytes / 1000)} kB; target {_TARGETS[expanded.target]}"
        )
        if expanded.window != "none":
            what += f", window {expanded.window}"
        heading(page, size, title if title is not None else style.name_of(b), what)
        _errors(_axes(figure, size, 0, 2, True), told)
        _spectrum(_axes(figure, size, 1, 2, True), told)
        drawn = [
            _slice(_axes(figure, size, k, lights.size, False), b, expanded, float(light), pick, k == 0, lights.size > 3)
            for k, light in enumerate(lights)
        ]
        notes = [
            f"slices: channel {b.channels.labels()[pick]}; θₒ positive on the mirror side",
            *delta_notes({"": b}, lights),
        ]
        notes[0] += _least(drawn, told)
        footnotes(page, [n.replace(" (dotted)", "") for n in notes])
        handles, labels = figure.axes[-1].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="lower center", ncols=4, frameon=False, fontsize=8.5,
            bbox_to_anchor=(0.5, (0.12 + 0.17 * len(notes)) / size[1]), borderaxespad=0.0,
        )  # fmt: skip
    return figure


_TARGETS = {"f_cos_cos": "fᵣ cos θᵢ cos θₒ", "f": "fᵣ", "f_cos_o": "fᵣ cos θₒ"}


def _axes(figure: Figure, size: tuple[float, float], k: int, count: int, above: bool) -> Axes:
    left, right, gap = 0.72, 0.25, 0.72 if above else 0.5
    wide = (size[0] - left - right - gap * (count - 1)) / count
    half = (size[1] - 2.7) / 2
    bottom = 1.95 + half if above else 1.15
    axes = figure.add_axes(((left + k * (wide + gap)) / size[0], bottom / size[1], wide / size[0], half / size[1]))
    axes.tick_params(labelsize=8, width=0.6, colors=INK)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(True, color=RING, lw=0.4, alpha=0.7)
    axes.set_axisbelow(True)
    return axes


def _errors(axes: Axes, told: dict[str, Any]) -> None:
    axes.set_title("what is left out", fontsize=9, loc="left")
    axes.set_xlabel("ends at degree l", fontsize=8.5, labelpad=2)
    axes.set_ylabel("relative L2 error", fontsize=8.5, labelpad=2)
    errors = np.asarray(told["error_by_degree"], np.float64)
    usable = errors > 0
    if errors.size < 2 or not usable.any():
        _nothing(axes, "no regular part" if errors.size else "not recorded in this file")
        return
    l = np.arange(errors.size)  # noqa: E741
    axes.loglog(l[1:], np.where(usable, errors, np.nan)[1:], color=_BLUE, lw=1.5, label=_TARGETS[told["target"]])
    if told["target"] != "f":
        mark: dict[str, Any] = {"ls": "none", "marker": "D", "ms": 5, "color": _RED, "clip_on": False}
        axes.loglog([told["lmax"]], [told["truncation"]["f"]], label="fᵣ, at the last degree", **mark)
    if told["window"]["name"] != "none" and told["truncation"]["target"] > 0:
        mark = {"ls": "none", "marker": "o", "ms": 5, "color": _BLUE, "clip_on": False}
        axes.loglog([told["lmax"]], [told["truncation"]["target"]], label="with the window", **mark)
    quadrature = told["quadrature"]["target"]
    low = float(errors[usable].min())
    if quadrature > 1e-3 * low:
        axes.axhline(quadrature, color=FAINT, lw=0.9, ls=(0, (1.5, 1.3)), label="sampling (quadrature)")
    _decades(axes)
    axes.set_xlim(1, max(told["lmax"], 2))
    _degrees(axes)
    axes.legend(fontsize=7.5, loc="lower left", edgecolor="none", framealpha=0.9)


def _spectrum(axes: Axes, told: dict[str, Any]) -> None:
    axes.set_title("where the energy is", fontsize=9, loc="left")
    axes.set_xlabel("degree l", fontsize=8.5, labelpad=2)
    axes.set_ylabel("share of the energy", fontsize=8.5, labelpad=2)
    l = np.arange(told["lmax"] + 1)  # noqa: E741
    shares = {side: np.asarray(told["spectrum"][side]) for side in ("light", "viewer")}
    if not any(s.any() for s in shares.values()):
        _nothing(axes, "no regular part")
        return
    same = np.allclose(shares["light"], shares["viewer"], rtol=1e-6, atol=1e-12)
    looks = (("light", _BLUE, "-", "of the light, and of the viewer" if same else "of the light"),)
    looks += () if same else (("viewer", _RED, (0, (5, 2)), "of the viewer"),)  # type: ignore[assignment]
    for side, colour, dashes, label in looks:
        shown = shares[side] > 0  # odd, or even, functions only: others are 0
        axes.semilogy(l[shown], shares[side][shown], color=colour, ls=dashes, lw=1.4, label=label)
    _decades(axes)
    axes.set_xlim(0, told["lmax"])
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.legend(fontsize=7.5, loc="lower left", edgecolor="none", framealpha=0.9)


def _slice(
    axes: Axes, b: Brdf, expanded: HarmonicExpansion, light: float, pick: int, first: bool, narrow: bool
) -> Array:
    """Draw one slice; the expansion's values."""
    theta = np.radians(np.linspace(-90, 90, _DIRECTIONS))
    cosine, phi = np.cos(theta), np.where(theta >= 0, np.pi, 0.0)
    original, found = (x.evaluate(light, np.abs(theta), phi)[:, pick] * cosine for x in (b, expanded))
    degrees = np.degrees(theta)
    axes.fill_between(degrees, original, found, color=_GOLD, alpha=0.55, lw=0, label="difference")
    axes.plot(degrees, original, color=INK, lw=2.6, alpha=0.35, label="original")
    axes.plot(degrees, found, color=_BLUE, lw=1.1, label=f"degree {expanded.lmax}")
    # drawn once where nothing is negative too, so that the legend is the same in every picture
    axes.fill_between(degrees, np.minimum(found, 0.0), 0.0, color=_RED, alpha=0.8, lw=0, label="negative: ringing")
    axes.axhline(0.0, color=FAINT, lw=0.6)
    inner = np.abs(degrees) < 89.9
    top = max(float(np.nanmax(original[inner])), float(found[inner].max()), 1e-300)
    low = min(float(found[inner].min()), 0.0)
    axes.set(xlim=(-90, 90), ylim=(low - 0.04 * (top - low), top + 0.06 * (top - low)))
    ticks = (-90, -45, 0, 45, 90) if narrow else (-90, -60, -30, 0, 30, 60, 90)
    axes.set_xticks(ticks, [f"{t}°".replace("-", "−") for t in ticks], fontsize=7.5)
    axes.tick_params(axis="y", labelsize=7.5)
    axes.set_title(f"light at θᵢ = {style.degrees_text(light)}", fontsize=9, loc="left")
    axes.set_xlabel("viewer θₒ", fontsize=8.5, labelpad=2)
    if first:
        axes.set_ylabel("fᵣ cos θₒ (1/sr)", fontsize=8.5, labelpad=2)
    return np.asarray(found)


def _least(drawn: Sequence[Array], told: dict[str, Any]) -> str:
    if "minimum" not in told:
        return ""
    least = told["minimum"]
    if least >= 0:
        return "; fᵣ is nowhere negative on the grid that was searched"
    at = told["minimum_at"]
    return (
        f"; the least fᵣ is {style.number_text(least)} 1/sr, at θᵢ = {at[0]:.3g}°, θₒ = {at[1]:.3g}°, Δφ = {at[2]:.3g}°"
        f" (largest {style.number_text(told['maximum'])})"
    )


def _nothing(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", fontsize=9, color=FAINT)
    axes.set(xticks=[], yticks=[])


def _degrees(axes: Axes) -> None:
    """Ticks at powers of two."""
    high = axes.get_xlim()[1]
    ticks = [*(2**k for k in range(11) if 2**k < high / 1.3), round(high)]
    axes.set_xticks(ticks, [str(t) for t in ticks], fontsize=8)
    axes.minorticks_off()


def _decades(axes: Axes) -> None:
    """At least one decade, its ticks labelled like those of the other pictures."""
    spans = [np.asarray(line.get_ydata(), np.float64) for line in axes.lines]
    low, high = float(min(np.nanmin(y) for y in spans)), float(max(np.nanmax(y) for y in spans))
    # 1.0000001 is no reason for another decade
    first, last = int(np.floor(np.log10(low) + 1e-3)), int(np.ceil(np.log10(high) - 1e-3))
    last = max(last, first + 1)
    axes.set_ylim(10.0**first, 10.0**last)
    step = max((last - first) // 8, 1) if last - first > 8 else 1
    if last - first <= 2:
        ticks = [d * 10.0**k for k in range(first, last) for d in (1, 2, 5)] + [10.0**last]
    else:
        ticks = [10.0**k for k in range(first, last + 1, step)]
    axes.minorticks_off()
    axes.set_yticks(ticks, [style.number_text(t) for t in ticks], fontsize=8)
