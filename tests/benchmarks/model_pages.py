"""The documentation's page of models, from the registry: `python -m tests.benchmarks.model_pages [--pictures]`.

Claims are those of the default parameters; every option is tried by itself, and where one changes a claim the page
says so. `--pictures` also draws docs/pictures/model-NAME.png: f_r in the plane of incidence, nothing written on it.
"""

from __future__ import annotations

import argparse
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

import brdfcore as bc
from brdfcore.base.parameters import Parameter
from brdfcore.base.registry import MODELS
from brdfcore.plot import style
from brdfcore.plot.rendering import drawing, render

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
THETA_I = np.radians([0.0, 30.0, 60.0])
#: A logarithmic radius keeps lobes of 1 and of 100 in one picture, and shows the tails.
DECADES = 4
#: Inches and dots an inch: twice the 160 pixels that the page gives it.
SIZE, DPI = (1.6, 0.92), 200
LARGEST = 8_000


def text() -> str:
    """An overview, then a section a model, as Markdown."""
    heads = ["model", "what it is", "reciprocal", "conserves energy"]
    rows = [heads, ["---"] * len(heads), *(_overview(name, MODELS.load(name)) for name in MODELS.entries)]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
    return "\n\n".join([table, *(_section(name, MODELS.load(name)) for name in MODELS.entries)])


def _overview(name: str, model: Any) -> list[str]:
    claims = [_claim(name, model.PARAMETERS, c) for c in ("reciprocal", "energy_conserving")]
    return [f"[{name}](#{name})", model.SUMMARY.rstrip("."), *claims]


def _section(name: str, model: Any) -> str:
    picture = f"![Polar slices of {name} at 0, 30 and 60 degrees](pictures/{picture_of(name).name})"
    heads = ["parameter", "default", "range or choices"]
    rows = [heads, ["---"] * len(heads), *(_described(p) for p in model.PARAMETERS)]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
    formula = f"```text\n{model.FORMULA}\n```"
    return "\n\n".join([f"({name})=\n## {name}", model.SUMMARY, picture, formula, _linked(model.REFERENCE), table])


def _linked(reference: str) -> str:
    """With each DOI as a link."""
    return re.sub(r"doi:(\S+?)(?=[;,]?(?:\s|$))", r"[doi:\1](https://doi.org/\1)", reference)


def _described(p: Parameter) -> list[str]:
    """Name and symbol, default, and what else it may be."""
    name = f"`{p.name}`" + (f" ({p.symbol})" if p.symbol else "")
    if p.kind in ("choice", "flag"):
        choices = p.choices if p.kind == "choice" else ("true", "false")
        default = str(p.default) if p.kind == "choice" else str(p.default).lower()
        return [name, default, ", ".join(c for c in choices if c != default)]
    # an index has its own grammar, and no range: complex numbers and names are no numbers on a line
    where = "n, (n, k) or a name" if p.kind == "ior" else p.range_text() + (f" {p.unit}" if p.unit else "")
    return [name, "" if p.default is None else f"{p.default:g}", where]


def _claim(name: str, parameters: tuple[Parameter, ...], claim: str) -> str:
    """ "yes" or "no" at the defaults, and the values of single parameters that change it."""
    usual = bool(getattr(bc.model(name), claim))
    words = {True: "yes", False: "no"}
    changes = [text for p in parameters if (text := _changed(name, p, claim, usual))]
    return words[usual] + (f"; {words[not usual]} for {'; '.join(changes)}" if changes else "")


def _changed(name: str, p: Parameter, claim: str, usual: bool) -> str:
    if p.kind in ("choice", "flag"):
        values: tuple[Any, ...] = p.choices if p.kind == "choice" else (True, False)
        other = [str(v).lower() for v in values if _holds(name, claim, p, v) is (not usual)]
        return f"`{p.name}` {' or '.join(other)}" if other else ""
    if p.kind != "number" or p.default is None:
        return ""
    found = []
    for bound, sign in zip(p.bounds, "<>"):
        if np.isfinite(bound) and _holds(name, claim, p, bound) is (not usual):
            found.append(f"`{p.name}` {sign} {_edge(name, claim, p, bound, usual):.3g}")
    return " or ".join(found)


def _edge(name: str, claim: str, p: Parameter, changed: float, usual: bool) -> float:
    """Where the claim changes between the default of `p` and the value `changed`."""
    kept = float(p.default)
    for _ in range(50):
        middle = 0.5 * (kept + changed)
        kept, changed = (middle, changed) if _holds(name, claim, p, middle) is usual else (kept, middle)
    return kept


def _holds(name: str, claim: str, p: Parameter, value: Any) -> bool | None:
    """The claim with one parameter changed; None where that is no model by itself (no ior for a conductor)."""
    try:
        return bool(getattr(bc.model(name, **{p.name: value}), claim))
    except bc.InputError:
        return None


def picture_of(name: str) -> Path:
    return PICTURES / f"model-{name}.png"


def drawn(name: str) -> bytes:
    """The thumbnail of a model at its defaults: a PNG of few colours."""
    b = bc.model(name)
    data = bc.plot.slice(b, THETA_I)
    values = data.values[:, :, 0]
    radial = style.Radial.fit(values, "log", style.at_horizon(data.theta_o), DECADES)
    with drawing():
        figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(-1.06, 1.06), ylim=(-0.06, 2.12 * SIZE[1] / SIZE[0] - 0.06))
        axes.set_axis_off()
        rim = np.radians(np.linspace(-90, 90, 181))
        rings = [np.column_stack([r * np.sin(rim), r * np.cos(rim)]) for r in _rings(radial)]
        spokes = [np.array([(0.0, 0.0), (np.sin(t), np.cos(t))]) for t in np.radians([-60, -30, 0, 30, 60])]
        axes.add_collection(LineCollection([*rings[:-1], *spokes], colors=style.RING, linewidths=0.4))
        axes.plot([-1, *np.sin(rim), -1], [0, *np.cos(rim), 0], color=style.FAINT, lw=0.6)
        for k, (colour, dashes) in zip(range(THETA_I.size), style.line_looks()):
            r = np.nan_to_num(radial(values[k]))
            if b.has_delta:  # a direction without a height: a line to the rim
                axes.plot([0, np.sin(THETA_I[k])], [0, np.cos(THETA_I[k])], color=colour, ls=dashes, lw=1.3)
            elif r.any():
                axes.plot(r * np.sin(data.theta_o[k]), r * np.cos(data.theta_o[k]), color=colour, ls=dashes, lw=1.3)
    image = Image.open(io.BytesIO(render(figure))).convert("RGB").quantize(16, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    image.save(buffer, "png", optimize=True)
    return buffer.getvalue()


def _rings(radial: style.Radial) -> Iterator[float]:
    return ((t - radial.low) / (radial.high - radial.low) for t in radial.ticks if t > radial.low)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", action="store_true", help="also draw docs/pictures/model-NAME.png")
    if parser.parse_args().pictures:
        for name in MODELS.entries:
            picture_of(name).write_bytes(drawn(name))
    print(text())


if __name__ == "__main__":
    main()
