"""The README's table of results, read out of docs/: `python -m tests.benchmarks.headline [--pictures]`.

Every figure stands in a generated part of a page; where one is missing, `ValueError` says what was looked for. With
`--pictures` docs/pictures/example.png and paint.png are drawn too.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterator

import numpy as np

import brdfcore as bc
from tests.benchmarks.pages import ROOT, held

Row = tuple[str, str, str]


def text() -> str:
    """The table as Markdown."""
    tables, report = held("docs/accuracy.md", "tables"), held("docs/accuracy.md", "report")
    lookup, service = held("docs/speed.md", "lookup"), held("docs/speed.md", "service")
    machines = {_found(part, r"^([^\n]*?, [0-9]+ cores)") for part in (tables, lookup, service)}
    heads = [(f"measured on {' and '.join(sorted(machines))}", "here", "beside it"), ("---", "---", "---")]
    rows = [*heads, *_accuracy(tables, report), *_look_ups(tables, lookup), *_service(service)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def _accuracy(tables: str, report: str) -> Iterator[Row]:
    worst, median = (100 * float(_found(tables, rf"{word} ([\d.]+)")) for word in ("worst", "median"))
    files = "ten measured RGL files within 768 kB, against Mitsuba 3's own values: L1"
    yield files, f"worst {worst:.2g} %, median {median:.2g} %", ""
    gold = re.findall(r"^(?:ggx|beckmann), roughness \S+ +\d+ +([\d.]+)", tables, re.MULTILINE)
    yield (
        f"gold of {len(gold)} lobes, roughness 1 to 0.003, within 256 kB: L1",
        f"at most {100 * max(map(float, gold)):.2g} %",
        "",
    )
    row = next(line for line in report.splitlines() if line.startswith("| chm"))
    _, _, _, error, size, _, _, usual, _ = (cell.strip() for cell in row.split("|"))
    usual = usual.rpartition(",")[0].removeprefix("error ")
    yield "the measured chm_light_blue within 1 %", f"{error}, {size}", f"MERL's layout, nearest node: {usual}"


def _look_ups(tables: str, lookup: str) -> Iterator[Row]:
    rgb = {
        n: _found(tables, rf"^{n} +([\d.]+) million/s") for n in ("half_difference rgb 768 kB", "Mitsuba measured rgb")
    }
    ours, mitsuba = (f"{float(rate):.0f}" for rate in rgb.values())
    yield "RGB look-ups of a measured material, million/s, 2 threads", ours, f"Mitsuba 3 `measured` {mitsuba}"
    grid = lookup[lookup.index("0.26 MB") :]
    rates = {
        n: f"{float(_found(grid, rf'^{n} +([0-9.]+)')):.0f}" for n in ("angle_grid", "plain C", "interpn", "scipy")
    }
    ours, others = rates.pop("angle_grid"), ", ".join(f"{name} {rate}" for name, rate in rates.items())
    yield "look-ups of one channel in a plain grid of 0.26 MB, million/s", ours, others


def _service(service: str) -> Iterator[Row]:
    def number(what: str, who: str) -> float:
        return float(_found(service, rf"^{what}: {who} +([\d.]+) "))

    # names of the run before, too: the part is measured anew on an idle machine only
    gets = {"one value": "GET of one value, concurrency 16|GET evaluate, concurrency 16"}
    if "GET of 30 values" in service:
        gets["30 values"] = "GET of 30 values, concurrency 16"
    for what, label in gets.items():
        ours, fastapi, bare = (number(f"(?:{label})", who) for who in ("service", "stock FastAPI", "bare ASGI"))
        others = f"stock FastAPI {fastapi:,.0f}, bare ASGI {bare:,.0f}"
        yield f"GET of {what}, requests/s, one process", f"{ours:,.0f}", others
    post, many = "POST of 1000 points as JSON", "1000000 look-ups, f4"
    others = f"stock FastAPI {number(post, '(?:stock FastAPI|pydantic lists)'):,.0f}"
    yield "POST of 1,000 points as JSON, requests/s", f"{number(post, 'service'):,.0f}", others
    others = f"bare ASGI that echoes as much {number(many, 'bare ASGI'):.3g} ms"
    yield "POST of 1,000,000 points as float32", f"{number(many, 'service'):.3g} ms", others


def _found(part: str, pattern: str) -> str:
    found = re.search(pattern, part, re.MULTILINE)
    if found is None:
        raise ValueError(f"no {pattern!r} in a generated part that begins {part[:60]!r}")
    return found[1]


def draw() -> None:
    """The pictures of the README and of the first page of the documentation."""
    pictures = ROOT / "docs" / "pictures"
    gold = bc.model("cook_torrance", roughness=0.2, ior="gold")
    figure = bc.plot.polar(gold, np.radians([0.0, 30.0, 60.0]), title="gold, roughness 0.2")
    (pictures / "example.png").write_bytes(bc.plot.render(figure, "png"))
    with tempfile.TemporaryDirectory() as folder:
        named = {path.name: bc.read(path) for path in bc.example_files(folder)}
    figure = bc.plot.polar(named, np.radians(45.0), scale="log", title="a scan, another scan, and the truth")
    (pictures / "paint.png").write_bytes(bc.plot.render(figure, "png"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", action="store_true", help="also draw the pictures")
    if parser.parse_args().pictures:
        draw()
    print(text())


if __name__ == "__main__":
    main()
