"""How well regridding predicts what was not measured: `python -m tests.benchmarks.holdout`.

A random 20 % of the geometries is left out, the rest is regridded, and the table is asked for what was left out. The
error of a geometry is sum |f' - f| / sum |f| over its channels; that of a value |f' - f| / f, of values above 0.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.parameters import resolve
from brdfcore.base.status import Status
from brdfcore.formats import astm
from brdfcore.formats.base.measurements import Measurements
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.formats.csv import format as csv_file
from tests.shared import FOLDER

#: What each file's header does not say.
PTFE = {
    "theta_i": "thetai",
    "phi_i": "phi",
    "theta_o": "thetar",
    "phi_o": "phir",
    "value": "f_r11",
    "wavelength": "lambda",
    "wavelength_unit": "um",
    "angles": "deg",
    "mirror": 180,
    "quantity": "f",
}
SOLAR_ARRAY = {
    "theta_i": "1",
    "phi_i": "2",
    "theta_o": "3",
    "phi_o": "4",
    "value": "5",
    "channels": "532nm",
    "angles": "deg",
    "mirror": 180,
    "quantity": "f",
}
FILES: dict[str, tuple[Path, dict[str, Any] | None]] = {
    "ptfe": (FOLDER / "data/ptfe/PTFE.data.csv", PTFE),
    "garnet_red": (FOLDER / "data/astm/garnet_red.astm", None),
    "cayman": (FOLDER / "data/astm/cayman.astm", None),
    "solar_array": (FOLDER / "data/inplane/solar_array_brdf.csv", SOLAR_ARRAY),
}


def measurements(path: Path, options: dict[str, Any] | None) -> Measurements:
    """The rows of a file: csv with options, else astm."""
    if options is None:
        return astm.measurements_of(path)
    return csv_file.measurements_of(path, resolve("csv", csv_file.CsvFormat.PARAMETERS, options))


def held_out(m: Measurements, share: float, seed: int, **policies: Any) -> dict[str, Any]:
    """Leave out `share` of the geometries, regrid the rest, predict them. Repeats of one geometry stay together."""
    groups = m.groups()
    count = int(groups.max()) + 1
    left = np.isin(groups, np.random.default_rng(seed).permutation(count)[: round(share * count)])
    table = to_brdf(m.select(~left), **policies)
    out = m.select(left)
    found = table.evaluate(out.theta_i, out.theta_o, out.delta_phi)
    size = np.abs(out.values).sum(axis=1)
    geometry = np.abs(found - out.values).sum(axis=1) / np.where(size > 0, size, np.nan)
    positive = out.values > 0
    value = np.abs(found - out.values)[positive] / out.values[positive]
    zero = out.values == 0
    codes = table.status(out.theta_i, out.theta_o, out.delta_phi)
    level = float(m.values[m.values > 0].mean()) if positive.any() else 1.0
    return {
        "geometries": int(left.sum()),
        "geometry": geometry[np.isfinite(geometry)],
        "value": value,
        "zero": found[zero],
        "zeros": float(zero.mean()),
        "floor": spectral_noise(m.values),
        "level": level,
        "interpolated": float((codes <= Status.INTERPOLATED).mean()),
        "interpolation": table.report["interpolation"],
        "table": table,
    }


def spectral_noise(values: npt.NDArray[np.float64]) -> float:
    """Median noise of a value relative to it, from third differences along the wavelength; nan with less than 6.

    A spectrum is smooth: the third difference of neighbouring bands is noise, of sqrt(20) standard deviations.
    """
    if values.shape[1] < 6:
        return float("nan")
    deviation = np.abs(np.diff(values, n=3, axis=1)) / np.sqrt(20) / 0.6745
    middle = values[:, 1:-2]
    return float(np.median(deviation[middle > 0] / middle[middle > 0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=0.2, help="of the geometries left out")
    parser.add_argument("--seeds", type=int, default=3, help="random choices of them")
    parser.add_argument("--files", nargs="*", default=list(FILES), choices=list(FILES))
    given = parser.parse_args()
    print(f"hold-out of {given.share:.0%} of the geometries, {given.seeds} seeds; relative errors, median (90 %)")
    print(f"{'file':12} {'seed':>4} {'left out':>8} {'a geometry':>17} {'a value > 0':>17} {'noise':>6}  zeros")
    for name in given.files:
        path, options = FILES[name]
        m = measurements(path, options)
        for seed in range(given.seeds):
            start = time.perf_counter()
            r = held_out(m, given.share, seed)
            g, v = r["geometry"], r["value"]
            zeros = f"{r['zeros']:.1%}"
            if r["zero"].size:
                zeros += f", predicted {np.median(r['zero']):.2g}/sr (90 %: {np.quantile(r['zero'], 0.9):.2g})"
            print(
                f"{name:12} {seed:4} {r['geometries']:8} {np.median(g):8.2%} ({np.quantile(g, 0.9):5.1%}) "
                f"{np.median(v):9.2%} ({np.quantile(v, 0.9):5.0%}) {r['floor']:6.1%}  {zeros}; "
                f"{time.perf_counter() - start:.1f} s"
            )
        how = r["interpolation"]
        print(
            f"             {how['kernel']}, smoothing {how['smoothing']:g} ({how['noise']} noise), "
            f"width {how['width']:g}"
        )


if __name__ == "__main__":
    main()
