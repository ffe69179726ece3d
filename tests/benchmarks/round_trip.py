"""What files cost, for every pair of writable formats: `python -m tests.benchmarks.round_trip [FILE ...]`.

A row is the first format, a column the second; a cell is L1 of the source with what comes back after both, "-" where a
format can't hold the material. The column "alone" is the first format by itself. Without files: models, and the real
files beside the project where they are.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import brdfcore as bc
from brdfcore.base.registry import FORMATS
from brdfcore.formats.base.format import LossWarning
from tests.shared import FOLDER

_DIRECTIONS = 40_000
_REAL = ("rgl/paper_white_rgb.bsdf", "rgl/aurora_white_rgb.bsdf", "rgl/chm_light_blue_rgb.bsdf",
         "zemax/AnoBlackEC1onAlum.bsdf", "astm/garnet_red.astm", "ptfe/PTFE.data.csv")  # fmt: skip


def through(b: bc.Brdf, name: str, folder: Path) -> bc.Brdf | None:
    """`b` written in a format and read back; None if the format can't hold it."""
    path = folder / f"file{FORMATS.load(name).EXTENSIONS[0]}"
    try:
        bc.write(b, path, name)
    except bc.InputError:
        return None
    return bc.read(path, name)


def cell(source: bc.Brdf, b: bc.Brdf | None) -> str:
    if b is None:
        return "-"
    if source.channels != b.channels:
        return "channels"
    l1 = bc.compare(source, b, directions=_DIRECTIONS).l1
    return "0" if l1 == 0 else f"{l1:.2g}"


def sources(given: list[str]) -> dict[str, bc.Brdf]:
    found = {Path(name).name: bc.read(name) for name in given}
    if given:
        return found
    models = {
        "lambert": bc.model("lambert", reflectance=[0.7, 0.5, 0.3]),
        "ggx roughness 0.3": bc.model("ggx", roughness=0.3),
        "gold roughness 0.1, RGB": bc.model("cook_torrance", roughness=0.1, ior=["gold", "copper", "silver"]),
    }
    real = {}
    for name in _REAL:
        path = FOLDER / "data" / name
        try:
            real[path.name] = bc.read(path)
        except bc.BrdfError as error:  # a file that needs options, or that no registered format reads
            print(f"{path.name}: left out: {error.detail[:120]}\n")
    return models | real


def main() -> None:
    names = [n for n in FORMATS.names() if FORMATS.load(n)().writable]
    warnings.simplefilter("ignore", LossWarning)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for label, source in sources(sys.argv[1:]).items():
            print(f"\n{label}\n\n| first \\ second | alone | {' | '.join(names)} |\n|---|---|{'---|' * len(names)}")
            for first in names:
                once = through(source, first, folder)
                if once is None:
                    continue
                twice = [cell(source, through(once, second, folder)) for second in names]
                print(f"| {first} | {cell(source, once)} | {' | '.join(twice)} |", flush=True)


if __name__ == "__main__":
    main()
