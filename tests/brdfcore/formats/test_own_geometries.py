"""A look-up at a file's own geometries gives the file's own values, as an independent parser reads them; of rows that
repeat, their mean. Grids have this test beside their readers; these are the lists of measurements."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.status import Status
from tests.benchmarks.holdout import PTFE, SOLAR_ARRAY
from tests.shared import FOLDER, needs_shared
from tests.support import plain_csv, plain_lists
from tests.support.format_examples import bird_text, pbrt_text, tracepro_text
from tests.support.plain_alta import plain_alta

CASES, DATA = FOLDER / "cases", FOLDER / "data"
GIVEN: dict[str, Any] = {"angles": "deg", "mirror": 180, "quantity": "f"}
Rows = list[tuple[float, float, float, tuple[float, ...]]]


def check(b: Any, rows: Rows, *, noisy: float = 0.0) -> None:
    """Every geometry of `rows` once; `noisy`: the share of them whose repeats differ: their mean is no row's."""
    table = np.array([[i, o, d, *values] for i, o, d, values in rows])
    table[:, 2] = np.where((table[:, 0] < 1e-4) | (table[:, 1] < 1e-4), 0, table[:, 2])
    turn = table[:, 2] - 2 * np.pi * np.round(table[:, 2] / (2 * np.pi))
    turn = np.where(turn < -np.pi + 1e-9, np.pi, np.where(np.abs(turn) < 1e-12, 0, turn))
    table[:, 2] = np.abs(turn) if b.bilateral else turn
    _, first, group = np.unique(np.rint(table[:, :3] / 1e-4), axis=0, return_index=True, return_inverse=True)
    count = np.bincount(group.reshape(-1))
    means = np.stack([np.bincount(group.reshape(-1), v) / count for v in table[:, 3:].T], axis=1)
    angles = table[first, :3]
    assert (b.status(*angles.T) == Status.SMOOTHED).mean() <= noisy
    off = np.abs(b.evaluate(*angles.T) - means)
    allowed = 1e-11 * np.abs(means) + 1e-13 * np.abs(means).max()
    assert (off <= allowed).all(), (off / allowed).max()


def comma(columns: tuple[int, ...], factor: Callable[[Any], Any] = lambda row: 1.0) -> Callable[[Path], Rows]:
    """Rows of a file of numbers and commas in degrees: the columns of theta_i, theta_o, delta_phi, and all after."""

    def rows(path: Path) -> Rows:
        i, o, d, v = columns
        table = plain_csv.rows(path)
        values = table[:, v:] * np.array([factor(row) for row in table])[:, None]
        return [(*np.radians([r[i], r[o], r[d]]).tolist(), tuple(f)) for r, f in zip(table, values, strict=True)]

    return rows


def plane(factor: float = 1.0) -> Callable[[Path], Rows]:
    def rows(path: Path) -> Rows:
        found = plain_csv.in_project(plain_csv.rows(path))
        return [(*np.radians([i, o, d]).tolist(), tuple(np.array(v) * factor)) for i, o, d, v in found]

    return rows


def used(rows: Callable[[Path], Rows], keep: Callable[[Any], bool]) -> Callable[[Path], Rows]:
    return lambda path: [row for row in rows(path) if keep(row)]


def alta(path: Path) -> Rows:
    return [(i, o, d, (f,)) for i, o, d, f in plain_alta(path)]


def ptfe(path: Path) -> Rows:
    """Columns lambda, thetai, phii, thetar, phir, f: signed zenith angles."""
    found: dict[tuple[float, ...], dict[float, float]] = {}
    for wave, i, pi, o, po, f in plain_csv.rows(path)[:, :6].tolist():
        turn = np.radians(po - pi) + np.pi * ((i < 0) + (o < 0))
        found.setdefault((abs(np.radians(i)), abs(np.radians(o)), turn), {})[wave] = f
    return [(i, o, d, tuple(f[w] for w in sorted(f))) for (i, o, d), f in found.items()]


def solar(path: Path) -> Rows:
    lines = [line for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]
    rows = [[float(x) for x in line.split()] for line in lines]
    return [
        (abs(np.radians(i)), abs(np.radians(o)), np.radians(po - pi) + np.pi * ((i < 0) + (o < 0)), (f,))
        for i, pi, o, po, f in rows
    ]


PLAIN = comma((0, 1, 2, 3))
SMALL: dict[str, tuple[dict[str, Any], Callable[[Path], Rows]]] = {
    "named_columns.csv": (
        {"theta_i": "AOI", "theta_o": "Scatter", "delta_phi": "Azimuth", "value": "BRDF", **GIVEN}, PLAIN,
    ),
    "preamble.csv": (GIVEN, PLAIN),
    "quoted.csv": (GIVEN, PLAIN),
    "sentinel.csv": (GIVEN, used(PLAIN, lambda row: row[3][0] != -9999)),
    "percent.csv": (
        {**GIVEN, "value": "percent", "quantity": "pi_f", "unit": "percent"},
        comma((0, 1, 2, 3), lambda row: 0.01 / np.pi),
    ),
    "fcos_to_90.csv": (
        {"angles": "deg", "mirror": 180},
        used(comma((0, 1, 2, 3), lambda row: 1 / np.cos(np.radians(row[1]))), lambda row: row[1] < 1.5707),
    ),
    "grazing.csv": ({}, PLAIN),
    "retro.csv": ({}, PLAIN),
    "inplane_metal.csv": ({}, PLAIN),
    "inplane_signed.csv": ({"angles": "deg"}, plane()),
    "alta.dat": ({}, alta),
}  # fmt: skip
REAL: dict[str, tuple[dict[str, Any], Callable[[Path], Rows], float]] = {
    "inplane/scan_2d.csv": ({"angles": "deg", "quantity": "pi_f"}, plane(1 / np.pi), 0.0),
    "inplane/solar_array_brdf.csv": (SOLAR_ARRAY, solar, 0.0),
    "astm/cayman.astm": ({}, plain_lists.astm, 0.0),
    "astm/garnet_red.astm": ({}, plain_lists.astm, 0.0),
    "alta/retro-3M-jaune.dat": ({}, alta, 0.0),
    "ptfe/PTFE.data.csv": ({**PTFE, "smoothing": 0}, ptfe, 0.02),
}


@needs_shared
@pytest.mark.parametrize("name", SMALL)
def test_small_files(name: str) -> None:
    options, rows = SMALL[name]
    check(bc.read(CASES / name, **options), rows(CASES / name))


@needs_shared
@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_real_files(name: str) -> None:
    options, rows, noisy = REAL[name]
    check(bc.read(DATA / name, **options), rows(DATA / name), noisy=noisy)


MADE: dict[str, tuple[str, str, dict[str, Any], Callable[[Path], Rows]]] = {
    "pbrt": (pbrt_text(), "made.brdf", {}, plain_lists.pbrt),
    "bird 0": (bird_text(0), "made.json", {}, plain_lists.bird),
    "bird 1": (bird_text(1, radians=True), "made.brdf", {}, plain_lists.bird),
    "tracepro": (tracepro_text((0.55, 0.65)), "made.txt", {}, lambda path: plain_lists.tracepro(path, 1.0)),
    "tracepro normal": (
        tracepro_text(outwards=-1.0), "made.txt", {"zero": "normal"}, lambda path: plain_lists.tracepro(path, -1.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MADE)
def test_lists_of_other_programs(name: str, tmp_path: Path) -> None:
    text, file, options, rows = MADE[name]
    path = tmp_path / file
    path.write_text(text)
    check(bc.read(path, **options), rows(path))
