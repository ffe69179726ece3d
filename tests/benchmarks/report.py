"""Which representation each of seven materials needs, as `brdf report` says: `python -m tests.benchmarks.report`.

Three formulas and, where ../shared is present, four measured files. --runs 3 repeats it and compares the order of the
fronts.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from brdfcore.cli.arguments import load
from brdfcore.reporting.markdown import measured_on, summary
from brdfcore.reporting.report import Report, Subject, report
from tests import shared

FORMULAS = ("oren_nayar:sigma=0.5", "cook_torrance:roughness=0.1,ior=gold", "cook_torrance:roughness=0.01,ior=gold")
FILES = ("aurora_white", "cardboard", "paper_white", "chm_light_blue")


def subjects() -> list[Subject]:
    found = [Subject(source, load(source), source) for source in FORMULAS]
    if shared.RGL.exists():
        for name in FILES:
            path = Path(shared.rgl_path(name))
            found.append(Subject(name, load(str(path)), path.name, path))
    return found


def fronts(made: Report) -> list[list[str]]:
    return [[e.label for e in item.found.front] for item in made.items]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=120.0, help="a material")
    given = parser.parse_args()
    made = report(subjects(), tolerance=0.01, seconds=given.seconds, peers=True)
    print("\n".join(summary(made)))
    print(f"\n{measured_on(made)}")
    first = fronts(made)
    for run in range(1, given.runs):
        again = fronts(report(subjects(), tolerance=0.01, seconds=given.seconds))
        for item, before, now in zip(made.items, first, again):
            kept = [label for label in before if label in now]
            order = kept == [label for label in now if label in before]
            print(
                f"run {run + 1}, {item.found.material}: order {'the same' if order else 'CHANGED'}, "
                f"{len(kept)} of {len(before)} kept, {len(now) - len(kept)} new"
            )


if __name__ == "__main__":
    main()
