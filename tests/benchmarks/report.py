"""Which representation each of seven materials needs, as `brdf report` says: `python -m tests.benchmarks.report`.

Three formulas and, where ../shared is present, four measured files; each is printed when it is done, with what it
took. --runs 3 repeats it and says what of the fronts another run measures otherwise. --table prints the lines of the
documentation's table alone, the rest goes to stderr.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from brdfcore.analysis.pareto.entries import Entry
from brdfcore.analysis.pareto.pareto import Pareto
from brdfcore.cli.arguments import load
from brdfcore.reporting import words
from brdfcore.reporting.item import Subject
from brdfcore.reporting.markdown import measured_on, summary
from brdfcore.reporting.report import Report, report
from tests import shared

FORMULAS = ("oren_nayar:sigma=0.5", "cook_torrance:roughness=0.1,ior=gold", "cook_torrance:roughness=0.01,ior=gold")
FILES = ("aurora_white", "cardboard", "paper_white", "chm_light_blue")
#: A line of progress at most this often, seconds.
_EVERY = 5.0


def subjects() -> list[Subject]:
    found = [Subject(source, load(source), source) for source in FORMULAS]
    if shared.RGL.exists():
        for name in FILES:
            path = Path(shared.rgl_path(name))
            found.append(Subject(name, load(str(path)), path.name, path))
    return found


class Progress:
    """A line on stderr every few seconds."""

    def __init__(self, head: str) -> None:
        self.head, self.start = head, time.perf_counter()
        self.said = self.start

    def __call__(self, done: int, total: int, stage: str) -> None:
        now = time.perf_counter()
        if now - self.said >= _EVERY:
            self.said = now
            print(f"{now - self.start:5.0f} s  {self.head}: {stage}", file=sys.stderr, flush=True)


def made(seconds: float, *, peers: bool, only: list[str]) -> Iterator[tuple[Report, float]]:
    """A report of each material alone, and the seconds it took."""
    chosen = [s for s in subjects() if not only or any(text in s.label for text in only)]
    for subject in chosen:
        start = time.perf_counter()
        one = report([subject], tolerance=0.01, seconds=seconds, peers=peers, progress=Progress(subject.label))
        yield one, time.perf_counter() - start


def front(found: Pareto) -> list[str]:
    return [e.label for e in found.front]


def differences(first: Pareto, again: Pareto) -> list[str]:
    """What of the front another run measured otherwise, and what was nearly a tie."""
    before, now = front(first), front(again)
    kept = [label for label in before if label in now]
    order = kept == [label for label in now if label in before]
    use = "the same" if first.chosen.label == again.chosen.label else f"CHANGED to {again.chosen.label}"
    if first.chosen.label != again.chosen.label:
        rivals = [e.label for e in first.rivals] + [e.label for e in again.rivals]
        said = {first.chosen.label, again.chosen.label} & set(rivals)
        use += ", said to be as good" if said else ", NOT said to be as good"
    lines = [f"order {'the same' if order else 'CHANGED'}, {len(kept)} of {len(before)} kept, chosen {use}"]
    for label in [*(x for x in before if x not in now), *(x for x in now if x not in before)]:
        was, here = (next((e for e in run.entries if e.label == label), None) for run in (first, again))
        lines.append(
            f"    {'left' if here is None or not here.on_front else 'came'}: {label}: {_why(was, here, first, again)}"
        )
    return lines


def _why(was: Entry | None, here: Entry | None, first: Pareto, again: Pareto) -> str:
    if was is None or here is None:
        return "built in one of the runs only"
    rival = was.dominated_by or here.dominated_by or ""
    ratios = []
    for run, entry in ((first, was), (again, here)):
        other = next((e for e in run.entries if e.label == rival), None)
        ratios.append("?" if other is None else f"{other.ns.best / entry.ns.best:.2f}")
    told = was.near_tie or here.near_tie
    return f"{' and '.join(ratios)} x as fast as {rival}" + (
        ", said to be a near tie" if told else ", NOT said to be one"
    )


def repeats(runs: list[list[Pareto]]) -> str:
    """By what factor the time of one candidate differs between runs."""
    ratios = []
    for each in zip(*runs):
        for entry in each[0].entries:
            times = [e.ns.best for run in each for e in run.entries if e.label == entry.label]
            ratios.append(max(times) / min(times))
    ratios.sort()
    quoted = ", ".join(f"{100 * q:g} %: {ratios[int(q * (len(ratios) - 1))]:.3f}" for q in (0.5, 0.9, 0.99, 1.0))
    return f"slowest run / fastest run of one candidate ({len(ratios)} candidates): {quoted}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=120.0, help="a material, about")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help="materials whose name has this")
    given = parser.parse_args()
    listener = sys.stderr if given.table else sys.stdout
    items, runs = [], []
    begun = time.perf_counter()
    for run in range(given.runs):
        runs.append([])
        for k, (one, seconds) in enumerate(made(given.seconds, peers=run == 0, only=given.only)):
            found = one.items[0].found
            runs[-1].append(found)
            if run == 0:
                items += one.items
                print(
                    f"{found.material}: {words.advice(found)} {seconds:.0f} s, {len(found.entries)} entries",
                    file=listener,
                )
                for e in found.front:
                    tie = f"  (near tie with {e.near_tie})" if e.near_tie else ""
                    print(f"    {e.label:52} {words.figures(e)}{tie}", file=listener)
            else:
                head, *rest = differences(runs[0][k], found)
                print("\n".join([f"run {run + 1}, {found.material}: {head}, {seconds:.0f} s", *rest]), file=listener)
            listener.flush()
    print(f"{time.perf_counter() - begun:.0f} s in all", file=listener)
    whole = Report(items, "" if given.table else "python -m tests.benchmarks.report")
    print("\n".join([*summary(whole.items), "", measured_on(whole.items, whole.command)]))
    if given.runs > 1:
        print(repeats(runs), file=listener)


if __name__ == "__main__":
    main()
