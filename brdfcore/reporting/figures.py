"""The pictures of a report: the front, slices, the error map, lit spheres; and all of them on one sheet."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from brdfcore.analysis.pareto.entries import Entry
from brdfcore.analysis.pareto.pareto import Pareto
from brdfcore.base.brdf import Brdf
from brdfcore.base.registry import REPRESENTATIONS
from brdfcore.plot.rendering import drawing
from brdfcore.plot.slices import slice as slice_of
from brdfcore.plot.style import COLOUR_MAP, COLOURS, FAINT, INK, clean
from brdfcore.reporting import words
from brdfcore.reporting.appearance import Appearance
from brdfcore.reporting.error_map import ErrorMap

#: Errors below are drawn at it: "exact".
LEAST_ERROR = 1e-6
#: What a formula, which has no table, is drawn at, bytes; further left where a table is smaller than thrice that.
NO_TABLE = 1_500
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
#: As many colours as there are formulas and representations.
PALETTE = (*COLOURS, "#228833", "#AA3377")
#: theta_i of the slices, degrees.
SLICES = (0.0, 45.0, 75.0)
DPI = 110


def looks_of(entries: list[Entry]) -> dict[str, int]:
    """Which colour and marker each representation has, the same for every material: formulas the first, tables as they
    are registered. Others' libraries are grey."""
    order = ["", *REPRESENTATIONS.names()]
    return {e.representation: order.index(e.representation if e.kind == "table" else "")
            for e in entries if e.kind != "peer"}  # fmt: skip


def front(found: Pareto) -> Figure:
    """Error against bytes, the front as a line."""
    with drawing():
        figure = Figure(figsize=(7.2, 4.6), dpi=DPI, facecolor="white", layout="constrained")
        draw_front(figure.add_subplot(), found)
    return figure


def draw_front(axes: Axes, found: Pareto) -> None:
    looks = looks_of(found.entries)
    none = no_table(found)
    left, right = none / 2, max([10 * NO_TABLE, *(e.nbytes for e in found.entries)]) * 3
    axes.axhspan(LEAST_ERROR / 4, found.tolerance, color="#DDEBDD", zorder=0)
    axes.axhline(found.tolerance, color="#228833", lw=1, ls="--", zorder=1)
    axes.text(
        left, found.tolerance, f" right enough: {words.percent(found.tolerance)}", color="#1A6B28", fontsize=8, va="top"
    )
    seen = set()
    for entry in found.entries:
        x, y = place(entry, none)
        new = entry.representation not in seen
        seen.add(entry.representation)
        if entry.kind == "peer":
            axes.plot(x, y, "x", color=FAINT, ms=7, label=entry.representation if new else None, zorder=2)
            continue
        look = looks[entry.representation]
        colour, marker = PALETTE[look % len(PALETTE)], MARKERS[look % len(MARKERS)]
        face = colour if entry.on_front else "white"
        axes.plot(
            x, y, marker, color=colour, mfc=face, ms=7, ls="none", label=entry.representation if new else None, zorder=3
        )
    path = np.array([place(e, none) for e in envelope(found.front)])
    axes.plot(*path.T, color=INK, lw=0.8, alpha=0.5, zorder=2)
    x, y = place(found.chosen, none)
    axes.plot(x, y, "o", mfc="none", mec="#CC3311", mew=2, ms=15, zorder=4)
    text = f"{'use this' if found.met else 'closest'}: {found.chosen.label}"
    # towards the middle, so that it stays inside
    right_half = x * x > left * right
    axes.annotate(
        text, (x, y), (-12 if right_half else 12, -4), textcoords="offset points", fontsize=8.5, color="#CC3311",
        ha="right" if right_half else "left", weight="bold", parse_math=False, annotation_clip=False,
        bbox={"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75},
    )  # fmt: skip
    top = max([found.tolerance, *(place(e, none)[1] for e in found.entries)])
    axes.set(xscale="log", yscale="log", xlim=(left, right), ylim=(LEAST_ERROR / 2, max(2 * top, 0.02)))
    axes.set_xlabel("bytes that a look-up may touch")
    axes.set_ylabel("error: share of the reflected energy misplaced at the worst incidence")
    formulas = [none] if any(e.nbytes == 0 for e in found.entries) else []
    ticks = [t for t in (1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9) if 3 * none < t < right]
    axes.set_xticks([*formulas, *ticks], [*("no table" for _ in formulas), *(words.size(int(t)) for t in ticks)])
    axes.set_xticks([], minor=True)
    shares = [t for t in (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0) if t <= axes.get_ylim()[1]]
    axes.set_yticks(shares, [f"{100 * t:g} %" if t > LEAST_ERROR else "exact" for t in shares])
    axes.grid(color="#E4E4E4", lw=0.6, zorder=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(
        loc="upper left", bbox_to_anchor=(0, -0.14), ncols=3, fontsize=8, frameon=False, title_fontsize=8,
        title="filled: nothing else is smaller, faster and more exact; hollow: something is",
        alignment="left",
    )  # fmt: skip


def envelope(front: list[Entry]) -> list[Entry]:
    """Of the front, what has the smallest error up to its size; the rest is on it for its speed."""
    path: list[Entry] = []
    for entry in front:
        if not path or entry.error < path[-1].error:
            path.append(entry)
    return path


def no_table(found: Pareto) -> float:
    """What a formula is drawn at, bytes: left of every table."""
    return min([NO_TABLE, *(e.nbytes / 3 for e in found.entries if e.nbytes)])


def place(entry: Entry, none: float) -> tuple[float, float]:
    """Where an entry is drawn: bytes, those of a formula `none`; error."""
    return float(entry.nbytes or none), float(np.clip(entry.error, LEAST_ERROR, 1e3))


def slices(reference: Brdf, candidate: Brdf, name: str) -> Figure:
    """f_r in the plane of incidence, log scale, of both, at three theta_i."""
    with drawing():
        figure = Figure(figsize=(7.2, 3.6), dpi=DPI, facecolor="white", layout="constrained")
        draw_slices(figure.add_subplot(), reference, candidate, name)
    return figure


def draw_slices(axes: Axes, reference: Brdf, candidate: Brdf, name: str) -> None:
    channel = len(reference.channels) // 2
    lights = np.radians(SLICES)
    data = [slice_of(b, lights) for b in (reference, candidate)]
    values = [np.where(d.values[..., channel] > 0, d.values[..., channel], np.nan) for d in data]
    away = np.abs(np.degrees(data[0].theta_o)) < 89.5  # f itself may have no finite value at the horizon
    top = float(np.nanmax(np.where(away, values[0], np.nan), initial=1e-12))
    for k, degrees in enumerate(SLICES):
        x = np.degrees(data[0].theta_o[k])
        colour = COLOURS[k % len(COLOURS)]
        axes.plot(x, values[0][k], color=colour, lw=3.2, alpha=0.35, label=f"light at {degrees:g}°: reference")
        label = f"{degrees:g}°: {clean(name, 24)}"
        axes.plot(np.degrees(data[1].theta_o[k]), values[1][k], color=colour, lw=1.1, label=label)
    low = float(np.nanmin(np.where(away, values[0], np.nan), initial=top))
    axes.set(yscale="log", xlim=(-90, 90), ylim=(max(low / 2, top * 1e-7), top * 3))
    axes.set_xticks(range(-90, 91, 30), [f"{t}°" for t in range(-90, 91, 30)])
    axes.set_xlabel("direction of the viewer in the plane of incidence (mirror side positive)")
    which = reference.channels.labels()[channel]
    axes.set_ylabel(f"f_r, 1/sr ({clean(str(which), 20)})", parse_math=False)
    axes.set_title(clean(f"reference (wide) and {name} (thin)", 90), fontsize=9.5, loc="left", parse_math=False)
    axes.grid(color="#E4E4E4", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7.5, frameon=False, ncols=3, loc="upper left", bbox_to_anchor=(0, -0.2))


def errors(found: ErrorMap) -> Figure:
    """Relative error over (theta_h, theta_d)."""
    with drawing():
        figure = Figure(figsize=(7.2, 3.2), dpi=DPI, facecolor="white", layout="constrained")
        draw_errors(figure.add_subplot(), found)
    return figure


def draw_errors(axes: Axes, found: ErrorMap) -> None:
    shown = np.ma.masked_invalid(np.clip(found.error, 1e-4, 1.0)).T
    axes.set_facecolor("#BBBBBB")
    # the cells are even in sqrt(theta_h): the axis is, too
    mesh = axes.pcolormesh(
        np.sqrt(np.degrees(found.theta_h)), np.degrees(found.theta_d), shown, cmap=COLOUR_MAP, norm=LogNorm(1e-4, 1.0),
        rasterized=True,
    )  # fmt: skip
    ticks = [0, 1, 5, 15, 30, 60, 90]
    axes.set_xticks(np.sqrt(ticks), [f"{t}°" for t in ticks])
    axes.set_yticks([0, 30, 60, 90], ["0°", "30°", "60°", "90°"])
    axes.set_xlabel("half angle: 0° is the mirror direction")
    axes.set_ylabel("difference angle")
    axes.set_title("where it is wrong (grey: below the horizon)", fontsize=9.5, loc="left")
    bar = axes.figure.colorbar(mesh, ax=axes, ticks=[1e-4, 1e-3, 1e-2, 1e-1, 1.0])
    bar.ax.set_yticklabels(["≤ 0.01 %", "0.1 %", "1 %", "10 %", "≥ 100 %"])
    bar.set_label("mean |error| / mean value")


def spheres(found: Appearance) -> Figure:
    """Reference, candidate and FLIP side by side."""
    with drawing():
        figure = Figure(figsize=(7.2, 2.75), dpi=DPI, facecolor="white", layout="constrained")
        grid = figure.subplots(1, 3)
        draw_spheres(list(grid), found)
    return figure


def draw_spheres(axes: list[Axes], found: Appearance) -> None:
    difference = found.difference
    pictures: list[tuple[str, Any]] = [("reference", found.reference), ("as looked up", found.candidate)]
    if difference is not None and found.mean is not None:
        pictures.append((f"FLIP: mean {found.mean:.2g}, p95 {found.p95:.2g}", difference))
    else:
        pictures.append(("FLIP: not installed (the extra `flip`)", np.zeros(found.reference.shape[:2])))
    for one, (text, picture) in zip(axes, pictures):
        mesh = one.imshow(
            picture, interpolation="nearest", cmap="magma", vmin=0.0, vmax=0.3
        )  # colours stay as they are
        one.set_title(text, fontsize=9.5)
        one.set_axis_off()
        if picture.ndim == 2:
            bar = one.figure.colorbar(mesh, ax=one, fraction=0.046, ticks=[0, 0.1, 0.2, 0.3])
            bar.ax.set_yticklabels(["0 same", "0.1", "0.2", "≥ 0.3"])


def sheet(
    rows: list[tuple[Pareto, Appearance, ErrorMap, Brdf, str]],
) -> Figure:
    """One row a material: the front, and what the chosen one looks like."""
    with drawing():
        figure = Figure(figsize=(14.4, 8.2 * len(rows)), dpi=DPI, facecolor="white", layout="constrained")
        parts: Any = figure.subfigures(len(rows), 1, squeeze=False)
        for part, (found, look, where, candidate, name) in zip(parts[:, 0], rows):
            text = clean(f"{found.material}: {words.advice(found)}", 170)
            part.suptitle(text, fontsize=12, weight="bold", parse_math=False)
            left, right = part.subfigures(1, 2)
            draw_front(left.add_subplot(), found)
            above, middle, below = right.subfigures(3, 1, height_ratios=(1.1, 0.9, 0.9))
            draw_slices(above.add_subplot(), found.source, candidate, name)
            draw_errors(middle.add_subplot(), where)
            draw_spheres(list(below.subplots(1, 3)), look)
    return figure
