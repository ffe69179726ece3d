"""A report as one HTML page that loads nothing: style, script, numbers and pictures are inside."""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from brdfcore.analysis.pareto.entries import Entry
from brdfcore.analysis.pareto.pareto import Pareto
from brdfcore.models.base.model import Model
from brdfcore.plot.rendering import render
from brdfcore.reporting import figures, words
from brdfcore.reporting.item import Item

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHAPES = ("circle", "square", "triangle", "diamond", "down")
#: Albedo bias is quoted up to this theta_i, degrees; the table of all angles is in the JSON.
_BIAS_TO = 85.0
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"


def page(items: Sequence[Item], command: str) -> str:
    """The whole page."""
    sections = "\n".join(_section(k, item) for k, item in enumerate(items))
    style, script = (files("brdfcore.reporting").joinpath(f"page.{end}").read_text("utf-8") for end in ("css", "js"))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<title>{escape(_heading(items))}</title><style>
{style}</style></head><body>
<h1>{escape(_heading(items))}</h1>
{_contents(items)}
{sections}
{_method(items, command)}
<script>
{script}</script></body></html>
"""


def _heading(items: Sequence[Item]) -> str:
    count = len(items)
    return "Which representation to use" + (f" for {count} materials" if count > 1 else "")


def _contents(items: Sequence[Item]) -> str:
    """One line a material: the answer first."""
    if len(items) == 1:
        return ""
    rows = "".join(
        f'<tr><td><a href="#m{k}">{escape(i.found.material)}</a></td><td>{escape(words.advice(i.found))}</td></tr>'
        for k, i in enumerate(items)
    )
    return f'<table class="contents"><tbody>{rows}</tbody></table>'


def _section(k: int, item: Item) -> str:
    found, chosen = item.found, item.found.chosen
    several = "".join(f"<li>{escape(text)}</li>" for text in words.alternatives(found))
    shown = ""
    if item.shown is not chosen.brdf:
        text = f"The formula gives the reference itself, so the pictures show the table {item.shown_name}."
        shown = f"<p class='faint'>{escape(text)}</p>"
    numbers = (
        (
            words.percent(chosen.error),
            "of the reflected energy is misplaced, or missing, at the worst angle of incidence up to 85 degrees",
        ),
        (words.size(chosen.nbytes), "in memory"),
        (words.nanoseconds(chosen.ns.best), f"a look-up of many on one core; {_alone(chosen)} for a single one"),
    )
    boxes = "".join(f"<div><b>{escape(a)}</b><span>{escape(b)}</span></div>" for a, b in numbers)
    pictures = (
        (figures.spheres(item.look), f"lit spheres of the reference and of {item.shown_name}, and their difference"),
        (figures.slices(found.source, item.shown, item.shown_name), "slices in the plane of incidence"),
        (figures.errors(item.where), "error over half and difference angle"),
    )
    return f"""<section class="material" id="m{k}">
<h2>{escape(found.material)}</h2>
<p class="answer{"" if found.met else " no"}">{escape(words.advice(found))}</p>
<div class="numbers">{boxes}</div>
<ul>{several}</ul>
<pre>{escape(_code(item))}</pre>
{_checked(item)}
<h3>Error against cost</h3>
<div class="switch">across: <button data-key="nbytes" aria-pressed="true">memory</button>
<button data-key="ns" aria-pressed="false">time</button></div>
<div class="plot"></div>
<noscript><p>{_image(figures.front(found), "error against bytes")}</p></noscript>
<script type="application/json">{_data(found)}</script>
<h3>What it looks like</h3>
{shown}
<div class="pictures">{"".join(_image(figure, text) for figure, text in pictures)}</div>
<h3>Everything that was tried</h3>
{_table(found)}
{_left_out(found)}
</section>"""


def _code(item: Item) -> str:
    """How to have what was chosen."""
    chosen = item.found.chosen
    lines = ["import brdfcore as bc"]
    if isinstance(chosen.brdf, Model):
        defaults = {p.name: p.default for p in chosen.brdf.PARAMETERS}
        named = chosen.brdf.metadata["parameters"]
        given = {k: v for k, v in named.items() if k != "precision" and v != defaults.get(k)}
        listed = "".join(f", {k}={_literal(v)}" for k, v in given.items())
        precision = ', precision="fast"' if chosen.variant == "fast" else ""
        lines.append(f'b = bc.model("{chosen.representation}"{listed}{precision})')
    elif item.table_path is not None:
        lines.append(f"b = bc.open_table({str(item.table_path)!r})")
    else:
        source = f"bc.read({item.subject.source!r})"
        lines.append(f"b = bc.tabulate({source}, {chosen.representation!r}, max_bytes={chosen.nbytes})")
    lines.append("b.evaluate(theta_i, theta_o, delta_phi)  # radians; f_r in 1/sr, without the cosine")
    return "\n".join(lines)


def _alone(entry: Entry) -> str:
    return words.nanoseconds(entry.timings["1"].best)


def _literal(value: Any) -> str:
    if isinstance(value, dict) and set(value) == {"n", "k"}:
        return repr((value["n"], value["k"]))
    return json.dumps(value) if isinstance(value, str) else repr(value)


def _checked(item: Item) -> str:
    if item.table_path is None or item.verified is None:
        return ""
    text = "values that are not finite"
    if item.verified["error"] is not None:
        text = f"error {words.percent(item.verified['error'])} at the worst incidence"
    if item.verified["l1"] is not None:
        text += f", {words.percent(item.verified['l1'])} under light from everywhere"
    return (
        f"<p class='faint'>The table {escape(item.table_path.name)} was written, read again and measured on "
        f"{item.verified['directions']:,} directions that nothing was chosen by: {escape(text)}.</p>"
    )


def _data(found: Pareto) -> str:
    """What the script draws."""
    looks = {
        name: {"colour": figures.PALETTE[k % len(figures.PALETTE)], "shape": _SHAPES[k % len(_SHAPES)]}
        for name, k in figures.looks_of(found.entries).items()
    }
    looks |= {e.representation: {"colour": "#777", "shape": "cross"} for e in found.entries if e.kind == "peer"}
    keys = ("representation", "label", "kind", "nbytes", "error", "ns", "ns_median", "on_front")
    entries = []
    for k, entry in enumerate(found.entries):
        told = entry.to_json(found.tolerance)
        entries.append({
            **{key: told[key] for key in keys},
            "k": k, "words": words.figures(entry), "verdict": words.verdict(entry, found),
        })  # fmt: skip
    data = {
        "entries": entries, "looks": looks, "chosen": found.entries.index(found.chosen), "met": found.met,
        "tolerance": found.tolerance, "tolerance_text": words.percent(found.tolerance),
    }  # fmt: skip
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")


def _table(found: Pareto) -> str:
    threads = [label for label in found.chosen.timings if "x" in label]
    heads = [
        "representation", "", "worst incidence ± 1σ", "p99 off by", f"albedo bias to {_BIAS_TO:g}°", "memory",
        "ns a look-up <small>best – median</small>", "1 000 at a time", "1 at a time",
        *(f"{label.partition('x')[2]} cores" for label in threads), "build",
    ]  # fmt: skip
    head = f"<thead><tr>{''.join(f'<th>{h}</th>' for h in heads)}</tr></thead>"
    shown = [e.on_front or e.kind == "peer" or e.usual or e is found.chosen for e in found.entries]
    parts = []
    for wanted in (True, False):
        some = [_row(k, e, found, threads) for k, e in enumerate(found.entries) if shown[k] is wanted]
        table = f"<div class='wide'><table>{head}<tbody>{''.join(some)}</tbody></table></div>"
        text = f"<details><summary>Beaten by one of these, or too wrong to use ({len(some)})</summary>{table}</details>"
        parts.append((table if wanted else text) if some else "")
    return "".join(parts)


def _row(k: int, entry: Entry, found: Pareto, threads: list[str]) -> str:
    measured = entry.comparison
    spread = ""
    if measured.l1_stderr > words.NEXT_TO_NOTHING:
        spread = f" <small>± {words.percent(measured.l1_stderr)}</small>"
    right = ' class="right"' if entry.meets(found.tolerance) else ""
    p99 = measured.log_ratio["p99"]
    kind = "peer" if entry.kind == "peer" else "" if entry.on_front else "beaten"
    kind = "chosen" if entry is found.chosen else kind
    verdict = words.verdict(entry, found)
    times = [words.nanoseconds(entry.timings[b].best) if b in entry.timings else "" for b in ("1000", "1", *threads)]
    cells = [
        f"<td>{escape(entry.label)}</td>",
        f'<td title="{escape(verdict)}">{escape(verdict.partition(" by ")[0])}</td>',
        f"<td{right}>{words.percent(entry.error)}{spread}</td>",
        f"<td>{_factor(p99)}</td>",
        f"<td>{_bias(entry)}</td>",
        f"<td>{words.size(entry.nbytes)}</td>",
        f"<td>{entry.ns.best:.3g} <small>– {entry.ns.median:.3g}</small></td>",
        *(f"<td>{t}</td>" for t in times),
        f"<td>{f'{entry.build_seconds:.2g} s' if entry.build_seconds else ''}</td>",
    ]
    return f'<tr data-k="{k}" class="{kind}">{"".join(cells)}</tr>'


def _bias(entry: Entry) -> str:
    found = entry.comparison.albedo_bias
    near = [b for t, b in zip(found["theta_i"], found["bias"]) if np.degrees(t) <= _BIAS_TO + 1e-9 and b == b]
    if not near:
        return ""
    worst = max(near, key=abs)
    return ("+" if worst > 0 else "−" if worst < 0 else "") + words.percent(abs(worst))


def _factor(log: float) -> str:
    """exp of a log ratio as "3 %" or "a factor 4"."""
    if log != log:
        return ""
    if log < 0.7:
        return words.percent(float(np.expm1(log)))
    return f"a factor {np.exp(log):.3g}" if log < 20 else "a factor &gt; 10⁸"


def _image(figure: Figure, text: str) -> str:
    coded = base64.b64encode(render(figure, "png")).decode("ascii")
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{coded}">'


def _left_out(found: Pareto) -> str:
    listed = "".join(f"<li>{escape(text)}</li>" for text in found.left_out)
    return f"<details><summary>Left out ({len(found.left_out)})</summary><ul>{listed}</ul></details>" if listed else ""


def _method(items: Sequence[Item], command: str) -> str:
    first = items[0].found
    sources = [i.subject.source or i.subject.label for i in items]
    command = command or shlex.join(["brdf", "report", *sources, "-o", "report.html"])
    stated = ", ".join(f"{escape(k)} {escape(v)}" for k, v in first.versions.items())
    directions, seed = first.chosen.comparison.directions, first.chosen.comparison.seed
    return f"""<h2>How this was measured</h2>
<p><b>Worst incidence</b>: the share of the reflected energy that is in the wrong direction, ∫|f′−f| cosθₒ / ∫f cosθₒ,
or the error of the albedo if that is more, with light from the angle where it is largest: of 0 to 85 degrees, at 88 and
89 a quarter of it; below 5 degrees of means over the azimuth. Against the material as given, on random directions where
either has its energy, none a node of a table. ± is one standard error of the mean under light from everywhere, on
{directions:,} pairs (seed {seed}). <b>p99 off by</b>: 99 % of the values are within it.</p>
<p><b>Time</b>: float32 angles, a million look-ups in one call on one core, in processor time (others at work on the
machine do not count); all candidates in turn, round after round, so that drift hits all alike. The fastest round is
quoted, then the median. Differences below a quarter count as none.</p>
<p><b>Front</b>: what no other is no larger than, no less exact than, and not distinctly slower than.
<b>Chosen</b>: of what is within the tolerance the smallest that takes at most 1.25 times the time of the fastest table,
by times stored once; a formula where no table is four times faster.</p>
<p><b>Machine</b>: {escape(first.machine)}, {first.threads} threads. <b>Versions</b>: {stated}.</p>
<p><b>To reproduce</b>:</p><pre>{escape(command)}</pre>"""
