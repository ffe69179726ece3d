"""What the commands print: plain text that reads the same on a terminal and in a pipe, JSON, a progress bar."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from brdfcore.base.parameters import Parameter


def line(text: str = "", style: str | None = None) -> None:
    """One line to stdout as it is: no markup, no wrapping; bold and the like on a terminal only."""
    Console(highlight=False, markup=False, emoji=False, soft_wrap=True).print(text, style=style)


def warn(text: str) -> None:
    Console(stderr=True, highlight=False, markup=False, emoji=False, soft_wrap=True).print(
        f"warning: {text}", style="yellow"
    )


def as_json(value: Any) -> None:
    """`value` to stdout; floats with all their digits, what is not finite as null."""
    print(json.dumps(finite(value), indent=1, ensure_ascii=False, default=str))


def finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, complex):
        return {"n": value.real, "k": value.imag}
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return value


@contextmanager
def progress_bar() -> Iterator[Callable[[int, int, str], None] | None]:
    """A callback progress(done, total, stage) drawing a bar on stderr; None if stderr is no terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total, stage: bar.update(task, completed=done, total=max(total, 1), description=stage)


def bytes_text(count: int) -> str:
    for unit, size in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= size:
            return f"{count / size:.3g} {unit} ({count} bytes)"
    return f"{count} bytes"


#: Mappings of more plain facts than this take one line.
_LISTED = 6


def facts(values: Mapping[str, Any], indent: int = 0) -> None:
    """Nested facts, one a line; empty ones are left out."""
    pad = " " * indent
    for key, value in values.items():
        if _empty(value):
            continue
        if isinstance(value, Mapping) and len(value) > _LISTED and not any(map(_nested, value.values())):
            # a number a channel, say: one line, those that are all alike once
            alike = len({_fact(v) for v in value.values()}) == 1
            shown = f"{_fact(next(iter(value.values())))} each, {len(value)} in all" if alike else _pairs(value)
            line(f"{pad}{key:<{max(20 - indent, len(key) + 1)}} {shown}")
        elif isinstance(value, Mapping):
            line(f"{pad}{key}")
            facts(value, indent + 2)
        elif isinstance(value, (list, tuple)) and any(isinstance(x, str) and " " in x for x in value):
            line(f"{pad}{key}")
            for x in value:
                line(f"{pad}  - {x}")
        else:
            line(f"{pad}{key:<{max(20 - indent, len(key) + 1)}} {_fact(value)}")


def _nested(value: Any) -> bool:
    return isinstance(value, Mapping) or (isinstance(value, str) and len(value) > 40)


def _pairs(values: Mapping[str, Any]) -> str:
    """Names with their values; of two numbers a range, of whole numbers a shape."""

    def shown(value: Any) -> str:
        if not isinstance(value, (list, tuple)):
            return _fact(value)
        whole = all(isinstance(x, int) for x in value)
        return (" x " if whole else " to ").join(map(_fact, value))

    return "; ".join(f"{k}: {shown(v)}" for k, v in values.items())


def _empty(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(_empty(v) for v in value.values())
    return value is None or (isinstance(value, (str, list, tuple)) and not value)


def _fact(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        shown = [_fact(x) for x in value[:40]]
        return ", ".join(shown) + (f", ... ({len(value)} in all)" if len(value) > 40 else "")
    return str(value)


def parameter_lines(parameters: tuple[Parameter, ...]) -> Iterator[str]:
    """One line a parameter: name, symbol, default, range, meaning, in columns."""
    rows = [
        (
            p.name + (f" (or {', '.join(p.aliases)})" if p.aliases else ""),
            p.symbol,
            "not given" if p.default is None else f"{p.default:g}" if isinstance(p.default, float) else str(p.default),
            "" if p.kind == "choice" else _range(p),
            f"{p.meaning}: {' | '.join(p.choices)}" if p.kind == "choice" else p.meaning,
        )
        for p in parameters
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(4)] if rows else []
    for row in rows:
        yield "  ".join([*(cell.ljust(w) for cell, w in zip(row, widths)), row[4]])


def _range(p: Parameter) -> str:
    if p.kind == "ior":
        return "number, (n,k), name or [list]"
    if p.kind in ("flag", "text"):
        return "true or false" if p.kind == "flag" else "text"
    return p.range_text() + (f" {p.unit}" if p.unit else "")


def error_lines(error: Mapping[str, Any], has_delta: bool = False) -> Iterator[str]:
    """A table's measured error in plain words; that of the mirror part if it has one, or if it is not 0."""
    if not error:
        yield "measured error: none recorded; only tabulate measures it, against what it tabulates"
        return
    yield f"error, measured on {error.get('directions') or 0:,} random directions (seed {error.get('seed')}):"
    l1 = error.get("l1")
    if l1 is None and error.get("regular", bool(error.get("nan"))):
        yield "  L1               can't be told: values are not finite"
    elif l1 is None:
        yield "  L1               has no meaning: the source has no regular part"
    else:
        yield (
            f"  L1               {percent(l1)} ± {percent(error.get('l1_stderr') or 0.0)}"
            " of the reflected energy is misplaced"
        )
    yield from incidence_lines(error.get("by_theta_i") or [])
    delta = error.get("delta")
    if has_delta or delta:
        off = "not finite" if delta is None else f"{delta:.2g} of the light at its worst angle"
        yield f"  mirror part      {off}: the error of its reflectance"
    bias = error.get("albedo_bias") or {}
    pairs = [(t, x) for t, x in zip(bias.get("theta_i", []), bias.get("bias", [])) if t is not None and x is not None]
    if pairs:
        theta, worst = max(pairs, key=lambda pair: abs(pair[1]))
        where = f"theta_i = {math.degrees(theta):.4g} degrees"
        yield f"  albedo bias      {percent(worst, signed=True)} at its worst angle, {where}"
    ratio = error.get("log_ratio") or {}
    if ratio.get("p99") is not None:
        yield (
            f"  p99 log ratio    {ratio['p99']:.3g}: 99 % of the values are within a factor {_factor(ratio['p99'])}"
            + (f"; the worst is off by a factor {_factor(ratio['max'])}" if ratio.get("max") is not None else "")
        )
    for key, words in (("negatives", "values are negative"), ("nan", "values are not numbers")):
        if error.get(key):
            yield f"  {error[key]} of {error.get('values', '?')} {words}"


def incidence_lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Error by angle of incidence: theta_i, L1 and the largest error of an albedo, side by side."""
    finite = [r for r in rows if r.get("l1") is not None and r.get("albedo_error") is not None]
    if not finite:
        return
    table = [("theta_i", *(f"{math.degrees(r['theta_i']):.3g}" for r in finite))]
    table += [("L1", *(percent(r["l1"]).removesuffix(" %") for r in finite))]
    table += [("albedo off by", *(percent(r["albedo_error"]).removesuffix(" %") for r in finite))]
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
    for name, row in zip(("by incidence", "", ""), table):
        cells = [row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:]))]
        yield f"  {name:<16} {' '.join(cells)}{' degrees' if row[0] == 'theta_i' else ' %'}"


def percent(share: float, signed: bool = False) -> str:
    text = (
        f"{100 * share:{'+' if signed else ''}.2g}" if abs(share) < 0.1 else f"{100 * share:{'+' if signed else ''}.0f}"
    )
    return f"{text} %"


def _factor(log: float) -> str:
    return f"{math.exp(log):.4g}" if log < 300 else "> 1e130"
