"""A report as Markdown: one sentence and one table a material."""

from __future__ import annotations

from collections.abc import Sequence

from brdfcore.analysis.pareto.entries import Entry
from brdfcore.analysis.pareto.pareto import Pareto
from brdfcore.reporting import words
from brdfcore.reporting.item import Item

HEAD = ("representation", "worst incidence", "bytes", "ns a look-up", "1 at a time", "build", "")


def markdown(items: Sequence[Item], command: str) -> str:
    """The whole report."""
    parts = ["\n".join(summary(items))] if len(items) > 1 else []
    for item in items:
        found = item.found
        lines = [f"### {_cell(found.material)}", "", f"**{_cell(words.advice(found))}**", ""]
        lines += [f"- {_cell(text)}" for text in words.alternatives(found)]
        if item.verified is not None and item.verified["error"] is not None:
            again = words.percent(item.verified["error"])
            lines.append(f"- The table, read again and measured on other directions: {again} at the worst incidence.")
        if item.look.mean is not None:
            name = _cell(item.shown_name)
            lines.append(f"- Lit sphere, {name} against the reference: mean FLIP {item.look.mean:.2g}.")
        lines += ["", *table(found), ""]
        lines += [f"- left out: {_cell(text)}" for text in found.left_out]
        parts.append("\n".join(lines).rstrip())
    parts.append(measured_on(items, command))
    return "\n\n".join(parts) + "\n"


def summary(items: Sequence[Item]) -> list[str]:
    """Lines of one table for all materials: what to use, and beside it the best table and the usual practice."""
    head = ("material", "use", "worst incidence", "bytes", "ns a look-up", "best table", "usual practice")
    lines = ["| " + " | ".join(head) + " |", "|---|---|---:|---:|---:|---|---|"]
    for item in items:
        found, chosen = item.found, item.found.chosen
        usual = next((e for e in found.entries if e.usual), None)
        best = found.table if found.table is not chosen else None
        cells = [
            _cell(found.material),
            _cell(chosen.label) + ("" if found.met else " (not right enough)"),
            words.percent(chosen.error),
            words.size(chosen.nbytes),
            f"{chosen.ns.best:.2g}",
            "the same" if best is None else _cell(f"{best.label}: {words.figures(best)}"),
            "" if usual is None else words.figures(usual),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def measured_on(items: Sequence[Item], command: str) -> str:
    """What the numbers mean and where they come from, in a sentence."""
    first = items[0].found
    stated = ", ".join(f"{k} {v}" for k, v in first.versions.items())
    return (
        "ns: a million float32 look-ups in one call, processor time of one thread, the fastest of the rounds; "
        f"{first.machine}; {stated}." + (f" Made by `{command}`." if command else "")
    )


def table(found: Pareto) -> list[str]:
    """The entries as lines of a Markdown table."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---|" + "---:|" * 5 + "---|"]
    return lines + ["| " + " | ".join(row(e, found)) + " |" for e in found.entries]


def row(entry: Entry, found: Pareto) -> list[str]:
    """Cells of one entry, in the order of `HEAD`."""
    name = _cell(entry.label)
    spread = words.percent(entry.comparison.l1_stderr) if entry.comparison.l1_stderr > 0 else ""
    text = words.percent(entry.error) + (f" ± {spread}" if spread and entry.error > words.NEXT_TO_NOTHING else "")
    return [
        f"**{name}**" if entry is found.chosen else name,
        text,
        words.size(entry.nbytes),
        words.nanoseconds(entry.ns.best),
        words.nanoseconds(entry.timings["1"].best),
        f"{entry.build_seconds:.2g} s" if entry.kind == "table" and entry.build_seconds else "",
        _cell(words.verdict(entry, found)),
    ]


def _cell(text: str) -> str:
    """Text that Markdown shows as it is."""
    for mark in "\\`*_[]<>|":
        text = text.replace(mark, "\\" + mark)
    return text.replace("\n", " ")
