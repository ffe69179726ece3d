"""What lectures say of Phong against Torrance, in numbers and a picture:
`python -m tests.benchmarks.phong_against_torrance [-o file.png]`.

The lobes are equally wide at normal incidence: (r.v)^n, (n.h)^(4n) and Beckmann's with m = 1/sqrt(2n); Torrance is
`cook_torrance` without Fresnel's loss (F = 1), so that what is missing of an albedo is lost by the geometry alone.
"""

from __future__ import annotations

import argparse
import textwrap
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

import brdfcore as bc
from brdfcore import metrics
from brdfcore.base.quadrature import integrate_hemisphere
from brdfcore.plot import style
from brdfcore.plot.rendering import drawing, render

Array = npt.NDArray[np.float64]

EXPONENTS = (20, 200)
ALBEDO_AT = (0, 45, 75, 85, 89)
BELOW_AT = (75, 85)
PEAK_AT = (75, 80)
#: As a column of two in a journal, at 220 dots an inch.
SIZE, DPI = (7.2, 2.35), 220
DRAWN_AT = (30, 60, 80)
#: Colours dark enough for text, and line styles that tell the curves apart in grey.
LOOKS = tuple(zip((style.COLOURS[k] for k in (0, 1, 5)), style.STYLES))


def materials(n: float) -> dict[str, bc.Brdf]:
    torrance = bc.model("cook_torrance", roughness=(2 * n) ** -0.5, distribution="beckmann", masking="vgroove")
    return {
        "Phong, published": bc.model("phong", exponent=n, convention="published"),
        "Phong, normalised": bc.model("phong", exponent=n),
        "Blinn-Phong, published": bc.model("blinn_phong", exponent=4 * n, convention="published"),
        "Torrance": torrance,
    }


def phong_below(n: float, theta_i: float) -> float:
    """Share of int (r.v)^n dw over all directions that lies below the surface.

    v at the angle a from r, turned by psi about it, is below where cos psi < -cot a cot theta_i.
    """
    x, w = np.polynomial.legendre.leggauss(4_000)
    a = 0.25 * np.pi * (x + 1)
    lobe = w * np.cos(a) ** n * np.sin(a)
    turned = np.arccos(np.clip(1 / (np.tan(a) * np.tan(theta_i)), 0, 1)) / np.pi
    return float((lobe * turned).sum() / lobe.sum())


def blinn_below(n: float, theta_i: float) -> float:
    """Share of int (n.h)^n dw below the surface, n.h > 0, wi.h > 0: dw = 4 wi.h dw_h, w_z = 2 (wi.h) h_z - cos theta_i.

    wi.h = a + b cos psi with a = cos theta_i cos theta_h, b = sin theta_i sin theta_h; int over psi in closed form.
    """
    x, w = np.polynomial.legendre.leggauss(4_000)
    t = 0.25 * np.pi * (x + 1)
    a, b = np.cos(theta_i) * np.cos(t), np.sin(theta_i) * np.sin(t)
    ends = [np.arccos(np.clip((c - a) / b, -1, 1)) for c in (np.zeros_like(t), np.cos(theta_i) / (2 * np.cos(t)))]
    everything, above = (a * psi + b * np.sin(psi) for psi in ends)
    lobe = w * np.cos(t) ** n * np.sin(t)
    return float((lobe * (everything - above)).sum() / (lobe * everything).sum())


def peak(b: bc.Brdf, theta_i: float) -> float:
    """theta_o of the largest f in the plane of incidence, degrees, to 0.01."""
    theta_o = np.radians(np.linspace(0, 90, 9_001))
    return float(np.degrees(theta_o[b.evaluate(theta_i, theta_o, np.pi)[:, 0].argmax()]))


def _defect(b: bc.Brdf) -> str:
    """Mean of eight seeds with its standard error: the published lobes grow as 1/cos theta_i, and few draws see it."""
    found = np.array([metrics.reciprocity_defect(b, pairs=200_000, seed=seed) for seed in range(1, 9)])
    return f"{found.mean():.3f} ± {found.std(ddof=1) / found.size**0.5:.3f}" if found.any() else "0"


def rows(n: int) -> list[list[str]]:
    found = []
    for name, b in materials(n).items():
        below = ["0 (masked)"] * len(BELOW_AT)
        width = f"m = {(2 * n) ** -0.5:.3f}"
        if name != "Torrance":
            share, exponent = (blinn_below, 4 * n) if name.startswith("Blinn") else (phong_below, n)
            width = f"n = {exponent}"
            below = [f"{100 * share(exponent, t):.2g} %" for t in np.radians(BELOW_AT)]
        found.append(
            [
                f"{name}, {width}",
                _defect(b),
                *(f"{x:.3f}" for x in b.albedo(np.radians(ALBEDO_AT))[:, 0]),
                *below,
                *(f"{peak(b, t):.1f}°" for t in np.radians(PEAK_AT)),
            ]
        )
    return found


def text() -> str:
    """The table and what it says, as Markdown."""
    heads = ["lobe", "reciprocity defect", *(f"albedo {t}°" for t in ALBEDO_AT)]
    heads += [*(f"below the surface {t}°" for t in BELOW_AT), *(f"peak for {t}°" for t in PEAK_AT)]
    lines = [heads, ["---"] * len(heads), *(row for n in EXPONENTS for row in rows(n))]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n\n" + _said()


def _said() -> str:
    growth = []
    for n in EXPONENTS:
        a = materials(n)["Phong, published"].albedo(np.radians([0.0, 89.0]))[:, 0]
        growth.append((a[0], a[1] / a[0]))
    (low, times), (low2, times2) = growth
    said = (
        f"`specular` = 1 of a published Phong is no reflectance: at normal incidence it reflects {low:.2f} "
        f"(n = {EXPONENTS[0]}) or {low2:.2f} (n = {EXPONENTS[1]}) of the light, at 89° {times:.1f} or {times2:.1f} "
        "times that, and towards 90° without bound. Normalised it is reciprocal and never passes 1, but part of the "
        "lobe still points into the surface and is lost: it goes dark at grazing incidence. Torrance's facets keep the "
        "lobe above the surface, and its peak lies beyond the mirror direction, as measured on rough surfaces "
        "([Torrance and Sparrow 1967](https://doi.org/10.1364/JOSA.57.001105))."
    )
    return textwrap.fill(said, 118, break_long_words=False, break_on_hyphens=False)


def picture() -> Figure:
    """Both lobes in the plane of incidence, each to its own peak, and the albedos."""
    n = EXPONENTS[0]
    named = materials(n)
    with drawing():
        figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white")
        panels = [figure.add_axes(box) for box in ((0.0, 0.0, 0.34, 0.93), (0.335, 0.0, 0.34, 0.93))]
        _lobes(panels[0], named["Phong, published"], n)
        _lobes(panels[1], named["Torrance"], None)
        titles = f"(a) Phong, n = {n}", f"(b) Torrance, m = {(2 * n) ** -0.5:.2f}", "(c) Energy"
        for x, title in zip((0.165, 0.5, 0.862), titles):
            figure.text(x, 0.97, title, ha="center", va="top", fontsize=8.5, weight="bold")
        _albedos(figure.add_axes((0.755, 0.19, 0.215, 0.66)), named)
    return figure


def _lobes(axes: Axes, b: bc.Brdf, exponent: float | None) -> None:
    """f over its largest value, for each theta_i; with an exponent also what Phong's lobe sends below the surface."""
    axes.set(xlim=(-1.22, 1.38), ylim=(-0.62, 1.12))
    axes.set_aspect("equal")
    axes.set_axis_off()
    rim = np.radians(np.linspace(-90, 90, 181))
    axes.add_patch(Polygon([(-1.1, -0.6), (1.1, -0.6), (1.1, 0), (-1.1, 0)], closed=True, color="#EDEDED", zorder=0))
    axes.plot([-1.1, 1.1], [0, 0], color=style.INK, lw=0.9, zorder=2)
    for r in (0.5, 1.0):
        axes.plot(r * np.sin(rim), r * np.cos(rim), color=style.RING, lw=0.6, zorder=1)
    for deg, (colour, dashes) in zip(DRAWN_AT, LOOKS):
        t = float(np.radians(deg))
        axes.plot([0, np.sin(t)], [0, np.cos(t)], color=colour, lw=0.6, zorder=1)
        axes.text(1.1 * np.sin(t), 1.08 * np.cos(t), f"{deg}°", ha="left", va="center", fontsize=7.5, color=colour)
        axes.annotate(
            "", xy=(-1.0 * np.sin(t), 1.0 * np.cos(t)), xytext=(-1.17 * np.sin(t), 1.17 * np.cos(t)),
            arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1, "mutation_scale": 7, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        data = bc.plot.slice(b, t)
        theta, f = data.theta_o[0], data.values[0, :, 0]
        r = f / f.max()
        axes.plot(r * np.sin(theta), r * np.cos(theta), color=colour, ls=dashes, lw=1.4, zorder=3)
        if exponent is None:
            k = int(f.argmax())
            axes.plot(np.sin(theta[k]), np.cos(theta[k]), "o", color=colour, ms=4, zorder=4, clip_on=False)
        else:
            under = np.linspace(np.pi / 2, min(t + np.pi / 2, np.pi), 181)
            r = np.cos(under - t) ** exponent
            x, y = r * np.sin(under), r * np.cos(under)
            axes.fill([0, *x], [0, *y], color=colour, alpha=0.6, lw=0, zorder=2.5)
            axes.plot(x, y, color=colour, ls=dashes, lw=1.1, zorder=3)
    note = "filled: light into the surface" if exponent else "dots: the peak, beyond the\nmirror direction (thin lines)"
    axes.text(0.0, -0.55, note, ha="center", va="bottom", fontsize=7.5, color=style.INK)


def _quick_albedo(b: bc.Brdf, theta_i: float) -> float:
    """To a thousandth of a line's width: `Brdf.albedo` would spend a minute on a picture."""
    return float(integrate_hemisphere(lambda o, phi: b.evaluate(theta_i, o, phi), theta_i, bilateral=True)[0][0])


def _albedos(axes: Axes, named: dict[str, bc.Brdf]) -> None:
    """Albedo over that at normal incidence, as k_s of the published lobe is no reflectance."""
    theta = np.radians(np.concatenate([np.linspace(0, 76, 20), np.linspace(78, 89, 23)]))
    axes.axhline(1.0, color=style.FAINT, lw=0.6)
    where = {"Phong, published": (52, 2.3), "Phong, normalised": (3, 0.52), "Torrance": (10, 1.4)}
    for (name, (x, y)), (colour, dashes) in zip(where.items(), LOOKS):
        albedo = np.array([_quick_albedo(named[name], float(t)) for t in theta])
        axes.plot(np.degrees(theta), albedo / albedo[0], color=colour, ls=dashes, lw=1.4)
        axes.text(x, y, name.replace(", ", ",\n"), fontsize=7.5, color=colour, ha="left", va="center", linespacing=1.0)
    axes.set_yscale("log")
    axes.set(xlim=(0, 90), ylim=(0.07, 8), xticks=(0, 30, 60, 90), yticks=(0.1, 0.3, 1, 3))
    axes.set_xticklabels(["0°", "30°", "60°", "90°"])
    axes.set_yticklabels(["0.1", "0.3", "1", "3"])
    axes.minorticks_off()
    axes.tick_params(labelsize=7.5, length=2.5, pad=2)
    axes.set_xlabel("θᵢ", fontsize=8, labelpad=1)
    axes.set_ylabel("albedo / albedo at 0°", fontsize=8, labelpad=2)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, help="draw the picture into this PNG")
    output = parser.parse_args().output
    with warnings.catch_warnings():
        # the published lobe is here to be shown: that nobody should use it so is the point
        warnings.filterwarnings("ignore", message=".*reflects more light.*")
        if output:
            output.write_bytes(render(picture()))
        print(text())


if __name__ == "__main__":
    main()
